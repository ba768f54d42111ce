"""The stage merge: both sides' brackets to one relative picture each, with the camera's response and times."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

from processing.errors import BracketError, ProcessingError, ResponseError
from processing.stages.brackets import SideBracket, merge_geometry, side_bracket
from processing.stages.camera_response import CameraResponse, camera_response
from processing.stages.contract import StageContext, StageOutput, StageWarning
from processing.stages.parameters import MergeParameters
from station.session.session import Side, shutter_label

if TYPE_CHECKING:
    from processing.calibration.merge.merge import Merged
    from processing.calibration.profile import RigProfile

_STEPS = 2 * 2
"""Response and merge of two sides: for the progress."""


@dataclass
class _Gathered:
    """What the sides have given so far."""

    artifacts: dict[str, object] = field(default_factory=dict)
    response: dict[str, Any] = field(default_factory=dict)
    metrics: dict[str, Any] = field(default_factory=dict)
    warnings: list[StageWarning] = field(default_factory=list)
    left_out: dict[str, str] = field(default_factory=dict)

    def refuse(self, side: Side, error: ProcessingError) -> None:
        """Leave out a side that cannot be merged; the other one stands."""
        text = f"{error.message} ({error.advice})"
        self.left_out[side.value] = text[:500]
        self.warnings.append(StageWarning(code=f"{side}-refused", message=f"{side}: {text}"[:500]))


def nothing_to_merge(context: StageContext) -> str | None:
    """Return why there is nothing to merge: one panorama was given."""
    return None if context.session.panorama is None else "one picture was given, no bracket"


def run(context: StageContext) -> StageOutput:
    """Merge what the session has.

    An outdoor bracket that cannot be merged is left out with the reason and a warning where the indoor one could: it
    often shows too little of its camera's curve, and then needs the rig's profile. Raises `BracketError` where there
    are no frames at all or they do not fit together, `ResponseError` where no response curve can be recovered,
    `ProfileError` for a calibration that cannot be read.
    """
    parameters = context.parameters_of(MergeParameters)
    profile = _profile(context)
    gathered = _Gathered()
    for number, side in enumerate(Side):
        if parameters.side not in ("both", side.value):
            gathered.left_out[side.value] = f"only {parameters.side} was asked for"
            continue
        bracket = side_bracket(context.session, context.session_path, side)
        if bracket is None:
            gathered.left_out[side.value] = f"the session has no {side} frames"
            continue
        try:
            _merge_side(context, bracket, profile, gathered, 2 * number)
        except (ResponseError, BracketError) as error:
            if not gathered.artifacts:
                raise
            gathered.refuse(side, error)
    if not gathered.artifacts:
        raise BracketError(
            f"there is nothing to merge: {'; '.join(gathered.left_out.values())}",
            where=context.session_path.name,
            advice="capture or import a bracket",
        )
    return StageOutput(
        artifacts={**gathered.artifacts, "response": gathered.response},
        metrics=gathered.metrics,
        warnings=tuple(gathered.warnings),
        left_out=gathered.left_out,
        honoured=_honoured(context, gathered),
    )


def _profile(context: StageContext) -> RigProfile | None:
    parameters = context.parameters_of(MergeParameters)
    if parameters.calibration is None:
        return None
    from processing.calibration.profile import load_profile

    return load_profile(parameters.calibration)


def _merge_side(
    context: StageContext,
    bracket: SideBracket,
    profile: RigProfile | None,
    gathered: _Gathered,
    step: int,
) -> None:
    from processing.calibration.merge.merge import MergeOptions, merge

    side = bracket.side.value
    context.progress((step + 0.1) / _STEPS, f"{side}: response curve")
    response, frames = camera_response(bracket, profile)
    context.progress((step + 1) / _STEPS, f"{side}: merging")
    merged = merge(
        frames,
        response.times_s,
        response.curve,
        response.noise,
        geometry=merge_geometry(bracket, context.session.rig),
        options=MergeOptions(
            quality=context.quality.value, max_error=context.max_error, own_curve=response.source == "recovered"
        ),
        time_sigma=response.time_sigma,
        given_s=bracket.nominal_s,
    )
    context.progress((step + 2) / _STEPS, f"{side}: merged")
    _gather(context, bracket, response, merged, gathered)


def _gather(
    context: StageContext, bracket: SideBracket, response: CameraResponse, merged: Merged, gathered: _Gathered
) -> None:
    from dataclasses import replace

    side, report = bracket.side.value, merged.report
    attributes = {**merged.image.attributes, "side": side, "session_id": context.session.session_id}
    gathered.artifacts[side] = replace(merged.image, attributes=attributes)
    gathered.response[side] = response.to_dict(bracket)
    gathered.metrics[side] = _metrics(response, merged)
    gathered.warnings += response.warnings
    gathered.warnings += (StageWarning(code="merge", message=f"{side}: {text}"[:500]) for text in report.warnings)
    for use in report.frames:
        if use.used_share == 0:
            label = shutter_label(bracket.records[use.number].camera_s)
            gathered.left_out[f"{side} {label}"] = use.reason or "adds nothing"


def _metrics(response: CameraResponse, merged: Merged) -> dict[str, Any]:
    report = merged.report
    return {
        "response_source": response.source,
        "times_source": response.times_source,
        "response_residual_stops": response.curve.residual_stops,
        **({"drift_stops": response.check["drift_stops"]} if response.check else {}),
        "clipped_share": report.shares.clipped,
        "dark_share": report.shares.dark,
        "ghost_share": report.shares.ghost,
        "frames": [{"file": use.name, "time_s": use.time_s, "used_share": use.used_share} for use in report.frames],
        "offset_stops": [round(float(offset), 6) for offset in report.offset_stops],
    }


def _honoured(context: StageContext, gathered: _Gathered) -> dict[str, str]:
    """Say what quality and max_error came to."""
    frames: Sequence[dict[str, Any]] = [f for side in gathered.metrics.values() for f in side["frames"]]
    spared = sum(1 - frame["used_share"] for frame in frames)
    what = f"{spared:.1f} of {len(frames)} frames' samples left out"
    honoured = {"quality": f"{context.quality.value}: {what}"}
    if context.max_error is not None:
        honoured["max_error"] = f"each pixel's uncertainty may grow by {100 * context.max_error:g} %: {what}"
    return honoured

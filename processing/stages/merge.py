"""The stage merge: both sides' brackets to one relative picture each, with the camera's response and times."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from processing.calibration.merge.lens_pair import LensPair, stitched
from processing.calibration.merge.lens_places import clearest, place_lenses
from processing.calibration.merge.merge import Merged, MergeOptions, merge
from processing.calibration.merge.motion import check_view
from processing.calibration.merge.tables import linear_curve
from processing.calibration.profile import CameraProfile, RigProfile, load_profile, profile_matches
from processing.calibration.profile_records import NoiseRecord, ResponseRecord, ShutterRecord
from processing.calibration.response.curve import NoiseModel, ResponseCurve
from processing.calibration.response.linear import fit_linear
from processing.calibration.response.response import check_response, estimate_noise, recover_response, residuals_by_code
from processing.calibration.response.samples import Bracket8, take_samples
from processing.calibration.response.shutter import ShutterRule, camera_rule, true_time_s
from processing.errors import BracketError, PictureFileError, ProcessingError, ResponseError
from processing.ground.arrays import Bytes
from processing.ground.threads import side_by_side
from processing.pictures.frames import FrameSource, array_frame
from processing.pictures.images import Validity
from processing.pictures.modes import multiplied
from processing.pictures.mosaic import FULL, PEDESTAL
from processing.sphere import Equirectangular, Geometry
from processing.stages import brackets
from processing.stages.contract import StageContext, StageOutput, StageWarning
from processing.stages.parameters import MergeParameters
from station.session.session import Side, shutter_label

_ONLY_JPEGS = "the rig profile holds for this camera's JPEGs only (daylit rig calibrate with raw files of chart, flat)"
_STEPS, Z95 = 2 * 2, 1.96  # response and merge of two sides, for the progress; 95 % of a normal distribution


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
    return None if context.session.panorama is None else "a single picture, no bracket"


def run(context: StageContext) -> StageOutput:
    """Merge what the session has.

    An outdoor bracket that cannot be merged is left out with the reason and a warning where the indoor one could: it
    often shows too little of its camera's curve, and then needs the rig's profile. Raises `BracketError` where there
    are no frames at all or they do not fit together, `ResponseError` where no response curve can be recovered,
    `ProfileError` for a calibration that cannot be read.
    """
    parameters = context.parameters_of(MergeParameters)
    profile = None if parameters.calibration is None else load_profile(parameters.calibration)
    asked: dict[Side, brackets.FramesAsked] = dict.fromkeys(Side, parameters.frames)
    why = _ONLY_JPEGS
    if profile and profile.raw and parameters.frames == "auto":
        try:
            return _merged(context, profile.raw, profile.raw.frames, why)
        except (PictureFileError, ResponseError, BracketError) as error:
            # JPEGs of both cameras then: the profile knows no pair of one's raw files and the other's JPEGs but that.
            why = f"the kind of frames that the rig profile covers is missing: {error}"
    if profile and parameters.frames == "auto":
        asked |= {side: "jpeg" for side, camera in profile.cameras.items() if camera.response}
    return _merged(context, profile, asked, why)


def _merged(
    context: StageContext, profile: RigProfile | None, frames: Mapping[Side, brackets.FramesAsked], why_jpegs: str
) -> StageOutput:
    """Merge each side from its frames; ``why_jpegs``: of raw files that a profile passes over."""
    parameters, gathered = context.parameters_of(MergeParameters), _Gathered()
    raws = {frame.side for frame in context.session.frames if frame.is_raw}
    for number, side in enumerate(Side):
        if parameters.side not in ("both", side.value):
            gathered.left_out[side.value] = f"only {parameters.side} was asked for"
            continue
        asked = frames.get(side, "auto")
        bracket = brackets.side_bracket(context.session, context.session_path, side, asked)
        if bracket is None:
            gathered.left_out[side.value] = f"the session has no {side} frames"
            continue
        if side in raws and not bracket.linear and asked != parameters.frames:
            bracket = replace(bracket, raw_refused=why_jpegs)
        try:
            _merge_or_jpegs(context, bracket, profile, gathered, 2 * number)
        except (ResponseError, BracketError) as error:
            if (asked, parameters.frames) == ("raw", "auto") or not gathered.artifacts:
                error.where = error.where or side.value
                raise
            gathered.refuse(side, error)
    if not gathered.artifacts:
        text = f"there is nothing to merge: {'; '.join(gathered.left_out.values())}"
        raise BracketError(text, where=context.session_path.name, advice="capture or import a bracket")
    return StageOutput(
        artifacts={**gathered.artifacts, "response": gathered.response},
        metrics=gathered.metrics,
        warnings=tuple(gathered.warnings),
        left_out=gathered.left_out,
        honoured=_honoured(context, gathered),
    )


def _merge_or_jpegs(
    context: StageContext, bracket: brackets.SideBracket, profile: RigProfile | None, gathered: _Gathered, step: int
) -> None:
    """Merge a side; by its JPEGs, with a warning, where raw files that nobody insists on break or contradict."""
    try:
        return _merge_side(context, bracket, profile, gathered, step)
    except (PictureFileError, ResponseError, BracketError) as error:
        held = profile is not None and profile.frames.get(bracket.side) == "raw"
        asked = context.parameters_of(MergeParameters).frames
        beside = any(not frame.is_raw for frame in context.session.pictures(bracket.side))
        if held or asked != "auto" or not bracket.records[0].is_raw or not beside:
            raise
        jpegs = brackets.side_bracket(context.session, context.session_path, bracket.side, "jpeg")
        assert jpegs is not None
        _merge_side(context, replace(jpegs, raw_refused=str(error)), profile, gathered, step)


def _merge_side(
    context: StageContext, bracket: brackets.SideBracket, profile: RigProfile | None, gathered: _Gathered, step: int
) -> None:
    side = bracket.side.value
    response, merged, pair = merged_bracket(
        *(bracket, profile, brackets.merge_geometry(bracket, context.session.rig)),
        MergeOptions(quality=context.quality.value, max_error=context.max_error),
        lambda part, what: context.progress((step + part) / _STEPS, f"{side}: {what}"),
    )
    _gather(context, bracket, response, merged, gathered)
    if pair is not None:
        gathered.metrics[side]["lenses"] = pair.to_dict()


def merged_bracket(
    bracket: brackets.SideBracket,
    profile: RigProfile | None,
    geometry: Geometry,
    options: MergeOptions,
    progress: Callable[[float, str], None] = lambda _part, _what: None,
) -> tuple[CameraResponse, Merged, LensPair | None]:
    """Return the response that holds, the picture, and how a panorama camera's two lenses look; ``progress``: to 2.

    Raises `ResponseError`, `BracketError` and `PictureFileError` for frames that cannot be merged.
    """
    progress(0.1, "response curve")
    response, frames = camera_response(bracket, profile)
    pair = _lens_pair(bracket, frames) if bracket.panoramas else None
    progress(1, "merging")
    colours = getattr(bracket.frames[0], "colours", None)
    merged = merge(
        frames,
        response.times_s,
        None if bracket.linear else response.curve,
        response.noise,
        geometry=geometry,
        options=replace(options, own_curve=options.own_curve or response.source != "profile", colours=colours),
        time_sigma=response.time_sigma,
        given_s=bracket.nominal_s,
    )
    if (white := getattr(bracket.frames[0], "white", 1.0)) < 1:
        # In the unit of the stated white level, whatever the frames show: k1 and k2 of other brackets hold.
        merged = replace(merged, image=multiplied(merged.image, white))
    if pair is not None:
        progress(1.8, "stitching")
        merged = stitched(merged, pair, Equirectangular(*bracket.panoramas[0].size_px))
    progress(2, "merged")
    return response, merged, pair


def _lens_pair(bracket: brackets.SideBracket, raws: Sequence[FrameSource]) -> LensPair:
    """Return where a camera's two lenses look, by the raw frame (in memory) and panorama that show the most."""
    wells = [np.asarray(raw.decode(), np.uint16) for raw in raws]
    best = clearest(wells, brackets.decoded(bracket.panoramas, brackets.coarse(bracket.panoramas)))
    colours = bracket.frames[best].colours  # type: ignore[union-attr]
    return place_lenses(wells[best], colours, brackets.decoded(bracket.panoramas[best : best + 1])[0])


def _gather(
    context: StageContext, bracket: brackets.SideBracket, response: CameraResponse, merged: Merged, gathered: _Gathered
) -> None:
    side, report = bracket.side.value, merged.report
    attributes = {**merged.image.attributes, "side": side, "session_id": context.session.session_id}
    gathered.artifacts[side] = replace(merged.image, attributes=attributes)
    gathered.response[side] = response.to_dict(bracket)
    gathered.metrics[side] = _metrics(response, merged)
    gathered.warnings += response.warnings
    if bracket.raw_refused:
        gathered.left_out[f"{side} raw files"] = bracket.raw_refused[:500]
        text = f"{side}: merged from JPEGs because the raw files are unusable: {bracket.raw_refused}"
        gathered.warnings.append(StageWarning(code="raw-files", message=text[:500]))
    gathered.warnings += (StageWarning(code="merge", message=f"{side}: {text}"[:500]) for text in report.warnings)
    for use in report.frames:
        if use.used_share == 0:
            label = shutter_label(bracket.records[use.number].camera_s)
            gathered.left_out[f"{side} {label}"] = use.reason or "adds nothing"


def _metrics(response: CameraResponse, merged: Merged) -> dict[str, Any]:
    report, known = merged.report, merged.image.uncertainty[merged.image.validity == Validity.VALID]
    return {
        "error95": float(Z95 * np.quantile(known, 0.95)) if known.size else None,
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
    what = f"samples of {spared:.1f} out of {len(frames)} frames skipped"
    honoured = {"quality": f"{context.quality.value}: {what}"}
    if context.max_error is not None:
        honoured["max_error"] = f"each pixel's uncertainty may grow by {100 * context.max_error:g} %: {what}"
    return honoured


# Which response curve, noise and times hold for a bracket: the profile's, checked on the bracket, or its own.


DRIFTED = "drifted"
_Held = tuple["CameraResponse", tuple[FrameSource, ...]]


@dataclass(frozen=True)
class CameraResponse:
    """What a merge needs of the camera, and where it comes from."""

    curve: ResponseCurve
    noise: NoiseModel
    times_s: tuple[float, ...]
    time_sigma: tuple[float, ...]
    """Relative standard uncertainty of each time."""
    source: str
    """"profile", "recovered", or "linear" of raw files and 16 bits, which have no curve but a straight line."""
    times_source: str
    """"profile" (its shutter rule or measured times), the camera model's rule, or "estimated" from the bracket."""
    check: dict[str, Any]
    """How the profile's curve fits this bracket; empty for a recovered one."""
    residuals: dict[str, Any]
    """What remains by code: see `code_residuals`."""
    warnings: tuple[StageWarning, ...] = ()

    def to_dict(self, bracket: brackets.SideBracket) -> dict[str, Any]:
        """Return the side's part of response.json."""
        rows = zip(bracket.records, self.times_s, self.time_sigma, strict=True)
        return {
            "source": self.source,
            "times_source": self.times_source,
            "times": [
                {"file": record.file, "nominal_s": record.camera_s, "time_s": time_s, "relative_uncertainty": sigma}
                for record, time_s, sigma in rows
            ],
            "check": self.check,
            "residuals": self.residuals,
            "curve": ResponseRecord.of(self.curve).model_dump(mode="json", exclude={"modes"}),
            "noise": NoiseRecord.of(self.noise).model_dump(mode="json"),
        }


def camera_response(bracket: brackets.SideBracket, profile: RigProfile | None) -> _Held:
    """Return the profile's response where it has this camera's, else one recovered from the bracket; and the frames.

    The frames are in memory already where all of them were looked at. Raises `ResponseError` where no response can
    be had.
    """
    camera = profile.cameras.get(bracket.side) if profile else None
    if bracket.linear:
        return _linear(bracket, camera)
    if profile and camera and camera.response:
        return _from_profile(bracket, profile, camera), bracket.frames
    codes = brackets.decoded(bracket.frames)
    held = tuple(array_frame(code, frame.name) for code, frame in zip(codes, bracket.frames, strict=True))
    return _recovered(bracket, codes), held


def _linear(bracket: brackets.SideBracket, camera: CameraProfile | None) -> _Held:
    """Take noise, black level and times from linear frames; the profile's or the camera's rule of them, if known."""
    codes = side_by_side(lambda frame: np.asarray(frame.decode(), np.uint16), bracket.frames, brackets.DECODERS)
    check_view(bracket.frames, codes)
    rule = camera_rule(bracket.device.model) if bracket.device else None
    shutter = camera.shutter if camera else ShutterRecord(rule=rule or ShutterRule.NOMINAL)
    times_s = [shutter.true_s(nominal) for nominal in bracket.nominal_s]
    fit = fit_linear(codes, times_s, PEDESTAL / FULL if bracket.records[0].is_raw else 0.0)
    held = tuple(array_frame(code, frame.name) for code, frame in zip(codes, bracket.frames, strict=True))
    source = "profile" if camera else f"rule of the camera: {rule}" if rule else "as given"
    found = CameraResponse(
        *(linear_curve(), fit.noise, fit.times_s, fit.time_sigma, "linear", f"{source}, checked against the frames"),
        *({}, {}, _warnings("response", bracket, fit.warnings)),
    )
    return found, held


def _recovered(bracket: brackets.SideBracket, codes: Sequence[Bytes]) -> CameraResponse:
    """Recover the response from the bracket; its times too, unless the camera's rule is known."""
    check_view(bracket.frames, codes)
    rule = camera_rule(bracket.device.model) if bracket.device else None
    times_s = [true_time_s(nominal, rule) for nominal in bracket.nominal_s] if rule else bracket.nominal_s
    names = [frame.name for frame in bracket.frames]
    fit = recover_response([Bracket8(codes, times_s, bracket.nominal_s, names)], estimate_times=rule is None)
    source = f"rule of the camera: {rule}" if rule else "estimated"
    warnings = _warnings("response", bracket, fit.warnings)
    left = code_residuals(codes, fit.times_s, fit.curve)
    return CameraResponse(fit.curve, fit.noise, fit.times_s, fit.time_sigma, "recovered", source, {}, left, warnings)


def _from_profile(bracket: brackets.SideBracket, profile: RigProfile, camera: CameraProfile) -> CameraResponse:
    """Take the profile's curve; warn where the bracket or its settings contradict it."""
    assert camera.response
    curve = camera.response.curve()
    times_s = tuple(camera.shutter.true_s(nominal) for nominal in bracket.nominal_s)
    time_sigma = tuple(camera.shutter.sigma_stops(nominal) * math.log(2) for nominal in bracket.nominal_s)
    if camera.noise:
        noise = camera.noise.model()
    else:
        noise = estimate_noise([Bracket8(brackets.decoded(bracket.frames), times_s)], curve)
    warnings = _warnings("profile", bracket, profile_matches(profile, bracket.side, bracket.device, bracket.records))
    check: dict[str, Any] = {}
    small = brackets.decoded(bracket.frames, brackets.coarse(bracket.frames))
    check_view(bracket.frames, small)
    try:
        checked = check_response(curve, noise, Bracket8(small, times_s))
    except ResponseError as error:
        warnings += _warnings("unchecked", bracket, [f"the profile's response cannot be checked: {error.message}"])
    else:
        check = {name: getattr(checked, name) for name in ("drifted", "drift_stops", "sigma_stops", "noise_ratio")}
        warnings += _warnings(DRIFTED if checked.drifted else "response", bracket, checked.warnings)
    left = code_residuals(small, times_s, curve)
    return CameraResponse(curve, noise, times_s, time_sigma, "profile", "profile", check, left, warnings)


def code_residuals(codes: Sequence[Bytes], times_s: Sequence[float], curve: ResponseCurve) -> dict[str, Any]:
    """Return what frames say of a patch's light apart from one another, by code: lists for response.json.

    ``codes``: (H, W, 3) uint8 of each frame. The lists: ``rms_stops`` (3, bins) over ``codes`` (bins,), None where no
    patch has such a code; empty where there are none.
    """
    try:
        found = residuals_by_code(take_samples([Bracket8(codes, times_s)]), curve)
    except ResponseError:
        return {}
    rms = [
        [float((m * m + s * s) ** 0.5) if n else None for m, s, n in zip(means, spreads, counts, strict=True)]
        for means, spreads, counts in zip(found.mean_stops, found.spread_stops, found.count, strict=True)
    ]
    return {"codes": [float(code) for code in found.codes], "rms_stops": rms}


def _warnings(code: str, bracket: brackets.SideBracket, texts: Iterable[str]) -> tuple[StageWarning, ...]:
    side = bracket.side.value
    named = (text if text.startswith(f"{side}:") else f"{side}: {text}" for text in texts)
    return tuple(StageWarning(code=code, message=text[:500]) for text in named)

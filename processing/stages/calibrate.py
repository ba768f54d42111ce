"""The stage calibrate: indoor and outdoor pictures in cd/m2 (paper, section 3, eq. 1 and 2)."""

from __future__ import annotations

import json

from processing.calibration.outdoor.session_sky import calibrate_outdoor, why_no_scale
from processing.calibration.profile import load_profile
from processing.calibration.profile_records import ResponseRecord
from processing.calibration.scale.luminance import Calibrated
from processing.errors import LensError
from processing.stages.calibrate_indoor import calibrate_indoor
from processing.stages.calibrate_panorama import calibrate_panorama
from processing.stages.contract import StageContext, StageOutput, StageWarning
from processing.stages.parameters import CalibrateParameters
from station.session.session import Side


def run(context: StageContext) -> StageOutput:
    """Scale the merged pictures: k1 from the meter, k2 from the rig profile; the sky through its lens and filter.

    A sky whose lens cannot be told is left out with the reason; the room stands. One panorama instead of brackets is
    taken as it is, without a scale.
    """
    if context.session.panorama is not None:
        return calibrate_panorama(context)
    asked = context.parameters
    assert isinstance(asked, CalibrateParameters)
    profile = None if asked.calibration is None else load_profile(asked.calibration)
    left_out: dict[str, str] = {}
    context.progress(0.0, "indoor scale")
    indoor = calibrate_indoor(context.artifact("merge", "indoor"), context.session, asked, profile)
    sky = context.optional_artifact("merge", "outdoor")
    outdoor: Calibrated | None = None
    if sky is None:
        left_out["outdoor"] = "the stage merge made no outdoor picture"
    elif reason := why_no_scale(context.session, asked, profile):
        left_out["outdoor"] = reason
    else:
        context.progress(0.3, "outdoor chain")
        try:
            outdoor = calibrate_outdoor(sky, context.session, asked, profile, indoor.scale, _responses(context))
        except LensError as error:
            left_out["outdoor"] = str(error)
    sides = {"indoor": indoor} | ({"outdoor": outdoor} if outdoor else {})
    facts = {name: side.facts for name, side in sides.items()}
    warnings = [(name, text) for name, side in sides.items() for text in side.warnings]
    if sky is not None and outdoor is None:
        warnings.append(("outdoor", f"there is no outdoor picture in cd/m2: {left_out['outdoor']}"))
    return StageOutput(
        artifacts={name: side.image for name, side in sides.items()} | {"calibration": facts},
        metrics={"k1": indoor.scale.value, "k1_relative_uncertainty": indoor.scale.relative_uncertainty}
        | _outdoor_metrics(outdoor),
        warnings=tuple(StageWarning(code=name, message=text[:500]) for name, text in warnings),
        left_out=left_out,
    )


def _responses(context: StageContext) -> dict[Side, ResponseRecord]:
    """Return the curves that the brackets were merged with."""
    found = context.optional_artifact("merge", "response") or {}
    return {Side(name): ResponseRecord.model_validate_json(json.dumps(one["curve"])) for name, one in found.items()}


def _outdoor_metrics(outdoor: Calibrated | None) -> dict[str, float]:
    if outdoor is None:
        return {}
    horizontal = outdoor.facts["illuminance_lx"]["up"]
    return {"outdoor_lux": horizontal["value"], "outdoor_lux_uncertainty": horizontal["uncertainty"]}

"""The stage calibrate: indoor and outdoor pictures in cd/m2 (paper, section 3, eq. 1 and 2).

One panorama instead of brackets stays in relative units unless its file says more.
"""

from __future__ import annotations

import json
from dataclasses import replace
from typing import Any

from processing.calibration.outdoor.session_sky import calibrate_outdoor, why_no_scale
from processing.calibration.profile import load_profile, unlike_profile
from processing.calibration.profile_records import ResponseRecord
from processing.calibration.scale.luminance import Calibrated, given_scale
from processing.calibration.scale.photometry import PLANES, illuminances
from processing.errors import LensError, ScaleError
from processing.pictures.images import LuminanceImage
from processing.pictures.panorama import GivenPanorama, read_panorama
from processing.stages.calibrate_indoor import calibrate_indoor
from processing.stages.contract import StageContext, StageOutput, StageWarning
from processing.stages.parameters import CalibrateParameters
from station.session.session import Side


def run(context: StageContext) -> StageOutput:
    """Scale the merged pictures: k1 from the meter, k2 from the rig profile; the sky through its lens and filter.

    A sky whose lens cannot be determined is left out with the reason; the room stands. One panorama instead of
    brackets is taken as it is, without a scale.
    """
    if context.session.panorama is not None:
        return calibrate_panorama(context)
    asked = context.parameters_of(CalibrateParameters)
    profile = None if asked.calibration is None else load_profile(asked.calibration)
    left_out: dict[str, str] = {}
    context.progress(0.0, "indoor scale")
    room, sky = (context.optional_artifact("merge", side) for side in ("indoor", "outdoor"))
    indoor: Calibrated | None = None
    if room is None:
        left_out["indoor"] = _without_room(asked)
    else:
        indoor = calibrate_indoor(room, context.session, asked, profile)
    k1 = indoor.scale if indoor else given_scale("k1", asked.k1 or 1.0)
    outdoor: Calibrated | None = None
    if sky is None:
        left_out["outdoor"] = "the stage merge made no outdoor picture"
    elif reason := why_no_scale(context.session, asked, profile, sky):
        left_out["outdoor"] = reason
    else:
        context.progress(0.3, "outdoor chain")
        try:
            outdoor = calibrate_outdoor(sky, context.session, asked, profile, k1, _responses(context))
        except LensError as error:
            left_out["outdoor"] = str(error)
    sides = {name: side for name, side in (("indoor", indoor), ("outdoor", outdoor)) if side is not None}
    if not sides:
        raise ScaleError(f"nothing can be scaled: {'; '.join(left_out.values())}", advice="give what is named")
    facts = {name: side.facts for name, side in sides.items()}
    warnings = [("profile", text) for text in unlike_profile(profile, context.session)]
    warnings += [(name, text) for name, side in sides.items() for text in side.warnings]
    if sky is not None and outdoor is None:
        warnings.append(("outdoor", f"there is no outdoor picture in cd/m2: {left_out['outdoor']}"))
    return StageOutput(
        artifacts={name: side.image for name, side in sides.items()} | {"calibration": facts},
        metrics={"k1": k1.value, "k1_relative_uncertainty": k1.relative_uncertainty} | _outdoor_metrics(outdoor),
        warnings=tuple(StageWarning(code=name, message=text[:500]) for name, text in warnings),
        left_out=left_out,
    )


def _without_room(asked: CalibrateParameters) -> str:
    if asked.k1 is None and asked.outdoor_lux is None:
        raise ScaleError(
            "a session without a room has no reading of its own to scale the sky by",
            advice="give --outdoor-lux, or --k1 and --k2",
        )
    return "the stage merge made no indoor picture"


def _responses(context: StageContext) -> dict[Side, ResponseRecord]:
    """Return the curves that the brackets were merged with."""
    found = context.optional_artifact("merge", "response") or {}
    return {
        Side(name): ResponseRecord.model_validate_json(json.dumps(one["curve"], default=dict))
        for name, one in found.items()
    }


def _outdoor_metrics(outdoor: Calibrated | None) -> dict[str, float]:
    if outdoor is None:
        return {}
    horizontal = outdoor.facts["illuminance_lx"]["up"]
    return {"outdoor_lux": horizontal["value"], "outdoor_lux_uncertainty": horizontal["uncertainty"]}


MUCH_CLIPPED = 0.001
"""Share of all directions."""
NO_SCALE = (
    "one picture, no meter: every luminance is in relative units (100: a photograph's white). Proportions hold as far "
    "as the picture keeps them; nothing is in cd/m2 or lx"
)


def calibrate_panorama(context: StageContext) -> StageOutput:
    """Return the session's panorama as the calibrated picture; it says itself whether it is absolute."""
    asked, record = context.parameters, context.session.panorama
    assert isinstance(asked, CalibrateParameters)
    assert record is not None
    found = read_panorama(context.session_path / record.file, k1=asked.k1)
    attributes = {
        **found.image.attributes,
        "side": "indoor",
        "session_id": context.session.session_id,
        "source": found.source,
        "units": found.image.unit,
    }
    image = replace(found.image, attributes=attributes)
    facts = _facts(found, image)
    return StageOutput(
        artifacts={"indoor": image, "calibration": {"indoor": facts}},
        metrics={"absolute": image.absolute, "units": image.unit, "clipped_share": round(found.clipped_share, 5)},
        warnings=tuple(StageWarning(code="indoor", message=text[:500]) for text in _warnings(found, asked)),
        left_out={"outdoor": "one picture: there is no sky"}
        | ({} if image.absolute else {"scale": "no meter reading, and the file does not say what its values are"}),
    )


def _facts(found: GivenPanorama, image: LuminanceImage) -> dict[str, Any]:
    """Return what the report and others read; without a scale there are neither k1 nor illuminances."""
    absolute = image.absolute
    return {
        "absolute": absolute,
        "units": image.unit,
        "source": found.source,
        "factor": found.factor,
        "clipped_share": found.clipped_share,
        "k1": found.factor if absolute else None,
        "k1_relative_uncertainty": image.scale_uncertainty if absolute else None,
        "k1_parts": {},
        "falloff": "not corrected: one picture",
        "target": {"source": "none: one picture"},
        "meter_cd_m2": None,
        "displayed": None,
        "meter_drift_frac": None,
        "illuminance_lx": illuminances(image, PLANES)[0] if absolute else {},
    }


def _warnings(found: GivenPanorama, asked: CalibrateParameters) -> list[str]:
    texts = list(found.notes)
    if not found.image.absolute:
        texts.append(NO_SCALE)
    elif asked.k1 is not None:
        texts.append("k1 is as given: its uncertainty is not known, and not part of the uncertainties stated")
    if found.clipped_share > MUCH_CLIPPED:
        texts.append(
            f"{found.clipped_share:.1%} of all directions are clipped (windows, lamps): their light is a lower bound, "
            "and daylight that comes in there is underestimated"
        )
    return texts

"""The stage calibrate: indoor and outdoor pictures in cd/m2 (paper, section 3, eq. 1 and 2).

One panorama instead of brackets stays in relative units unless its file says more.
"""

import json
import math
from dataclasses import replace
from typing import Any

from processing.calibration.optics import LAMPS, falloff_of, find_optics, glare_facts, lamp_kernel
from processing.calibration.outdoor.outdoor import OutdoorView, outdoor_view, project
from processing.calibration.outdoor.session_sky import bare_light, calibrate_outdoor, why_no_scale, with_shared_modes
from processing.calibration.profile import RigProfile, chart_mismatches, load_profile, unlike_profile
from processing.calibration.profile_records import ResponseRecord
from processing.calibration.scale.luminance import Calibrated, ScaleFactor, given_scale, scale_from_reading, scaled
from processing.calibration.scale.photometry import PLANES, UP, illuminances
from processing.calibration.scale.veiling_glare import (
    bound_from_darkest,
    kernel_modes,
    metered,
    unmeasured_modes,
    without_glare,
)
from processing.calibration.scale.vignetting import correct_panorama
from processing.errors import LensError, ScaleError
from processing.ground.board import find_board
from processing.pictures.images import LuminanceImage, RelativeImage, Validity, luminance_cd_m2
from processing.pictures.modes import SEAM_KEY, SEAM_SIGMA, carrying, colour_mode, falloff_mode, seam_mode, widened
from processing.pictures.panorama import GivenPanorama, read_panorama
from processing.sphere import Equirectangular, Fisheye
from processing.stages.brackets import is_panorama_camera
from processing.stages.contract import Quality, StageContext, StageOutput, StageWarning
from processing.stages.parameters import CalibrateParameters
from station.session.session import SessionManifest, Side


def run(context: StageContext) -> StageOutput:
    """Scale the merged pictures: k1 from the meter, k2 from the rig profile; the sky through its lens and filter.

    A sky whose lens cannot be determined is left out with the reason. One panorama is taken as it is, without a scale.
    """
    if context.session.panorama is not None:
        return calibrate_panorama(context)
    asked = context.parameters_of(CalibrateParameters)
    merged = context.optional_artifact("merge", "response") or {}
    by_raw = {Side(name): one["source"] == "linear" for name, one in merged.items()}
    profile = None if asked.calibration is None else load_profile(asked.calibration).of(by_raw)
    left_out: dict[str, str] = {}
    # Each is handed over: nothing here holds it while what is made of it takes as much memory.
    pictures: dict[str, Any] = {side: context.optional_artifact("merge", side) for side in ("indoor", "outdoor")}
    context.let_go()
    sides: dict[str, Calibrated] = {}
    if pictures["indoor"] is None:
        left_out["indoor"] = _without_room(asked)
    else:
        sides["indoor"] = calibrate_indoor(pictures.pop("indoor"), context.session, asked, profile)
    k1 = sides["indoor"].scale if sides else given_scale("k1", asked.k1 or 1.0)
    found = _sky(context, profile, sides["indoor"].of_camera if sides else k1, pictures)
    if isinstance(found, Calibrated):
        sides["outdoor"] = found
    else:
        left_out["outdoor"] = found or "the stage merge made no outdoor picture"
    if not sides:
        raise ScaleError(f"no picture can be calibrated: {'; '.join(left_out.values())}", advice="give what is missing")
    mismatches = chart_mismatches(profile, context.session)
    facts = {name: side.facts | {"spectral_mismatch": mismatches.get(Side(name))} for name, side in sides.items()}
    sizes = (f"{name} {side.image.rgb.shape[1]} pixels wide" for name, side in sides.items())
    warnings = [("profile", text) for text in unlike_profile(profile, context.session)]
    warnings += [(name, text) for name, side in sides.items() for text in side.warnings]
    if isinstance(found, str):
        warnings.append(("outdoor", f"no outdoor picture in cd/m2: {found}"))
    return StageOutput(
        artifacts={name: side.image for name, side in sides.items()} | {"calibration": facts},
        metrics={"k1": k1.value, "k1_relative_uncertainty": k1.relative_uncertainty} | _outdoor_metrics(sides),
        warnings=tuple(StageWarning(code=name, message=text[:500]) for name, text in warnings),
        left_out=left_out,
        honoured={"quality": f"{context.quality.value}: {', '.join(sizes)}"},
    )


def _sky(
    context: StageContext, profile: RigProfile | None, k1: ScaleFactor, pictures: dict[str, Any]
) -> Calibrated | str | None:
    """Return the outdoor picture in cd/m2, taken out of those merged, or why there is none; None: none was merged."""
    session, asked, curves = context.session, context.parameters_of(CalibrateParameters), _responses(context)
    if pictures["outdoor"] is None:
        return None
    if reason := why_no_scale(session, asked, profile, pictures["outdoor"]):
        return reason
    context.progress(0.3, "outdoor chain")
    draft = context.quality is Quality.DRAFT
    try:  # without a tuple of arguments, which would hold the picture
        return calibrate_outdoor(pictures.pop("outdoor"), session, asked, profile, k1, curves, draft=draft)
    except LensError as error:
        return str(error)


def _without_room(asked: CalibrateParameters) -> str:
    if asked.k1 is None and asked.outdoor_lux is None:
        advice = "give --outdoor-lux, or --k1 and --k2"
        raise ScaleError("a session without a room has no meter reading to scale the sky", advice=advice)
    return "the stage merge made no indoor picture"


def _responses(context: StageContext) -> dict[Side, ResponseRecord]:
    """Return the curves that the brackets were merged with."""
    merged = context.optional_artifact("merge", "response") or {}
    return {
        Side(name): ResponseRecord.model_validate_json(json.dumps(one["curve"], default=dict))
        for name, one in merged.items()
    }


def _outdoor_metrics(sides: dict[str, Calibrated]) -> dict[str, float]:
    if "outdoor" not in sides:
        return {}
    horizontal = sides["outdoor"].facts["illuminance_lx"]["up"]
    return {"outdoor_lux": horizontal["value"], "outdoor_lux_uncertainty": horizontal["uncertainty"]}


MUCH_CLIPPED = 0.001  # share of all directions
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
        left_out={"outdoor": "one picture, no sky"}
        | ({} if image.absolute else {"scale": "no meter reading, and the file does not state the unit of its values"}),
    )


def _facts(found: GivenPanorama, image: LuminanceImage) -> dict[str, Any]:
    """Return what the report and others read; without a scale there are neither k1 nor illuminances."""
    absolute = image.absolute
    return dict.fromkeys(("meter_cd_m2", "displayed", "meter_drift_frac")) | {
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
        "illuminance_lx": illuminances(image, PLANES)[0] if absolute else {},
    }


def _warnings(found: GivenPanorama, asked: CalibrateParameters) -> list[str]:
    texts = list(found.notes)
    if not found.image.absolute:
        texts.append(NO_SCALE)
    elif asked.k1 is not None:
        texts.append("k1 was given: its uncertainty is unknown and not included in the stated uncertainties")
    if found.clipped_share > MUCH_CLIPPED:
        texts.append(
            f"{found.clipped_share:.1%} of all directions are clipped (windows, lamps): their values are lower bounds, "
            "and daylight entering there is underestimated"
        )
    return texts


# The indoor half: fall-off of the panorama's lenses, then k1.


ASPECT_TOLERANCE = 0.02  # chosen: a row cut off a panorama is within it


def calibrate_indoor(
    merged: RelativeImage, session: SessionManifest, asked: CalibrateParameters, profile: RigProfile | None
) -> Calibrated:
    """Return the panorama in cd/m2. Raises `ScaleError` where neither readings nor --k1 give a scale."""
    if isinstance(merged.geometry, Fisheye):
        return calibrate_eye(merged, session, asked, profile)
    falloff, source = falloff_of(session, asked, profile, [], Side.INDOOR)
    kernel = None if asked.glare == "keep" else lamp_kernel(profile, Side.INDOOR)
    image, tied = merged if kernel is None else without_glare(merged, kernel), merged.attributes.get(SEAM_KEY)
    del merged
    image = image if falloff is None else correct_panorama(image, falloff)
    scale, target = _scale(image, session, asked)
    picture = scaled(image, scale, side="indoor", session_id=session.session_id, k1=scale.value)
    del image
    lenses = any(is_panorama_camera(device) for device in session.devices if device.role == "indoor")
    spot, lit = metered(picture, scale, target)
    sigma = tied if isinstance(tied, float) else SEAM_SIGMA
    seam = [seam_mode(spot[1] if spot else None, sigma)] if lenses else []
    stray = kernel_modes(picture, kernel, spot) if kernel else unmeasured_modes(picture, spot)
    picture = widened(picture, [*stray, *seam, colour_mode(lit, indoors=True)])
    if falloff and falloff.relative_uncertainty:
        cosine = math.cos(spot[1]) * math.cos(spot[2]) if spot else 1.0
        picture = carrying(picture, [falloff_mode(falloff.relative_uncertainty, cosine)])
    lux, low = illuminances(picture, PLANES)
    facts = _scale_facts(scale, target, session) | {"falloff": source, "illuminance_lx": lux}
    if kernel is not None:
        facts["veil"] = glare_facts(kernel, LAMPS) | {"taken_off": True}
    try:
        facts["veil_upper_bound"] = dict(zip(("cd_m2", "index"), bound_from_darkest(picture), strict=True))
    except LensError as error:
        facts["veil_upper_bound"] = {"none": str(error)}
    return Calibrated(picture, scale, facts, (*scale.warnings, *low, *not_a_panorama(picture)))


def _scale_facts(scale: ScaleFactor, target: dict[str, Any], session: SessionManifest) -> dict[str, Any]:
    return {
        "k1": scale.value,
        "k1_relative_uncertainty": scale.relative_uncertainty,
        "k1_parts": dict(scale.parts),
        "target": target,
        "meter_cd_m2": scale.measured,
        "displayed": scale.displayed,
        "meter_drift_frac": scale.drift_frac,
        "repeat_drift_frac": session.repeat_drift(Side.INDOOR) or None,
    }


def calibrate_eye(
    merged: RelativeImage, session: SessionManifest, asked: CalibrateParameters, profile: RigProfile | None
) -> Calibrated:
    """Return what a fisheye at the eye sees, in cd/m2: equidistant, 180 degrees, the line of sight in its middle."""
    optics, facts, warnings = find_optics(merged, session, asked, profile, None, Side.INDOOR)
    bare, kernel, veil = bare_light(merged, optics, asked, lamp_kernel(profile, Side.INDOOR))
    image = project(bare, outdoor_view(OutdoorView.EQUIDISTANT, round(2 * facts["image_circle"]["radius_px"])))
    scale, target = _scale(image, session, asked)
    picture = scaled(image, scale, side="indoor", session_id=session.session_id, k1=scale.value)
    picture = with_shared_modes(picture, optics, kernel, metered(picture, scale, target))
    lux, low = illuminances(picture, {"eye": UP})
    facts |= _scale_facts(scale, target, session) | {"veil": veil, "illuminance_lx": lux}
    return Calibrated(picture, scale, facts, (*scale.warnings, *warnings, *low))


def not_a_panorama(image: LuminanceImage) -> list[str]:
    """Return a warning where the picture has not a whole panorama's shape: directions are then wrong."""
    height, width = image.validity.shape
    if abs(width / height - 2) <= ASPECT_TOLERANCE:
        return []
    return [
        f"the picture is {width} x {height}, not 2:1: it is treated as a whole panorama; if it is not, "
        "directions and illuminances are wrong, but luminances hold"
    ]


def _scale(
    image: RelativeImage, session: SessionManifest, asked: CalibrateParameters
) -> tuple[ScaleFactor, dict[str, Any]]:
    if asked.k1 is not None:
        return given_scale("k1", asked.k1), {"source": "none: k1 given"}
    longitude, latitude, target = _target(image, session, asked)
    frames = [frame for frame in session.frames if frame.side is Side.INDOOR]
    drift = session.repeat_drift(Side.INDOOR)
    scale = scale_from_reading(image, session.readings, longitude, latitude, frames=frames, repeat_frac=drift)
    return scale, target | {"longitude_deg": math.degrees(longitude), "latitude_deg": math.degrees(latitude)}


def _target(
    image: RelativeImage, session: SessionManifest, asked: CalibrateParameters
) -> tuple[float, float, dict[str, Any]]:
    if asked.target is not None:
        return (*asked.angles_rad(asked.target), {"source": "given"})
    if session.target is not None:
        return session.target.longitude_rad, session.target.latitude_rad, {"source": "recorded in the session"}
    if not isinstance(image.geometry, Equirectangular):
        raise ScaleError("the target board is searched for in panoramas only", advice="give the target's direction")
    board = find_board(image.rgb, luminance_cd_m2(image.rgb), image.validity == Validity.VALID)
    longitude = math.remainder(board.longitude_rad + image.geometry.yaw_rad, 2 * math.pi)
    return longitude, board.latitude_rad, {"source": "board found", "confidence": board.confidence}

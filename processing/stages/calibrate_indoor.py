"""The indoor half of the stage calibrate: fall-off of the panorama's lenses, then k1."""

from __future__ import annotations

import math
from typing import Any

from processing.calibration.optics import indoor_falloff
from processing.calibration.profile import RigProfile
from processing.calibration.scale.luminance import Calibrated, ScaleFactor, given_scale, scale_from_reading, scaled
from processing.calibration.scale.photometry import PLANES, illuminances
from processing.calibration.scale.veiling_glare import veil_bound_from_darkest
from processing.calibration.scale.vignetting import correct_panorama
from processing.errors import LensError, ScaleError
from processing.ground.board import find_board
from processing.ground.colour import LUMINANCE_WEIGHTS
from processing.pictures.images import LuminanceImage, RelativeImage, Validity, luminance_cd_m2
from processing.pictures.modes import camera_modes, widened
from processing.sphere import Equirectangular
from processing.stages.parameters import CalibrateParameters
from station.session.session import SessionManifest, Side

ASPECT_TOLERANCE = 0.02


def calibrate_indoor(
    merged: RelativeImage, session: SessionManifest, asked: CalibrateParameters, profile: RigProfile | None
) -> Calibrated:
    """Return the panorama in cd/m2. Raises `ScaleError` where neither readings nor --k1 give a scale."""
    falloff, source = indoor_falloff(session, asked, profile)
    image = merged if falloff is None else correct_panorama(merged, falloff)
    scale, target = _scale(image, session, asked)
    picture = scaled(image, scale, side="indoor", session_id=session.session_id, k1=scale.value)
    lenses = any(device.kind == "theta_z1" for device in session.devices if device.role == "indoor")
    picture = widened(picture, camera_modes(float(luminance_cd_m2(picture.rgb).mean()), two_lenses=lenses))
    lux, low = illuminances(picture, PLANES)
    facts: dict[str, Any] = {
        "k1": scale.value,
        "k1_relative_uncertainty": scale.relative_uncertainty,
        "k1_parts": dict(scale.parts),
        "falloff": source,
        "target": target,
        "meter_cd_m2": scale.measured,
        "displayed": scale.displayed,
        "meter_drift_frac": scale.drift_frac,
        "illuminance_lx": lux,
    }
    try:
        veil = veil_bound_from_darkest(picture)
        facts["veil_upper_bound"] = {"cd_m2": _luminance(veil.veil_rgb), "index": veil.index}
    except LensError as error:
        facts["veil_upper_bound"] = {"none": str(error)}
    return Calibrated(picture, scale, facts, (*scale.warnings, *low, *not_a_panorama(picture)))


def not_a_panorama(image: LuminanceImage) -> list[str]:
    """Return a warning where the picture has not a whole panorama's shape: directions are then wrong."""
    height, width = image.validity.shape
    if abs(width / height - 2) <= ASPECT_TOLERANCE:
        return []
    return [
        f"the picture is {width} x {height}, not twice as wide as high: it is taken for a whole panorama, so that "
        "places and illuminances are wrong if it is not; luminances hold"
    ]


def _scale(
    image: RelativeImage, session: SessionManifest, asked: CalibrateParameters
) -> tuple[ScaleFactor, dict[str, Any]]:
    if asked.k1 is not None:
        return given_scale("k1", asked.k1), {"source": "none: k1 given"}
    longitude, latitude, target = _target(image, session, asked)
    frames = [frame for frame in session.frames if frame.side is Side.INDOOR]
    scale = scale_from_reading(image, session.readings, longitude, latitude, frames=frames)
    place = {"longitude_deg": math.degrees(longitude), "latitude_deg": math.degrees(latitude)}
    return scale, target | place


def _target(
    image: RelativeImage, session: SessionManifest, asked: CalibrateParameters
) -> tuple[float, float, dict[str, Any]]:
    if asked.target is not None:
        return (*asked.angles_rad(asked.target), {"source": "given"})
    if session.target is not None:
        return session.target.longitude_rad, session.target.latitude_rad, {"source": "recorded in the session"}
    if not isinstance(image.geometry, Equirectangular):
        raise ScaleError("the board is looked for in panoramas only", advice="give the target's direction")
    board = find_board(image.rgb, luminance_cd_m2(image.rgb), image.validity == Validity.VALID)
    longitude = math.remainder(board.longitude_rad + image.geometry.yaw_rad, 2 * math.pi)
    return longitude, board.latitude_rad, {"source": "board found", "confidence": board.confidence}


def _luminance(rgb: tuple[float, float, float]) -> float:
    return sum(weight * value for weight, value in zip(LUMINANCE_WEIGHTS, rgb, strict=True))

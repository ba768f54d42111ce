"""The indoor half of the stage calibrate: fall-off of the panorama's lenses, then k1."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

from processing.calibration.profile import RigProfile
from processing.calibration.scale.board import find_board
from processing.calibration.scale.luminance import ScaleFactor, scale_from_reading, scaled
from processing.calibration.scale.photometry import illuminance_lx
from processing.calibration.scale.veiling_glare import veil_bound_from_darkest
from processing.calibration.scale.vignetting import Vignetting, correct_panorama, published_vignetting
from processing.errors import LensError
from processing.pictures.images import LuminanceImage, RelativeImage
from processing.stages.parameters import CalibrateParameters
from station.session.session import SessionManifest, Side

PANORAMA_FALLOFF = {"theta_z1": "theta_z1"}
"""Published fall-off by kind of camera."""
ASPECT_TOLERANCE = 0.02
GIVEN_UNCERTAINTY = 0.0
CLIPPED_SHARE = 0.01
"""Of an illuminance, from clipped pixels: more is worth a warning."""
PLANES = {
    "up": (0.0, 0.0, 1.0),
    "ahead": (0.0, 1.0, 0.0),
    "right": (1.0, 0.0, 0.0),
    "back": (0.0, -1.0, 0.0),
    "left": (-1.0, 0.0, 0.0),
}


@dataclass(frozen=True)
class Calibrated:
    """One side's picture, its scale, and what there is to say of it (plain JSON values)."""

    image: LuminanceImage
    scale: ScaleFactor
    facts: dict[str, Any]
    warnings: tuple[str, ...] = ()


def calibrate_indoor(
    merged: RelativeImage, session: SessionManifest, asked: CalibrateParameters, profile: RigProfile | None
) -> Calibrated:
    """Return the panorama in cd/m2. Raises `ScaleError` where neither readings nor --k1 give a scale."""
    falloff, source = indoor_falloff(session, asked, profile)
    image = merged if falloff is None else correct_panorama(merged, falloff)
    scale, target = _scale(image, session, asked)
    picture = scaled(image, scale, side="indoor", session_id=session.session_id, k1=scale.value)
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


def illuminances(
    image: LuminanceImage, planes: dict[str, tuple[float, float, float]]
) -> tuple[dict[str, dict[str, float]], list[str]]:
    """Return value, standard uncertainty (lx) and share from clipped pixels for each plane through the camera.

    Warnings name the planes on which so much is clipped that the value is a lower bound.
    """
    found = {name: illuminance_lx(image, normal) for name, normal in planes.items()}
    facts = {
        name: {"value": e.value_lx, "uncertainty": e.uncertainty_lx, "clipped_share": e.invalid_shares["clipped"]}
        for name, e in found.items()
    }
    low = [f"{name} ({e['clipped_share']:.0%})" for name, e in facts.items() if e["clipped_share"] > CLIPPED_SHARE]
    text = f"illuminance is a lower bound, as part of it comes from pixels clipped in every frame: {', '.join(low)}"
    return facts, [text] if low else []


def given_scale(name: str, value: float) -> ScaleFactor:
    """Return a factor that the user gave, with the warning that nothing is known of its uncertainty."""
    text = f"{name} is as given: its uncertainty is not known, and not part of the uncertainties stated"
    return ScaleFactor(value, GIVEN_UNCERTAINTY, {"given": GIVEN_UNCERTAINTY}, warnings=(text,))


def indoor_falloff(
    session: SessionManifest, asked: CalibrateParameters, profile: RigProfile | None
) -> tuple[Vignetting | None, str]:
    """Return the panorama's fall-off that is corrected (None: none is), and where it is from."""
    if asked.falloff == "off":
        return None, "not corrected, as asked"
    camera = profile.cameras.get(Side.INDOOR) if profile else None
    if camera and camera.vignetting:
        return camera.vignetting.vignetting(), "the rig profile's"
    kinds = [device.kind for device in session.devices if device.role == "indoor"]
    name = PANORAMA_FALLOFF.get(kinds[0]) if kinds else None
    if name is None:
        return None, "not corrected: none is known for this camera"
    found = published_vignetting(name)
    return found, f"published: {found.source}"


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
    board = find_board(image)
    return board.longitude_rad, board.latitude_rad, {"source": "board found", "confidence": board.confidence}


def _luminance(rgb: tuple[float, float, float]) -> float:
    return 0.2127 * rgb[0] + 0.7151 * rgb[1] + 0.0722 * rgb[2]

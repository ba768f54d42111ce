"""All light figures of a session as plain values: what the stage figures writes and the report shows."""

import math
import subprocess
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from processing.calibration.scale.luminance import Spot, sighted, spot_pixels
from processing.calibration.scale.photometry import UP, illuminance_lx, illuminances_lx, luminance_map
from processing.errors import ParameterError, ProcessingError, ScaleError
from processing.figures.glare import CLASSES, FAINT_LX, glare_indices, pixel_of
from processing.figures.uncertainty import Figure, Part, light_figure, statistics
from processing.ground.room_model import RoomModel
from processing.pictures.images import LuminanceImage, Validity
from processing.pictures.radiance import write_radiance_hdr
from processing.sphere import Equirectangular, Fisheye, Geometry, LensMapping, directions, solid_angles
from processing.sphere.resampling import resample, resample_uncertainty
from processing.surfaces.maps import planes_of, surface_maps

SIZE_PX = 1000  # chosen
_TIMEOUT_S = 900.0  # chosen
WIDTH_PX = 2048  # of the panorama that is looked at: a third of a sun's width a pixel
DIRECTIONS = 8  # in which an observer may look, evenly around

Facts = dict[str, Any]


def write_glare_views(folder: Path, name: str, image: LuminanceImage, *, size_px: int = SIZE_PX) -> list[Path]:
    """Write a fisheye of 180 degrees for each direction of the light figures; return their paths in that order.

    Of a fisheye at the eye, that one.
    """
    fisheye, found = isinstance(image.geometry, Fisheye), list[Path]()
    for degrees in range(0, 1 if fisheye else 360, 360 // DIRECTIONS):
        found.append(folder / f"{name}_eye-{degrees:03d}.hdr")
        write_radiance_hdr(found[-1], image if fisheye else eye_view(image, math.radians(degrees), size_px))
    return found


def evalglare(tool: Path, view: Path) -> dict[str, float]:
    """Return evalglare's own figures of a view: dgp, dgi, ugr, vcp, cgi, veiling luminance (by its names).

    Raises `ProcessingError` where it gives none (its exit code says nothing).
    """
    try:
        done = subprocess.run([str(tool), str(view)], capture_output=True, text=True, timeout=_TIMEOUT_S, check=False)
        names, _, values = done.stdout.partition(":")
        found = dict(zip(names.split(","), (float(v) for v in values.split()), strict=False))
    except (OSError, subprocess.TimeoutExpired, ValueError) as error:
        raise ProcessingError(f"evalglare failed: {error}", where=view.name) from None
    if "dgp" not in found:
        raise ProcessingError(f"evalglare gave no dgp: {done.stderr.strip()[:200]}", where=view.name)
    return found


def parts_of(room: RoomModel | None, geometry: Geometry) -> list[Part]:
    """Return name, kind and pixels (H, W) of the whole and, of a room, of its surfaces and openings as they are seen.

    Surfaces that the camera does not see are left out. A wall is counted without its openings.
    """
    found: list[Part] = [("whole", "whole", np.ones((geometry.height_px, geometry.width_px), bool))]
    if room is None or not isinstance(geometry, Equirectangular):
        return found
    maps = surface_maps(room, geometry)
    for plane in planes_of(room):
        kind = plane.name if plane.name in ("floor", "ceiling") else "wall"
        found.append((plane.name, kind, (maps.plane == plane.index) & (maps.opening < 0)))
    for number, opening in enumerate(room.openings):
        found.append((f"{opening.kind.value}-{number}", opening.kind.value, maps.opening == number))
    return [(name, kind, mask) for name, kind, mask in found if mask.any()]


def camera_figures(image: LuminanceImage, *, height_m: float, heading_rad: float | None) -> Facts:
    """Return the light at the camera: illuminance on level and upright planes, glare in each direction.

    Illuminances are in lx; of a picture without absolute scale in relative units, and then there is no glare, which
    depends on the scale. ``heading_rad``: compass azimuth of the panorama's centre, None where it is not known. A
    fisheye at the eye has one direction, and nothing of what it does not see: None.
    """
    picture = reduced(image, WIDTH_PX)
    if isinstance(picture.geometry, Fisheye):
        (glare,) = glare_indices(picture) if picture.absolute else (None,)
        looks = [_look(0.0, heading_rad, light_figure(illuminance_lx(picture)), glare)]
        unseen = dict.fromkeys(("level_up", "level_down", "cylindrical"))
        return {"height_m": height_m, **unseen, "directions": looks, "brightest": 0}
    azimuths = [2 * math.pi * k / DIRECTIONS for k in range(DIRECTIONS)]
    planes = [UP, (0.0, 0.0, -1.0), *((math.sin(a), math.cos(a), 0.0) for a in azimuths)]
    up, down, *upright = map(light_figure, illuminances_lx(picture, planes))
    glares = glare_indices(picture, azimuths) if image.absolute else [None] * DIRECTIONS
    looks = [_look(*one) for one in zip(azimuths, [heading_rad] * DIRECTIONS, upright, glares, strict=True)]
    # Errors of the planes are not independent, and those of their mean at most the mean of theirs (Minkowski).
    means = {key: sum(light[key] for light in upright) / DIRECTIONS for key in ("value", "uncertainty")}
    bound = "lower" if any(light["bound"] for light in upright) else None
    level = {"height_m": height_m, "level_up": up, "level_down": down}
    brightest = int(np.argmax([light["value"] for light in upright]))
    return {**level, "cylindrical": means | {"bound": bound}, "directions": looks, "brightest": brightest}


def _look(azimuth_rad: float, heading_rad: float | None, light: Figure, glare: Mapping[str, Figure] | None) -> Facts:
    compass = None if heading_rad is None else round(math.degrees(azimuth_rad + heading_rad) % 360, 3)
    look: Facts = {"azimuth_deg": round(math.degrees(azimuth_rad), 6), "compass_deg": compass, "vertical": light}
    return look if glare is None else look | {"glare": _glare(glare), "indices": glare}


def _glare(found: Mapping[str, Figure]) -> Facts:
    rating = next(name for limit, name in CLASSES if found["dgp"]["value"] < limit)
    counted = {"sources": int(found["sources"]["value"]), "faint": found["ev_lx"]["value"] < FAINT_LX}
    return {"dgp": found["dgp"], "rating": rating, "brightest_cd_m2": found["brightest_cd_m2"], **counted}


def surface_figures(image: LuminanceImage, room: RoomModel | None) -> list[Facts]:
    """Return luminance statistics of the whole and, where the room is known, of its surfaces and openings."""
    picture = reduced(image, WIDTH_PX)
    return statistics(picture, solid_angles(picture.geometry), parts_of(room, picture.geometry))


def outdoor_figures(image: LuminanceImage | None, facts: Mapping[str, Any]) -> Facts | None:
    """Return the light on level ground outdoors, with a measured value where one was given; None without a picture."""
    if image is None:
        return None
    measured, light = facts.get("outdoor", {}).get("measured_outdoor_lux"), illuminance_lx(image)
    # What is clipped in a sky is the sun, however little of its light the picture shows.
    bound = {"bound": "lower"} if light.lower_bound else {}
    return {"level_up": light_figure(light) | bound, "measured": measured}


def meter_figures(image: LuminanceImage, facts: Mapping[str, Any], readings_cd_m2: list[float]) -> Facts | None:
    """Return the picture's luminance where the meter looked beside its readings; None where there is no such place.

    ``facts``: the indoor part of the stage calibrate. ``sets_scale`` says that k1 is from these readings: then the
    two agree by construction, and only the readings' own change says anything.
    """
    target = facts.get("target", {})
    if not readings_cd_m2 or "longitude_deg" not in target:
        return None
    towards = math.radians(target["longitude_deg"]), math.radians(target["latitude_deg"])
    spot = Spot(*sighted(image.geometry, *towards))
    try:
        shown = spot_pixels(image.geometry, spot).mean(luminance_map(image))
    except ScaleError:
        return None
    mean = sum(readings_cd_m2) / len(readings_cd_m2)
    off = {"difference_frac": shown / mean - 1 if mean > 0 else None, "drift_frac": facts.get("meter_drift_frac")}
    sets_scale = facts.get("k1_parts", {}).get("given") is None
    return {"readings_cd_m2": readings_cd_m2, "picture_cd_m2": shown, **off, "sets_scale": sets_scale}


def level_ratio(camera: Facts, outdoor: Facts | None) -> Figure | None:
    """Return illuminance on a level plane at the camera over that outdoors: under an overcast sky a daylight factor.

    Both are taken as independent; what their scales have in common makes the ratio's uncertainty smaller than stated.
    """
    if outdoor is None or camera["level_up"] is None or not outdoor["level_up"]["value"] > 0:
        return None
    inside, outside = camera["level_up"], outdoor["level_up"]
    ratio = inside["value"] / outside["value"]
    off = math.hypot(inside["uncertainty"], ratio * outside["uncertainty"]) / outside["value"]
    bound = ((None, "upper"), ("lower", "unknown"))[bool(inside["bound"])][bool(outside["bound"])]
    return {"value": ratio, "uncertainty": off, "bound": bound}


# Pictures as an observer's eye meets them, for Radiance's evalglare; and smaller ones that keep all light.

_FINE = 3  # samples along each side of a pixel of a view


def reduced(image: LuminanceImage, width_px: int) -> LuminanceImage:
    """Return a panorama of at most this width; light is kept, and a pixel of which any part is clipped is clipped.

    Of a square fisheye at most half the width, as it shows half of what is around. Raises `ParameterError` for another
    kind of picture.
    """
    source, half = image.geometry, width_px // 2
    target: Geometry
    if isinstance(source, Fisheye):
        target = replace(source, width_px=half, height_px=half, radius_px=half / 2)
    else:
        target = Equirectangular(width_px, half, panorama_of(image).yaw_rad)
    if source.width_px <= target.width_px:
        return image
    rgb, _ = resample(image.rgb, source, target)
    uncertainty = resample_uncertainty(image.uncertainty, source, target)
    validity = np.zeros(rgb.shape[:2], np.uint8)
    shares = ((Validity.DARK, 0.5), (Validity.REPAIRED, 0.0), (Validity.CLIPPED, 0.0), (Validity.OUTSIDE, 0.5))
    for code, share in shares:
        there = image.validity == code
        if there.any():
            validity[resample(there.astype(np.float32), source, target)[0] > share] = code
    return replace(image, rgb=rgb, uncertainty=uncertainty, validity=validity, geometry=target, ghost=None)


def panorama_of(image: LuminanceImage) -> Equirectangular:
    """Return the geometry of a whole panorama; raise `ParameterError` for another kind of picture."""
    if not isinstance(image.geometry, Equirectangular):
        raise ParameterError("light at the camera needs a whole panorama", advice="give an equirectangular panorama")
    return image.geometry


def eye_view(image: LuminanceImage, azimuth_rad: float, size_px: int = 1000) -> LuminanceImage:
    """Return the half space before someone who looks level towards an azimuth: an equidistant fisheye of 180 degrees.

    Its axis is where the observer looks and the picture's up is the room's up, left is left. The geometry's axes are
    the observer's: its "zenith" is straight ahead, its +y the room's up.
    """
    source = reduced(image, 2 * _FINE * size_px)
    panorama = panorama_of(source)
    target, fine = (Fisheye(n, n, LensMapping.EQUIDISTANT, n / 2) for n in (size_px, _FINE * size_px))
    light = np.zeros((size_px, size_px, 3))
    for row in range(size_px):
        rows = slice(_FINE * row, _FINE * (row + 1))
        found = source.rgb[pixel_of(panorama, _turned(fine, azimuth_rad, rows))]
        light[row] = found.reshape(_FINE, size_px, _FINE, 3).mean(axis=(0, 2), dtype=np.float64)
    if not (np.isfinite(light).all() and light.min() >= 0):
        raise ParameterError("the picture holds values that light cannot have (negative, or not finite)")
    _, seen = directions(target)
    middle = pixel_of(panorama, _turned(target, azimuth_rad))
    rgb = np.where(seen[..., None], light, 0).astype(np.float32)
    uncertainty = np.where(seen, source.uncertainty[middle], np.inf).astype(np.float32)
    validity = np.where(seen, source.validity[middle], Validity.OUTSIDE).astype(np.uint8)
    return replace(source, rgb=rgb, uncertainty=uncertainty, validity=validity, geometry=target, ghost=None)


def _turned(view: Fisheye, azimuth_rad: float, rows: slice | None = None) -> np.ndarray:
    """Return what a view's pixels, or those of rows, see (H, W, 3) when its axis is level and its up is the room's."""
    rays, _ = directions(view, rows)
    sine, cosine = math.sin(azimuth_rad), math.cos(azimuth_rad)
    # A fisheye that looks up has +x on its left.
    ahead, left, up = rays[..., 2:], rays[..., :1], rays[..., 1:2]
    return np.asarray(ahead * [sine, cosine, 0.0] + left * [-cosine, sine, 0.0] + up * [0.0, 0.0, 1.0])

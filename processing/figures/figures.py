"""All light figures of a session as plain values: what the stage figures writes and the report shows."""

import math
import subprocess
from collections.abc import Mapping
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from processing.calibration.scale.luminance import Spot, spot_pixels
from processing.calibration.scale.photometry import Illuminance, illuminance_lx, luminance_map
from processing.errors import ParameterError, ProcessingError, ScaleError
from processing.figures.glare import bright_spots, glare_of
from processing.ground.arrays import Bytes, Doubles, Flags
from processing.ground.room_model import RoomModel
from processing.pictures.images import LuminanceImage, Validity
from processing.pictures.radiance import write_radiance_hdr
from processing.sphere import Equirectangular, Fisheye, LensMapping, directions, solid_angles
from processing.sphere.resampling import resample, resample_uncertainty
from processing.surfaces.maps import planes_of, surface_maps

SIZE_PX = 1000  # chosen
_TIMEOUT_S = 900.0  # chosen


def write_glare_views(folder: Path, name: str, image: LuminanceImage, *, size_px: int = SIZE_PX) -> list[Path]:
    """Write a fisheye of 180 degrees for each direction of the light figures; return their paths in that order."""
    found = []
    for k in range(DIRECTIONS):
        degrees = 360 * k // DIRECTIONS
        path = folder / f"{name}_eye-{degrees:03d}.hdr"
        write_radiance_hdr(path, eye_view(image, math.radians(degrees), size_px))
        found.append(path)
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
        raise ProcessingError(f"evalglare did not answer: {error}", where=view.name) from None
    if "dgp" not in found:
        raise ProcessingError(f"evalglare gave no dgp: {done.stderr.strip()[:200]}", where=view.name)
    return found


# Luminance statistics of a picture's parts, each pixel weighted by its solid angle.


QUANTILES = {"p05": 0.05, "median": 0.5, "p95": 0.95}  # of solid angle


@dataclass(frozen=True)
class PartStatistics:
    """Luminance over a part of the sphere, in the picture's own unit."""

    name: str
    kind: str
    """whole, floor, ceiling, wall, window, door, passage."""
    solid_angle_sr: float
    mean: float
    p05: float
    median: float
    p95: float
    highest: float
    clipped_share: float
    """Of its solid angle: there the values are lower bounds."""

    def to_dict(self) -> dict[str, object]:
        """Return plain values."""
        return asdict(self)


def parts_of(room: RoomModel | None, geometry: Equirectangular) -> list[tuple[str, str, Flags]]:
    """Return name, kind and pixels (H, W) of the whole and, of a room, of its surfaces and openings as they are seen.

    Surfaces that the camera does not see are left out. A wall is counted without its openings.
    """
    found = [("whole", "whole", np.ones((geometry.height_px, geometry.width_px), bool))]
    if room is None:
        return found
    maps = surface_maps(room, geometry)
    for plane in planes_of(room):
        kind = plane.name if plane.name in ("floor", "ceiling") else "wall"
        found.append((plane.name, kind, (maps.plane == plane.index) & (maps.opening < 0)))
    for number, opening in enumerate(room.openings):
        found.append((f"{opening.kind.value}-{number}", opening.kind.value, maps.opening == number))
    return [(name, kind, mask) for name, kind, mask in found if mask.any()]


def statistics(
    luminance: npt.NDArray[np.floating], validity: Bytes, area_sr: Doubles, part: tuple[str, str, Flags]
) -> PartStatistics | None:
    """Return a part's statistics; None where the picture shows nothing of it.

    ``luminance``, ``validity``, ``area_sr``: (H, W), in the picture's unit, codes and steradians.
    """
    name, kind, mask = part
    chosen = mask & (validity != Validity.OUTSIDE) & (area_sr > 0)
    if not chosen.any():
        return None
    values, weights = luminance[chosen].astype(np.float64), area_sr[chosen]
    order = np.argsort(values, kind="stable")
    upto = np.cumsum(weights[order])
    total = float(upto[-1])
    found = {
        key: float(values[order[min(int(np.searchsorted(upto, share * total)), len(order) - 1)]])
        for key, share in QUANTILES.items()
    }
    clipped = float(weights[validity[chosen] == Validity.CLIPPED].sum()) / total
    mean = float(values @ weights) / total
    return PartStatistics(name, kind, total, mean, highest=float(values.max()), clipped_share=clipped, **found)


WIDTH_PX = 2048  # of the panorama that is looked at: a third of a sun's width a pixel
DIRECTIONS = 8  # in which an observer may look, evenly around
LOWER_BOUND = 0.01  # share of clipped light above which a value is called a lower bound

Facts = dict[str, Any]


def camera_figures(image: LuminanceImage, *, height_m: float, heading_rad: float | None) -> Facts:
    """Return the light at the camera: illuminance on level and upright planes, glare in each direction.

    Illuminances are in lx; of a picture without absolute scale in relative units, and then there is no glare, which
    depends on the scale. ``heading_rad``: compass azimuth of the panorama's centre, None where it is not known.
    """
    picture = reduced(image, WIDTH_PX)
    geometry = panorama_of(picture)
    rays, _ = directions(geometry)
    spots = bright_spots(rays, luminance_map(picture), solid_angles(geometry)) if image.absolute else None
    looks: list[Facts] = []
    for k in range(DIRECTIONS):
        azimuth = 2 * math.pi * k / DIRECTIONS
        light = illuminance_lx(picture, (math.sin(azimuth), math.cos(azimuth), 0.0))
        look: Facts = {
            "azimuth_deg": round(math.degrees(azimuth), 6),
            "compass_deg": None if heading_rad is None else round(math.degrees(azimuth + heading_rad) % 360, 3),
            "vertical": _illuminance(light),
        }
        if spots is not None:
            glare = glare_of(spots, light.value_lx, azimuth)
            look["glare"] = {"dgp": glare.dgp, "rating": glare.rating, "sources": glare.sources} | {
                "brightest_cd_m2": glare.brightest_cd_m2,
                "faint": glare.faint,
            }
        looks.append(look)
    upright = [look["vertical"]["value"] for look in looks]
    return {
        "height_m": height_m,
        "level_up": _illuminance(illuminance_lx(picture, (0.0, 0.0, 1.0))),
        "level_down": _illuminance(illuminance_lx(picture, (0.0, 0.0, -1.0))),
        "cylindrical": sum(upright) / len(upright),
        "directions": looks,
        "brightest": int(np.argmax(upright)),
    }


def surface_figures(image: LuminanceImage, room: RoomModel | None) -> list[Facts]:
    """Return luminance statistics of the whole and, where the room is known, of its surfaces and openings."""
    picture = reduced(image, WIDTH_PX)
    geometry = panorama_of(picture)
    luminance, area = luminance_map(picture), solid_angles(geometry)
    found = (statistics(luminance, picture.validity, area, part) for part in parts_of(room, geometry))
    return [one.to_dict() for one in found if one is not None]


def outdoor_figures(image: LuminanceImage | None, facts: Mapping[str, Any]) -> Facts | None:
    """Return the light on level ground outdoors, with a measured value where one was given; None without a picture."""
    if image is None:
        return None
    measured = facts.get("outdoor", {}).get("measured_outdoor_lux")
    return {"level_up": _illuminance(illuminance_lx(image)), "measured": measured}


def meter_figures(image: LuminanceImage, facts: Mapping[str, Any], readings_cd_m2: list[float]) -> Facts | None:
    """Return the picture's luminance where the meter looked beside its readings; None where there is no such place.

    ``facts``: the indoor part of the stage calibrate. ``sets_scale`` says that k1 is from these readings: then the
    two agree by construction, and only the readings' own change says anything.
    """
    target = facts.get("target", {})
    if not readings_cd_m2 or "longitude_deg" not in target:
        return None
    spot = Spot(math.radians(target["longitude_deg"]), math.radians(target["latitude_deg"]))
    try:
        shown = spot_pixels(image.geometry, spot).mean(luminance_map(image))
    except ScaleError:
        return None
    mean = sum(readings_cd_m2) / len(readings_cd_m2)
    return {
        "readings_cd_m2": readings_cd_m2,
        "picture_cd_m2": shown,
        "difference_frac": shown / mean - 1 if mean > 0 else None,
        "drift_frac": facts.get("meter_drift_frac"),
        "sets_scale": facts.get("k1_parts", {}).get("given") is None,
    }


def level_ratio(camera: Facts, outdoor: Facts | None) -> float | None:
    """Return illuminance on a level plane at the camera over that outdoors: under an overcast sky a daylight factor."""
    if outdoor is None or not outdoor["level_up"]["value"] > 0:
        return None
    return float(camera["level_up"]["value"] / outdoor["level_up"]["value"])


def _illuminance(light: Illuminance) -> Facts:
    return {
        "value": light.value_lx,
        "uncertainty": light.uncertainty_lx,
        "clipped_share": light.invalid_shares["clipped"],
        "lower_bound": light.invalid_shares["clipped"] > LOWER_BOUND or light.unseen_share > LOWER_BOUND,
    }


# Pictures as an observer's eye meets them, for Radiance's evalglare; and smaller ones that keep all light.


_FINE = 3  # samples along each side of a pixel of a view


def reduced(image: LuminanceImage, width_px: int) -> LuminanceImage:
    """Return a panorama of at most this width; light is kept, and a pixel of which any part is clipped is clipped.

    Raises `ParameterError` for another kind of picture.
    """
    source = panorama_of(image)
    if source.width_px <= width_px:
        return image
    target = Equirectangular(width_px, width_px // 2, source.yaw_rad)
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
        raise ParameterError("light at the camera needs a whole panorama", advice="give an equirectangular one")
    return image.geometry


def eye_view(image: LuminanceImage, azimuth_rad: float, size_px: int = 1000) -> LuminanceImage:
    """Return the half space before someone who looks level towards an azimuth: an equidistant fisheye of 180 degrees.

    Its axis is where the observer looks and the picture's up is the room's up, left is left. The geometry's axes are
    the observer's: its "zenith" is straight ahead, its +y the room's up.
    """
    source = reduced(image, 2 * _FINE * size_px)
    panorama = panorama_of(source)
    target = Fisheye(size_px, size_px, LensMapping.EQUIDISTANT, size_px / 2)
    _, seen = directions(target)
    total = np.zeros((size_px, size_px, 3))
    for k in range(_FINE**2):
        row, column = _nearest(_turned(_shifted(target, k), azimuth_rad), panorama)
        total += source.rgb[row, column]
    if not (np.isfinite(total).all() and total.min() >= 0):
        raise ParameterError("the picture holds values that light cannot have (negative, or not finite)")
    row, column = _nearest(_turned(target, azimuth_rad), panorama)
    rgb = np.where(seen[..., None], total / _FINE**2, 0).astype(np.float32)
    uncertainty = np.where(seen, source.uncertainty[row, column], np.inf).astype(np.float32)
    validity = np.where(seen, source.validity[row, column], Validity.OUTSIDE).astype(np.uint8)
    return replace(source, rgb=rgb, uncertainty=uncertainty, validity=validity, geometry=target, ghost=None)


def _shifted(target: Fisheye, k: int) -> Fisheye:
    """Return the view whose pixel middles are the k-th part of each of the target's pixels."""
    down, right = ((part + 0.5) / _FINE - 0.5 for part in divmod(k, _FINE))
    # Its circle is a little wider than half the picture, so that shifted middles are still in its field.
    reach = 1 + 2 / target.width_px
    centre = (target.width_px / 2 - right, target.height_px / 2 - down)
    half = target.half_field_rad * reach
    return replace(target, centre_px=centre, radius_px=target.radius_px * reach, half_field_rad=half)


def _turned(view: Fisheye, azimuth_rad: float) -> np.ndarray:
    """Return what a view's pixels see (H, W, 3) when its axis is level and its up is the room's."""
    rays, _ = directions(view)
    sine, cosine = math.sin(azimuth_rad), math.cos(azimuth_rad)
    # A fisheye that looks up has +x on its left.
    ahead, left, up = rays[..., 2:], rays[..., :1], rays[..., 1:2]
    return np.asarray(ahead * [sine, cosine, 0.0] + left * [-cosine, sine, 0.0] + up * [0.0, 0.0, 1.0])


def _nearest(rays: np.ndarray, panorama: Equirectangular) -> tuple[np.ndarray, np.ndarray]:
    """Return row and column of the pixel that each direction falls into: bright edges stay sharp."""
    latitude = np.arcsin(np.clip(rays[..., 2], -1, 1))
    longitude = np.arctan2(rays[..., 0], rays[..., 1]) - panorama.yaw_rad
    row = np.floor((0.5 - latitude / math.pi) * panorama.height_px).astype(np.intp)
    column = np.floor((longitude / (2 * math.pi) + 0.5) * panorama.width_px).astype(np.intp)
    return row.clip(0, panorama.height_px - 1), column % panorama.width_px


# What an observer's eye meets, as files that Radiance's evalglare takes; and what evalglare says of them.

"""Glare indices of what one eye sees, as evalglare defines them; each with its uncertainty.

For an observer who looks along the axis of a picture: Ev the illuminance at the eye, L, w and P luminance, solid angle
and position index of each source, Lb = (Ev - sources') / pi the background. DGI: Hopkinson 1972; UGR: CIE 117; CGI:
Einhorn 1979; VCP: Guth 1963; UGP: Hirning 2014; veiling luminance: Stiles and Holladay (CIE 146).
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace

import numpy as np

from processing.calibration.scale.photometry import illuminance_lx, luminance_map
from processing.errors import ParameterError
from processing.figures.glare import BrightSpots, bright_spots, position_index, probability
from processing.ground.arrays import Doubles
from processing.pictures.images import LuminanceImage
from processing.pictures.modes import modes_of, relative_error
from processing.sphere import Fisheye, directions, solid_angles

TASK_FACTOR = 5.0
"""Times the task's mean luminance above which a pixel may glare (evalglare's -b with -T)."""
_NEAR_DEG = 1.0  # chosen: nearer to the line of sight the formula of veiling light has no meaning
Task = tuple[float, float, float]
"""Right and up of the line of sight, and the cone's whole angle, degrees."""


def eye_rays(geometry: Fisheye) -> Doubles:
    """Return directions (H, W, 3) of a fisheye's pixels for an observer who looks along its axis, +y, with up +z."""
    rays, _ = directions(geometry)
    return np.stack([-rays[..., 0], rays[..., 2], rays[..., 1]], axis=-1)


def glare_indices(image: LuminanceImage, *, task: Task | None = None) -> dict[str, dict[str, float]]:
    """Return each index with value and standard uncertainty: from the scale and from what all pixels share.

    Raises `ParameterError` for a picture that is no fisheye, or a task that the picture does not show.
    """
    geometry = image.geometry
    if not isinstance(geometry, Fisheye):
        raise ParameterError("glare indices need a fisheye picture at the eye", advice="give --view")
    rays, area = eye_rays(geometry), solid_angles(geometry)
    level = luminance_map(image)
    threshold = None if task is None else _task_threshold(rays, level, area, task)
    values = _values(image, rays, area, threshold)
    changed = [_values(replace(image, rgb=image.rgb * np.float32(1 + image.scale_uncertainty)), rays, area, threshold)]
    for mode in modes_of(image):
        factor = np.maximum(1 + relative_error(mode, image, level), 0)
        changed.append(_values(replace(image, rgb=image.rgb * factor[..., None]), rays, area, threshold))
    return {
        name: {"value": value, "uncertainty": math.hypot(*(other[name] - value for other in changed))}
        for name, value in values.items()
    }


def _task_threshold(rays: Doubles, level: np.ndarray, area: Doubles, task: Task) -> float:
    right, up, across = (math.radians(value) for value in task)
    towards = np.array([math.sin(right) * math.cos(up), math.cos(right) * math.cos(up), math.sin(up)])
    inside = (rays @ towards >= math.cos(across / 2)) & (area > 0)
    if not inside.any():
        raise ParameterError(
            "the picture does not show the task's zone", advice="give --task RIGHT,UP,ACROSS in degrees"
        )
    return TASK_FACTOR * float(np.sum(level[inside] * area[inside]) / np.sum(area[inside]))


def _values(image: LuminanceImage, rays: Doubles, area: Doubles, threshold: float | None) -> dict[str, float]:
    level, lux = luminance_map(image), illuminance_lx(image).value_lx
    spots = bright_spots(rays, level, np.where(rays[..., 1] > 0, area, 0.0), threshold)
    mean = float(np.sum(level * area) / max(float(area.sum()), 1e-9))
    return {"ev_lx": lux, "mean_cd_m2": mean, **_formulas(_sources(spots), lux, mean), "sources": float(spots.count)}


def _sources(spots: BrightSpots) -> tuple[Doubles, Doubles, Doubles, Doubles]:
    """Return luminance, solid angle, position index and cosine from the line of sight of each source, (n,)."""
    count = spots.count
    area = np.asarray(np.bincount(spots.source, spots.area_sr, count), np.float64)
    light = spots.area_sr * spots.luminance_cd_m2
    middle = np.stack([np.bincount(spots.source, light * spots.rays[:, k], count) for k in range(3)], axis=-1)
    ways = middle / np.maximum(np.linalg.norm(middle, axis=1, keepdims=True), 1e-30)
    level = np.bincount(spots.source, light, count) / np.maximum(area, 1e-30)
    return level, area, position_index(ways, 0.0), np.asarray(np.clip(ways[:, 1], 0, 1), np.float64)


def _formulas(sources: tuple[Doubles, Doubles, Doubles, Doubles], lux: float, mean: float) -> dict[str, float]:
    level, area, index, cosine = sources
    direct = float(np.sum(level * area * cosine))
    back = max((lux - direct) / math.pi, 1e-6)
    weighed = float(np.sum(level**2 * area / index**2))
    dgi = 0.478 * np.sum(level**1.6 * area**0.8 / index**1.6 / (back + 0.07 * np.sqrt(area) * level))
    cgi = 2 * (1 + direct / 500) / max(direct + math.pi * back, 1e-6) * weighed
    shape = 20.4 * area + 1.52 * area**0.2 - 0.075
    sensation = float(np.sum(0.5 * level * shape / (index * max(mean, 1e-6) ** 0.44)))
    angle = np.degrees(np.arccos(cosine))
    veil = 10 * np.sum(np.where(angle > _NEAR_DEG, level * area * cosine / np.maximum(angle, _NEAR_DEG) ** 2, 0))
    return {
        "dgp": probability(lux, weighed),
        "dgi": _log(10, float(dgi)),
        "ugr": _log(8, 0.25 / back * weighed),
        "cgi": _log(8, cgi),
        "vcp_pct": _comfort(sensation, len(level)),
        "ugp": max(_log(0.26, 0.25 / back * weighed), 0.0),
        "lveil_cd_m2": float(veil),
    }


def _log(factor: float, value: float) -> float:
    return factor * math.log10(value) if value > 1e-9 else 0.0


def _comfort(sensation: float, count: int) -> float:
    """Return how many of a hundred are not disturbed."""
    if count == 0 or sensation <= 0:
        return 100.0
    rating = sensation ** (count**-0.0914)
    return 50 * (1 + math.erf((6.374 - 1.3227 * math.log(rating)) / math.sqrt(2)))


def with_uncertainty(values: Callable[[LuminanceImage], float], image: LuminanceImage) -> tuple[float, float]:
    """Return a figure of a picture and its standard uncertainty by scale and shared modes."""
    level, plain = luminance_map(image), values(image)
    off = [plain * image.scale_uncertainty]
    for mode in modes_of(image):
        factor = np.maximum(1 + relative_error(mode, image, level), 0)
        off.append(values(replace(image, rgb=image.rgb * factor[..., None])) - plain)
    return plain, math.hypot(*off)

"""Glare: daylight glare probability for an observer at the camera (Wienold and Christoffersen 2006), and indices.

DGP = 5.87e-5 Ev + 0.0918 log10(1 + sum L^2 w / (Ev^1.87 P^2)) + 0.16, with the vertical illuminance Ev at the eye and,
of each glare source, luminance L, solid angle w and position index P. It was found for 380 lx and more at the eye;
nothing is done about less, as in evalglare. P above the line of sight is Guth's (IES Lighting Handbook), below it
Iwata's.

A glare source is what is brighter than 2000 cd/m2 (evalglare's own threshold), with what lies within 0.2 rad of it;
the parts above 50,000 cd/m2, the sun and its mirror images, count as sources of their own.

Indices are of what one eye sees, as evalglare defines them, each with its uncertainty; for an observer who looks along
the axis of a picture: Ev, L, w and P as above, Lb = (Ev - sources') / pi the background. DGI: Hopkinson 1972; UGR: CIE
117; CGI: Einhorn 1979; VCP: Guth 1963; UGP: Hirning 2014; veiling luminance: Stiles and Holladay (CIE 146).
"""

import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
import numpy.typing as npt

from processing.calibration.scale.photometry import illuminance_lx, luminance_map
from processing.errors import ParameterError
from processing.ground.arrays import Doubles, Indices
from processing.pictures.images import LuminanceImage
from processing.pictures.modes import modes_of, relative_error
from processing.sphere import Fisheye, directions, solid_angles

THRESHOLD_CD_M2 = 2000.0  # evalglare's -b
PEAK_CD_M2 = 50_000.0  # evalglare's -Y
REACH_RAD = 0.2  # evalglare's -r
MOST_INDEX = 16.0  # evalglare's bound of P
FAINT_LX = 380.0  # at the eye, below which the formula was never tried

CLASSES = ((0.35, "imperceptible"), (0.40, "perceptible"), (0.45, "disturbing"), (math.inf, "intolerable"))
"""Upper ends of what observers say (Wienold 2009)."""

_CELLS = 360  # rows of the grid on which neighbours are found: half a degree each


@dataclass(frozen=True)
class BrightSpots:
    """All pixels of a picture that may glare, each with the source that it belongs to."""

    rays: Doubles
    """(n, 3) unit."""
    luminance_cd_m2: Doubles
    area_sr: Doubles
    source: Indices
    """(n,): 0 .. count - 1."""

    @cached_property
    def count(self) -> int:
        """Return how many sources there are."""
        return int(self.source.max()) + 1 if len(self.source) else 0


@dataclass(frozen=True)
class Glare:
    """What an observer meets who looks one way."""

    dgp: float
    vertical_lx: float
    sources: int
    """How many are in view."""
    brightest_cd_m2: float
    """Mean luminance of the brightest source; 0 where there is none."""

    @property
    def faint(self) -> bool:
        """Return whether there is too little light for the formula."""
        return self.vertical_lx < FAINT_LX

    @property
    def rating(self) -> str:
        """Return what observers call it."""
        return next(name for limit, name in CLASSES if self.dgp < limit)


def bright_spots(
    rays: Doubles, luminance_cd_m2: npt.NDArray[np.floating], area_sr: Doubles, threshold_cd_m2: float | None = None
) -> BrightSpots:
    """Return what may glare of a picture: directions (H, W, 3), luminance (H, W), solid angles (H, W).

    ``threshold_cd_m2`` None: 2000 cd/m2.
    """
    bright = (luminance_cd_m2 > (threshold_cd_m2 or THRESHOLD_CD_M2)) & (area_sr > 0)
    towards, level = rays[bright], luminance_cd_m2[bright].astype(np.float64)
    source = np.zeros(len(level), np.intp)
    peak = level > PEAK_CD_M2
    source[~peak] = linked(towards[~peak], REACH_RAD)
    if peak.any():
        first = int(source[~peak].max()) + 1 if (~peak).any() else 0
        source[peak] = first + linked(towards[peak], REACH_RAD)
    return BrightSpots(towards, level, area_sr[bright], source)


def linked(rays: Doubles, reach_rad: float) -> Indices:
    """Return for directions (n, 3) the number of the group that each is in; groups lie more than ``reach_rad`` apart.

    To the half degree of a grid over the sphere. ``rays``: unit vectors of shape (N, 3).
    """
    from scipy.ndimage import label
    from scipy.spatial import cKDTree

    if not len(rays):
        return np.zeros(0, np.intp)
    row, column = _cells(rays)
    used = np.zeros((_CELLS, 2 * _CELLS), bool)
    used[row, column] = True
    latitude = (0.5 - (np.arange(_CELLS) + 0.5) / _CELLS) * math.pi
    longitude = ((np.arange(2 * _CELLS) + 0.5) / (2 * _CELLS) - 0.5) * 2 * math.pi
    flat = np.cos(latitude)[:, None]
    parts = (flat * np.sin(longitude), flat * np.cos(longitude), np.sin(latitude)[:, None] + 0 * longitude)
    middles = np.stack(parts, axis=-1)
    chord = 2 * math.sin(reach_rad / 4)
    far, _ = cKDTree(middles[used]).query(middles.reshape(-1, 3), distance_upper_bound=chord)
    labels, count = label(np.isfinite(far).reshape(used.shape), np.ones((3, 3)))
    _, number = np.unique(_joined(labels, count)[labels[row, column]], return_inverse=True)
    return np.asarray(number, dtype=np.intp)


def _joined(labels: npt.NDArray[np.integer], count: int) -> Indices:
    """Return the group of each label, joined over the seam and the poles."""
    group = np.arange(count + 1)
    pairs = [(labels[:, 0], labels[:, -1]), (labels[1:, 0], labels[:-1, -1]), (labels[:-1, 0], labels[1:, -1])]
    pairs += [(np.full_like(labels[pole], labels[pole].max()), labels[pole]) for pole in (0, -1)]
    for left, right in pairs:
        for a, b in zip(left, right, strict=True):
            if a and b and group[a] != group[b]:
                group[group == group[b]] = group[a]
    return group


def _cells(rays: Doubles) -> tuple[Indices, Indices]:
    latitude = np.arcsin(np.clip(rays[:, 2], -1, 1))
    longitude = np.arctan2(rays[:, 0], rays[:, 1])
    row = np.floor((0.5 - latitude / math.pi) * _CELLS).astype(np.intp).clip(0, _CELLS - 1)
    return row, np.floor((0.5 + longitude / (2 * math.pi)) * 2 * _CELLS).astype(np.intp) % (2 * _CELLS)


def glare_of(spots: BrightSpots, vertical_lx: float, azimuth_rad: float) -> Glare:
    """Return the glare for someone upright who looks level towards an azimuth (from +y towards +x).

    ``vertical_lx``: illuminance at the eye, on a plane facing that way.
    Raises `ParameterError`: an illuminance that is negative or no number.
    """
    if not (math.isfinite(vertical_lx) and vertical_lx >= 0):
        raise ParameterError(f"an illuminance of {vertical_lx} lx")
    seen = spots.rays @ np.array([math.sin(azimuth_rad), math.cos(azimuth_rad), 0.0]) > 0
    area = np.bincount(spots.source[seen], spots.area_sr[seen], spots.count)
    light = np.bincount(spots.source[seen], (spots.area_sr * spots.luminance_cd_m2)[seen], spots.count)
    weights = (spots.area_sr * spots.luminance_cd_m2)[seen]
    middle = np.stack([np.bincount(spots.source[seen], weights * spots.rays[seen, k], spots.count) for k in range(3)])
    there = area > 0
    level = light[there] / area[there]
    index = position_index((middle[:, there] / np.linalg.norm(middle[:, there], axis=0)).T, azimuth_rad)
    total = float((level**2 * area[there] / index**2).sum())
    dgp = probability(vertical_lx, total)
    return Glare(dgp, vertical_lx, int(there.sum()), float(level.max()) if there.any() else 0.0)


def probability(vertical_lx: float, sources: float) -> float:
    """Return DGP (0 to 1) of the illuminance at the eye and the sum of L^2 w / P^2 over sources."""
    if vertical_lx <= 0:
        return 0.0
    return min(5.87e-5 * vertical_lx + 0.0918 * math.log10(1 + sources / vertical_lx**1.87) + 0.16, 1.0)


def position_index(rays: Doubles, azimuth_rad: float) -> Doubles:
    """Return how little a source in each direction (n, 3), ahead of the observer, disturbs: 1 ahead to 16.

    ``rays``: unit vectors of shape (N, 3); the result has shape (N,).
    """
    sine, cosine = math.sin(azimuth_rad), math.cos(azimuth_rad)
    ahead = np.clip(rays @ np.array([sine, cosine, 0.0]), 1e-9, 1)
    aside, up = np.abs(rays @ np.array([cosine, -sine, 0.0])), rays[:, 2]
    sigma = np.degrees(np.arccos(ahead))
    tau = np.degrees(np.arctan2(aside, up))
    steep = (35.2 - 0.31889 * tau - 1.22 * np.exp(-2 * tau / 9)) / 1000 * sigma
    guth = np.exp(steep + (21 + 0.26667 * tau - 0.002963 * tau**2) / 100_000 * sigma**2)
    away = np.hypot(aside, up) / ahead
    iwata = 1 + np.where(away > 0.6, 1.2, 0.8) * np.minimum(away, 3)
    return np.asarray(np.minimum(np.where(up < 0, iwata, guth), MOST_INDEX))


TASK_FACTOR = 5.0  # times the task's mean luminance above which a pixel may glare (evalglare's -b with -T)
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
        raise ParameterError("the picture lacks the task's zone", advice="give --task RIGHT,UP,ACROSS in degrees")
    return TASK_FACTOR * float(np.sum(level[inside] * area[inside]) / np.sum(area[inside]))


def _values(image: LuminanceImage, rays: Doubles, area: Doubles, threshold: float | None) -> dict[str, float]:
    level, lux = luminance_map(image), illuminance_lx(image).value_lx
    spots = bright_spots(rays, level, np.where(rays[..., 1] > 0, area, 0.0), threshold)
    mean = float(np.sum(level * area) / max(float(area.sum()), 1e-9))
    return {"ev_lx": lux, "mean_cd_m2": mean, **_formulas(_sources(spots), lux, mean), "sources": float(spots.count)}


def _sources(spots: BrightSpots) -> tuple[Doubles, Doubles, Doubles, Doubles, Doubles]:
    """Return each source's luminance, solid angle, position index, mean cosine and degrees off the sight, all (n,)."""
    count = spots.count
    area = np.asarray(np.bincount(spots.source, spots.area_sr, count), np.float64)
    light = spots.area_sr * spots.luminance_cd_m2
    middle = np.stack([np.bincount(spots.source, light * spots.rays[:, k], count) for k in range(3)], axis=-1)
    ways = middle / np.maximum(np.linalg.norm(middle, axis=1, keepdims=True), 1e-30)
    total = np.bincount(spots.source, light, count)
    level, cosine = total / np.maximum(area, 1e-30), np.clip(middle[:, 1] / np.maximum(total, 1e-30), 0, 1)
    return level, area, position_index(ways, 0.0), cosine, np.degrees(np.arccos(np.clip(ways[:, 1], 0, 1)))


def _formulas(sources: tuple[Doubles, ...], lux: float, mean: float) -> dict[str, float]:
    level, area, index, cosine, angle = sources
    direct = float(np.sum(level * area * cosine))
    back = max((lux - direct) / math.pi, 1e-6)
    weighed = float(np.sum(level**2 * area / index**2))
    dgi = 0.478 * np.sum(level**1.6 * area**0.8 / index**1.6 / (back + 0.07 * np.sqrt(area) * level))
    cgi = 2 * (1 + direct / 500) / max(direct + math.pi * back, 1e-6) * weighed
    shape = 20.4 * area + 1.52 * area**0.2 - 0.075
    sensation = float(np.sum(0.5 * level * shape / (index * max(mean, 1e-6) ** 0.44)))
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

"""Daylight glare probability for an observer at the camera (Wienold and Christoffersen 2006).

DGP = 5.87e-5 Ev + 0.0918 log10(1 + sum L^2 w / (Ev^1.87 P^2)) + 0.16, with the vertical illuminance Ev at the eye and,
of each glare source, luminance L, solid angle w and position index P. It was found for 380 lx and more at the eye;
nothing is done about less, as in evalglare. P above the line of sight is Guth's (IES Lighting Handbook), below it
Iwata's.

A glare source is what is brighter than 2000 cd/m2 (evalglare's own threshold), with what lies within 0.2 rad of it;
the parts above 50,000 cd/m2, the sun and its mirror images, count as sources of their own.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property

import numpy as np
import numpy.typing as npt

from processing.errors import ParameterError
from processing.ground.arrays import Doubles, Indices

THRESHOLD_CD_M2 = 2000.0  # evalglare's -b
PEAK_CD_M2 = 50_000.0  # evalglare's -Y
REACH_RAD = 0.2  # evalglare's -r
MOST_INDEX = 16.0  # evalglare's bound of P
FAINT_LX = 380.0
"""At the eye, below which the formula was never tried."""

CLASSES = ((0.35, "imperceptible"), (0.40, "perceptible"), (0.45, "disturbing"), (math.inf, "intolerable"))
"""Upper ends of what observers say (Wienold 2009)."""

_CELLS = 360
"""Rows of the grid on which neighbours are found: half a degree each."""


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
    middles = _cell_middles()
    chord = 2 * math.sin(reach_rad / 4)
    far, _ = cKDTree(middles[used]).query(middles.reshape(-1, 3), distance_upper_bound=chord)
    labels, count = label(np.isfinite(far).reshape(used.shape), np.ones((3, 3)))
    group = _joined(labels, count)
    _, number = np.unique(group[labels[row, column]], return_inverse=True)
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


def _cell_middles() -> Doubles:
    latitude = (0.5 - (np.arange(_CELLS) + 0.5) / _CELLS) * math.pi
    longitude = ((np.arange(2 * _CELLS) + 0.5) / (2 * _CELLS) - 0.5) * 2 * math.pi
    flat = np.cos(latitude)[:, None]
    parts = (flat * np.sin(longitude), flat * np.cos(longitude), np.sin(latitude)[:, None] + 0 * longitude)
    return np.stack(parts, axis=-1)


def glare_of(spots: BrightSpots, vertical_lx: float, azimuth_rad: float) -> Glare:
    """Return the glare for someone upright who looks level towards an azimuth (from +y towards +x).

    Parameters
    ----------
    vertical_lx
        Illuminance at the eye, on a plane facing that way.

    Raises
    ------
    ParameterError
        An illuminance that is negative or no number.
    """
    if not (math.isfinite(vertical_lx) and vertical_lx >= 0):
        raise ParameterError(f"an illuminance of {vertical_lx} lx")
    ahead = np.array([math.sin(azimuth_rad), math.cos(azimuth_rad), 0.0])
    seen = spots.rays @ ahead > 0
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
    found = 5.87e-5 * vertical_lx + 0.0918 * math.log10(1 + sources / vertical_lx**1.87) + 0.16
    return min(found, 1.0)


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

"""What the boundaries say of each column: how far away the wall is, by the floor and by the ceiling.

A wall is a line in the plan; over the azimuth its inverse distance is 1/r = a sin(azimuth) + b cos(azimuth), and so
are the tangents of both boundaries, tan(-floor) = camera height / r and tan(ceiling) = (ceiling - camera) / r. All
fitting is done in these inverse distances: linear, finite, and with errors that are nearly the picture's own.
"""

import math
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from processing.errors import ParameterError
from processing.ground.arrays import Doubles, weighted_median
from processing.segmentation.evidence import BoundaryEvidence

COLUMNS = 192  # columns that are fitted: 1.9 degrees each; networks see no more
ERRING_TOGETHER = 1.8
"""Factor on stated uncertainties: neighbouring columns err together, and are counted each for itself."""
LEAST_SIGMA_RAD = math.radians(0.25)
LARGEST_SIGMA_RAD = math.radians(30.0)
STEEPEST_RAD = math.radians(86.0)
FLATTEST_RAD = math.radians(1.5)
"""Latitudes of boundaries are held within these: beyond, a wall touches the camera or stands 40 m away."""
RATIO_RANGE = (0.15, 10.0)  # of the ceiling's height over the camera to the camera's over the floor; 10: 17.6 m
RATIO_SIGMA = 0.05  # of the ratio's logarithm, with which a fit begins


@dataclass(frozen=True)
class Columns:
    """Inverse distances of the wall (1 / camera heights) in n columns, by floor and by ceiling, with uncertainties."""

    azimuth_rad: Doubles
    floor: Doubles
    floor_sigma: Doubles
    ceiling: Doubles
    """tan(ceiling): inverse distance times the ratio of the heights."""
    ceiling_sigma: Doubles
    corner: Doubles
    """0..1."""
    ratio: float
    """Ceiling over camera to camera over floor, as these columns say."""
    ratio_spread: float
    """Robust relative spread of the columns' ratios: how well floor and ceiling agree."""
    ratio_sigma: float = RATIO_SIGMA


def columns_of(evidence: BoundaryEvidence, count: int = COLUMNS) -> Columns:
    """Return boundaries as inverse distances in ``count`` columns.

    Raises `ParameterError`: arrays of different lengths or fewer than 16, values that are not finite, boundaries on the
    wrong side.
    """
    check_boundary(evidence)
    floor, floor_sigma = _resampled(-evidence.floor_rad, evidence.floor_sigma_rad, count)
    ceiling, ceiling_sigma = _resampled(evidence.ceiling_rad, evidence.ceiling_sigma_rad, count)
    ratio, spread = height_ratio(floor, floor_sigma, ceiling, ceiling_sigma)
    return Columns(
        azimuth_rad=((np.arange(count) + 0.5) / count - 0.5) * (2 * math.pi),
        floor=np.tan(floor),
        floor_sigma=floor_sigma / np.cos(floor) ** 2,
        ceiling=np.tan(ceiling),
        ceiling_sigma=ceiling_sigma / np.cos(ceiling) ** 2,
        corner=_largest(np.asarray(evidence.corner, np.float64), count),
        ratio=ratio,
        ratio_spread=spread,
    )


def check_boundary(evidence: BoundaryEvidence) -> None:
    """Raise `ParameterError` for boundaries that cannot be: see `columns_of`."""
    sigmas = evidence.ceiling_sigma_rad, evidence.floor_sigma_rad
    arrays = (evidence.ceiling_rad, evidence.floor_rad, *sigmas, evidence.corner)
    shapes = {np.shape(a) for a in arrays}
    if len(shapes) != 1 or len(next(iter(shapes))) != 1 or len(arrays[0]) < 16:
        raise ParameterError(f"boundaries of shapes {sorted(shapes)}", advice="give (n,) each, n of at least 16")
    if not all(np.isfinite(a).all() for a in arrays[:2]):
        raise ParameterError("boundaries that are not finite", likely="NaN from a network")
    if not all((np.asarray(a) > 0).all() for a in arrays[2:4]):
        raise ParameterError("uncertainties of boundaries must be above 0", advice="give inf where nothing is known")
    if (np.asarray(arrays[0]) <= 0).mean() > 0.5 or (np.asarray(arrays[1]) >= 0).mean() > 0.5:
        likely = "up and down are exchanged, or latitudes are in pixels"
        raise ParameterError("ceiling boundaries below or floor boundaries above the horizon", likely=likely)


def height_ratio(
    floor_rad: Doubles, floor_sigma: Doubles, ceiling_rad: Doubles, ceiling_sigma: Doubles
) -> tuple[float, float]:
    """Return the median of tan(ceiling) / tan(floor), weighted by uncertainties, and its spread; all (N,) in rad."""
    logs = np.log(np.tan(ceiling_rad) / np.tan(floor_rad))
    sigma = np.hypot(2 * floor_sigma / np.sin(2 * floor_rad), 2 * ceiling_sigma / np.sin(2 * ceiling_rad))
    weights = 1 / (sigma**2 + 0.05**2)
    middle = float(weighted_median(logs, weights))
    spread = 1.4826 * float(weighted_median(np.abs(logs - middle), weights))
    return float(np.clip(math.exp(middle), *RATIO_RANGE)), spread


def _resampled(latitude: Doubles, sigma: npt.ArrayLike, count: int) -> tuple[Doubles, Doubles]:
    """Return |latitudes| and uncertainties in ``count`` columns: weighted means of what falls into each."""
    spread = np.clip(ERRING_TOGETHER * np.asarray(sigma, np.float64), LEAST_SIGMA_RAD, LARGEST_SIGMA_RAD)
    # Errors of neighbours are alike: uncertainties are averaged, not reduced.
    weights = 1 / spread**2
    total = _binned(weights, count)
    held = np.clip(np.asarray(latitude, np.float64), FLATTEST_RAD, STEEPEST_RAD)
    return _binned(held * weights, count) / total, np.sqrt(1 / total)


def _binned(values: Doubles, count: int) -> Doubles:
    """Return the means of ``values`` over ``count`` equal parts of the turn, by exact overlap."""
    n = len(values)
    running = np.concatenate([[0.0], np.cumsum(values)])
    edges = np.interp(np.arange(count + 1) * (n / count), np.arange(n + 1), running)
    return np.asarray(np.diff(edges) * (count / n))


def _largest(values: Doubles, count: int) -> Doubles:
    """Return the largest value in each of ``count`` parts."""
    n = len(values)
    starts = np.floor(np.arange(count) * n / count).astype(int)
    ends = np.maximum(np.ceil((np.arange(count) + 1) * n / count).astype(int), starts + 1)
    return np.array([values[a:b].max() for a, b in zip(starts, ends, strict=True)])

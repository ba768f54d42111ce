"""Walls fitted to boundaries: all parameters of an outline at once, robustly, and what the fit is worth."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from processing.ground.arrays import Doubles
from processing.room.columns import Columns
from processing.room.outline import Outline, polygon_of, values_of, with_values
from processing.surfaces.sight import wall_ranges

CAP = 3.0
"""Standard deviations beyond which a column counts as unexplained."""
BROKEN = 1e3
"""Residual of an outline that is no room."""
AZIMUTH_SIGMA_RAD = math.radians(0.7)
RATIO_SIGMA = 0.05
CHANGE_SIGMA = 0.5
"""Of the logarithm of distances: a weak tie that keeps walls which few columns see."""
MOST_ROUNDS = 12


@dataclass(frozen=True)
class Fit:
    """An outline fitted to boundaries."""

    outline: Outline
    polygon: Doubles
    """(n, 2), counter-clockwise, in camera heights."""
    cost: float
    """Sum over columns of the capped squared residuals of both boundaries, in standard deviations."""
    unexplained: float
    """Share of columns beyond `CAP`."""


def residuals(polygon: Doubles, ratio: float, columns: Columns) -> Doubles:
    """Return (2, n): predicted less found inverse distances, by floor and ceiling, in standard deviations."""
    distance, _ = wall_ranges(polygon, columns.azimuth_rad)
    inverse = 1 / np.maximum(distance, 1e-3)
    return np.stack(
        [(inverse - columns.floor) / columns.floor_sigma, (inverse * ratio - columns.ceiling) / columns.ceiling_sigma]
    )


def cost_of(polygon: Doubles, ratio: float, columns: Columns) -> tuple[float, float]:
    """Return the capped cost and the share of unexplained columns."""
    found = np.minimum(np.abs(residuals(polygon, ratio, columns)), CAP)
    return float((found**2).sum()), float((found >= CAP).any(axis=0).mean())


def fitted(outline: Outline, columns: Columns, *, rounds: int = MOST_ROUNDS) -> Fit | None:
    """Return an outline with its walls where the columns say, by Gauss-Newton with robust weights; None if no room.

    Steps that break the room (walls that cross, a camera outside) are shortened.
    """
    values = values_of(outline)
    start, scale = values.copy(), _tie_sigmas(outline, values)
    polygon = polygon_of(outline)
    if polygon is None:
        return None
    best = _objective(outline, values, start, scale, columns)
    for _ in range(rounds):
        step = _step(outline, values, start, scale, columns)
        if step is None:
            break
        size = 1.0
        while size > 0.05:
            tried = _objective(outline, values + size * step, start, scale, columns)
            if tried < best:
                break
            size /= 2
        else:
            break
        values = values + size * step
        gain, best = best - tried, tried
        if gain < 1e-3 * max(best, 1.0):
            break
    found = with_values(outline, values)
    polygon = polygon_of(found)
    if polygon is None:
        return None
    cost, unexplained = cost_of(polygon, found.ratio, columns)
    return Fit(found, polygon, cost, unexplained)


def _tie_sigmas(outline: Outline, values: Doubles) -> Doubles:
    count = len(outline.walls)
    distances = np.maximum(np.abs(values[2 : 2 + count]), 0.3) * CHANGE_SIGMA
    free = np.full(len(values) - 2 - count, 0.3)
    return np.concatenate([[AZIMUTH_SIGMA_RAD, RATIO_SIGMA], distances, free])


def _plain(outline: Outline, values: Doubles, columns: Columns) -> Doubles | None:
    moved = with_values(outline, values)
    polygon = polygon_of(moved)
    return None if polygon is None else residuals(polygon, moved.ratio, columns).ravel()


def _objective(outline: Outline, values: Doubles, start: Doubles, scale: Doubles, columns: Columns) -> float:
    found = _plain(outline, values, columns)
    if found is None:
        return math.inf
    squared = (found / CAP) ** 2
    # Geman-McClure: as the cap of the final cost, but smooth.
    return float(CAP**2 * (squared / (1 + squared)).sum() + (((values - start) / scale) ** 2).sum())


def _step(outline: Outline, values: Doubles, start: Doubles, scale: Doubles, columns: Columns) -> Doubles | None:
    found = _plain(outline, values, columns)
    if found is None:
        return None
    slopes = np.zeros((len(found), len(values)))
    for k in range(len(values)):
        nudge = np.zeros(len(values))
        nudge[k] = 1e-4
        moved = _plain(outline, values + nudge, columns)
        if moved is not None:
            slopes[:, k] = (moved - found) / 1e-4
    # Columns at corners and edges of occlusion jump; their slopes mean nothing.
    slopes[(np.abs(slopes) > BROKEN).any(axis=1)] = 0.0
    weight = 1 / (1 + (found / CAP) ** 2) ** 2
    normal = slopes.T @ (slopes * weight[:, None]) + np.diag(1 / scale**2)
    right = slopes.T @ (weight * found) + (values - start) / scale**2
    return np.asarray(-np.linalg.solve(normal + 1e-9 * np.eye(len(values)), right))

"""Which walls explain the columns: the cheapest division of the turn into stretches that each show one wall.

Each stretch is a wall fitted robustly to the inverse distances of its columns (`processing.room.columns`); a division
pays for every wall and is paid back by explaining columns. Exact over all divisions by dynamic programming; columns
that a wall does not explain (a doorway to another room, a mirror) cost a fixed amount and so may stay unexplained.
"""

from __future__ import annotations

from processing.ground.arrays import Doubles

from dataclasses import dataclass
from typing import Any

import numba as nb
import numpy as np
import numpy.typing as npt

from processing.room.columns import Columns


ALONG_X, ALONG_Y, FREE = 0, 1, 2
"""Kinds of wall, in axes turned by the walls' azimuth: seen at +-90 degrees, at 0 or 180 degrees, or at any angle."""
LEAST_COLUMNS = 3
CAP = 3.0
"""Standard deviations beyond which a column is unexplained."""
ROUNDS = 4
STARTS = 24


@dataclass(frozen=True)
class Stretch:
    """Columns first .. first + count - 1 (counted on around the turn) that show one wall: 1/r = a sin + b cos."""

    first: int
    count: int
    kind: int
    a: float
    b: float


@dataclass(frozen=True)
class Costs:
    """Of every stretch: ``cost`` (kinds, n, longest + 1) by first column and number of columns, and its fit."""

    cost: Doubles
    fit: Doubles
    """(kinds, n, longest + 1, 2)."""


def stretch_costs(columns: Columns, turned_rad: float, kinds: tuple[int, ...] = (ALONG_X, ALONG_Y, FREE)) -> Costs:
    """Return what each stretch of columns costs as one wall, in axes turned by ``turned_rad`` (walls' azimuth)."""
    n = len(columns.azimuth_rad)
    longest = n // 2 - 2
    cost = np.full((3, n, longest + 1), np.inf)
    fit = np.zeros((3, n, longest + 1, 2))
    angle = columns.azimuth_rad - turned_rad
    values = np.concatenate([columns.floor, columns.ceiling / columns.ratio])
    sigma = np.concatenate([columns.floor_sigma, columns.ceiling_sigma / columns.ratio])
    basis = np.tile(np.stack([np.sin(angle), np.cos(angle)], axis=-1), (2, 1))
    for kind in kinds:
        _fit_all(values, 1 / sigma, basis, kind, n, cost[kind], fit[kind])
    return Costs(cost, fit)


@nb.njit(cache=True, nogil=True)
def _fit_all(values: Any, weight: Any, basis: Any, kind: int, n: int, cost: Any, fit: Any) -> None:
    longest = cost.shape[1] - 1
    for first in range(n):
        for count in range(LEAST_COLUMNS, longest + 1):
            a, b, total, whole = _fit_one(values, weight, basis, kind, n, first, count)
            if whole:
                cost[first, count] = total
                fit[first, count, 0] = a
                fit[first, count, 1] = b


@nb.njit(cache=True, nogil=True)
def _fit_one(values: Any, weight: Any, basis: Any, kind: int, n: int, first: int, count: int) -> Any:
    """Return a, b, the capped cost, and whether the wall is before the camera in all columns."""
    a, b, total = 0.0, 0.0, 0.0
    for round_ in range(ROUNDS + 1):
        ss, sc, cc, qs, qc, total = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
        for k in range(2 * count):
            i = (first + k % count) % n + (n if k >= count else 0)
            s, c = basis[i, 0], basis[i, 1]
            w = weight[i] * weight[i]
            if round_ > 0:
                residual = (values[i] - a * s - b * c) * weight[i] / CAP
                squared = residual * residual
                total += CAP * CAP * min(squared, 1.0)
                w /= (1.0 + squared) ** 2
            ss += w * s * s
            sc += w * s * c
            cc += w * c * c
            qs += w * values[i] * s
            qc += w * values[i] * c
        if round_ < ROUNDS:
            if kind == 0:
                a, b = qs / max(ss, 1e-30), 0.0
            elif kind == 1:
                a, b = 0.0, qc / max(cc, 1e-30)
            else:
                determinant = ss * cc - sc * sc
                if determinant < 1e-9 * (ss + cc) ** 2:
                    return 0.0, 0.0, 0.0, False
                a, b = (qs * cc - qc * sc) / determinant, (qc * ss - qs * sc) / determinant
    start, end = first % n, (first + count - 1) % n
    whole = a * basis[start, 0] + b * basis[start, 1] > 1e-3 and a * basis[end, 0] + b * basis[end, 1] > 1e-3
    return a, b, total, whole


def divide(costs: Costs, corner: Doubles, price: float, kinds: dict[int, float]) -> tuple[float, list[Stretch]]:
    """Return the cheapest division of the turn and its cost; ([], inf) where there is none.

    ``price`` is paid for each wall, less where a corner is likely (``corner``, 0..1); ``kinds`` adds a price by kind.
    """
    best_kind, best = _cheapest_kinds(costs.cost, kinds)
    n = len(corner)
    around = np.maximum(corner, np.maximum(np.roll(corner, 1), np.roll(corner, -1)))
    # A stretch begins at the left border of its first column.
    begin = price * (1.4 - 0.8 * np.maximum(around, np.roll(around, 1)))
    likely = np.argsort(-corner)[: STARTS - 8]
    starts = np.unique(np.concatenate([likely, (likely + 1) % n, np.arange(8) * n // 8]))
    found = (np.inf, -1, np.zeros(0, np.int64))
    for start in starts:
        total, back = _walk(best, begin, int(start))
        if total < found[0]:
            found = (float(total), int(start), back)
    total, start, back = found
    if start < 0:
        return np.inf, []
    stretches, end = [], n
    while end > 0:
        first = int(back[end])
        column, count = (start + first) % n, end - first
        kind = int(best_kind[column, count])
        a, b = costs.fit[kind, column, count]
        stretches.append(Stretch(column, count, kind, float(a), float(b)))
        end = first
    return total, stretches[::-1]


def _cheapest_kinds(cost: Doubles, kinds: dict[int, float]) -> tuple[npt.NDArray[np.intp], Doubles]:
    priced = np.full(cost.shape, np.inf)
    for kind, extra in kinds.items():
        priced[kind] = cost[kind] + extra
    return priced.argmin(axis=0), priced.min(axis=0)


@nb.njit(cache=True, nogil=True)
def _walk(cost: Any, begin: Any, start: int) -> Any:
    """Return the least cost of dividing the turn from a column on, and where the stretch before each end begins."""
    n, longest = cost.shape[0], cost.shape[1] - 1
    best = np.full(n + 1, np.inf)
    back = np.zeros(n + 1, np.int64)
    best[0] = 0.0
    for end in range(1, n + 1):
        for count in range(LEAST_COLUMNS, min(longest, end) + 1):
            column = (start + end - count) % n
            total = best[end - count] + cost[column, count] + begin[column]
            if total < best[end]:
                best[end] = total
                back[end] = end - count
    return best[n], back

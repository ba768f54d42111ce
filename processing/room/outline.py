"""A room's floor as walls in order, and the polygon that they make.

Walls are lines n.p = distance with the normal pointing out of the room; some are not seen (the side of a recess that
turns its back). Corners are where neighbours meet. Lengths are in camera heights, so that nothing depends on scale.
"""

import math
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from processing.ground.arrays import Doubles
from processing.ground.kernels import compiled, inner
from processing.room.columns import Columns

# Which walls explain the columns: the cheapest division of the turn into stretches that each show one wall.
#
# Each stretch is a wall fitted robustly to the inverse distances of its columns (`processing.room.columns`); a division
# pays for every wall and is paid back by explaining columns. Exact over all divisions by dynamic programming; columns
# that a wall does not explain (a doorway to another room, a mirror) cost a fixed amount and so may stay unexplained.
ALONG_X, ALONG_Y, FREE = 0, 1, 2
"""Kinds of wall, in axes turned by the walls' azimuth: seen at +-90 degrees, at 0 or 180 degrees, or at any angle."""
LEAST_COLUMNS = 3  # of the shortest wall; chosen, never swept
CAP = 3.0  # standard deviations beyond which a column is unexplained
ROUNDS = 4  # chosen, never swept
STARTS = 24  # columns at which a turn may begin, eight of them evenly around; chosen, never swept


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
    """Of every stretch: ``cost`` (KINDS, N, LONGEST + 1) by first column and number of columns, and its fit."""

    cost: Doubles
    fit: Doubles
    """(KINDS, N, LONGEST + 1, 2)."""


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


@compiled
def _fit_all(values: Any, weight: Any, basis: Any, kind: int, n: int, cost: Any, fit: Any) -> None:
    longest = cost.shape[1] - 1
    for first in range(n):
        for count in range(LEAST_COLUMNS, longest + 1):
            a, b, total, whole = _fit_one(values, weight, basis, kind, n, first, count)
            if whole:
                cost[first, count] = total
                fit[first, count, 0] = a
                fit[first, count, 1] = b


@inner
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

    ``price`` is paid for each wall, less where a corner is likely (``corner`` (N,), 0..1); ``kinds`` adds some by kind.
    """
    priced = np.full(costs.cost.shape, np.inf)
    for kind, extra in kinds.items():
        priced[kind] = costs.cost[kind] + extra
    best_kind, best = priced.argmin(axis=0), priced.min(axis=0)
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


@compiled
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


NEARLY_PARALLEL = math.sin(math.radians(12.0))
SAME_WALL = 0.05  # relative difference of distances below which parallel neighbours are one wall
MEETING = 0.22  # relative difference of distances at a border up to which two walls are taken to meet there


@dataclass(frozen=True)
class Wall:
    """A line in the plan; ``kind`` ALONG_X and ALONG_Y have normals at multiples of 90 degrees from the azimuth."""

    kind: int
    normal_rad: float
    """Azimuth of the outward normal, from the walls' azimuth; fixed but for FREE."""
    distance: float
    """Along the normal, in camera heights; negative for walls that turn their back."""
    seen: bool = True


@dataclass(frozen=True)
class Outline:
    """Walls clockwise seen from above (by azimuth), in axes turned by ``turned_rad``, and the heights' ratio."""

    walls: tuple[Wall, ...]
    turned_rad: float
    ratio: float
    """Ceiling over camera to camera over floor."""


def corners_of(outline: Outline) -> Doubles:
    """Return corner i, where wall i - 1 meets wall i, (N, 2) in the world's axes, clockwise; NaN if parallel."""
    angle = np.array([w.normal_rad for w in outline.walls]) + outline.turned_rad
    distance = np.array([w.distance for w in outline.walls])
    nx, ny = np.sin(angle), np.cos(angle)
    px, py, before = np.roll(nx, 1), np.roll(ny, 1), np.roll(distance, 1)
    determinant = px * ny - py * nx
    with np.errstate(divide="ignore", invalid="ignore"):
        x = (before * ny - distance * py) / determinant
        y = (distance * px - before * nx) / determinant
    corners = np.stack([x, y], axis=-1)
    corners[np.abs(determinant) < 1e-9] = np.nan
    return corners


def polygon_of(outline: Outline) -> Doubles | None:
    """Return the corners (K, 2) counter-clockwise, in camera heights; None where walls make no room."""
    if len(outline.walls) < 3:
        return None
    corners = corners_of(outline)
    if not np.isfinite(corners).all() or np.abs(corners).max() > 60.0:
        return None
    floor = corners[::-1]
    return floor if _encloses(floor) else None


def _encloses(floor: Doubles) -> bool:
    """Return whether corners run counter-clockwise around the camera without crossing themselves."""
    import shapely

    ring = shapely.LinearRing(floor)
    if not ring.is_simple or not ring.is_ccw:
        return False
    room = shapely.Polygon(ring)
    return bool(room.contains(shapely.Point(0, 0)) and room.exterior.distance(shapely.Point(0, 0)) > 0.03)


def outline_of(stretches: list[Stretch], azimuth_rad: Doubles, turned_rad: float, ratio: float) -> Outline | None:
    """Return the walls that stretches of columns (N,) show, and what stands unseen between; None if too few."""
    n = len(azimuth_rad)
    seen = [Wall(s.kind, math.atan2(s.a, s.b), 1 / math.hypot(s.a, s.b)) for s in stretches]
    found = _merged([(w, (s.first / n - 0.5) * 2 * math.pi - turned_rad) for w, s in zip(seen, stretches, strict=True)])
    if len(found) < 2:
        return None
    walls: list[Wall] = []
    for k, (wall, _) in enumerate(found):
        following, border = found[(k + 1) % len(found)]
        walls.append(wall)
        walls += _between(wall, following, border)
    return Outline(tuple(walls), turned_rad, ratio) if len(walls) >= 3 else None


def inverse_range(wall: Wall, azimuth_rad: float) -> float:
    """Return the wall's inverse distance in a direction (of the turned axes)."""
    return math.cos(azimuth_rad - wall.normal_rad) / wall.distance


def _merged(parts: list[tuple[Wall, float]]) -> list[tuple[Wall, float]]:
    """Return walls and the azimuths at which they begin, without neighbours that are one wall."""
    found: list[tuple[Wall, float]] = []
    for wall, begin in parts:
        if not (found and _same(found[-1][0], wall)):
            found.append((wall, begin))
    while len(found) > 2 and _same(found[-1][0], found[0][0]):
        found.pop(0)
    return found


def _same(one: Wall, other: Wall) -> bool:
    turn = math.sin(other.normal_rad - one.normal_rad)
    if abs(turn) > NEARLY_PARALLEL or math.cos(other.normal_rad - one.normal_rad) < 0:
        return False
    return abs(math.log(other.distance / one.distance)) < SAME_WALL


def _between(wall: Wall, following: Wall, border_rad: float) -> list[Wall]:
    """Return the unseen wall between two that do not meet where one gives way to the other; nothing if they do."""
    here, there = inverse_range(wall, border_rad), inverse_range(following, border_rad)
    parallel = abs(math.sin(following.normal_rad - wall.normal_rad)) < NEARLY_PARALLEL
    if here <= 0 or there <= 0 or (not parallel and abs(math.log(here / there)) < MEETING):
        return []
    near, far, sign = (wall, following, 1) if here > there else (following, wall, -1)
    reach = 1 / max(here, there)
    x, y = reach * math.sin(border_rad), reach * math.cos(border_rad)
    # Clockwise, the side of a recess that is left turns its back: its normal points back along the nearer wall.
    normal = near.normal_rad - sign * math.pi / 2
    if abs(math.sin(far.normal_rad - normal)) < NEARLY_PARALLEL and not parallel:
        return []
    kind = {ALONG_X: ALONG_Y, ALONG_Y: ALONG_X}.get(near.kind, FREE)
    distance = x * math.sin(normal) + y * math.cos(normal)
    return [Wall(kind, math.remainder(normal, 2 * math.pi), distance, seen=False)]


def with_values(outline: Outline, values: Doubles) -> Outline:
    """Return the outline with its parameters (M,) replaced: see `values_of`."""
    turned, log_ratio = float(values[0]), float(values[1])
    free = iter(values[2 + len(outline.walls) :])
    walls = [
        replace(wall, distance=float(distance), normal_rad=float(next(free)) if wall.kind == FREE else wall.normal_rad)
        for wall, distance in zip(outline.walls, values[2:], strict=False)
    ]
    return Outline(tuple(walls), turned, math.exp(log_ratio))


def values_of(outline: Outline) -> Doubles:
    """Return the parameters (M,): walls' azimuth, log of the heights' ratio, distances, normals of FREE walls."""
    free = [w.normal_rad for w in outline.walls if w.kind == FREE]
    return np.array([outline.turned_rad, math.log(outline.ratio), *(w.distance for w in outline.walls), *free])

"""A room's floor as walls in order, and the polygon that they make.

Walls are lines n.p = distance with the normal pointing out of the room; some are not seen (the side of a recess that
turns its back). Corners are where neighbours meet. Lengths are in camera heights, so that nothing depends on scale.
"""

from __future__ import annotations

from processing.ground.arrays import Doubles

import math
from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt

from processing.room.segments import ALONG_X, ALONG_Y, FREE, Stretch


NEARLY_PARALLEL = math.sin(math.radians(12.0))
SAME_WALL = 0.05
"""Relative difference of distances below which parallel neighbours are one wall."""
MEETING = 0.22
"""Relative difference of distances at a border up to which two walls are taken to meet there."""


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

    @property
    def kinds(self) -> tuple[int, ...]:
        """Return the kinds of the walls."""
        return tuple(wall.kind for wall in self.walls)


def corners_of(outline: Outline) -> Doubles:
    """Return corner i, where wall i - 1 meets wall i, (n, 2) in the world's axes, clockwise; NaN if parallel."""
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
    """Return the corners counter-clockwise, in camera heights; None where the walls make no room around the camera."""
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
    """Return the walls that stretches of columns show, with what must stand between them unseen; None if too few."""
    n = len(azimuth_rad)
    merged = _merged([(_wall(s), (s.first / n - 0.5) * 2 * math.pi - turned_rad) for s in stretches])
    if len(merged) < 2:
        return None
    walls: list[Wall] = []
    for k, (wall, _) in enumerate(merged):
        following, border = merged[(k + 1) % len(merged)]
        walls.append(wall)
        walls += _between(wall, following, border)
    outline = Outline(tuple(walls), turned_rad, ratio)
    return outline if len(walls) >= 3 else None


def _wall(stretch: Stretch) -> Wall:
    steepness = math.hypot(stretch.a, stretch.b)
    normal = math.atan2(stretch.a, stretch.b)
    return Wall(stretch.kind, normal, 1 / steepness)


def inverse_range(wall: Wall, azimuth_rad: float) -> float:
    """Return the wall's inverse distance in a direction (of the turned axes)."""
    return math.cos(azimuth_rad - wall.normal_rad) / wall.distance


def _merged(parts: list[tuple[Wall, float]]) -> list[tuple[Wall, float]]:
    """Return walls and the azimuths at which they begin, without neighbours that are one wall."""
    found: list[tuple[Wall, float]] = []
    for wall, begin in parts:
        if found and _same(found[-1][0], wall):
            continue
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
    turn = math.sin(following.normal_rad - wall.normal_rad)
    parallel = abs(turn) < NEARLY_PARALLEL
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
    """Return the outline with its parameters replaced: see `values_of`."""
    turned, log_ratio = float(values[0]), float(values[1])
    free = iter(values[2 + len(outline.walls) :])
    walls = [
        replace(
            wall,
            distance=float(distance),
            normal_rad=float(next(free)) if wall.kind == FREE else wall.normal_rad,
        )
        for wall, distance in zip(outline.walls, values[2:], strict=False)
    ]
    return Outline(tuple(walls), turned, math.exp(log_ratio))


def values_of(outline: Outline) -> Doubles:
    """Return the parameters: walls' azimuth, log of the heights' ratio, distances, then the normals of FREE walls."""
    free = [w.normal_rad for w in outline.walls if w.kind == FREE]
    return np.array([outline.turned_rad, math.log(outline.ratio), *(w.distance for w in outline.walls), *free])

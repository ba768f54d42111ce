"""The outline of a room's floor and the place of the camera in it."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import shapely
from shapely.geometry import LineString, Polygon
from shapely.geometry import Point as Spot

from mocks.rooms.model import Point, Use

CAMERA_CLEARANCE_M = 0.8
"""Least distance of the camera from every wall."""
LEAST_SEEN = 0.85
"""Least share of the floor that the camera sees."""

AREA_M2: dict[Use, tuple[float, float]] = {
    Use.BEDROOM: (9.0, 22.0),
    Use.LIVING: (14.0, 40.0),
    Use.DINING: (10.0, 22.0),
    Use.OFFICE: (8.0, 18.0),
    Use.EMPTY: (8.0, 36.0),
}
FORMS = ("rectangle", "l", "t", "cut corner", "slanted wall", "bay")
FORM_SHARES = (0.50, 0.16, 0.07, 0.08, 0.07, 0.12)
SHORTEST_SIDE_M = 2.3


@dataclass(frozen=True)
class Outline:
    """A floor polygon, counter-clockwise, and which of its edges are facets of a bay."""

    points: tuple[Point, ...]
    bay: tuple[int, ...] = ()


def draw_outline(rng: np.random.Generator, use: Use) -> Outline:
    """Draw the form and size of a room; mirrored half of the time."""
    area = float(rng.uniform(*AREA_M2[use]))
    form = str(rng.choice(FORMS, p=FORM_SHARES))
    width, depth = _sides(rng, area)
    if form == "l":
        outline = _notched(rng, area, two=False)
    elif form == "t":
        outline = _notched(rng, area, two=True)
    elif form == "cut corner":
        outline = _cut_corner(rng, width, depth)
    elif form == "slanted wall":
        slope = float(rng.uniform(0.12, 0.35)) * depth
        outline = Outline(((0.0, 0.0), (width, 0.0), (width, depth - slope / 2), (0.0, depth + slope / 2)))
    elif form == "bay" and width > 3.0:
        outline = _bay(rng, width, depth)
    else:
        outline = rectangle(width, depth)
    return _mirrored(outline) if rng.random() < 0.5 else outline


def rectangle(width_m: float, depth_m: float) -> Outline:
    """Return a rectangle with its first corner at the origin."""
    return Outline(((0.0, 0.0), (width_m, 0.0), (width_m, depth_m), (0.0, depth_m)))


def draw_camera(rng: np.random.Generator, points: Sequence[Point]) -> Point | None:
    """Draw a place for the camera: clear of the walls and with a view of most of the floor; None if none is found."""
    room = Polygon(points)
    clear = room.buffer(-CAMERA_CLEARANCE_M - 0.02)
    if clear.is_empty:
        return None
    x0, y0, x1, y1 = clear.bounds
    for _ in range(60):
        place = (float(rng.uniform(x0, x1)), float(rng.uniform(y0, y1)))
        if clear.contains(Spot(place)) and floor_seen(points, place) >= LEAST_SEEN:
            return place
    return None


def floor_seen(points: Sequence[Point], place: Point, step_m: float = 0.2) -> float:
    """Return the share of the floor (0..1, on a grid) that is in straight sight of a place."""
    room = Polygon(points)
    x0, y0, x1, y1 = room.bounds
    grid_x, grid_y = np.meshgrid(np.arange(x0 + step_m / 2, x1, step_m), np.arange(y0 + step_m / 2, y1, step_m))
    inside = shapely.contains_xy(room, grid_x, grid_y)
    targets = np.stack([grid_x[inside], grid_y[inside]], axis=-1)
    sights = shapely.linestrings(np.stack([np.broadcast_to(place, targets.shape), targets], axis=1))
    shapely.prepare(room)
    return float(np.mean(shapely.covers(room, sights)))


def draw_turn_rad(rng: np.random.Generator) -> float:
    """Draw the room's angle about the camera: any quarter turn, near it or up to 45 degrees off."""
    quarter = math.pi / 2 * int(rng.integers(4))
    near = rng.random() < 0.45
    skew = rng.normal(0.0, 3.0) if near else rng.uniform(-45.0, 45.0)
    return quarter + math.radians(float(skew))


def seen_from(outline: Outline, camera: Point, turn_rad: float) -> Outline:
    """Return the outline with the camera at the origin and turned about it, to a tenth of a millimetre."""
    c, s = math.cos(turn_rad), math.sin(turn_rad)
    moved = ((x - camera[0], y - camera[1]) for x, y in outline.points)
    return Outline(tuple((round(c * x - s * y, 4), round(s * x + c * y, 4)) for x, y in moved), outline.bay)


def hull_edges(points: Sequence[Point]) -> list[int]:
    """Return the edges that have the whole room on one side: from them nothing of the room is in view outside."""
    found = []
    for i, (x0, y0) in enumerate(points):
        x1, y1 = points[(i + 1) % len(points)]
        left = [(x1 - x0) * (y - y0) - (y1 - y0) * (x - x0) for x, y in points]
        if min(left) > -1e-3:
            found.append(i)
    return found


def inner_angle_rad(points: Sequence[Point], corner: int) -> float:
    """Return the angle (0..2 pi) within the room at a corner of a counter-clockwise polygon."""
    x, y = points[corner]
    back, ahead = points[corner - 1], points[(corner + 1) % len(points)]
    angle = math.atan2(back[1] - y, back[0] - x) - math.atan2(ahead[1] - y, ahead[0] - x)
    return angle % (2 * math.pi)


def is_simple(points: Sequence[Point]) -> bool:
    """Return whether the outline does not cross itself and turns counter-clockwise."""
    ring = LineString([*points, points[0]])
    return bool(ring.is_simple) and Polygon(points).exterior.is_ccw


def _sides(rng: np.random.Generator, area_m2: float) -> tuple[float, float]:
    aspect = float(rng.uniform(1.0, 1.75))
    depth = max(math.sqrt(area_m2 / aspect), SHORTEST_SIDE_M)
    return area_m2 / depth, depth


def _notched(rng: np.random.Generator, area_m2: float, two: bool) -> Outline:
    """Return an L (one far corner left out) or a T (both)."""
    across = rng.uniform(0.18, 0.32, 2) if two else np.array([0.0, rng.uniform(0.28, 0.5)])
    deep = float(rng.uniform(0.25, 0.45))
    w, d = _sides(rng, area_m2 / (1.0 - float(across.sum()) * deep))
    a, b, near = w * float(across[0]), w * (1.0 - float(across[1])), d * (1.0 - deep)
    right = [(0.0, 0.0), (w, 0.0), (w, near), (b, near), (b, d)]
    left = [(a, d), (a, near), (0.0, near)] if two else [(0.0, d)]
    return Outline(tuple(right + left))


def _cut_corner(rng: np.random.Generator, w: float, d: float) -> Outline:
    a, b = (float(v) for v in rng.uniform(0.7, 1.5, 2))
    return Outline(((0.0, 0.0), (w, 0.0), (w, d - b), (w - a, d), (0.0, d)))


def _bay(rng: np.random.Generator, w: float, d: float) -> Outline:
    """Return a rectangle with a bay of three facets on its long side."""
    span = float(rng.uniform(2.4, max(2.5, min(3.4, w - 0.6))))
    start = float(rng.uniform(0.25, w - span - 0.25))
    out, slant = float(rng.uniform(0.6, 0.85)), float(rng.uniform(0.45, 0.65))
    end = start + span
    bay = [(start, 0.0), (start + slant, -out), (end - slant, -out), (end, 0.0)]
    return Outline(((0.0, 0.0), *bay, (w, 0.0), (w, d), (0.0, d)), (1, 2, 3))


def _mirrored(outline: Outline) -> Outline:
    n = len(outline.points)
    points = tuple((-x, y) for x, y in reversed(outline.points))
    return Outline(points, tuple(sorted((n - 2 - edge) % n for edge in outline.bay)))

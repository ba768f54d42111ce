"""The forms of rooms: floor polygons, what the camera sees of them, and the space that doors and fixtures take."""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Self

import numpy as np
import shapely
from shapely.geometry import LineString, Polygon
from shapely.geometry import Point as Spot

from mocks.rooms.model import USES, Door, Fixture, Plan, Point, Use, Window

CAMERA_CLEARANCE_M = 0.8  # least distance of the camera from every wall
LEAST_SEEN = 0.85  # least share of the floor that the camera sees

AREA_M2 = {use: facts["area_m2"] for use, facts in USES.items()}
FORMS = ("rectangle", "l", "t", "cut corner", "slanted wall", "bay")
FORM_SHARES = (0.50, 0.16, 0.07, 0.08, 0.07, 0.12)
SHORTEST_SIDE_M = 2.3  # chosen: narrower rooms take no bed or sofa


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
        a, b = (float(v) for v in rng.uniform(0.7, 1.5, 2))
        outline = Outline(((0.0, 0.0), (width, 0.0), (width, depth - b), (width - a, depth), (0.0, depth)))
    elif form == "slanted wall":
        slope = float(rng.uniform(0.12, 0.35)) * depth
        outline = Outline(((0.0, 0.0), (width, 0.0), (width, depth - slope / 2), (0.0, depth + slope / 2)))
    elif form == "bay" and width > 3.0:
        outline = _bay(rng, width, depth)
    else:
        outline = rectangle(width, depth)
    if rng.random() >= 0.5:
        return outline
    points = tuple((-x, y) for x, y in reversed(outline.points))
    return Outline(points, tuple(sorted((len(points) - 2 - edge) % len(points) for edge in outline.bay)))


def rectangle(width_m: float, depth_m: float) -> Outline:
    """Return a rectangle with its first corner at the origin."""
    return Outline(((0.0, 0.0), (width_m, 0.0), (width_m, depth_m), (0.0, depth_m)))


def draw_camera(rng: np.random.Generator, points: Sequence[Point]) -> Point | None:
    """Draw a place for the camera: clear of the walls and with a view of most of the floor; None if none is found."""
    clear = Polygon(points).buffer(-CAMERA_CLEARANCE_M - 0.02)
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
    skew = rng.normal(0.0, 3.0) if rng.random() < 0.45 else rng.uniform(-45.0, 45.0)
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
    return (math.atan2(back[1] - y, back[0] - x) - math.atan2(ahead[1] - y, ahead[0] - x)) % (2 * math.pi)


def is_simple(points: Sequence[Point]) -> bool:
    """Return whether the outline does not cross itself and turns counter-clockwise."""
    return bool(LineString([*points, points[0]]).is_simple) and Polygon(points).exterior.is_ccw


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


def _bay(rng: np.random.Generator, w: float, d: float) -> Outline:
    """Return a rectangle with a bay of three facets on its long side."""
    span = float(rng.uniform(2.4, max(2.5, min(3.4, w - 0.6))))
    start = float(rng.uniform(0.25, w - span - 0.25))
    out, slant = float(rng.uniform(0.6, 0.85)), float(rng.uniform(0.45, 0.65))
    end = start + span
    bay = [(start, 0.0), (start + slant, -out), (end - slant, -out), (end, 0.0)]
    return Outline(((0.0, 0.0), *bay, (w, 0.0), (w, d), (0.0, d)), (1, 2, 3))


TRIM_M = 0.07  # width of a door's architrave, on both sides and above
REVEAL_GAP_M = 0.04  # what is kept free round a window (its sill board reaches beyond the opening)
APPROACH_M = 0.6  # depth of floor kept free before a door that opens outwards
HALL_DEPTH_M = 1.2  # depth of the closed hallway behind each door
HALL_SIDE_M = 0.3  # how far that hallway reaches beyond the opening on both sides
FLUSH_M = 0.03  # fixtures flatter than this (sockets, switches) do not keep furniture from the wall


@dataclass(frozen=True)
class WallSpan:
    """A rectangle of a wall: along its edge from ``start_m`` to ``end_m``, in height from ``bottom_m`` to ``top_m``."""

    start_m: float
    end_m: float
    bottom_m: float
    top_m: float

    @property
    def width_m(self) -> float:
        """Return the width."""
        return self.end_m - self.start_m

    @property
    def height_m(self) -> float:
        """Return the height."""
        return self.top_m - self.bottom_m

    def overlaps(self, other: Self) -> bool:
        """Return whether the two share any area."""
        across = self.start_m < other.end_m - 1e-9 and other.start_m < self.end_m - 1e-9
        return across and self.bottom_m < other.top_m - 1e-9 and other.bottom_m < self.top_m - 1e-9


def openings_of(plan: Plan, wall: int | None = None) -> tuple[Window | Door, ...]:
    """Return the windows and doors of a plan, or of one of its walls."""
    every: tuple[Window | Door, ...] = (*plan.windows, *plan.doors)
    return tuple(o for o in every if wall is None or o.wall == wall)


def opening_span(opening: Window | Door) -> WallSpan:
    """Return what an opening takes of its wall with its sill board or trim."""
    start, end = opening.start_m, opening.start_m + opening.width_m
    if isinstance(opening, Door):
        return WallSpan(start - TRIM_M, end + TRIM_M, 0.0, opening.height_m + TRIM_M)
    top = opening.sill_m + opening.height_m + REVEAL_GAP_M
    return WallSpan(start - REVEAL_GAP_M, end + REVEAL_GAP_M, max(0.0, opening.sill_m - REVEAL_GAP_M), top)


def fixture_span(fixture: Fixture) -> WallSpan:
    """Return the rectangle of the wall that a fixture covers."""
    top_m = fixture.bottom_m + fixture.height_m
    return WallSpan(fixture.start_m, fixture.start_m + fixture.width_m, fixture.bottom_m, top_m)


def free_spans(plan: Plan, wall: int, flush_too: bool = False) -> list[WallSpan]:
    """Return the largest free rectangles of a wall, widest first. They overlap: each cannot grow to any side.

    A sofa fits below a window where a span with ``bottom_m`` 0 is wide and high enough; a picture hangs in any.
    """
    length = plan.wall_length_m(wall)
    openings = [opening_span(o) for o in openings_of(plan, wall)]
    fixtures = [fixture_span(f) for f in plan.fixtures if f.wall == wall and (flush_too or f.depth_m >= FLUSH_M)]
    taken = openings + fixtures
    rows = _ticks([t for s in taken for t in (s.bottom_m, s.top_m)], plan.height_m)
    found: list[WallSpan] = []
    for i, bottom in enumerate(rows):
        for top in rows[i + 1 :]:
            band = [s for s in taken if s.bottom_m < top - 1e-9 and s.top_m > bottom + 1e-9]
            found += [WallSpan(a, b, bottom, top) for a, b in _gaps(band, length)]
    largest = [s for s in found if not any(_within(s, t) and s != t for t in found)]
    return sorted(largest, key=lambda s: (-s.width_m, s.start_m, s.bottom_m))


def door_swing(door: Door, plan: Plan) -> Polygon:
    """Return the floor that a door needs: its leaf's quarter disc, or the way to it when it opens outwards."""
    if door.opens == "out":
        along = door.start_m, door.start_m + door.width_m
        return Polygon(plan.floor_along(door.wall, along, (0.0, APPROACH_M)))
    way = 1.0 if door.hinge == "start" else -1.0
    hinge_m = door.start_m if door.hinge == "start" else door.start_m + door.width_m
    sweep_rad = max(math.pi / 2, door.open_rad)
    steps = 12
    arc = [
        (hinge_m + way * door.width_m * math.cos(a), door.width_m * math.sin(a))
        for a in (sweep_rad * i / steps for i in range(steps + 1))
    ]
    return Polygon([plan.on_wall(door.wall, along, away) for along, away in [(hinge_m, 0.0), *arc]])


def hall_floor(door: Door, plan: Plan) -> Polygon:
    """Return the floor of the hallway behind a door, with the opening through the wall."""
    along = door.start_m - HALL_SIDE_M, door.start_m + door.width_m + HALL_SIDE_M
    return Polygon(plan.floor_along(door.wall, along, (-door.depth_m - HALL_DEPTH_M, -door.depth_m)))


def reveal_floor(hole: Window | Door, plan: Plan, depth_m: float | None = None) -> Polygon:
    """Return what an opening takes of its wall, seen from above: its width by the wall's thickness (or a depth)."""
    far = -(hole.depth_m if depth_m is None else depth_m)
    return Polygon(plan.floor_along(hole.wall, (hole.start_m, hole.start_m + hole.width_m), (far, -1e-3)))


def fixture_floor(fixture: Fixture, plan: Plan) -> Polygon:
    """Return what a fixture on a wall takes of the room, seen from above."""
    along = fixture.start_m, fixture.start_m + fixture.width_m
    return Polygon(plan.floor_along(fixture.wall, along, (0.0, fixture.depth_m)))


def _ticks(values: list[float], end: float) -> list[float]:
    return sorted({0.0, end, *(v for v in values if 0.0 < v < end)})


def _gaps(spans: list[WallSpan], length_m: float) -> list[tuple[float, float]]:
    """Return the intervals along the wall that no span covers."""
    at = _ticks([t for s in spans for t in (s.start_m, s.end_m)], length_m)
    gaps: list[tuple[float, float]] = []
    for a, b in pairwise(at):
        middle = (a + b) / 2
        if b - a < 1e-9 or any(s.start_m < middle < s.end_m for s in spans):
            continue
        if gaps and gaps[-1][1] == a:
            gaps[-1] = (gaps[-1][0], b)
        else:
            gaps.append((a, b))
    return gaps


def _within(inner: WallSpan, outer: WallSpan) -> bool:
    across = outer.start_m <= inner.start_m and inner.end_m <= outer.end_m
    return across and outer.bottom_m <= inner.bottom_m and inner.top_m <= outer.top_m

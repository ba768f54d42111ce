"""What is still free in an empty room: the parts of a wall without openings or fixtures, and the way of its doors."""

from __future__ import annotations

import math
from dataclasses import dataclass
from itertools import pairwise

from shapely.geometry import Polygon

from mocks.rooms.model import Door, Fixture, Plan, Window

TRIM_M = 0.07
"""Width of a door's architrave, on both sides and above."""
REVEAL_GAP_M = 0.04
"""What is kept free round a window (its sill board reaches beyond the opening)."""
APPROACH_M = 0.6
"""Depth of floor kept free before a door that opens outwards."""
HALL_DEPTH_M = 1.2
"""Depth of the closed hallway behind each door."""
HALL_SIDE_M = 0.3
"""How far that hallway reaches beyond the opening on both sides."""
FLUSH_M = 0.03
"""Fixtures flatter than this (sockets, switches) do not keep furniture from the wall."""


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

    def overlaps(self, other: WallSpan) -> bool:
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


def taken_spans(plan: Plan, wall: int, flush_too: bool = False) -> list[WallSpan]:
    """Return what windows, doors (with their trim) and fixtures take of a wall.

    ``flush_too`` counts sockets and switches as well, which matters for pictures and not for cupboards.
    """
    openings = [opening_span(o) for o in openings_of(plan, wall)]
    fixtures = [fixture_span(f) for f in plan.fixtures if f.wall == wall and (flush_too or f.depth_m >= FLUSH_M)]
    return openings + fixtures


def free_spans(plan: Plan, wall: int, flush_too: bool = False) -> list[WallSpan]:
    """Return the largest free rectangles of a wall, widest first. They overlap: each cannot grow to any side.

    A sofa fits below a window where a span with ``bottom_m`` 0 is wide and high enough; a picture hangs in any.
    """
    length = plan.wall_length_m(wall)
    taken = taken_spans(plan, wall, flush_too)
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
        near, far = door.start_m, door.start_m + door.width_m
        ends = ((near, 0.0), (far, 0.0), (far, APPROACH_M), (near, APPROACH_M))
        return Polygon([plan.on_wall(door.wall, along, away) for along, away in ends])
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
    start, end = door.start_m - HALL_SIDE_M, door.start_m + door.width_m + HALL_SIDE_M
    near, far = -door.depth_m, -door.depth_m - HALL_DEPTH_M
    return Polygon([plan.on_wall(door.wall, a, b) for a, b in ((start, far), (end, far), (end, near), (start, near))])


def reveal_floor(opening: Window | Door, plan: Plan, depth_m: float | None = None) -> Polygon:
    """Return what an opening takes of its wall, seen from above: its width by the wall's thickness (or a depth)."""
    start, end = opening.start_m, opening.start_m + opening.width_m
    far = -(opening.depth_m if depth_m is None else depth_m)
    return Polygon(
        [plan.on_wall(opening.wall, a, b) for a, b in ((start, far), (end, far), (end, -1e-3), (start, -1e-3))]
    )


def fixture_floor(fixture: Fixture, plan: Plan) -> Polygon:
    """Return what a fixture on a wall takes of the room, seen from above."""
    start, end, depth = fixture.start_m, fixture.start_m + fixture.width_m, fixture.depth_m
    return Polygon([plan.on_wall(fixture.wall, a, b) for a, b in ((start, 0), (end, 0), (end, depth), (start, depth))])


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

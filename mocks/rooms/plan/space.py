"""The free floor of a plan, and the rules that every plan must meet. Metres, as in `mocks.rooms.model`."""

from __future__ import annotations

import math
from dataclasses import dataclass
from itertools import combinations, pairwise

from shapely.geometry import Point as Spot
from shapely.geometry import Polygon

from mocks.rooms.model import Door, Fixture, Plan, Window
from mocks.rooms.plan.forms import CAMERA_CLEARANCE_M, LEAST_SEEN, floor_seen, inner_angle_rad, is_simple

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


HEIGHT_M = (2.3, 3.4)
LEAST_EDGE_M = 0.2
LEAST_ANGLE_RAD = math.radians(40)
OPENINGS_APART_M = 0.05
UNDER_CEILING_M = 0.1
OUTLOOK_M = 1.5
"""Nothing of the house stands so near before a window."""
FROM_CAMERA_M = 0.45
"""Kept free of doors and hanging lamps: the tripod's feet stand 0.41 m from the camera's axis."""
IN_WINDOW = ("roller blind", "venetian blind")
OVER_WINDOW = ("curtain", "curtain rod")


def check_plan(plan: Plan) -> list[str]:
    """Return what is wrong with a plan, in words; nothing if it is sound."""
    wrong = outline_problems(plan)
    if wrong:
        return wrong
    return camera_problems(plan) + opening_problems(plan) + fixture_problems(plan)


def outline_problems(plan: Plan) -> list[str]:
    """Return problems of the floor polygon and the height."""
    points = plan.polygon
    if len(points) < 3 or not is_simple(points):
        return ["the outline crosses itself or turns clockwise"]
    wrong = [f"wall {i} is too short" for i in range(len(points)) if plan.wall_length_m(i) < LEAST_EDGE_M]
    angles = [inner_angle_rad(points, i) for i in range(len(points))]
    wrong += [f"corner {i} is too narrow" for i, a in enumerate(angles) if a < LEAST_ANGLE_RAD]
    if not HEIGHT_M[0] <= plan.height_m <= HEIGHT_M[1]:
        wrong.append(f"the ceiling is at {plan.height_m:.2f} m")
    return wrong


def camera_problems(plan: Plan) -> list[str]:
    """Return problems of the camera's place, which is the origin."""
    room = Polygon(plan.polygon)
    if not room.contains(Spot(0, 0)):
        return ["the camera is outside the room"]
    wrong = []
    if room.exterior.distance(Spot(0, 0)) < CAMERA_CLEARANCE_M:
        wrong.append("the camera is too near a wall")
    if floor_seen(plan.polygon, (0.0, 0.0)) < LEAST_SEEN - 0.02:
        wrong.append("the camera sees too little of the floor")
    return wrong


def opening_problems(plan: Plan) -> list[str]:
    """Return problems of windows and doors: their place in the wall, each other, and the space behind and before."""
    openings = openings_of(plan)
    wrong = [f"{_name(o)}: {text}" for o in openings for text in _place_problems(plan, o)]
    if wrong:
        return wrong
    room = Polygon(plan.polygon)
    spaces = [(_name(w), reveal_floor(w, plan)) for w in plan.windows]
    spaces += [(_name(d), reveal_floor(d, plan).union(hall_floor(d, plan))) for d in plan.doors]
    wrong += [f"{name} reaches into the room" for name, space in spaces if space.intersection(room).area > 1e-4]
    wrong += [f"{a} and {b} meet" for (a, one), (b, two) in combinations(spaces, 2) if one.distance(two) < 0.01]
    for window in plan.windows:
        outlook = reveal_floor(window, plan, window.depth_m + OUTLOOK_M)
        wrong += [f"a hallway hides {_name(window)}" for d in plan.doors if outlook.intersects(hall_floor(d, plan))]
    return wrong + _swing_problems(plan, room)


def fixture_problems(plan: Plan) -> list[str]:
    """Return problems of fixtures: outside their wall, over openings, in each other or in a door's way."""
    wrong = [f"{f.kind}: {text}" for f in plan.fixtures for text in _fixture_place_problems(plan, f)]
    solid = [f for f in plan.fixtures if f.wall >= 0 and f.depth_m >= FLUSH_M and f.kind not in IN_WINDOW]
    for a, b in combinations(solid, 2):
        curtains = a.kind in OVER_WINDOW and b.kind in OVER_WINDOW and a.kind != b.kind
        apart = a.bottom_m >= b.bottom_m + b.height_m or b.bottom_m >= a.bottom_m + a.height_m
        if not (curtains or apart) and fixture_floor(a, plan).intersects(fixture_floor(b, plan)):
            wrong.append(f"{a.kind} and {b.kind} meet")
    for flat in (f for f in plan.fixtures if f.wall >= 0 and f.depth_m < FLUSH_M):
        others = (f for f in plan.fixtures if f is not flat and f.wall == flat.wall and f.kind not in IN_WINDOW)
        wrong += [f"{flat.kind} and {f.kind} meet" for f in others if fixture_span(flat).overlaps(fixture_span(f))]
    return wrong


def _name(opening: Window | Door) -> str:
    kind = "window" if isinstance(opening, Window) else "door"
    return f"{kind} at {opening.start_m:.2f} m of wall {opening.wall}"


def _place_problems(plan: Plan, opening: Window | Door) -> list[str]:
    if not 0 <= opening.wall < len(plan.polygon):
        return ["there is no such wall"]
    wrong = []
    span = opening_span(opening)
    if opening.width_m < 0.3 or span.height_m < 0.3:
        wrong.append("too small")
    if span.start_m < 0.01 or span.end_m > plan.wall_length_m(opening.wall) - 0.01:
        wrong.append("beyond the end of its wall")
    if span.top_m > plan.height_m - UNDER_CEILING_M:
        wrong.append("above the ceiling")
    for other in (o for o in openings_of(plan, opening.wall) if o is not opening):
        beside = opening_span(other)
        if span.start_m < beside.end_m + OPENINGS_APART_M and beside.start_m < span.end_m + OPENINGS_APART_M:
            wrong.append("too near another opening")
    return wrong


def _swing_problems(plan: Plan, room: Polygon) -> list[str]:
    ways = [(d, door_swing(d, plan)) for d in plan.doors]
    wrong = [f"the camera is in the way of {_name(d)}" for d, w in ways if w.distance(Spot(0, 0)) < FROM_CAMERA_M]
    swings = [(d, way) for d, way in ways if d.opens == "in"]
    # A leaf opened to a little more than a right angle may reach beyond its hinge, not to a wall there.
    wrong += [f"{_name(d)} cannot open" for d, swing in swings if swing.difference(room).area > 1e-3]
    return wrong + ["doors hit each other" for (_, a), (_, b) in combinations(swings, 2) if a.intersects(b)]


def _fixture_place_problems(plan: Plan, fixture: Fixture) -> list[str]:
    room = Polygon(plan.polygon)
    if fixture.wall < 0:
        disc = Spot(fixture.centre).buffer(fixture.width_m / 2)
        low = fixture.bottom_m < 1.8 or (fixture.height_m > 0.3 and disc.distance(Spot(0, 0)) < FROM_CAMERA_M)
        return [*([] if room.contains(disc) else ["not under the ceiling"]), *(["in the way"] if low else [])]
    wrong = []
    span = fixture_span(fixture)
    if span.start_m < 0.005 or span.end_m > plan.wall_length_m(fixture.wall) - 0.005:
        wrong.append("beyond the end of its wall")
    if span.bottom_m < 0.0 or span.top_m > plan.height_m - 0.01:
        wrong.append("above the ceiling or below the floor")
    if fixture.kind in IN_WINDOW:
        return wrong
    if not room.buffer(1e-3).contains(fixture_floor(fixture, plan)):
        wrong.append("through another wall")
    over = [o for o in openings_of(plan, fixture.wall) if isinstance(o, Door) or fixture.kind not in OVER_WINDOW]
    wrong += ["over an opening" for o in over if span.overlaps(opening_span(o))]
    inward = [d for d in plan.doors if d.opens == "in"]
    if fixture.depth_m >= FLUSH_M and fixture.bottom_m < 2.2:
        wrong += ["in a door's way" for d in inward if door_swing(d, plan).intersects(fixture_floor(fixture, plan))]
    return wrong

"""What can be wrong with a plan."""

from __future__ import annotations

import math
from itertools import combinations

from shapely.geometry import Point as Spot
from shapely.geometry import Polygon

from mocks.rooms.model import Door, Fixture, Plan, Window
from mocks.rooms.plan.forms import CAMERA_CLEARANCE_M, LEAST_SEEN, floor_seen, inner_angle_rad, is_simple
from mocks.rooms.plan.space import (
    FLUSH_M,
    door_swing,
    fixture_floor,
    fixture_span,
    hall_floor,
    opening_span,
    openings_of,
    reveal_floor,
)

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

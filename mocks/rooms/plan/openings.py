"""Where windows and doors are in the walls of a room, and the rules that every plan must meet."""

import math
from dataclasses import dataclass, replace
from itertools import combinations
from typing import Literal

import numpy as np
from shapely.geometry import Point as Spot
from shapely.geometry import Polygon

from mocks.rooms.model import Door, Fixture, Plan, Window
from mocks.rooms.plan import forms
from processing.ground.tables import table_of

HEIGHT_M = (2.3, 3.4)
LEAST_EDGE_M = 0.2  # chosen: a shorter wall is a slip of the plan
LEAST_ANGLE_RAD = math.radians(40)
OPENINGS_APART_M = 0.05  # chosen: room for two frames' edges
UNDER_CEILING_M = 0.1  # chosen: the lintel
OUTLOOK_M = 1.5  # nothing of the house stands so near before a window
FROM_CAMERA_M = 0.45  # kept free of doors and hanging lamps: the tripod's feet stand 0.41 m from the camera's axis
IN_WINDOW = ("roller blind", "venetian blind")
OVER_WINDOW = ("curtain", "curtain rod")


def check_plan(plan: Plan) -> list[str]:
    """Return what is wrong with a plan, in words; nothing if it is sound."""
    return outline_problems(plan) or camera_problems(plan) + opening_problems(plan) + fixture_problems(plan)


def outline_problems(plan: Plan) -> list[str]:
    """Return problems of the floor polygon and the height."""
    points = plan.polygon
    if len(points) < 3 or not forms.is_simple(points):
        return ["the outline crosses itself or turns clockwise"]
    wrong = [f"wall {i} is too short" for i in range(len(points)) if plan.wall_length_m(i) < LEAST_EDGE_M]
    angles = [forms.inner_angle_rad(points, i) for i in range(len(points))]
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
    if room.exterior.distance(Spot(0, 0)) < forms.CAMERA_CLEARANCE_M:
        wrong.append("the camera is too near a wall")
    if forms.floor_seen(plan.polygon, (0.0, 0.0)) < forms.LEAST_SEEN - 0.02:
        wrong.append("the camera sees too little of the floor")
    return wrong


def opening_problems(plan: Plan) -> list[str]:
    """Return problems of windows and doors: their place in the wall, each other, and the space behind and before."""
    wrong = [f"{_name(o)}: {text}" for o in forms.openings_of(plan) for text in _place_problems(plan, o)]
    if wrong:
        return wrong
    room = Polygon(plan.polygon)
    spaces = [(_name(w), forms.reveal_floor(w, plan)) for w in plan.windows]
    spaces += [(_name(d), forms.reveal_floor(d, plan).union(forms.hall_floor(d, plan))) for d in plan.doors]
    wrong += [f"{name} reaches into the room" for name, space in spaces if space.intersection(room).area > 1e-4]
    wrong += [f"{a} and {b} meet" for (a, one), (b, two) in combinations(spaces, 2) if one.distance(two) < 0.01]
    for window in plan.windows:
        view = forms.reveal_floor(window, plan, window.depth_m + OUTLOOK_M)
        wrong += [f"a hallway hides {_name(window)}" for d in plan.doors if view.intersects(forms.hall_floor(d, plan))]
    return wrong + _swing_problems(plan, room)


def fixture_problems(plan: Plan) -> list[str]:
    """Return problems of fixtures: outside their wall, over openings, in each other or in a door's way."""
    wrong = [f"{f.kind}: {text}" for f in plan.fixtures for text in _fixture_place_problems(plan, f)]
    solid = [f for f in plan.fixtures if f.wall >= 0 and f.depth_m >= forms.FLUSH_M and f.kind not in IN_WINDOW]
    for a, b in combinations(solid, 2):
        curtains = a.kind in OVER_WINDOW and b.kind in OVER_WINDOW and a.kind != b.kind
        apart = a.bottom_m >= b.bottom_m + b.height_m or b.bottom_m >= a.bottom_m + a.height_m
        if not (curtains or apart) and forms.fixture_floor(a, plan).intersects(forms.fixture_floor(b, plan)):
            wrong.append(f"{a.kind} and {b.kind} meet")
    for flat in (f for f in plan.fixtures if f.wall >= 0 and f.depth_m < forms.FLUSH_M):
        others = (f for f in plan.fixtures if f is not flat and f.wall == flat.wall and f.kind not in IN_WINDOW)
        wrong += [
            f"{flat.kind} and {f.kind} meet" for f in others if forms.fixture_span(flat).overlaps(forms.fixture_span(f))
        ]
    return wrong


def _name(opening: Window | Door) -> str:
    kind = "window" if isinstance(opening, Window) else "door"
    return f"{kind} at {opening.start_m:.2f} m of wall {opening.wall}"


def _place_problems(plan: Plan, opening: Window | Door) -> list[str]:
    if not 0 <= opening.wall < len(plan.polygon):
        return ["there is no such wall"]
    wrong = []
    span = forms.opening_span(opening)
    if opening.width_m < 0.3 or span.height_m < 0.3:
        wrong.append("too small")
    if span.start_m < 0.01 or span.end_m > plan.wall_length_m(opening.wall) - 0.01:
        wrong.append("beyond the end of its wall")
    if span.top_m > plan.height_m - UNDER_CEILING_M:
        wrong.append("above the ceiling")
    for other in (o for o in forms.openings_of(plan, opening.wall) if o is not opening):
        beside = forms.opening_span(other)
        if span.start_m < beside.end_m + OPENINGS_APART_M and beside.start_m < span.end_m + OPENINGS_APART_M:
            wrong.append("too near another opening")
    return wrong


def _swing_problems(plan: Plan, room: Polygon) -> list[str]:
    ways = [(d, forms.door_swing(d, plan)) for d in plan.doors]
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
    span = forms.fixture_span(fixture)
    if span.start_m < 0.005 or span.end_m > plan.wall_length_m(fixture.wall) - 0.005:
        wrong.append("beyond the end of its wall")
    if span.bottom_m < 0.0 or span.top_m > plan.height_m - 0.01:
        wrong.append("above the ceiling or below the floor")
    if fixture.kind in IN_WINDOW:
        return wrong
    floor = forms.fixture_floor(fixture, plan)
    if not room.buffer(1e-3).contains(floor):
        wrong.append("through another wall")
    over = [o for o in forms.openings_of(plan, fixture.wall) if isinstance(o, Door) or fixture.kind not in OVER_WINDOW]
    wrong += ["over an opening" for o in over if span.overlaps(forms.opening_span(o))]
    inward = [d for d in plan.doors if d.opens == "in"]
    if fixture.depth_m >= forms.FLUSH_M and fixture.bottom_m < 2.2:
        wrong += ["in a door's way" for d in inward if forms.door_swing(d, plan).intersects(floor)]
    return wrong


CORNER_M = 0.15  # least distance of a window from the corner of its wall
PIER_M = 0.3  # least wall between two windows
STYLES = table_of(__package__, "windows")
MOST_WINDOWS = 4  # chosen: few rooms have more
LEAST_GLAZING = 0.09  # window area per floor area; building codes ask for about a tenth to an eighth


@dataclass(frozen=True)
class WindowStyle:
    """What the windows of one room share."""

    kind: str
    sill_m: float
    head_m: float
    frame_m: float
    depth_m: float
    panes_up: int
    pane_m: float
    """Width beyond which a window has one more pane across."""


def draw_windows(rng: np.random.Generator, plan: Plan, bay: tuple[int, ...]) -> Plan:
    """Return the plan with one to four windows: in the facets of its bay, else in one or two outer walls.

    Of several draws the first is taken that gives the floor enough window, else the one that gives most.
    """
    needed = LEAST_GLAZING * Polygon(plan.polygon).area
    drawn: list[tuple[float, Plan]] = []
    for _ in range(8):
        candidate = _windows(rng, plan, bay)
        drawn.append((sum(w.width_m * w.height_m for w in candidate.windows), candidate))
        if drawn[-1][0] >= needed:
            break
    return max(drawn, key=lambda entry: entry[0])[1]


def _windows(rng: np.random.Generator, plan: Plan, bay: tuple[int, ...]) -> Plan:
    style = _draw_style(rng, plan.height_m)
    if bay:
        return replace(plan, windows=tuple(_in_facet(plan, wall, style) for wall in bay))
    walls = [w for w in forms.hull_edges(plan.polygon) if plan.wall_length_m(w) > 1.1]
    lengths = np.array([plan.wall_length_m(w) for w in walls])
    first = int(rng.choice(walls, p=lengths / lengths.sum()))
    chosen = [first]
    if len(walls) > 1 and rng.random() < 0.4:
        n = len(plan.polygon)
        beside = [w for w in walls if (w - first) % n in (1, n - 1)]
        others = beside if beside and rng.random() < 0.8 else [w for w in walls if w != first]
        chosen.append(int(rng.choice(others)))
    found: list[Window] = []
    for wall in chosen:
        found += _in_wall(rng, plan, wall, style)
    return replace(plan, windows=tuple(found[:MOST_WINDOWS]))


def draw_doors(rng: np.random.Generator, plan: Plan) -> Plan | None:
    """Return the plan with one or two doors, in walls without windows if possible; None if no door fits."""
    wanted = 2 if rng.random() < (0.2 if len(plan.polygon) == 4 else 0.4) else 1
    facade = {w.wall for w in plan.windows}
    inner = [w for w in range(len(plan.polygon)) if w not in facade]
    height = float(rng.choice([1.985, 2.0, 2.03, 2.1]))
    height = min(height, plan.height_m - 0.2)
    for attempt in range(60):
        walls = inner if inner and attempt < 45 else list(range(len(plan.polygon)))
        door = _draw_door(rng, plan, int(rng.choice(walls)), height)
        if door is None:
            continue
        candidate = replace(plan, doors=(*plan.doors, door))
        if not opening_problems(candidate):
            plan = candidate
        if len(plan.doors) == wanted:
            break
    return plan if plan.doors else None


def _draw_style(rng: np.random.Generator, height_m: float) -> WindowStyle:
    kind = str(rng.choice(list(STYLES), p=[style["share"] for style in STYLES.values()]))
    highest = height_m - 0.2
    head = min(float(rng.uniform(2.05, 2.35) if height_m < 2.9 else rng.uniform(2.3, height_m - 0.3)), highest)
    sill = float(rng.uniform(*STYLES[kind]["sill_m"]))
    old = height_m > 2.75 and rng.random() < 0.6
    return WindowStyle(
        kind=kind,
        sill_m=round(sill, 3),
        head_m=round(head, 3),
        frame_m=round(float(rng.uniform(0.045, 0.075)), 3),
        depth_m=round(float(rng.uniform(0.28, 0.45) if old else rng.uniform(0.2, 0.36)), 3),
        panes_up=int(rng.choice([2, 3])) if old and kind != "high" else int(rng.choice([1, 2], p=[0.85, 0.15])),
        pane_m=0.75 if old else float(rng.uniform(0.95, 1.25)),
    )


def _window(wall: int, start_m: float, width_m: float, style: WindowStyle) -> Window:
    return Window(
        wall=wall,
        start_m=round(start_m, 3),
        width_m=round(width_m, 3),
        sill_m=style.sill_m,
        height_m=round(style.head_m - style.sill_m, 3),
        depth_m=style.depth_m,
        frame_m=style.frame_m,
        panes_across=max(1, min(4, round(width_m / style.pane_m))),
        panes_up=style.panes_up,
    )


def _in_facet(plan: Plan, wall: int, style: WindowStyle) -> Window:
    length = plan.wall_length_m(wall)
    side = 0.12 if length < 1.2 else 0.16
    sill = max(style.sill_m, 0.4)
    return _window(wall, side, length - 2 * side, replace(style, sill_m=sill, depth_m=min(style.depth_m, 0.3)))


def _in_wall(rng: np.random.Generator, plan: Plan, wall: int, style: WindowStyle) -> list[Window]:
    """Return one to three equal windows, evenly set or (a single one) anywhere."""
    room = plan.wall_length_m(wall) - 2 * CORNER_M
    low, high = STYLES[style.kind]["width_m"]
    width = min(float(rng.uniform(low, high)), room)
    count = min(int((room + PIER_M) / (width + PIER_M)), int(rng.choice([1, 2, 3], p=[0.6, 0.32, 0.08])))
    if count <= 1:
        slack = room - width
        place = 0.5 if rng.random() < 0.4 else float(rng.uniform(0.0, 1.0))
        return [_window(wall, CORNER_M + slack * place, width, style)]
    gap = (room - count * width) / (count + 1)
    edge = max(gap, 0.0) if gap >= PIER_M else 0.0
    between = (room - 2 * edge - count * width) / (count - 1)
    return [_window(wall, CORNER_M + edge + i * (width + between), width, style) for i in range(count)]


def _draw_door(rng: np.random.Generator, plan: Plan, wall: int, height_m: float) -> Door | None:
    width = float(rng.choice([0.7, 0.76, 0.8, 0.86, 0.9, 0.95]))
    least = forms.TRIM_M + 0.04
    slack = plan.wall_length_m(wall) - width - 2 * least
    if slack < 0:
        return None
    near = min(slack, float(rng.uniform(0.0, 0.25)))
    at_end = rng.random() < 0.5
    start = least + float(rng.uniform(0.0, slack))
    if rng.random() < 0.7:
        start = least + (slack - near if at_end else near)
    hinge: Literal["start", "end"] = "end" if start > least + slack / 2 else "start"
    if rng.random() < 0.2:
        hinge = "start" if hinge == "end" else "end"
    opens: Literal["in", "out"] = "in" if rng.random() < 0.7 else "out"
    open_rad = float(rng.uniform(0.6, 1.6)) if rng.random() < 0.25 else 0.0
    return Door(wall, round(start, 3), width, height_m, hinge, opens, round(open_rad, 3))

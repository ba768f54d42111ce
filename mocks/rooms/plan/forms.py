"""The forms of rooms: floor polygons, and where windows and doors are in their walls."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np
import shapely
from shapely.geometry import LineString, Polygon
from shapely.geometry import Point as Spot

from mocks.rooms.model import Door, Plan, Point, Use, Window
from mocks.rooms.plan.space import TRIM_M, opening_problems

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


CORNER_M = 0.15
"""Least distance of a window from the corner of its wall."""
PIER_M = 0.3
"""Least wall between two windows."""
STYLES = ("standard", "wide", "tall", "french", "high")
STYLE_SHARES = (0.42, 0.2, 0.13, 0.17, 0.08)
WIDTHS_M = {"standard": (0.8, 1.5), "wide": (1.5, 3.6), "tall": (0.55, 0.9), "french": (0.8, 2.4), "high": (0.9, 1.8)}
SILLS_M = {
    "standard": (0.78, 1.0),
    "wide": (0.4, 0.92),
    "tall": (0.3, 0.6),
    "french": (0.0, 0.0),
    "high": (1.0, 1.1),
}
MOST_WINDOWS = 4
LEAST_GLAZING = 0.09
"""Window area per floor area; building codes ask for about a tenth to an eighth."""


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
    walls = [w for w in hull_edges(plan.polygon) if plan.wall_length_m(w) > 1.1]
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
    kind = str(rng.choice(STYLES, p=STYLE_SHARES))
    highest = height_m - 0.2
    head = min(float(rng.uniform(2.05, 2.35) if height_m < 2.9 else rng.uniform(2.3, height_m - 0.3)), highest)
    sill = float(rng.uniform(*SILLS_M[kind]))
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
    low, high = WIDTHS_M[style.kind]
    width = min(float(rng.uniform(low, high)), room)
    fits = int((room + PIER_M) / (width + PIER_M))
    count = min(fits, int(rng.choice([1, 2, 3], p=[0.6, 0.32, 0.08])))
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
    least = TRIM_M + 0.04
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

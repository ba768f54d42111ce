"""Where a room has its windows and doors."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Literal

import numpy as np
from shapely.geometry import Polygon

from mocks.rooms.model import Door, Plan, Window
from mocks.rooms.plan.check import opening_problems
from mocks.rooms.plan.forms import hull_edges
from mocks.rooms.plan.space import TRIM_M

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

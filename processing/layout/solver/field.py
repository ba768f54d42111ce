"""The plan as arrays: walls as segments, doors, windows and pinned pieces as convex outlines with heights."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, TypeAlias

import numpy as np
import shapely
import shapely.affinity
from shapely.geometry import Polygon

from processing.ground.arrays import Doubles, Int64s
from processing.layout.plan import DOOR_HEAD_M, Door, FloorPlan
from processing.layout.rules import RuleSet
from processing.layout.solver.free_sets import BODY, DOOR, KEPT, MEETS, RUG, SKIN_M, WINDOW, ZONE

Row: TypeAlias = tuple[Doubles, float, float, int, str]
"""Corners (4, 2), bottom and top in metres, class and name of an outline."""

PERSON_M = 2.0
"""Use zones and paths are this high: what hangs above does not matter."""
KEEP_FREE_RADIUS_M = 0.3
UNDER_SILL_M = 0.05
"""A piece before a window ends this much below its sill."""


@dataclass(frozen=True)
class Outlines:
    """Convex outlines with their heights and classes (`free_sets`)."""

    corners: Doubles
    """(n, 4, 2)."""
    heights_m: Doubles
    """(n, 2)."""
    classes: Int64s
    names: tuple[str, ...]


@dataclass(frozen=True)
class DoorWay:
    """Where a path through a door begins: a rectangle of floor before it."""

    name: str
    corners: Doubles
    """(4, 2)."""


@dataclass(frozen=True)
class Field:
    """All that stands fast while furniture is placed."""

    plan: FloorPlan
    rules: RuleSet
    walls: Doubles
    """(n, 4): segments of the outline and of the columns."""
    fixed: Outlines
    doorways: tuple[DoorWay, ...]


def make_field(plan: FloorPlan, rules: RuleSet, pinned: Sequence[Row] = ()) -> Field:
    """Return the arrays of a plan; `pinned` are (corners, low, high, class, name) of pieces that stand already."""
    rings = [plan.corners, *plan.holes]
    walls = np.concatenate([np.concatenate([ring, np.roll(ring, -1, axis=0)], axis=1) for ring in rings])
    rows: list[Row] = []
    doorways = []
    for number, door in enumerate(plan.doors):
        name = door_name(door, number)
        rows += [(c, 0.0, DOOR_HEAD_M, DOOR, name) for c in door_outlines(plan, door, rules)]
        deep = max(rules.door_approach, rules.path / 2 + 0.1)
        doorways.append(DoorWay(name, _on_edge(plan, door.edge, door.start_m, door.end_m, deep)))
    for number, window in enumerate(plan.windows):
        low = max(0.0, window.sill_m - UNDER_SILL_M)
        outline = _on_edge(plan, window.edge, window.start_m, window.end_m, rules.window_band)
        rows.append((outline, low, window.head_m, WINDOW, f"window {number + 1}"))
    r = KEEP_FREE_RADIUS_M
    for x, y in plan.keep_free:
        square = np.array([[x - r, y - r], [x + r, y - r], [x + r, y + r], [x - r, y + r]])
        rows.append((square, 0.0, math.inf, KEPT, "the place kept free"))
    rows += pinned
    return Field(plan, rules, np.ascontiguousarray(walls), outlines(rows), tuple(doorways))


def outlines(rows: Sequence[Row]) -> Outlines:
    """Return the rows as arrays."""
    return Outlines(
        np.array([row[0] for row in rows], dtype=np.float64).reshape(-1, 4, 2),
        np.array([[row[1], row[2]] for row in rows], dtype=np.float64).reshape(-1, 2),
        np.array([row[3] for row in rows], dtype=np.int64),
        tuple(row[4] for row in rows),
    )


def door_name(door: Door, number: int) -> str:
    """Return how a door is called in reasons."""
    return f"door {number + 1}" + (f" (to {door.name})" if door.name else "")


def leaf_m(door: Door, rules: RuleSet) -> float:
    """Return how deep a door's leaf swings into the room: 0 for sliding and outward ones, half for pairs."""
    if door.swing in {"sliding", "out"}:
        return 0.0
    if door.width_m <= rules.door_reach or door.swing == "in":
        return door.width_m
    return door.width_m / 2 if door.width_m <= 2 * rules.door_reach else 0.0


def door_outlines(plan: FloorPlan, door: Door, rules: RuleSet) -> list[Doubles]:
    """Return the convex outlines that a door keeps free: its approach, and its swing for either hand or the one told.

    The swing's quarter disc is circumscribed: a square for an unknown hand, five corners (as two outlines) for a known.
    """
    side, leaf = rules.door_side, leaf_m(door, rules)
    deep = rules.door_approach
    if door.hinge == "unknown" or leaf == 0.0 or leaf < door.width_m:
        deep = max(deep, leaf)
    found = [_on_edge(plan, door.edge, door.start_m - side, door.end_m + side, deep)]
    if deep < leaf:
        corner, along, _ = plan.edge(door.edge)
        inward = np.array([-along[1], along[0]])
        at_end = door.hinge == "left"
        hinge = corner + along * (door.end_m if at_end else door.start_m)
        sweep = -along if at_end else along
        t = math.tan(math.pi / 8) * leaf
        knee = hinge + sweep * t + inward * leaf
        first = np.array([hinge, hinge + sweep * leaf, hinge + sweep * leaf + inward * t, knee])
        second = np.array([hinge, knee, hinge + inward * leaf, hinge])
        found += [first, second]
    return found


def _on_edge(plan: FloorPlan, edge: int, start_m: float, end_m: float, deep_m: float) -> Doubles:
    corner, along, _ = plan.edge(edge)
    inward = np.array([-along[1], along[0]])
    a, b = corner + along * start_m, corner + along * end_m
    return np.array([a, b, b + inward * deep_m, a + inward * deep_m])


__all__ = ["BODY", "PERSON_M", "RUG", "ZONE", "DoorWay", "Field", "Outlines", "make_field", "outlines"]


# Exact regions for what stands free: all positions of rectangles at one angle that walls and obstacles allow.
#
# The region is the floor's inner fit (every position at which the rectangle lies on the floor) without the Minkowski
# sums of the obstacles with the turned rectangle. All outlines are convex pieces, whose sums are hulls of corner sums.


Rows = Sequence[tuple[tuple[float, float, float, float, float, float], int]]
"""(x0, x1, y0, y1, low, high) in the piece's frame and class (`free_sets`) of each rectangle that moves together."""


def free_region(field: Field, rows: Rows, theta_rad: float, extra: Sequence[tuple[Any, ...]] = ()) -> Any:
    """Return where the frame's origin may be, as a closed (multi)polygon.

    `extra` are further obstacles: (corners, low, high, class, name). Places that exist only as a point or a line
    (exact fits) are left out of the region; `free_sets` finds those along walls.
    """
    plan = field.plan
    room = Polygon(plan.corners, list(plan.holes))
    region = room.buffer(0)
    c, s = math.cos(theta_rad), math.sin(theta_rad)
    turn = np.array([[c, s], [-s, c]])
    fixed = field.fixed
    known = [(fixed.corners[i], *fixed.heights_m[i], int(fixed.classes[i]), "") for i in range(len(fixed.classes))]
    blocked = []
    for (x0, x1, y0, y1, low, high), kind in rows:
        corners = np.array([(x0, y0), (x1, y0), (x1, y1), (x0, y1)]) @ turn
        blocked += [_sum(segment.reshape(2, 2), corners) for segment in field.walls]
        middle = corners.mean(axis=0)
        region = region.intersection(shapely.affinity.translate(room, -middle[0], -middle[1]))
        for outline, bottom, top, other, _ in (*known, *extra):
            if MEETS[kind, other] and bottom < high - SKIN_M and top > low + SKIN_M:
                blocked.append(_sum(np.asarray(outline), corners))
    return region.difference(shapely.union_all([b for b in blocked if b.area > 0]))


def _sum(outline: Doubles, corners: Doubles) -> Polygon:
    """Return the positions at which a rectangle at `corners` from the origin meets a convex outline."""
    sums = (outline[:, None, :] - corners[None, :, :]).reshape(-1, 2)
    return shapely.convex_hull(shapely.multipoints(sums))

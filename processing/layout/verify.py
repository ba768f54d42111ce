"""The judge: checks an arrangement against every hard rule with shapely alone, sharing no code with the solver.

It reads the plan, the rule set's numbers and the placed pieces (size, position, angle, what their kind asks for) and
builds all geometry itself. Tolerances: overlaps count from 1 um deep (by area over length), paths are measured to 1 mm.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import combinations
from typing import Any

import numpy as np
import shapely
from shapely.geometry import MultiPolygon, Polygon

from processing.layout.items import ItemSpec
from processing.layout.plan import Door, FloorPlan
from processing.layout.rules import RuleSet

DEEP_M = 1e-5
"""Overlaps thinner than this are contact (arrays are rounded to 0.1 um, JSON to 1 um)."""
PATH_M = 1e-3
"""Paths may be narrower by this: below what anyone can measure."""
HEAD_ROOM_M = 2.0
TOUCH_M = 0.05
CAMERA_M = 0.3
SILL_GAP_M = 0.05
DOOR_TOP_M = 2.1


@dataclass(frozen=True)
class Piece:
    """A placed piece."""

    id: str
    spec: ItemSpec
    x_m: float
    y_m: float
    theta_rad: float
    group: str


@dataclass(frozen=True)
class Violation:
    """A hard rule broken: which, by what, and by how much."""

    rule: str
    who: tuple[str, ...]
    amount: float
    """m2 of overlap, or metres missing."""

    def __str__(self) -> str:
        return f"{self.rule}: {' and '.join(self.who)} ({self.amount:.4g})"


@dataclass(frozen=True)
class Verdict:
    """What was found."""

    violations: tuple[Violation, ...]
    unreachable_doors: tuple[int, ...]
    """Doors that no path of the rule's width reaches even in the empty room: not the furniture's fault."""


def verify(plan: FloorPlan, pieces: Sequence[Piece], rules: RuleSet) -> Verdict:
    """Check every hard rule (H1 to H6, H8, H9 of docs/arrangement.md)."""
    room = Polygon(plan.corners, [hole for hole in plan.holes])
    shapes = [
        _box(p, -p.spec.size_m[0] / 2, p.spec.size_m[0] / 2, -p.spec.size_m[1] / 2, p.spec.size_m[1] / 2)
        for p in pieces
    ]
    found = [
        *_outside(room, pieces, shapes),
        *_overlaps(pieces, shapes),
        *_under_ceiling(plan, pieces),
        *_doors(plan, pieces, shapes, rules),
        *_windows(plan, pieces, shapes, rules),
        *_kept_free(plan, pieces, shapes),
    ]
    zones, clashes = _zones(room, pieces, shapes, rules)
    found += clashes
    paths, unreachable = _paths(plan, room, pieces, shapes, zones, rules)
    return Verdict(tuple([*found, *paths]), unreachable)


def _box(piece: Piece, x0: float, x1: float, y0: float, y1: float) -> Polygon:
    c, s = math.cos(piece.theta_rad), math.sin(piece.theta_rad)
    return Polygon(
        [(piece.x_m + x * c - y * s, piece.y_m + x * s + y * c) for x, y in ((x0, y0), (x1, y0), (x1, y1), (x0, y1))]
    )


def _deep(shape: Any) -> bool:
    """Tell whether an overlap is more than contact."""
    return bool(shape.area > 0 and shape.area > DEEP_M * max(shape.length / 2, 1e-3))


def _outside(room: Polygon, pieces: Sequence[Piece], shapes: Sequence[Polygon]) -> list[Violation]:
    shapely.prepare(room)
    found = []
    for piece, shape in zip(pieces, shapes, strict=True):
        if not room.covers(shape):
            over = shape.difference(room)
            if _deep(over):
                found.append(Violation("inside the floor", (piece.id,), over.area))
    return found


def _overlaps(pieces: Sequence[Piece], shapes: Sequence[Polygon]) -> list[Violation]:
    found = []
    for i, j in combinations(range(len(pieces)), 2):
        a, b = pieces[i].spec, pieces[j].spec
        if a.is_rug != b.is_rug or min(a.top_m, b.top_m) - max(a.base_m, b.base_m) <= DEEP_M:
            continue
        if shapes[i].intersects(shapes[j]):
            shared = shapes[i].intersection(shapes[j])
            if _deep(shared):
                found.append(Violation("no overlap", (pieces[i].id, pieces[j].id), shared.area))
    return found


def _under_ceiling(plan: FloorPlan, pieces: Sequence[Piece]) -> list[Violation]:
    return [
        Violation("under the ceiling", (p.id,), p.spec.top_m - plan.ceiling_height_m)
        for p in pieces
        if p.spec.top_m > plan.ceiling_height_m + DEEP_M
    ]


def _strip(plan: FloorPlan, edge: int, start_m: float, end_m: float, deep_m: float) -> Polygon:
    a = plan.corners[edge]
    b = plan.corners[(edge + 1) % len(plan.corners)]
    u = (b - a) / math.dist(a, b)
    n = np.array([-u[1], u[0]])
    return Polygon([a + u * start_m, a + u * end_m, a + u * end_m + n * deep_m, a + u * start_m + n * deep_m])


def _door_areas(plan: FloorPlan, door: Door, rules: RuleSet) -> list[Polygon]:
    """Return the approach and the swept area of the leaf, for both hands where the hand is not known."""
    areas = [_strip(plan, door.edge, door.start_m - rules.door_side, door.end_m + rules.door_side, rules.door_approach)]
    wide = door.end_m - door.start_m
    if door.swing in ("sliding", "out"):
        return areas
    pair = wide > rules.door_reach and door.swing != "in"
    if pair and wide > 2 * rules.door_reach:
        return areas
    leaf = wide / 2 if pair else wide
    hands = ("left", "right") if door.hinge == "unknown" or pair else (door.hinge,)
    a = plan.corners[door.edge]
    b = plan.corners[(door.edge + 1) % len(plan.corners)]
    u = (b - a) / math.dist(a, b)
    inward = np.array([-u[1], u[0]])
    for hand in hands:
        pivot, closed = (a + u * door.end_m, -u) if hand == "left" else (a + u * door.start_m, u)
        turns = np.linspace(0, np.pi / 2, 33)
        areas.append(Polygon([pivot, *(pivot + leaf * (math.cos(t) * closed + math.sin(t) * inward) for t in turns)]))
    return areas


def _doors(plan: FloorPlan, pieces: Sequence[Piece], shapes: Sequence[Polygon], rules: RuleSet) -> list[Violation]:
    found = []
    for number, door in enumerate(plan.doors):
        area = shapely.union_all(_door_areas(plan, door, rules))
        for piece, shape in zip(pieces, shapes, strict=True):
            if piece.spec.base_m < DOOR_TOP_M and shape.intersects(area):
                shared = shape.intersection(area)
                if _deep(shared):
                    found.append(Violation("door free", (piece.id, f"door {number + 1}"), shared.area))
    return found


def _windows(plan: FloorPlan, pieces: Sequence[Piece], shapes: Sequence[Polygon], rules: RuleSet) -> list[Violation]:
    found = []
    for number, window in enumerate(plan.windows):
        area = _strip(plan, window.edge, window.start_m, window.end_m, rules.window_band)
        low = max(0.0, window.sill_m - SILL_GAP_M)
        for piece, shape in zip(pieces, shapes, strict=True):
            tall = piece.spec.top_m > low + DEEP_M and piece.spec.base_m < window.head_m - DEEP_M
            if tall and not piece.spec.is_rug and shape.intersects(area):
                shared = shape.intersection(area)
                if _deep(shared):
                    found.append(Violation("window free", (piece.id, f"window {number + 1}"), shared.area))
    return found


def _kept_free(plan: FloorPlan, pieces: Sequence[Piece], shapes: Sequence[Polygon]) -> list[Violation]:
    found = []
    for x, y in plan.keep_free:
        place = shapely.Point(x, y).buffer(CAMERA_M)
        for piece, shape in zip(pieces, shapes, strict=True):
            shared = shape.intersection(place)
            if _deep(shared):
                found.append(Violation("place kept free", (piece.id,), shared.area))
    return found


def _asked(piece: Piece, rules: RuleSet) -> tuple[list[Polygon], list[Polygon], int]:
    """Return the use zones that a piece always needs, its side zones, and how many of those it needs."""
    w, d, _ = (v / 2 for v in piece.spec.size_m)
    always, sides = [], []
    for zone in piece.spec.zones:
        deep = float(getattr(rules, zone.rule)) - zone.less_m
        if deep < 1e-6:
            continue
        extent = {"front": (-w, w, d, d + deep), "back": (-w, w, -d - deep, -d)}
        extent |= {"left": (-w - deep, -w, -d, d), "right": (w, w + deep, -d, d)}
        shape = _box(piece, *extent[zone.side])
        optional = bool(piece.spec.sides_rule) and zone.side in ("left", "right")
        (sides if optional else always).append(shape)
    need = int(getattr(rules, piece.spec.sides_rule)) if piece.spec.sides_rule else 0
    return always, sides, min(need, len(sides))


def _zones(
    room: Polygon, pieces: Sequence[Piece], shapes: Sequence[Polygon], rules: RuleSet
) -> tuple[list[tuple[str, list[Polygon], list[Polygon], int]], list[Violation]]:
    """Return for each piece (id, zones always asked, free side zones, how many of these); and what clashes."""
    asked, found = [], []
    for piece in pieces:
        always, sides, need = _asked(piece, rules)
        for zone in always:
            clash = _clash(room, piece, zone, pieces, shapes)
            if clash is not None:
                found.append(clash)
        clashes = [_clash(room, piece, zone, pieces, shapes) for zone in sides]
        free = [zone for zone, clash in zip(sides, clashes, strict=True) if clash is None]
        if len(free) < need:
            found.append(next(clash for clash in clashes if clash is not None))
        asked.append((piece.id, always, free, need))
    return asked, found


def _clash(
    room: Polygon, owner: Piece, zone: Polygon, pieces: Sequence[Piece], shapes: Sequence[Polygon]
) -> Violation | None:
    """Return what stands in a use zone: a wall or a piece of another group."""
    if not room.covers(zone):
        over = zone.difference(room)
        if _deep(over):
            return Violation("use zone free", (owner.id, "wall"), over.area)
    for piece, shape in zip(pieces, shapes, strict=True):
        if piece.id == owner.id or piece.group == owner.group or piece.spec.is_rug or piece.spec.base_m >= HEAD_ROOM_M:
            continue
        if shape.intersects(zone):
            shared = shape.intersection(zone)
            if _deep(shared):
                return Violation("use zone free", (owner.id, piece.id), shared.area)
    return None


def _paths(
    plan: FloorPlan,
    room: Polygon,
    pieces: Sequence[Piece],
    shapes: Sequence[Polygon],
    asked: Sequence[tuple[str, list[Polygon], list[Polygon], int]],
    rules: RuleSet,
) -> tuple[list[Violation], tuple[int, ...]]:
    radius = (rules.path - PATH_M) / 2
    deep = max(rules.door_approach, rules.path / 2 + 0.1)
    ways = [_strip(plan, door.edge, door.start_m, door.end_m, deep) for door in plan.doors]
    served = [{n for n, way in enumerate(ways) if part.intersects(way)} for part in _walkable(room, radius)]
    needed = max(served, key=len, default=set())
    unreachable = tuple(n for n in range(len(ways)) if n not in needed)
    solid = [s for p, s in zip(pieces, shapes, strict=True) if not p.spec.is_rug and p.spec.base_m < HEAD_ROOM_M]
    parts = _walkable(room.difference(shapely.union_all(solid)), radius)
    best: list[Violation] | None = None
    for part in parts:
        failed = _unserved(part, ways, needed, asked, radius, rules)
        if best is None or len(failed) < len(best):
            best = failed
        if not failed:
            break
    if best is None:
        best = [Violation("path", ("nowhere to walk",), rules.path)]
    return best, unreachable


def _walkable(floor: Any, radius: float) -> list[Polygon]:
    """Return the parts of the floor where the middle of a walker may be."""
    eroded = floor.buffer(-radius, quad_segs=32)
    parts = list(eroded.geoms) if isinstance(eroded, MultiPolygon) else [eroded]
    return sorted((p for p in parts if not p.is_empty), key=lambda p: -p.area)


def _unserved(
    part: Polygon,
    ways: Sequence[Polygon],
    needed: set[int],
    asked: Sequence[tuple[str, list[Polygon], list[Polygon], int]],
    radius: float,
    rules: RuleSet,
) -> list[Violation]:
    found = []
    served = {n for n in needed if part.intersects(ways[n])}
    alternatives_ok = len(served) == len(needed)
    if not alternatives_ok:
        missing = sorted(needed - served)
        found = [Violation("path", (f"door {n + 1}",), part.distance(ways[n])) for n in missing]
    near = radius - TOUCH_M + PATH_M
    for name, always, sides, need in asked:
        gaps = [part.distance(zone) for zone in always]
        side_gaps = sorted(part.distance(zone) for zone in sides)[:need]
        worst = max([*gaps, *side_gaps], default=0.0)
        if worst > near:
            found.append(Violation("path", (name,), worst - near))
    if rules.turning_circle > 0:
        spare = rules.turning_circle / 2 - radius
        if part.buffer(radius, quad_segs=32).buffer(-rules.turning_circle / 2 + PATH_M / 2, quad_segs=32).is_empty:
            found.append(Violation("turning circle", ("floor",), spare))
    return found

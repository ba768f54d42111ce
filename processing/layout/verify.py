"""The judge: checks an arrangement against every hard rule with shapely alone, sharing no code with the solver.

It reads the plan, the rule set's numbers and the placed pieces (size, position, angle, what their kind asks for) and
builds all geometry itself. Tolerances: overlaps count from 1 um deep (by area over length), paths are measured to 1 mm.
"""

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import combinations
from typing import Any, Self, TypeAlias

import numpy as np
import shapely
from shapely.geometry import Polygon

from processing.layout.arrangement import PlacedItem
from processing.layout.items import KINDS, ItemSpec
from processing.layout.plan import Door, FloorPlan
from processing.layout.rules import RuleSet

DEEP_M = 1e-5  # overlaps thinner than this are contact (arrays are rounded to 0.1 um, JSON to 1 um)
PATH_M = 1e-3  # paths may be narrower by this: below what anyone can measure
HEAD_ROOM_M = 2.0  # chosen: what hangs higher is in nobody's way
TOUCH_M = 0.05  # chosen: slack where a way passes a piece
CAMERA_M = 0.3  # chosen: a tripod's feet
VIEW_M, HIDES_M = 0.9, 1.3  # nothing taller than the second stands nearer to the camera than the first
SILL_GAP_M = 0.05  # chosen: clearance below a sill
DOOR_TOP_M = 2.1  # chosen: a usual door's
_QUARTER = np.linspace(0, np.pi / 2, 33)

_Reached: TypeAlias = tuple[str, list[Polygon], list[Polygon], int]
"""A piece's id, the zones it always needs, its free side zones, and how many of those it needs."""


@dataclass(frozen=True)
class Piece:
    """A placed piece."""

    id: str
    spec: ItemSpec
    x_m: float
    y_m: float
    theta_rad: float
    group: str

    @classmethod
    def of(cls, item: PlacedItem) -> Self:
        """Return a piece of an arrangement; one of no built-in kind asks for nothing but its size."""
        kind = KINDS.get(item.category, ItemSpec(item.category, item.size_m))
        spec = replace(kind, size_m=item.size_m, base_m=item.base_m)
        return cls(item.id, spec, *item.t_m[:2], item.theta_rad, item.group)


@dataclass(frozen=True)
class Violation:
    """A hard rule broken: which, by what, and by how much."""

    rule: str
    who: tuple[str, ...]
    amount: float
    """m2 of overlap, or metres missing."""

    def __str__(self) -> str:
        return f"{self.rule}: {' and '.join(self.who)} ({self.amount:.4g})"


class Judge:
    """Judges pieces in one room by one rule set; what does not depend on the pieces is made once."""

    def __init__(self, plan: FloorPlan, rules: RuleSet, like: Self | None = None) -> None:
        """Make what does not depend on the pieces; `like` is another judge of the same plan, to share from."""
        self._plan, self.rules = plan, rules
        self.room: Polygon = like.room if like else Polygon(plan.corners, list(plan.holes))
        shapely.prepare(self.room)
        if like and like.rules.door_reach == rules.door_reach:
            self.swings: list[tuple[int, Polygon]] = like.swings
        else:
            self.swings = [(n, area) for n, door in enumerate(plan.doors) for area in _swings(plan, door, rules)]
        side, deep = rules.door_side, rules.door_approach
        approaches = [_strip(plan, d.edge, d.start_m - side, d.end_m + side, deep) for d in plan.doors]
        self._doors = [*enumerate(approaches), *self.swings]
        self._windows = [_strip(plan, w.edge, w.start_m, w.end_m, rules.window_band) for w in plan.windows]
        self._kept, self._views = (
            [(n, shapely.Point(at).buffer(radius)) for n, at in enumerate(plan.keep_free)]
            for radius in (CAMERA_M, VIEW_M)
        )
        self._radius = (rules.path - PATH_M) / 2

    @cached_property
    def _ways(self) -> list[Polygon]:
        """The floor before each door, where a path through it begins."""
        deep = max(self.rules.door_approach, self.rules.path / 2 + 0.1)
        return [_strip(self._plan, door.edge, door.start_m, door.end_m, deep) for door in self._plan.doors]

    @cached_property
    def _needed(self) -> set[int]:
        """The doors of the largest part of the empty floor that any door leads to."""
        parts = _walkable(self.room, self._radius)  # largest first
        return next(filter(None, ({n for n, w in enumerate(self._ways) if p.intersects(w)} for p in parts)), set())

    def judge(self, pieces: Sequence[Piece]) -> tuple[Violation, ...]:
        """Return what breaks a hard rule (1 to 6, 8 to 10 of docs/reference/arrangement.md)."""
        return tuple(self._violations(pieces))

    def passes(self, pieces: Sequence[Piece], *, fits: bool = False) -> bool:
        """Return whether no rule is broken; ends at the first that is. `fits`: no need to look for overlaps again."""
        return next(self._violations(pieces, fits=fits), None) is None

    def _violations(self, pieces: Sequence[Piece], *, fits: bool = False) -> Iterator[Violation]:
        shapes = _boxes(pieces, [(-s[0] / 2, s[0] / 2, -s[1] / 2, s[1] / 2) for s in (p.spec.size_m for p in pieces)])
        if not fits:
            yield from _outside(self.room, pieces, shapes)
            yield from _overlaps(pieces, shapes)
            yield from [
                Violation("under the ceiling", (p.id,), p.spec.top_m - self._plan.ceiling_height_m)
                for p in pieces
                if p.spec.top_m > self._plan.ceiling_height_m + DEEP_M
            ]
        yield from _apart(pieces, shapes, self.rules.together)
        yield from self._openings(pieces, shapes)
        zones, clashes = _zones(self.room, pieces, shapes, _asked(pieces, self.rules))
        yield from clashes
        yield from self._paths(pieces, shapes, zones)

    def _openings(self, pieces: Sequence[Piece], shapes: Sequence[Polygon]) -> list[Violation]:
        found = []
        for piece, shape in zip(pieces, shapes, strict=True):
            if piece.spec.base_m < DOOR_TOP_M:
                found += _within("door free", "door", piece, shape, self._doors)
            found += _within("place kept free", "place", piece, shape, self._kept)
            if piece.spec.top_m > HIDES_M + DEEP_M:
                found += _within("view kept free", "place", piece, shape, self._views)
            for number, (window, area) in enumerate(zip(self._plan.windows, self._windows, strict=True)):
                low = max(0.0, window.sill_m - SILL_GAP_M)
                tall = piece.spec.top_m > low + DEEP_M and piece.spec.base_m < window.head_m - DEEP_M
                if tall and not piece.spec.is_rug:
                    found += _within("window free", "window", piece, shape, [(number, area)])
        return found

    def _paths(self, pieces: Sequence[Piece], shapes: Sequence[Polygon], zones: Sequence[_Reached]) -> list[Violation]:
        solid = [s for p, s in zip(pieces, shapes, strict=True) if not p.spec.is_rug and p.spec.base_m < HEAD_ROOM_M]
        parts = _walkable(self.room.difference(shapely.union_all(solid)), self._radius)
        best: list[Violation] | None = None
        for part in parts:
            failed = _unserved(part, self._ways, self._needed, zones, self._radius, self.rules)
            if best is None or len(failed) < len(best):
                best = failed
            if not failed:
                break
        return [Violation("path", ("nowhere to walk",), self.rules.path)] if best is None else best


def _boxes(pieces: Sequence[Piece], extents: Sequence[tuple[float, float, float, float]]) -> list[Polygon]:
    """Return rectangles x0, x1, y0, y1 of pieces' own frames in the room."""
    if not pieces:
        return []
    pose = np.array([(p.x_m, p.y_m, math.cos(p.theta_rad), math.sin(p.theta_rad)) for p in pieces])
    x, y = np.array(extents)[:, [0, 1, 1, 0]], np.array(extents)[:, [2, 2, 3, 3]]
    c, s = pose[:, 2:3], pose[:, 3:4]
    corners = np.stack([pose[:, 0:1] + x * c - y * s, pose[:, 1:2] + x * s + y * c], axis=2)
    return list(shapely.polygons(corners))


def _within(rule: str, what: str, piece: Piece, shape: Polygon, areas: Sequence[tuple[int, Any]]) -> list[Violation]:
    shared = [(number, _shared_m2(shape, area)) for number, area in areas]
    return [Violation(rule, (piece.id, f"{what} {number + 1}"), m2) for number, m2 in shared if m2]


def _shared_m2(shape: Polygon, area: Any) -> float:
    """Return the overlap of two shapes; 0 for contact."""
    return _deep_m2(shape.intersection(area)) if area.intersects(shape) else 0.0


def _over_m2(room: Polygon, shape: Polygon) -> float:
    """Return what of a shape lies outside of the room; 0 for contact."""
    return 0.0 if room.covers(shape) else _deep_m2(shape.difference(room))


def _deep_m2(shape: Any) -> float:
    """Return the area of an overlap; 0 where it is no more than contact."""
    area_m2 = float(shape.area)
    return area_m2 if area_m2 > DEEP_M * max(shape.length / 2, 1e-3) else 0.0


def _outside(room: Polygon, pieces: Sequence[Piece], shapes: Sequence[Polygon]) -> list[Violation]:
    over = [(piece, _over_m2(room, shape)) for piece, shape in zip(pieces, shapes, strict=True)]
    return [Violation("inside the floor", (piece.id,), over_m2) for piece, over_m2 in over if over_m2]


def _overlaps(pieces: Sequence[Piece], shapes: Sequence[Polygon]) -> list[Violation]:
    found = []
    for i, j in combinations(range(len(pieces)), 2):
        a, b = pieces[i].spec, pieces[j].spec
        if a.is_rug != b.is_rug or min(a.top_m, b.top_m) - max(a.base_m, b.base_m) <= DEEP_M:
            continue
        reach = math.hypot(*a.size_m[:2]) + math.hypot(*b.size_m[:2])
        if 2 * math.hypot(pieces[i].x_m - pieces[j].x_m, pieces[i].y_m - pieces[j].y_m) > reach:
            continue
        if shared_m2 := _shared_m2(shapes[i], shapes[j]):
            found.append(Violation("no overlap", (pieces[i].id, pieces[j].id), shared_m2))
    return found


def _apart(pieces: Sequence[Piece], shapes: Sequence[Polygon], within_m: float) -> list[Violation]:
    """Return bound pieces that stand away from what they belong to, where that is there."""
    found = []
    for piece, shape in zip(pieces, shapes, strict=True):
        host = piece.spec.group_with
        hosts = [s for p, s in zip(pieces, shapes, strict=True) if host and p.spec.category.endswith(host)]
        if piece.spec.bound and hosts:
            gap_m = min(shape.distance(s) for s in hosts)
            if gap_m > within_m + PATH_M:
                found.append(Violation("kept together", (piece.id,), gap_m - within_m))
    return found


def _strip(plan: FloorPlan, edge: int, start_m: float, end_m: float, deep_m: float) -> Polygon:
    (ax, ay), (ux, uy), _ = plan.edge(edge)
    rim = ((start_m, 0.0), (end_m, 0.0), (end_m, deep_m), (start_m, deep_m))
    return Polygon([(ax + t * ux - d * uy, ay + t * uy + d * ux) for t, d in rim])


def _swings(plan: FloorPlan, door: Door, rules: RuleSet) -> list[Polygon]:
    """Return what the leaf sweeps: of both hands where it is not known, of a pair of leaves where it is too wide."""
    areas: list[Polygon] = []
    wide = door.end_m - door.start_m
    if door.swing in ("sliding", "out"):
        return areas
    pair = wide > rules.door_reach and door.swing != "in"
    if pair and wide > 2 * rules.door_reach:
        return areas
    leaf = wide / 2 if pair else wide
    hands = ("left", "right") if door.hinge == "unknown" or pair else (door.hinge,)
    (ax, ay), (ux, uy), _ = plan.edge(door.edge)
    for hand in hands:
        at, sign = (door.end_m, -1.0) if hand == "left" else (door.start_m, 1.0)
        arc = np.stack([at + sign * leaf * np.cos(_QUARTER), leaf * np.sin(_QUARTER)], axis=1)
        rim = np.concatenate([[[at, 0.0]], arc])
        areas.append(Polygon(rim @ np.array([[ux, uy], [-uy, ux]]) + (ax, ay)))
    return areas


def _asked(pieces: Sequence[Piece], rules: RuleSet) -> list[tuple[list[Polygon], list[Polygon], int]]:
    """Return for each piece the use zones that it always needs, its side zones, and how many of those it needs."""
    rows = [_zone_extents(piece, rules) for piece in pieces]
    owners = [piece for piece, extents in zip(pieces, rows, strict=True) for _ in extents]
    zones = iter(_boxes(owners, [extent for extents in rows for _, extent in extents]))
    asked = []
    for piece, extents in zip(pieces, rows, strict=True):
        shapes = [(optional, next(zones)) for optional, _ in extents]
        sides = [shape for optional, shape in shapes if optional]
        need = getattr(rules, piece.spec.sides_needed) if piece.spec.sides_needed else 0
        asked.append(([shape for optional, shape in shapes if not optional], sides, min(need, len(sides))))
    return asked


def _zone_extents(piece: Piece, rules: RuleSet) -> list[tuple[bool, tuple[float, float, float, float]]]:
    """Return whether each use zone is a side's, of which not all are needed, and its extent in the piece's frame."""
    w, d, _ = (v / 2 for v in piece.spec.size_m)
    rows = []
    for zone in piece.spec.zones:
        deep = zone.depth_m(rules)
        if deep < 1e-6:
            continue
        extent = {"front": (-w, w, d, d + deep), "back": (-w, w, -d - deep, -d)}
        extent |= {"left": (-w - deep, -w, -d, d), "right": (w, w + deep, -d, d)}
        rows.append((piece.spec.sides_needed is not None and zone.side in ("left", "right"), extent[zone.side]))
    return rows


def _zones(
    room: Polygon,
    pieces: Sequence[Piece],
    shapes: Sequence[Polygon],
    asked: Sequence[tuple[list[Polygon], list[Polygon], int]],
) -> tuple[list[_Reached], list[Violation]]:
    """Return for each piece (id, zones always asked, free side zones, how many of these); and what clashes."""
    reached: list[_Reached] = []
    found = []
    for piece, (always, sides, need) in zip(pieces, asked, strict=True):
        found += [clash for zone in always if (clash := _clash(room, piece, zone, pieces, shapes)) is not None]
        side_clashes = [_clash(room, piece, zone, pieces, shapes) for zone in sides]
        free = [zone for zone, clash in zip(sides, side_clashes, strict=True) if clash is None]
        if len(free) < need:
            found.append(next(clash for clash in side_clashes if clash is not None))
        reached.append((piece.id, always, free, need))
    return reached, found


def _clash(
    room: Polygon, owner: Piece, zone: Polygon, pieces: Sequence[Piece], shapes: Sequence[Polygon]
) -> Violation | None:
    """Return what stands in a use zone: a wall or a piece of another group."""
    if over_m2 := _over_m2(room, zone):
        return Violation("use zone free", (owner.id, "wall"), over_m2)
    for piece, shape in zip(pieces, shapes, strict=True):
        if piece.id == owner.id or piece.group == owner.group or piece.spec.is_rug or piece.spec.base_m >= HEAD_ROOM_M:
            continue
        if shared_m2 := _shared_m2(shape, zone):
            return Violation("use zone free", (owner.id, piece.id), shared_m2)
    return None


def _walkable(floor: Any, radius: float) -> list[Polygon]:
    """Return the parts of the floor where the middle of a walker may be."""
    parts = shapely.get_parts(floor.buffer(-radius, quad_segs=32))
    return sorted((p for p in parts if not p.is_empty), key=lambda p: -p.area)


def _unserved(
    part: Polygon, ways: Sequence[Polygon], needed: set[int], asked: Sequence[_Reached], radius: float, rules: RuleSet
) -> list[Violation]:
    missing = sorted(n for n in needed if not part.intersects(ways[n]))
    found = [Violation("path", (f"door {n + 1}",), part.distance(ways[n])) for n in missing]
    near = radius - TOUCH_M + PATH_M
    for name, always, sides, need in asked:
        gaps = [part.distance(zone) for zone in always]
        worst = max([*gaps, *sorted(part.distance(zone) for zone in sides)[:need]], default=0.0)
        if worst > near:
            found.append(Violation("path", (name,), worst - near))
    if rules.turning_circle > 0:
        spare = rules.turning_circle / 2 - radius
        if part.buffer(radius, quad_segs=32).buffer(-rules.turning_circle / 2 + PATH_M / 2, quad_segs=32).is_empty:
            found.append(Violation("turning circle", ("floor",), spare))
    return found

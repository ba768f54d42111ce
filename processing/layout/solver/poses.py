"""Frames and poses: the room's canonical frame, and pieces where they stand in it or in the room.

However a room is moved, turned or mirrored, it gets the same arrangement: the search works in one canonical frame.
Every corner can be its origin with its edge along +x, in the plan or in its mirror image. The frame whose list of edge
lengths, turns and openings (rounded to 0.1 mm) is least is taken, and coordinates in it are rounded to 0.1 um, so that
the search sees the same numbers bit by bit.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import TypeAlias, TypeVar

import numpy as np

from processing.ground.arrays import Doubles
from processing.layout.items import Item
from processing.layout.plan import Door, FloorPlan, Hinge, Hung, Window
from processing.layout.rules import RuleSet
from processing.layout.solver.field import PERSON_M, Row
from processing.layout.solver.free_sets import BODY, RUG, ZONE
from processing.layout.solver.grouping import ROLES
from processing.layout.solver.search import Final
from processing.layout.solver.steering import ROLE
from processing.layout.solver.units import Rect, zone_choices, zone_rect
from processing.layout.verify import Judge, Piece

LIST_STEPS_M = (0.5, 0.1, 1e-4)
"""Lengths are compared to these steps, one after the other, when frames are (the last: what a plan is drawn to)."""
SNAP_M = 1e-7
"""Coordinates in the canonical frame are rounded to this (chosen: above rounding, below `DEEP_M` of the judge)."""
Pose: TypeAlias = tuple[float, float, float]  # x, y in metres, theta in radians
OpeningT = TypeVar("OpeningT", Door, Window, Hung)
_OTHER: dict[str, Hinge] = {"left": "right", "right": "left", "unknown": "unknown"}


@dataclass(frozen=True)
class Frame:
    """Where the canonical frame lies in the room: mirrored (x negated) first, then origin and angle."""

    origin: tuple[float, float]
    angle_rad: float
    mirrored: bool
    first: int = 0
    """The corner of the (mirrored) outline that is the canonical frame's origin."""
    count: int = 0
    """How many corners the outline has."""

    def edge_back(self, edge: int) -> int | None:
        """Return the room's edge of an edge in the canonical frame; None for a column's face."""
        if not 0 <= edge < self.count:
            return None
        side = (edge + self.first) % self.count
        return (self.count - 2 - side) % self.count if self.mirrored else side

    def into(self, pose: Pose) -> Pose:
        """Return a pose of the room in the canonical frame."""
        x, y, theta = pose
        if self.mirrored:
            x, theta = -x, -theta
        dx, dy = x - self.origin[0], y - self.origin[1]
        c, s = math.cos(self.angle_rad), math.sin(self.angle_rad)
        return dx * c + dy * s, dy * c - dx * s, wrapped(theta - self.angle_rad)

    def back(self, pose: Pose) -> Pose:
        """Return a pose of the canonical frame in the room."""
        x, y, theta = pose
        c, s = math.cos(self.angle_rad), math.sin(self.angle_rad)
        x, y = self.origin[0] + x * c - y * s, self.origin[1] + x * s + y * c
        theta += self.angle_rad
        return (-x, y, wrapped(-theta)) if self.mirrored else (x, y, wrapped(theta))


def wrapped(angle_rad: float) -> float:
    """Return an angle in (-pi, pi]."""
    turned = math.remainder(angle_rad, 2 * math.pi)
    return math.pi if turned <= -math.pi else turned


def canonical_plan(plan: FloorPlan, pins: Sequence[Pose], *, mirror: bool = True) -> tuple[FloorPlan, Frame]:
    """Return the plan in its canonical frame, and the frame."""
    sides = [(plan, False)] + ([(mirrored_plan(plan), True)] if mirror else [])
    best: tuple[tuple[object, ...], FloorPlan, bool, int] | None = None
    for side, flipped in sides:
        edges = [_edge_list(side, step_m) for step_m in LIST_STEPS_M]
        for first in range(len(side.corners)):
            listed = tuple((*one[first:], *one[:first]) for one in edges)
            if best is not None and listed > best[0][0]:  # type: ignore[operator]
                continue
            frame = _frame(side, first, flipped)
            free = sorted(tuple(map(_step, frame.into((x, y, 0.0))[:2])) for x, y in plan.keep_free)
            holes = sorted(
                tuple(sorted(tuple(map(_step, frame.into((float(x), float(y), 0.0))[:2])) for x, y in hole))
                for hole in plan.holes
            )
            stand = tuple(tuple(map(_step, frame.into(pin)[:2])) for pin in pins)
            key = (listed, (tuple(free), tuple(holes), stand))
            if best is None or key < best[0]:
                best = key, side, flipped, first
    assert best is not None
    _, side, flipped, first = best
    frame = _frame(side, first, flipped)
    return _moved(side, first, frame), frame


def mirrored_plan(plan: FloorPlan) -> FloorPlan:
    """Return the plan with x negated: edges run the other way, hinges change hands."""
    flip = np.array([-1.0, 1.0])
    count = len(plan.corners)

    def turned(openings: Sequence[OpeningT]) -> tuple[OpeningT, ...]:
        lengths_m = [plan.edge(o.edge)[2] for o in openings]
        return tuple(
            replace(o, edge=(count - 2 - o.edge) % count, start_m=long_m - o.end_m, end_m=long_m - o.start_m)
            for o, long_m in zip(openings, lengths_m, strict=True)
        )

    return replace(
        plan,
        corners=np.ascontiguousarray((plan.corners * flip)[::-1]),
        holes=tuple(np.ascontiguousarray((hole * flip)[::-1]) for hole in plan.holes),
        doors=tuple(replace(d, hinge=_OTHER[d.hinge]) for d in turned(plan.doors)),
        windows=turned(plan.windows),
        hung=turned(plan.hung),
        keep_free=tuple((-x, y) for x, y in plan.keep_free),
    )


def _step(value: float, step_m: float = LIST_STEPS_M[-1]) -> int:
    return round(value / step_m)


def _edge_list(plan: FloorPlan, step_m: float) -> list[tuple[object, ...]]:
    """Return the list of one step; openings by how far their middles are from their walls', and by their widths."""
    count = len(plan.corners)
    listed: list[tuple[object, ...]] = []

    def steps(*values_m: float) -> tuple[int, ...]:
        return tuple(_step(value, step_m) for value in values_m)

    def along(o: Door | Window) -> tuple[int, ...]:
        return steps(0.5 * (o.start_m + o.end_m - plan.edge(o.edge)[2]), o.width_m)

    openings: list[tuple[int, tuple[object, ...]]]
    openings = [(d.edge, (0, *along(d), d.hinge, d.swing)) for d in plan.doors]
    openings += [
        (w.edge, (1 + isinstance(w, Hung), *along(w), *steps(w.sill_m, w.head_m))) for w in (*plan.windows, *plan.hung)
    ]
    for i in range(count):
        _, ahead, length_m = plan.edge(i)
        _, following, _ = plan.edge((i + 1) % count)
        turn = math.atan2(ahead[0] * following[1] - ahead[1] * following[0], float(ahead @ following))
        listed.append((*steps(length_m, turn), tuple(sorted(o for e, o in openings if e == i))))
    return listed


def _frame(side: FloorPlan, first: int, mirrored: bool) -> Frame:
    at, along, _ = side.edge(first)
    return Frame((float(at[0]), float(at[1])), math.atan2(along[1], along[0]), mirrored, first, len(side.corners))


def _moved(side: FloorPlan, first: int, frame: Frame) -> FloorPlan:
    n = len(side.corners)
    c, s = math.cos(frame.angle_rad), math.sin(frame.angle_rad)
    turn = np.array([[c, -s], [s, c]])

    def snap(points: Doubles) -> Doubles:
        """Return points (N, 2) in the frame, rounded."""
        snapped: Doubles = np.round((points - frame.origin) @ turn / SNAP_M) * SNAP_M + 0.0
        return snapped

    def length(value: float) -> float:
        return round(value / SNAP_M) * SNAP_M

    def moved(openings: Sequence[OpeningT]) -> tuple[OpeningT, ...]:
        on = [replace(o, edge=(o.edge - first) % n, start_m=length(o.start_m), end_m=length(o.end_m)) for o in openings]
        return tuple(sorted(on, key=lambda o: (o.edge, o.start_m, o.end_m)))

    holes = []
    for hole in side.holes:
        ring = snap(hole)
        holes.append(np.roll(ring, -min(range(len(ring)), key=lambda i: tuple(ring[i])), axis=0))
    return replace(
        side,
        corners=np.ascontiguousarray(snap(np.roll(side.corners, -first, axis=0))),
        holes=tuple(sorted(holes, key=lambda h: h.tolist())),
        doors=moved(side.doors),
        windows=moved(side.windows),
        hung=moved(side.hung),
        keep_free=tuple(sorted((float(p[0]), float(p[1])) for p in snap(np.array(side.keep_free).reshape(-1, 2)))),
    )


@dataclass(frozen=True)
class Stand:
    """A piece in a frame: where it stands, with whom, at which edge, and the use zones kept for it."""

    item: Item
    x_m: float
    y_m: float
    theta_rad: float
    group: str
    edge: int | None
    zones: tuple[Rect, ...] = ()
    pinned: bool = False

    def facing(self) -> tuple[float, float]:
        """Return the unit vector of its front."""
        return -math.sin(self.theta_rad), math.cos(self.theta_rad)

    def corners(self, rect: Rect | None = None) -> list[tuple[float, float]]:
        """Return the corners of a rectangle of its frame; of its footprint by default."""
        if rect is None:
            w, d = self.item.spec.size_m[0] / 2, self.item.spec.size_m[1] / 2
            rect = (-w, w, -d, d)
        c, s = math.cos(self.theta_rad), math.sin(self.theta_rad)
        x0, x1, y0, y1 = rect
        return [
            (self.x_m + x * c - y * s, self.y_m + x * s + y * c) for x, y in ((x0, y0), (x1, y0), (x1, y1), (x0, y1))
        ]


def anchor(stand: Stand) -> Doubles:
    """Return a piece as an anchor of the search's score, shape (7,) (`steering`)."""
    role = ROLE[ROLES.get(stand.item.spec.category, "small")]
    half_w, half_d = (v / 2 for v in stand.item.spec.size_m[:2])
    return np.array([stand.x_m, stand.y_m, *stand.facing(), float(role), half_w, half_d])


def outline_rows(stand: Stand, *, zones: bool = True) -> list[Row]:
    """Return a placed piece's footprint and use zones as rows of `field.outlines`."""
    spec = stand.item.spec
    rows: list[Row] = [(np.array(stand.corners()), spec.base_m, spec.top_m, RUG if spec.is_rug else BODY)]
    if zones:
        rows += [(np.array(stand.corners(zone)), 0.0, PERSON_M, ZONE) for zone in stand.zones]
    return rows


def stands(final: Final) -> list[Stand]:
    """Return the pieces of a state, in the canonical frame."""
    placed = []
    for choice in final.choices:
        variant = final.packing.units[choice.unit].variants[choice.variant]
        ox, oy, ux, uy, _, edge = choice.line
        angle = math.atan2(uy, ux)
        for member in variant.members:
            x, y = choice.s_m + member.x_m, member.y_m
            at_x_m, at_y_m = ox + x * ux - y * uy, oy + x * uy + y * ux
            theta_rad = wrapped(angle + member.quarters * math.pi / 2)
            group, wall = variant.members[0].item.id, int(edge) if edge >= 0 else None
            placed.append(Stand(member.item, at_x_m, at_y_m, theta_rad, group, wall, member.zones))
    return placed


def in_frame(stand: Stand, frame: Frame) -> Stand:
    """Return a piece of the room in the canonical frame."""
    x, y, theta = frame.into((stand.x_m, stand.y_m, stand.theta_rad))
    return replace(stand, x_m=x, y_m=y, theta_rad=theta, zones=_mirrored_zones(stand, frame))


def in_room(stand: Stand, frame: Frame) -> Stand:
    """Return a piece in the room's frame, rounded to 1 um and 1 nrad."""
    x, y, theta = frame.back((stand.x_m, stand.y_m, stand.theta_rad))
    return replace(
        stand,
        x_m=round(x, 6) + 0.0,
        y_m=round(y, 6) + 0.0,
        theta_rad=round(theta, 9) + 0.0,
        edge=None if stand.edge is None else frame.edge_back(stand.edge),
        zones=_mirrored_zones(stand, frame),
    )


def _mirrored_zones(stand: Stand, frame: Frame) -> tuple[Rect, ...]:
    return tuple((-x1, -x0, y0, y1) for x0, x1, y0, y1 in stand.zones) if frame.mirrored else stand.zones


def pieces(placed: Sequence[Stand]) -> list[Piece]:
    """Return pieces in the room as the judge takes them."""
    return [Piece(s.item.id, s.item.spec, s.x_m, s.y_m, s.theta_rad, s.group) for s in placed]


def with_reached_sides(placed: Sequence[Stand], judge: Judge, rules: RuleSet) -> tuple[Stand, ...]:
    """Return pieces in the room whose side zones are free and reached.

    The search keeps a side free and the judge is content with any that serves, so the one that was kept need not be the
    one that a path leads to. The judge must pass the pieces as they are; the side kept goes first.
    """
    served, known = list(placed), pieces(placed)
    for n, stand in enumerate(placed):
        if stand.item.spec.sides_needed is None:
            continue
        for zones in (stand.zones, *zone_choices(stand.item, rules)):
            # The piece needs just these zones.
            kept = tuple(zone for zone in stand.item.spec.zones if zone_rect(stand.item, zone, rules) in zones)
            piece = replace(known[n], spec=replace(known[n].spec, zones=kept, sides_needed=None))
            needed = [*known[:n], piece, *known[n + 1 :]]
            if judge.passes(needed, fits=True):
                served[n], known = replace(stand, zones=zones), needed
                break
    return tuple(served)

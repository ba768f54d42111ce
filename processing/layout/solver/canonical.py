"""One frame for a room however it is moved, turned or mirrored, so that the same room gets the same arrangement.

Every corner can be the origin with its edge along +x, in the plan or in its mirror image. The frame whose list of edge
lengths, turns and openings (rounded to 0.1 mm) is least is taken, and coordinates in it are rounded to 0.1 um, so that
the search sees the same numbers bit by bit.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import TypeAlias

import numpy as np

from processing.ground.arrays import Doubles
from processing.layout.plan import Door, FloorPlan, Hinge, Window

LIST_STEP_M = 1e-4
SNAP_M = 1e-7
Pose: TypeAlias = tuple[float, float, float]
"""x, y in metres, theta in radians."""
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

    def edge_into(self, edge: int) -> int:
        """Return the canonical frame's edge of an edge of the room."""
        side = (self.count - 2 - edge) % self.count if self.mirrored else edge
        return (side - self.first) % self.count

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
        edges = _edge_list(side)
        for first in range(len(edges)):
            listed = (*edges[first:], *edges[:first])
            if best is not None and listed > best[0][0]:  # type: ignore[operator]
                continue
            frame = _frame(side, first, flipped)
            key = (listed, _points_list(plan, pins, frame))
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

    def edge(old: int) -> int:
        return (count - 2 - old) % count

    doors = tuple(
        Door(
            edge(d.edge),
            plan.edge(d.edge)[2] - d.end_m,
            plan.edge(d.edge)[2] - d.start_m,
            _OTHER[d.hinge],
            d.swing,
            d.name,
        )
        for d in plan.doors
    )
    windows = tuple(
        replace(w, edge=edge(w.edge), start_m=plan.edge(w.edge)[2] - w.end_m, end_m=plan.edge(w.edge)[2] - w.start_m)
        for w in plan.windows
    )
    return replace(
        plan,
        corners=np.ascontiguousarray((plan.corners * flip)[::-1]),
        holes=tuple(np.ascontiguousarray((hole * flip)[::-1]) for hole in plan.holes),
        doors=doors,
        windows=windows,
        keep_free=tuple((-x, y) for x, y in plan.keep_free),
    )


def _step(value: float) -> int:
    return round(value / LIST_STEP_M)


def _edge_list(plan: FloorPlan) -> list[tuple[object, ...]]:
    count = len(plan.corners)
    listed: list[tuple[object, ...]] = []
    openings: list[tuple[int, tuple[object, ...]]] = []
    for d in plan.doors:
        openings.append((d.edge, (0, _step(d.start_m), _step(d.end_m), d.hinge, d.swing)))
    for w in plan.windows:
        openings.append((w.edge, (1, _step(w.start_m), _step(w.end_m), _step(w.sill_m), _step(w.head_m))))
    for i in range(count):
        _, along, length_m = plan.edge(i)
        _, following, _ = plan.edge((i + 1) % count)
        turn = math.atan2(along[0] * following[1] - along[1] * following[0], float(along @ following))
        listed.append((_step(length_m), _step(turn), tuple(sorted(o for e, o in openings if e == i))))
    return listed


def _frame(side: FloorPlan, first: int, mirrored: bool) -> Frame:
    corner, along, _ = side.edge(first)
    return Frame(
        (float(corner[0]), float(corner[1])), math.atan2(along[1], along[0]), mirrored, first, len(side.corners)
    )


def _points_list(plan: FloorPlan, pins: Sequence[Pose], frame: Frame) -> tuple[object, ...]:
    free = sorted(tuple(map(_step, frame.into((x, y, 0.0))[:2])) for x, y in plan.keep_free)
    holes = sorted(
        tuple(sorted(tuple(map(_step, frame.into((float(x), float(y), 0.0))[:2])) for x, y in hole))
        for hole in plan.holes
    )
    stand = tuple(tuple(map(_step, frame.into(pin)[:2])) for pin in pins)
    return (tuple(free), tuple(holes), stand)


def _moved(side: FloorPlan, first: int, frame: Frame) -> FloorPlan:
    count = len(side.corners)
    c, s = math.cos(frame.angle_rad), math.sin(frame.angle_rad)
    turn = np.array([[c, -s], [s, c]])

    def snap(points: Doubles) -> Doubles:
        return np.asarray(np.round((points - frame.origin) @ turn / SNAP_M) * SNAP_M + 0.0)

    def length(value: float) -> float:
        return round(value / SNAP_M) * SNAP_M

    doors = [
        replace(d, edge=(d.edge - first) % count, start_m=length(d.start_m), end_m=length(d.end_m)) for d in side.doors
    ]
    windows = [
        replace(w, edge=(w.edge - first) % count, start_m=length(w.start_m), end_m=length(w.end_m))
        for w in side.windows
    ]
    holes = []
    for hole in side.holes:
        moved = snap(hole)
        holes.append(np.roll(moved, -min(range(len(moved)), key=lambda i: tuple(moved[i])), axis=0))
    return replace(
        side,
        corners=np.ascontiguousarray(snap(np.roll(side.corners, -first, axis=0))),
        holes=tuple(sorted(holes, key=lambda h: h.tolist())),
        doors=tuple(sorted(doors, key=_opening_key)),
        windows=tuple(sorted(windows, key=_opening_key)),
        keep_free=tuple(sorted((float(p[0]), float(p[1])) for p in snap(np.array(side.keep_free).reshape(-1, 2)))),
    )


def _opening_key(opening: Door | Window) -> tuple[int, float, float]:
    return opening.edge, opening.start_m, opening.end_m

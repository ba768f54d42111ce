"""The plan as arrays: walls as segments and lines, doors, windows and pinned pieces as convex outlines with heights."""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple, TypeAlias

import numpy as np
import shapely
from shapely.geometry import Polygon

from processing.ground.arrays import Doubles
from processing.layout.plan import DOOR_HEAD_M, HUNG_DOOR, Door, FloorPlan, Window
from processing.layout.rules import RuleSet
from processing.layout.solver.free_sets import DOOR, KEPT, WINDOW, Outlines
from processing.layout.solver.walk_grid import Grid, wall_clearance2

Row: TypeAlias = tuple[Doubles, float, float, int]  # corners (4, 2), bottom and top in metres, and class of an outline

PERSON_M = 2.0  # use zones and paths are this high: what hangs above does not matter
KEEP_FREE_RADIUS_M = 0.3  # half the side of the square around a place kept free (chosen: a tripod's feet)
BEFORE_EYE_M, TALL_M = 0.9, 1.3
"""Likewise for what is taller than the second (chosen: 0.9 m off, a wardrobe takes a fifth of the horizon)."""
UNDER_SILL_M = 0.05  # a piece before a window ends this much below its sill
PATH_SLACK_M = 1e-3  # paths are measured to a millimetre
LEAST_WALL_M = 0.2  # nothing is placed along shorter walls (chosen: less than the narrowest piece's depth)
MOST_DIRECTIONS, MOST_OFFSETS, OFFSET_M = 3, 20, 0.25
"""Directions and offsets of the lines for what stands free, and the step between them (chosen: time of a search)."""
NO_EDGE = -1.0  # a mark: the line lies along no wall
SAMPLES, WALK_CELL_M = 20, 0.07
"""Points along the floor's longer side, and the least cell, for scores (chosen: time of a score below 1 ms)."""


class Samples(NamedTuple):
    """What the scores of a whole arrangement look at."""

    points: Doubles
    """(N, 2) metres, spread over the floor."""
    clear_m: Doubles
    """(N,): their distance to the nearest wall."""
    grid: Grid
    cells2: Doubles
    """(rows, columns): squared distance of the grid's cells to the walls, m2; -1 outside."""


@dataclass(frozen=True)
class Floor:
    """A plan's arrays that do not depend on rules or furniture, made once each."""

    plan: FloorPlan

    @cached_property
    def walls(self) -> Doubles:
        """Return the segments of the outline and of the columns, (W, 4) metres: x, y of both ends."""
        rings = (self.plan.corners, *self.plan.holes)
        return np.concatenate([np.concatenate([ring, np.roll(ring, -1, axis=0)], axis=1) for ring in rings])

    @cached_property
    def wall_lines(self) -> Doubles:
        """Return (L, 6): first corner, unit direction, length, edge; columns' faces have edges past the outline's."""
        begin, ends = self.walls[:, :2], self.walls[:, 2:]
        lengths = np.hypot(*(ends - begin).T)[:, None]
        rows = np.hstack([begin, (ends - begin) / lengths, lengths, np.arange(len(begin), dtype=np.float64)[:, None]])
        return np.ascontiguousarray(rows[lengths[:, 0] >= LEAST_WALL_M])

    @cached_property
    def windows(self) -> Doubles:
        """Return (K, 8) of the windows: edge, start, end and sill in metres, middle x, y, inward normal x, y."""
        return self._on_walls(self.plan.windows)

    @cached_property
    def hung(self) -> Doubles:
        """Return (K, 8) of what hangs on walls, as `windows`."""
        return self._on_walls(self.plan.hung)

    @cached_property
    def eyes(self) -> Doubles:
        """Return where cameras stand, (E, 2) metres."""
        return np.array(self.plan.keep_free, dtype=np.float64).reshape(-1, 2)

    def _on_walls(self, windows: Sequence[Window]) -> Doubles:
        rows = []
        for window in windows:
            corner, along, _ = self.plan.edge(window.edge)
            middle = corner + along * 0.5 * (window.start_m + window.end_m)
            rows.append([window.edge, window.start_m, window.end_m, window.sill_m, *middle, -along[1], along[0]])
        return np.array(rows, dtype=np.float64).reshape(-1, 8)

    @cached_property
    def door_middles(self) -> Doubles:
        """Return the middles of the doors, (D, 2) metres."""
        edges = [(self.plan.edge(d.edge), (d.start_m + d.end_m) / 2) for d in self.plan.doors]
        return np.array([corner + along * at for (corner, along, _), at in edges]).reshape(-1, 2)

    @cached_property
    def samples(self) -> Samples:
        """Return points and a grid over the floor for `scores.py`."""
        low, high = self.plan.corners.min(axis=0), self.plan.corners.max(axis=0)
        extent = float(max(high - low))
        coarse = Grid(float(low[0]), float(low[1]), extent / SAMPLES)
        fine = Grid(coarse.x0, coarse.y0, max(WALK_CELL_M, extent / 150))
        clear2, cells2 = (
            wall_clearance2(self.walls, grid, *(int((high - low)[i] / grid.cell) + 1 for i in (1, 0)))
            for grid in (coarse, fine)
        )
        i, j = np.nonzero(clear2 > 0.01)
        points = np.stack([coarse.x0 + (j + 0.5) * coarse.cell, coarse.y0 + (i + 0.5) * coarse.cell], axis=1)
        return Samples(np.ascontiguousarray(points), np.sqrt(clear2[i, j]), fine, cells2)

    @cached_property
    def middle(self) -> Doubles:
        """Return the outline's centroid, shape (2,), metres."""
        return np.array(Polygon(self.plan.corners).centroid.coords[0])

    @cached_property
    def clearance(self) -> tuple[Grid, Doubles]:
        """Return the grid of paths and cells' squared distances to walls, m2 (-1 outside), shape (rows, columns)."""
        low, high = self.plan.corners.min(axis=0), self.plan.corners.max(axis=0)
        cell = float(np.clip(math.sqrt(float(np.prod(high - low))) / 90, 0.04, 0.2))
        columns, rows = (int(np.ceil((high - low)[i] / cell)) + 1 for i in (0, 1))
        grid = Grid(float(low[0]), float(low[1]), cell)
        return grid, wall_clearance2(self.walls, grid, rows, columns)

    def free_lines(self, depth_m: float) -> Doubles:
        """Return (L, 6) lines for a unit `depth_m` deep that stands free, along and across each wall direction.

        They lie where the unit's near or far side is level with a corner, and every `OFFSET_M` between.
        """
        found = []
        for u, start_m, length_m, levels in self._frames:
            offsets = _offsets(levels, depth_m)
            rows = np.empty((len(offsets), 6))
            rows[:, 0] = u[0] * start_m - u[1] * offsets
            rows[:, 1] = u[1] * start_m + u[0] * offsets
            rows[:, 2:] = (u[0], u[1], length_m, NO_EDGE)
            found.append(rows)
        return np.concatenate(found)

    @cached_property
    def _frames(self) -> list[tuple[Doubles, float, float, Doubles]]:
        """Return direction (2,), start and length along it, and the corners' levels (N,) across it, sorted."""
        points = np.concatenate([self.plan.corners, *self.plan.holes])
        frames = []
        for angle in self._directions():
            for quarter in range(4):
                turn = angle + quarter * np.pi / 2
                u = np.array([np.cos(turn), np.sin(turn)])
                along, away = points @ u, np.sort(points @ np.array([-u[1], u[0]]))
                frames.append((u, float(along.min()), float(along.max() - along.min()), away))
        return frames

    def _directions(self) -> list[float]:
        """Return the room's main directions, radians, 0 to pi/2, longest walls first; of a round room its axes."""
        totals: dict[int, tuple[float, float]] = {}
        for _, _, ux, uy, length_m, _ in self.wall_lines.tolist():
            angle = math.atan2(uy, ux) % (np.pi / 2)
            key = round(math.degrees(angle) * 2) % 180
            total, first = totals.get(key, (0.0, angle))
            totals[key] = (total + length_m, first)
        return [angle for _, angle in sorted(totals.values(), key=lambda pair: -pair[0])[:MOST_DIRECTIONS]] or [0.0]


def _offsets(levels: Doubles, depth_m: float) -> Doubles:
    low, high = levels[0], levels[-1] - depth_m
    if high < low - 1e-7:
        return np.empty(0)
    steps = np.arange(low, high + 1e-9, OFFSET_M)
    wanted: Doubles = np.sort(np.concatenate([levels, levels - depth_m, [0.5 * (low + high), high], steps]))
    wanted = wanted[(wanted >= low - 1e-9) & (wanted <= high + 1e-9)]
    wanted = wanted[np.concatenate([[True], np.diff(wanted) > 0.02])]
    if len(wanted) > MOST_OFFSETS:
        wanted = wanted[np.unique(np.linspace(0, len(wanted) - 1, MOST_OFFSETS).round().astype(int))]
    return wanted


@dataclass(frozen=True)
class Field:
    """All that stands fast while furniture is placed."""

    floor: Floor
    rules: RuleSet
    fixed: Outlines
    doorways: Doubles
    """(D, 4, 2) metres: the floor before each door, where a path through it begins."""

    def reachable_doors(self) -> list[int]:
        """Return the doors of the largest part of the empty floor that a walker can reach through any.

        Where no path of the rule's width leads even in the empty room, furniture cannot be blamed.
        """
        room = Polygon(self.floor.plan.corners, list(self.floor.plan.holes))
        parts = shapely.get_parts(room.buffer(-(self.rules.path - PATH_SLACK_M) / 2, quad_segs=32))
        ways = [Polygon(corners) for corners in self.doorways]
        for part in sorted(parts, key=lambda p: -p.area):
            served = [n for n, way in enumerate(ways) if not part.is_empty and part.intersects(way)]
            if served:
                return served
        return []


def make_field(floor: Floor, rules: RuleSet, pinned: Sequence[Row] = ()) -> Field:
    """Return the arrays of a floor under a rule set; `pinned` are the rows of pieces that stand already."""
    plan = floor.plan
    rows: list[Row] = []
    doorways = []
    for door in plan.doors:
        rows += [(corners, 0.0, DOOR_HEAD_M, DOOR) for corners in _door_outlines(plan, door, rules)]
        deep = max(rules.door_approach, rules.path / 2 + 0.1)
        doorways.append(_on_edge(plan, door.edge, door.start_m, door.end_m, deep))
    for seen in (Door(h.edge, h.start_m, h.end_m) for h in plan.hung if h.name == HUNG_DOOR):
        # Whether it leads anywhere is not known: it is kept free, and no path has to reach it.
        rows += [(corners, 0.0, DOOR_HEAD_M, DOOR) for corners in _door_outlines(plan, seen, rules)]
    for window in plan.windows:
        low = max(0.0, window.sill_m - UNDER_SILL_M)
        outline = _on_edge(plan, window.edge, window.start_m, window.end_m, rules.window_band)
        rows.append((outline, low, window.head_m, WINDOW))
    for x, y in plan.keep_free:
        for r, low in ((KEEP_FREE_RADIUS_M, 0.0), (BEFORE_EYE_M, TALL_M)):
            square = np.array([[x - r, y - r], [x + r, y - r], [x + r, y + r], [x - r, y + r]])
            rows.append((square, low, math.inf, KEPT))
    return Field(floor, rules, outlines([*rows, *pinned]), np.array(doorways, dtype=np.float64).reshape(-1, 4, 2))


def outlines(rows: Sequence[Row]) -> Outlines:
    """Return the rows as arrays, shapes (N, 4, 2), (N, 2), (N,)."""
    return Outlines(
        np.array([row[0] for row in rows], dtype=np.float64).reshape(-1, 4, 2),
        np.array([[row[1], row[2]] for row in rows], dtype=np.float64).reshape(-1, 2),
        np.array([row[3] for row in rows], dtype=np.int64),
    )


def more_outlines(first: Outlines, rows: Sequence[Row]) -> Outlines:
    """Return outlines with rows added."""
    corners, heights, classes = (np.concatenate(pair) for pair in zip(first, outlines(rows), strict=True))
    return Outlines(corners, heights, classes)


def _leaf_m(door: Door, rules: RuleSet) -> float:
    """Return how deep a door's leaf swings into the room: 0 for sliding and outward ones, half for pairs."""
    if door.swing in {"sliding", "out"}:
        return 0.0
    if door.width_m <= rules.door_reach or door.swing == "in":
        return door.width_m
    return door.width_m / 2 if door.width_m <= 2 * rules.door_reach else 0.0


def _door_outlines(plan: FloorPlan, door: Door, rules: RuleSet) -> list[Doubles]:
    """Return the convex outlines that a door keeps free: its approach, and its swing for either hand or the known one.

    The swing's quarter disc is circumscribed: a square for an unknown hand, five corners (as two outlines) for a known.
    """
    side, leaf = rules.door_side, _leaf_m(door, rules)
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

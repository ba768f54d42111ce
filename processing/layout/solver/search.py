"""Beam search over the units of a packing: exact places, best first, every state kept with all its paths."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from processing.ground.arrays import Doubles, Int64s
from processing.layout.solver.beam import select
from processing.layout.solver.expand import KEPT_INTERVALS, MOST_ROWS, expand, standing
from processing.layout.solver.field import PERSON_M, Field
from processing.layout.solver.free_sets import BODY, MEETS
from processing.layout.solver.grouping import Packing
from processing.layout.solver.lines import FreeLines, wall_lines
from processing.layout.solver.reach import PATH_SLACK_M
from processing.layout.solver.rebuild import RoomArrays, rebuild
from processing.layout.solver.soft import ROLE
from processing.layout.solver.states import Beam, Choice, Found, UnitArrays, Walk, quarter, rows_of
from processing.layout.solver.unit_table import all_found, unit_table
from processing.layout.solver.units import Unit
from processing.layout.solver.walk_grid import TOUCH_M, packed, stamp, wall_clearance2


@dataclass(frozen=True)
class Effort:
    """How wide the search is. Counts, never times: the same seed gives the same result on any machine."""

    beam: int
    per_parent: int
    per_stratum: int
    most_checks: int
    fractions: tuple[float, ...] = (0.0, 0.5, 1.0)
    noise: float = 0.05
    optimistic: bool = False
    """Let gaps pass that the grid is too coarse for; the exact test decides afterwards."""


@dataclass(frozen=True)
class Rounds:
    """How long units are taken out and placed anew."""

    rounds: int
    enough: int
    """Whole states after which it ends."""
    most_out: int = 3
    patience: int = 40
    noise: float = 0.7
    fractions: tuple[float, ...] = (0.0, 1.0)


class Shared:
    """What all searches in one plan share."""

    def __init__(self, field: Field) -> None:
        self._field = field
        self.walls = wall_lines(field.plan)
        self.windows = _window_rows(field)
        self.middle = _middle(field)
        self.rows = np.empty((MOST_ROWS, 3), dtype=np.int64), np.empty(MOST_ROWS), np.empty(MOST_ROWS)

    @cached_property
    def free(self) -> FreeLines:
        """Lines for what stands free."""
        return FreeLines(self._field.plan)

    @cached_property
    def clearance(self) -> tuple[Doubles, Doubles]:
        """The path grid (x0, y0, cell) and its cells' squared distances to the walls."""
        return _clearance(self._field)


class Search:
    """Searches in one field; keeps what does not change between runs."""

    def __init__(
        self, field: Field, doors: Sequence[int], stood: Sequence[Doubles] = (), like: Search | None = None
    ) -> None:
        """Prepare for a field: `doors` are those that paths must reach (none: paths are not looked at), `stood` the
        anchors (`soft`) of pieces that stand already, `like` a search in the same plan to share from."""
        self.field = field
        self.shared: Shared = like.shared if like else Shared(field)
        self._units: dict[tuple[str, ...], UnitArrays] = {}
        ways = np.array([d.corners for d in field.doorways]).reshape(-1, 4, 2)
        self._doors = np.ascontiguousarray(ways[list(doors)])
        self._door_middles = np.ascontiguousarray(0.5 * (ways[:, 0] + ways[:, 1]))
        self.stood = [np.asarray(row, dtype=np.float64) for row in stood]

    def run(self, packing: Packing, effort: Effort, seed: int, first: int | None = None) -> list[Found]:
        """Return the final states, best first; `first` shuffles the order of the units (a restart)."""
        rng = np.random.default_rng([seed, 0 if first is None else first + 1])
        order = list(range(len(packing.units)))
        if first is not None:
            weights = [u.footprint_m2 + rng.random() * 0.8 for u in packing.units]
            order.sort(key=lambda i: (packing.units[i].role == "rug", -weights[i]))
        return self._filled(
            Beam.start(self.walk(optimistic=effort.optimistic), self.stood, packing, effort.beam),
            packing,
            order,
            effort,
            rng,
        )

    def rebuild(self, packing: Packing, effort: Rounds, seed: int) -> list[Found]:
        """Return whole states, or the one that leaves out least, by taking units out and placing them anew."""
        units = [self.arrays(unit) for unit in packing.units]
        walk = self.walk(optimistic=True)
        room = RoomArrays(
            walk.blocked, walk.grid, walk.doors, self._door_middles, self.shared.windows,
            self.shared.middle,
            self._stood_rows(), walk.radius2, walk.reach,
        )  # fmt: skip
        table, origin = unit_table(units, packing)
        shape = (max(1, effort.enough), len(units))
        slots, places, gains = np.full(shape, -1), np.zeros(shape), np.zeros(shape)
        whole = rebuild(
            room, table, seed, effort.rounds, effort.most_out, effort.patience, effort.noise,
            np.array(effort.fractions), max(1, effort.enough), slots, places, gains,
        )  # fmt: skip
        kept = slice(max(1, whole))
        return all_found(packing, table, origin, slots[kept], places[kept], gains[kept])

    def _filled(
        self, state: Beam, packing: Packing, order: Sequence[int], effort: Effort, rng: np.random.Generator
    ) -> list[Found]:
        for number in order:
            state = self._step(state, packing, number, effort, rng)
        found = [
            Found(tuple(state.choices[b]), tuple(state.dropped[b]), float(state.scores[b])) for b in range(state.size)
        ]
        return sorted(found, key=lambda f: -f.score)

    def has_place(self, unit: Unit) -> bool:
        """Tell whether a unit has a place, paths aside."""
        made = self.arrays(unit)
        none = np.empty((1, 0, 4, 2)), np.empty((1, 0, 2)), np.empty((1, 0), np.int64), np.zeros(1, np.int64)
        return self._expand(made, none, self._stood_rows()[None], np.array([len(self.stood)]), (0.0,)) > 0

    def _stood_rows(self) -> Doubles:
        return np.array(self.stood, dtype=np.float64).reshape(-1, 7)

    def arrays(self, unit: Unit) -> UnitArrays:
        """Return a unit's arrays, made once."""
        key = (unit.role, unit.keeps_to, *(item.id for item in unit.items), str(len(unit.variants)))
        if key not in self._units:
            self._units[key] = self._prepare(unit)
        return self._units[key]

    def walk(self, *, optimistic: bool) -> Walk:
        """Return the path grid for the empty room."""
        grid, clearance2 = self.shared.clearance
        r, cell = (self.field.rules.path - PATH_SLACK_M) / 2, float(grid[2])
        radius = r - 0.45 * cell if optimistic else math.sqrt(r * r + cell * cell / 4) + 1e-7
        blocked = packed(clearance2 < radius * radius)
        fixed = self.field.fixed
        for corners, (low, _), kind in zip(fixed.corners, fixed.heights_m, fixed.classes, strict=True):
            if kind == BODY and low < PERSON_M:
                stamp(blocked, corners, grid[0], grid[1], grid[2], radius * radius)
        reach = r - TOUCH_M - 1e-6 + (0.3 * cell if optimistic else 0.0)
        return Walk(grid, blocked, self._doors, radius * radius, reach)

    def _prepare(self, unit: Unit) -> UnitArrays:
        count = max(len(rows_of(v)) for v in unit.variants)
        n = len(unit.variants)
        rects, kinds = np.zeros((n, count, 6)), np.zeros((n, count), dtype=np.int64)
        for v, variant in enumerate(unit.variants):
            for r, (rect, kind) in enumerate(rows_of(variant)):
                rects[v, r], kinds[v, r] = rect, kind
        n_rects = np.array([len(rows_of(v)) for v in unit.variants], dtype=np.int64)
        lines = [self.shared.walls]
        depths = sorted({round(v.depth_m, 6) for v in unit.variants if not v.at_wall})
        lines += [self.shared.free.lines(depth) for depth in depths]
        allowed = np.zeros((n, sum(len(rows) for rows in lines)), dtype=np.bool_)
        for v, variant in enumerate(unit.variants):
            at = 0
            for rows, depth in zip(lines, [None, *depths], strict=True):
                allowed[v, at : at + len(rows)] = (
                    depth is None if variant.at_wall else depth == round(variant.depth_m, 6)
                )
                at += len(rows)
        anchors = [v.members[0] for v in unit.variants]
        made = UnitArrays(
            rects, kinds, n_rects,
            np.array([v.width_m for v in unit.variants]),
            np.array([v.bonus for v in unit.variants]),
            np.array([[m.x_m, m.y_m] for m in anchors]),
            np.array([quarter(m.quarters) for m in anchors], dtype=np.float64),
            np.array([[v / 2 for v in m.item.spec.size_m[:2]] for m in anchors]),
            (ROLE[unit.keeps_to], unit.keeps_within_m) if unit.keeps_to else (-1, 0.0),
            np.ascontiguousarray(np.concatenate(lines)),
            allowed,
            np.empty((n, allowed.shape[1], KEPT_INTERVALS, 2)),
            np.empty((n, allowed.shape[1]), dtype=np.int64),
            ROLE.get(unit.role, ROLE["small"]),
        )  # fmt: skip
        fixed = self.field.fixed
        standing(
            self.field.walls, fixed.corners, fixed.heights_m, fixed.classes, rects, kinds, n_rects, made.widths,
            made.lines, allowed, MEETS, made.fixed, made.fixed_counts,
        )  # fmt: skip
        return made

    def _expand(
        self, unit: UnitArrays, placed: tuple[Doubles, Doubles, Int64s, Int64s], anchors: Doubles, n_anchors: Int64s,
        fractions: tuple[float, ...],
    ) -> int:  # fmt: skip
        """Write all places of a unit beside what is placed in each state; return how many."""
        return int(
            expand(
                unit.rects, unit.kinds, unit.n_rects, unit.widths, unit.bonus, unit.anchor_at,
                unit.anchor_to, unit.half, unit.role, unit.near, unit.lines, unit.allowed, MEETS, unit.fixed,
                unit.fixed_counts, *placed, anchors, n_anchors, np.array(fractions), self._door_middles,
                self.shared.windows, self.shared.middle, *self.shared.rows,
            )
        )  # fmt: skip

    def _step(self, beam: Beam, packing: Packing, number: int, effort: Effort, rng: np.random.Generator) -> Beam:
        unit = self.arrays(packing.units[number])
        index, place, score = self.shared.rows
        b = beam.size
        count = self._expand(
            unit, (beam.dyn[:b], beam.heights[:b], beam.classes[:b], beam.counts[:b]), beam.anchors[:b],
            beam.n_anchors[:b], effort.fractions,
        )  # fmt: skip
        index, place = index[:count], place[:count]
        gained = score[:count] + effort.noise * rng.standard_normal(count)
        total = beam.scores[index[:, 0]] + gained
        order = np.argsort(-total, kind="stable")
        strata = beam.strata[index[:, 0]] if beam.placed else _strata(index, place)
        after = beam.other()
        accepted = np.empty(effort.beam, dtype=np.int64)
        kept = select(
            order, index, place, strata, int(strata.max(initial=0)) + 1,
            effort.beam, effort.per_parent, effort.per_stratum, effort.most_checks,
            unit.rects, unit.kinds, unit.n_rects, unit.lines, beam.dyn[:b], beam.heights[:b], beam.classes[:b],
            beam.counts[:b], beam.blocked[:b], beam.walk.doors, beam.walk.grid, beam.walk.radius2, beam.walk.reach,
            after.dyn, after.heights, after.classes, after.counts, after.blocked, accepted,
        )  # fmt: skip
        for new, row in enumerate(accepted[:kept]):
            parent, variant, line = (int(i) for i in index[row])
            line_at = tuple(float(v) for v in unit.lines[line])
            choice = Choice(number, variant, line_at, float(place[row]))
            after.adopt(new, beam, parent, float(total[row]), choice, int(strata[row]), unit)
        after.size = kept
        after.placed = beam.placed or kept > 0
        after.fill_with_drops(beam, number, packing.units[number], set(index[accepted[:kept], 0].tolist()))
        return after


def _strata(index: Int64s, place: Doubles) -> Int64s:
    """Return a number for each place of the first unit: the same line and the same metre of it."""
    metres = np.minimum(place.astype(np.int64), 15)
    return index[:, 2] * 16 + metres + 1


def _window_rows(field: Field) -> Doubles:
    rows = []
    for window in field.plan.windows:
        corner, along, _ = field.plan.edge(window.edge)
        middle = corner + along * 0.5 * (window.start_m + window.end_m)
        rows.append([window.edge, window.start_m, window.end_m, window.sill_m, *middle, -along[1], along[0]])
    return np.array(rows, dtype=np.float64).reshape(-1, 8)


def _middle(field: Field) -> Doubles:
    ring = field.plan.corners
    nxt = np.roll(ring, -1, axis=0)
    cross = ring[:, 0] * nxt[:, 1] - nxt[:, 0] * ring[:, 1]
    return np.asarray(((ring + nxt) * cross[:, None]).sum(axis=0) / (3 * cross.sum()))


def _clearance(field: Field) -> tuple[Doubles, Doubles]:
    ring = field.plan.corners
    low, high = ring.min(axis=0), ring.max(axis=0)
    cell = float(np.clip(math.sqrt(float(np.prod(high - low))) / 90, 0.04, 0.2))
    columns, rows = (int(np.ceil((high - low)[i] / cell)) + 1 for i in (0, 1))
    grid = np.array([low[0], low[1], cell])
    return grid, wall_clearance2(field.walls, low[0], low[1], cell, rows, columns)

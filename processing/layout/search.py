"""Beam search over the units of a packing: exact places, best first, every state kept with all its paths."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import TypeAlias

import numpy as np
import numpy.typing as npt

from processing.layout.beam import select
from processing.layout.expand import KEPT_INTERVALS, MOST_ROWS, expand, standing
from processing.layout.field import PERSON_M, Field
from processing.layout.free_sets import BODY, MEETS, RUG, ZONE
from processing.layout.grouping import Packing
from processing.layout.lines import FreeLines, wall_lines
from processing.layout.polygons import Array
from processing.layout.reach import PATH_SLACK_M
from processing.layout.soft import ROLE
from processing.layout.units import Unit, Variant
from processing.layout.walk_grid import TOUCH_M, stamp, wall_clearance2

DROPPED = 1000.0
"""Taken off the score for what is left out, times its loss (`units.loss_of`)."""
Ints: TypeAlias = npt.NDArray[np.int64]


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
class Choice:
    """Where a unit went: variant, line (x, y, direction, length, edge) and place along it."""

    unit: int
    variant: int
    line: tuple[float, ...]
    s_m: float


@dataclass(frozen=True)
class Found:
    """A state of the search: what was placed where, and what was left out (unit numbers)."""

    choices: tuple[Choice, ...]
    dropped: tuple[int, ...]
    score: float
    stratum: int


@dataclass
class _Unit:
    """A unit as arrays over its variants."""

    rects: Array
    kinds: Ints
    n_rects: Ints
    widths: Array
    bonus: Array
    anchor_at: Array
    anchor_to: Array
    half: Array
    lines: Array
    allowed: npt.NDArray[np.bool_]
    fixed: Array
    fixed_counts: Ints
    role: int


@dataclass
class _Walk:
    """The grid that paths are checked on."""

    grid: Array
    blocked: npt.NDArray[np.uint8]
    doors: Array
    radius2: float
    reach: float


class Search:
    """Searches in one field; keeps what does not change between runs."""

    def __init__(self, field: Field, doors: Sequence[int], stood: Sequence[Array] = ()) -> None:
        """Prepare for a field: `doors` are those that paths must reach (none: paths are not looked at), `stood` the
        anchors (`soft`) of pieces that stand already."""
        self.field = field
        self._walls = wall_lines(field.plan)
        self._free = FreeLines(field.plan)
        self._units: dict[tuple[str, ...], _Unit] = {}
        self._clearance: tuple[Array, Array] | None = None
        self._rows = np.empty((MOST_ROWS, 3), dtype=np.int64), np.empty(MOST_ROWS), np.empty(MOST_ROWS)
        self._windows = _window_rows(field)
        ways = np.array([d.corners for d in field.doorways]).reshape(-1, 4, 2)
        self._doors = np.ascontiguousarray(ways[list(doors)])
        self._door_middles = np.ascontiguousarray(0.5 * (ways[:, 0] + ways[:, 1]))
        self._middle = _middle(field)
        self.stood = [np.asarray(row, dtype=np.float64) for row in stood]

    def run(self, packing: Packing, effort: Effort, seed: int, first: int | None = None) -> list[Found]:
        """Return the final states, best first; `first` shuffles the order of the units (a restart)."""
        rng = np.random.default_rng([seed, 0 if first is None else first + 1])
        order = list(range(len(packing.units)))
        if first is not None:
            weights = [u.footprint_m2 + rng.random() * 0.8 for u in packing.units]
            order.sort(key=lambda i: (packing.units[i].role == "rug", -weights[i]))
        state = _Beam.start(self, packing, effort)
        for number in order:
            state = self._step(state, packing, number, effort, rng)
        found = [
            Found(tuple(state.choices[b]), tuple(state.dropped[b]), float(state.scores[b]), int(state.strata[b]))
            for b in range(state.size)
        ]
        return sorted(found, key=lambda f: -f.score)

    def arrays(self, unit: Unit) -> _Unit:
        """Return a unit's arrays, made once."""
        key = (unit.role, *(item.id for item in unit.items), str(len(unit.variants)))
        if key not in self._units:
            self._units[key] = self._prepare(unit)
        return self._units[key]

    def walk(self, *, optimistic: bool) -> _Walk:
        """Return the path grid for the empty room."""
        if self._clearance is None:
            self._clearance = _clearance(self.field)
        grid, clearance2 = self._clearance
        r, cell = (self.field.rules.path - PATH_SLACK_M) / 2, float(grid[2])
        radius = r - 0.45 * cell if optimistic else math.sqrt(r * r + cell * cell / 4) + 1e-7
        blocked = (clearance2 < radius * radius).astype(np.uint8)
        reach = r - TOUCH_M - 1e-6 + (0.3 * cell if optimistic else 0.0)
        return _Walk(grid, blocked, self._doors, radius * radius, reach)

    def _prepare(self, unit: Unit) -> _Unit:
        count = max(len(_rows(v)) for v in unit.variants)
        n = len(unit.variants)
        rects, kinds = np.zeros((n, count, 6)), np.zeros((n, count), dtype=np.int64)
        for v, variant in enumerate(unit.variants):
            for r, (rect, kind) in enumerate(_rows(variant)):
                rects[v, r], kinds[v, r] = rect, kind
        n_rects = np.array([len(_rows(v)) for v in unit.variants], dtype=np.int64)
        lines = [self._walls]
        depths = sorted({round(v.depth_m, 6) for v in unit.variants if not v.at_wall})
        lines += [self._free.lines(depth) for depth in depths]
        allowed = np.zeros((n, sum(len(rows) for rows in lines)), dtype=np.bool_)
        for v, variant in enumerate(unit.variants):
            at = 0
            for rows, depth in zip(lines, [None, *depths], strict=True):
                allowed[v, at : at + len(rows)] = (
                    depth is None if variant.at_wall else depth == round(variant.depth_m, 6)
                )
                at += len(rows)
        anchors = [v.members[0] for v in unit.variants]
        to = [_quarter(m.quarters) for m in anchors]
        made = _Unit(
            rects, kinds, n_rects,
            np.array([v.width_m for v in unit.variants]),
            np.array([v.bonus for v in unit.variants]),
            np.array([[m.x_m, m.y_m] for m in anchors]),
            np.array(to, dtype=np.float64),
            np.array([m.item.spec.size_m[0] / 2 for m in anchors]),
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

    def _step(self, beam: _Beam, packing: Packing, number: int, effort: Effort, rng: np.random.Generator) -> _Beam:
        unit = self.arrays(packing.units[number])
        index, place, score = self._rows
        b = beam.size
        count = expand(
            self.field.walls, unit.rects, unit.kinds, unit.n_rects, unit.widths, unit.bonus, unit.anchor_at,
            unit.anchor_to, unit.half, unit.role, unit.lines, unit.allowed, MEETS, unit.fixed, unit.fixed_counts,
            beam.dyn[:b], beam.heights[:b], beam.classes[:b], beam.counts[:b], beam.anchors[:b], beam.n_anchors[:b],
            np.array(effort.fractions), self._door_middles, self._windows, self._middle, index, place, score,
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
            choice = Choice(number, variant, tuple(float(v) for v in unit.lines[line]), float(place[row]))
            after.adopt(new, beam, parent, float(total[row]), choice, int(strata[row]), unit)
        after.size = kept
        after.placed = beam.placed or kept > 0
        after.fill_with_drops(beam, number, packing.units[number], set(index[accepted[:kept], 0].tolist()))
        return after


@dataclass
class _Beam:
    """The states of one depth, as arrays."""

    walk: _Walk
    dyn: Array
    heights: Array
    classes: Ints
    counts: Ints
    blocked: npt.NDArray[np.uint8]
    anchors: Array
    n_anchors: Ints
    scores: Array
    strata: Ints
    choices: list[list[Choice]]
    dropped: list[list[int]]
    size: int
    placed: bool
    spare: _Beam | None = None

    @classmethod
    def start(cls, search: Search, packing: Packing, effort: Effort) -> _Beam:
        """Return the beam that holds the empty room."""
        rows = sum(max(len(_rows(v)) for v in u.variants) for u in packing.units) + 1
        walk = search.walk(optimistic=effort.optimistic)
        beam = cls._empty(walk, effort.beam, rows, len(packing.units) + 1 + len(search.stood))
        beam.blocked[0] = walk.blocked
        fixed = search.field.fixed
        for corners, (low, _), kind in zip(fixed.corners, fixed.heights_m, fixed.classes, strict=True):
            if kind == BODY and low < PERSON_M:
                stamp(beam.blocked[0], corners, walk.grid[0], walk.grid[1], walk.grid[2], walk.radius2)
        for number, row in enumerate(search.stood):
            beam.anchors[0, number] = row
        beam.n_anchors[0] = len(search.stood)
        beam.size = 1
        return beam

    @classmethod
    def _empty(cls, walk: _Walk, width: int, rows: int, units: int) -> _Beam:
        return cls(
            walk,
            np.zeros((width, rows, 4, 2)),
            np.zeros((width, rows, 2)),
            np.zeros((width, rows), dtype=np.int64),
            np.zeros(width, dtype=np.int64),
            np.empty((width, *walk.blocked.shape), dtype=np.uint8),
            np.zeros((width, units, 6)),
            np.zeros(width, dtype=np.int64),
            np.zeros(width),
            np.zeros(width, dtype=np.int64),
            [[] for _ in range(width)],
            [[] for _ in range(width)],
            0,
            False,
        )

    def other(self) -> _Beam:
        """Return the beam for the next depth: the one before this, whose arrays are used again."""
        after = self.spare or self._empty(self.walk, len(self.choices), self.dyn.shape[1], self.anchors.shape[1])
        after.spare, after.size = self, 0
        return after

    def adopt(self, new: int, old: _Beam, parent: int, score: float, choice: Choice, stratum: int, unit: _Unit) -> None:
        """Write what the compiled step left to Python for one new state."""
        self.scores[new], self.strata[new] = score, stratum
        self.choices[new] = [*old.choices[parent], choice]
        self.dropped[new] = list(old.dropped[parent])
        n = int(old.n_anchors[parent])
        self.anchors[new] = old.anchors[parent]
        ox, oy, ux, uy = choice.line[:4]
        ax, ay = unit.anchor_at[choice.variant] + (choice.s_m, 0.0)
        tx, ty = unit.anchor_to[choice.variant]
        self.anchors[new, n] = (
            ox + ax * ux - ay * uy, oy + ax * uy + ay * ux, tx * ux - ty * uy, tx * uy + ty * ux,
            unit.role, unit.half[choice.variant],
        )  # fmt: skip
        self.n_anchors[new] = n + 1

    def fill_with_drops(self, old: _Beam, number: int, unit: Unit, went_on: set[int]) -> None:
        """Let states in which the unit has no place go on without it, where there is room for them."""
        for parent in np.argsort(-old.scores[: old.size], kind="stable"):
            if self.size == len(self.choices):
                break
            if int(parent) in went_on and self.size:
                continue
            new = self.size
            for mine, theirs in (
                (self.dyn, old.dyn), (self.heights, old.heights), (self.classes, old.classes),
                (self.counts, old.counts), (self.blocked, old.blocked), (self.anchors, old.anchors),
                (self.n_anchors, old.n_anchors), (self.strata, old.strata),
            ):  # fmt: skip
                mine[new] = theirs[parent]
            self.scores[new] = old.scores[parent] - DROPPED * unit.loss
            self.choices[new] = list(old.choices[parent])
            self.dropped[new] = [*old.dropped[parent], number]
            self.size += 1


def _rows(variant: Variant) -> list[tuple[tuple[float, ...], int]]:
    """Return (x0, x1, y0, y1, low, high) and class of a variant's footprints and zones."""
    rows: list[tuple[tuple[float, ...], int]] = []
    for member in variant.members:
        spec = member.item.spec
        rows.append(((*member.body(), spec.base_m, spec.top_m), RUG if spec.is_rug else BODY))
        rows += [((*member.rect(zone), 0.0, PERSON_M), ZONE) for zone in member.zones]
    return rows


def _quarter(quarters: int) -> tuple[float, float]:
    return ((0.0, 1.0), (-1.0, 0.0), (0.0, -1.0), (1.0, 0.0))[quarters % 4]


def _strata(index: Ints, place: Array) -> Ints:
    """Return a number for each place of the first unit: the same line and the same metre of it."""
    metres = np.minimum(place.astype(np.int64), 15)
    return index[:, 2] * 16 + metres + 1


def _window_rows(field: Field) -> Array:
    rows = []
    for window in field.plan.windows:
        corner, along, _ = field.plan.edge(window.edge)
        middle = corner + along * 0.5 * (window.start_m + window.end_m)
        rows.append([window.edge, window.start_m, window.end_m, window.sill_m, *middle, -along[1], along[0]])
    return np.array(rows, dtype=np.float64).reshape(-1, 8)


def _middle(field: Field) -> Array:
    ring = field.plan.corners
    nxt = np.roll(ring, -1, axis=0)
    cross = ring[:, 0] * nxt[:, 1] - nxt[:, 0] * ring[:, 1]
    return np.asarray(((ring + nxt) * cross[:, None]).sum(axis=0) / (3 * cross.sum()))


def _clearance(field: Field) -> tuple[Array, Array]:
    ring = field.plan.corners
    low, high = ring.min(axis=0), ring.max(axis=0)
    cell = float(np.clip(math.sqrt(float(np.prod(high - low))) / 90, 0.04, 0.2))
    columns, rows = (int(np.ceil((high - low)[i] / cell)) + 1 for i in (0, 1))
    grid = np.array([low[0], low[1], cell])
    return grid, wall_clearance2(field.walls, low[0], low[1], cell, rows, columns)

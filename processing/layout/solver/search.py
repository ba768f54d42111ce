"""The search: one state at a time, units taken out and placed anew, until everything has a place.

Every round takes out a few units at random, places first what had no place, then what was taken out, each at the best
of a few places by a noisy score, all paths kept. A round that leaves out no more than the last is kept; whole states
follow each other as in annealing. Rounds are compiled (numba); states are counted, never timed, so that the same seed
gives the same result on any machine.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from processing.ground.arrays import Doubles, Int64s
from processing.ground.kernels import compiled, inner
from processing.layout.items import Item
from processing.layout.solver.field import PATH_SLACK_M, PERSON_M, Field
from processing.layout.solver.free_sets import BODY, ZONE
from processing.layout.solver.grouping import Packing
from processing.layout.solver.places import (
    Room,
    UnitTable,
    joined,
    main_at,
    make_placed,
    make_work,
    place_rect,
    places_of,
    unit_table,
)
from processing.layout.solver.units import Unit, loss_of
from processing.layout.solver.walk_grid import TOUCH_M, Grid, Walk, connected, copy_rows, packed, stamp

DROPPED = 1000.0  # taken off the score for what is left out, times its loss (`units.loss_of`): more than a place gains
ENDS, THREE, FIVE = np.array([0.0, 1.0]), np.linspace(0.0, 1.0, 3), np.linspace(0.0, 1.0, 5)
"""Fractions of a free interval at which places are tried."""
EVERY_PLACE = np.linspace(0.0, 1.0, 13)
MOST_SHOWN, MOST_ALIKE = 96, 4
"""Places of one unit shown to the judge at most, and of these on the same metre of a line (chosen: some 100 looks)."""


class Rounds(NamedTuple):
    """How long units are taken out and placed anew, and how."""

    rounds: int
    enough: int
    """Whole states after which it ends."""
    most_out: int = 3
    """Units taken out in a round at most, besides those that stand by them."""
    patience: int = 40
    """Rounds without a gain after which it begins anew."""
    noise: float = 0.7
    """Standard deviation of the noise on scores, and the temperature at which whole states follow each other."""
    tried: int = 4
    """Places of a unit whose paths are checked, best first."""
    fractions: Doubles = ENDS
    """(F,): of a free interval, at which places are tried."""
    optimistic: bool = True
    """Let gaps pass that the grid is too coarse for; the exact test decides afterwards."""


class States(NamedTuple):
    """States of the search: N of them, or one (without N), for U units."""

    slots: Int64s
    """(N, U): the slot of each unit; -1 where it has no place."""
    places: Doubles
    """(N, U): s along the slot's line, metres."""
    gains: Doubles
    """(N, U): the score of each place when it was taken."""


@dataclass(frozen=True)
class Choice:
    """Where a unit went: variant, line (x, y, direction, length, edge) and place along it."""

    unit: int
    variant: int
    line: tuple[float, ...]
    s_m: float


@dataclass(frozen=True)
class Final:
    """A state of a packing: what was placed where, and what was left out."""

    packing: Packing
    choices: tuple[Choice, ...]
    dropped: tuple[int, ...]
    """Numbers of the units left out."""
    score: float
    hopeless: tuple[Item, ...] = ()
    """Items that have no place even in the empty room; they are in no packing."""

    def left_out(self) -> list[Item]:
        """Return the items that found no place."""
        return [*self.hopeless, *(item for number in self.dropped for item in self.packing.units[number].items)]

    def loss(self) -> float:
        """Return what is lost by leaving them out (`units.loss_of`)."""
        return sum(loss_of(item) for item in self.left_out())

    def kind(self) -> tuple[object, ...]:
        """Return what distinguishes arrangements at a glance: the wall and the metre of each large unit."""
        large = self.packing.large
        return tuple(
            sorted(
                (large[c.unit], c.line[5], int(c.s_m), round(c.line[0]), round(c.line[1]))
                for c in self.choices
                if c.unit in large
            )
        )


class Search:
    """Searches in one field; keeps what does not change between runs."""

    def __init__(self, field: Field, doors: Sequence[int] = (), stood: Sequence[Doubles] = ()) -> None:
        """Prepare for a field.

        `doors` are those that paths must reach (none: paths are not looked at), `stood` the anchors, each of shape
        (7,) (`steering`), of pieces that stand already.
        """
        self.field = field
        self._doors = np.ascontiguousarray(field.doorways[list(doors)])
        self._stood = np.array(stood, dtype=np.float64).reshape(-1, 7)
        self._tables: dict[tuple[str, ...], UnitTable] = {}

    def rebuild(self, packing: Packing, how: Rounds, seed: int) -> list[Final]:
        """Return whole states, best first, or the one that leaves out least."""
        tables = [self._table(unit) for unit in packing.units]
        room, table = self._room(optimistic=how.optimistic), joined(tables)
        shape = (how.enough, len(tables))
        found = States(np.full(shape, -1), np.zeros(shape), np.zeros(shape))
        whole = rebuild(room, table, seed, how, found, make_placed(room, table), make_work(room, table))
        first = np.cumsum([0, *(len(t.variants.widths) for t in tables)]).tolist()
        finals = []
        for slots, places, gains in zip(*(rows[: max(1, whole)].tolist() for rows in found), strict=True):
            placed = [u for u, slot in enumerate(slots) if slot >= 0]
            dropped = [u for u, slot in enumerate(slots) if slot < 0]
            score = sum(gains[u] for u in placed) - DROPPED * sum(packing.units[u].loss for u in dropped)
            choices = tuple(self._choice(table, u, first[u], slots[u], places[u]) for u in placed)
            finals.append(Final(packing, choices, tuple(dropped), score))
        return sorted(finals, key=lambda one: -one.score)

    def has_place(self, unit: Unit) -> bool:
        """Return whether a unit has a place, paths aside."""
        table = self._table(unit)
        room = self._room(paths=False)
        return bool(places_of(room, table, 0, make_placed(room, table), ENDS[:1], make_work(room, table)) > 0)

    def all_places(self, unit: Unit) -> list[Final]:
        """Return where a unit could stand, paths aside, the best first and a few of each metre of a line."""
        table, packing = self._table(unit), Packing((unit,))
        room = self._room(paths=False)
        work = make_work(room, table)
        count = places_of(room, table, 0, make_placed(room, table), EVERY_PLACE, work)
        finals: list[Final] = []
        alike: dict[tuple[int, int], int] = {}
        for row in np.argsort(-work.scores[:count], kind="stable").tolist():
            slot, s = int(work.slots[row]), float(work.places[row])
            metre = (int(table.slots[slot, 1]), int(s))
            alike[metre] = alike.get(metre, 0) + 1
            if alike[metre] <= MOST_ALIKE and len(finals) < MOST_SHOWN:
                finals.append(Final(packing, (self._choice(table, 0, 0, slot, s),), (), float(work.scores[row])))
        return finals

    @staticmethod
    def _choice(table: UnitTable, unit: int, first_variant: int, slot: int, s_m: float) -> Choice:
        variant, line = table.slots[slot, :2].tolist()
        return Choice(unit, variant - first_variant, tuple(table.lines[line].tolist()), s_m)

    def _table(self, unit: Unit) -> UnitTable:
        key = (unit.role, unit.keeps_to, *(item.id for item in unit.items), str(len(unit.variants)))
        if key not in self._tables:
            self._tables[key] = unit_table(unit, self.field)
        return self._tables[key]

    def _room(self, *, optimistic: bool = False, paths: bool = True) -> Room:
        floor, ways = self.field.floor, self.field.doorways
        no_walk = Walk(Grid(0.0, 0.0, 1.0), np.zeros((1, 1), dtype=np.uint64), self._doors[:0], 0.0, 0.0)
        walk = self._walk(optimistic=optimistic) if paths else no_walk
        middles = np.ascontiguousarray(0.5 * (ways[:, 0] + ways[:, 1]))
        return Room(walk, middles, floor.windows, floor.middle, floor.hung, floor.eyes, self._stood)

    def _walk(self, *, optimistic: bool) -> Walk:
        """Return the path grid of the empty room with what stands fast in it."""
        grid, clearance2 = self.field.floor.clearance
        half = (self.field.rules.path - PATH_SLACK_M) / 2
        radius = half - 0.45 * grid.cell if optimistic else math.sqrt(half * half + grid.cell * grid.cell / 4) + 1e-7
        blocked = packed(clearance2 < radius * radius)
        for corners, (low, _), kind in zip(*self.field.fixed, strict=True):
            if kind == BODY and low < PERSON_M:
                stamp(blocked, corners, grid, radius)
        reach = half - TOUCH_M - 1e-6 + (0.3 * grid.cell if optimistic else 0.0)
        return Walk(grid, blocked, self._doors, radius, reach)


@inner
def copy_state(old, new):  # type: ignore[no-untyped-def]
    """Copy one state."""
    for u in range(old.slots.size):
        new.slots[u], new.places[u], new.gains[u] = old.slots[u], old.places[u], old.gains[u]


@inner
def put(table, u, slot, s, placed, blocked, walk):  # type: ignore[no-untyped-def]
    """Append a unit to what is placed, and mark in `blocked` (rows, words) where its bodies leave no way."""
    v, line = table.slots[slot, 0], table.lines[table.slots[slot, 1]]
    outlines, row = placed.outlines, placed.counts[0]
    for r in range(table.variants.n_rects[v]):
        rect, kind = table.variants.rects[v, r], table.variants.kinds[v, r]
        place_rect(rect, line, s, outlines.corners[row])
        outlines.heights[row, 0], outlines.heights[row, 1] = rect[4], rect[5]
        outlines.classes[row] = kind
        if kind == BODY and rect[4] < PERSON_M:
            stamp(blocked, outlines.corners[row], walk.grid, walk.radius)
        row += 1
    anchor = placed.anchors[placed.counts[1]]
    main_at(table, slot, s, anchor)
    anchor[4], anchor[5], anchor[6] = table.roles[u], table.variants.mains[v, 4], table.variants.mains[v, 5]
    placed.counts[0] = row
    placed.counts[1] += 1


@inner
def walkable(walk, blocked, placed, work):  # type: ignore[no-untyped-def]
    """Return whether all doors and use zones are joined by floor that is not `blocked` (rows, words)."""
    zones = 0
    for r in range(placed.counts[0]):
        if placed.outlines.classes[r] == ZONE:
            copy_rows(placed.outlines.corners[r], work.zones[zones])
            zones += 1
    return connected(walk, blocked, work.zones[:zones], work.flood)


@inner
def best_rows(scores, noise, rows):  # type: ignore[no-untyped-def]
    """Write the rows of the best of `scores` (M,) to `rows` (K,), best first, each with noise; return how many."""
    keys = np.empty(rows.size)
    kept = 0
    for i in range(scores.size):
        key = scores[i] + noise * np.random.standard_normal()
        if kept == rows.size and key <= keys[kept - 1]:
            continue
        j = kept if kept < rows.size else kept - 1
        while j > 0 and keys[j - 1] < key:
            rows[j], keys[j] = rows[j - 1], keys[j - 1]
            j -= 1
        rows[j], keys[j] = i, key
        kept = min(kept + 1, rows.size)
    return kept


@inner
def order_of(table, slots, taken, order):  # type: ignore[no-untyped-def]
    """Write the units to place to `order` (U,); return how many.

    First what had no place, then by size with chance; guests after all hosts, rugs last. slots, taken: (U,).
    """
    keys = np.empty(slots.size)
    found = 0
    for u in range(slots.size):
        if slots[u] >= 0 and not taken[u]:
            continue
        keys[u] = table.sizes[u] + 0.8 * np.random.random() + (3.0 if slots[u] < 0 else 0.0)
        if table.near[u, 0] >= 0:
            keys[u] -= 10.0
        if table.sizes[u] < 0:
            keys[u] -= 20.0
        j = found
        while j > 0 and keys[order[j - 1]] < keys[u]:
            order[j] = order[j - 1]
            j -= 1
        order[j] = u
        found += 1
    return found


@inner
def take_out(table, most, taken):  # type: ignore[no-untyped-def]
    """Mark up to `most` units at random in `taken` (U,), with those that stand by them; rugs always, as they follow."""
    for u in range(taken.size):
        taken[u] = table.sizes[u] < 0
    for _ in range(np.random.randint(1, most + 1)):
        u = np.random.randint(0, taken.size)
        taken[u] = True
        for guest in range(taken.size):
            if table.near[guest, 0] == table.roles[u]:
                taken[guest] = True


@inner
def loss_left(table, slots):  # type: ignore[no-untyped-def]
    """Return the loss of what has no place; slots (U,)."""
    total = 0.0
    for u in range(slots.size):
        if slots[u] < 0:
            total += table.losses[u]
    return total


@inner
def one_round(room, table, state, taken, how, placed, work):  # type: ignore[no-untyped-def]
    """Place in `state` (one of `States`) what has no place or was taken out, `taken` (U,)."""
    order, rows = np.empty(state.slots.size, np.int64), np.empty(how.tried, np.int64)
    n_order = order_of(table, state.slots, taken, order)
    # What stays is put back first: outlines, anchors and the grid of paths are made anew each round.
    copy_rows(room.walk.blocked, placed.blocked)
    placed.counts[0], placed.counts[1] = 0, room.stood.shape[0]
    for u in range(state.slots.size):
        if state.slots[u] >= 0 and not taken[u]:
            put(table, u, state.slots[u], state.places[u], placed, placed.blocked, room.walk)
    for u in order[:n_order]:
        state.slots[u], state.gains[u] = -1, 0.0
        found = places_of(room, table, u, placed, how.fractions, work)
        # The best places are tried until one leaves all paths open.
        for j in range(best_rows(work.scores[:found], how.noise, rows)):
            slot, s = work.slots[rows[j]], work.places[rows[j]]
            n_outlines, n_anchors = placed.counts[0], placed.counts[1]
            copy_rows(placed.blocked, work.blocked)
            put(table, u, slot, s, placed, work.blocked, room.walk)
            if walkable(room.walk, work.blocked, placed, work):
                copy_rows(work.blocked, placed.blocked)
                state.slots[u], state.places[u], state.gains[u] = slot, s, work.scores[rows[j]]
                break
            placed.counts[0], placed.counts[1] = n_outlines, n_anchors


@compiled
def rebuild(room, table, seed, how, found, placed, work):  # type: ignore[no-untyped-def]
    """Run rounds; write the best state so far to row 0 of `found` and, once all is placed, further whole ones after it.

    `room`, `table`, `how`, `found`, `placed`, `work`: `Room`, `UnitTable`, `Rounds`, `States`, `Placed`, `Work`.
    Ends after `how.rounds` rounds, or with as many whole states as `found` has rows. Returns how many rows are whole
    (0: row 0 is the best that leaves something out).
    """
    np.random.seed(seed)
    units = table.roles.size
    now = States(np.full(units, -1), np.zeros(units), np.zeros(units))
    before = States(now.slots.copy(), now.places.copy(), now.gains.copy())
    taken = np.zeros(units, np.bool_)
    loss, best, idle, whole = loss_left(table, now.slots), 1e300, 0, 0
    for _ in range(how.rounds):
        if idle > how.patience and whole == 0:
            now.slots[:] = -1
            loss, idle = loss_left(table, now.slots), 0
        copy_state(now, before)
        take_out(table, how.most_out, taken)
        one_round(room, table, now, taken, how, placed, work)
        new_loss = loss_left(table, now.slots)
        idle = 0 if new_loss < loss - 1e-9 else idle + 1
        # Whole states follow each other by Metropolis' rule on the sum of gains.
        worse = np.sum(before.gains) - np.sum(now.gains)
        if new_loss > loss + 1e-9 or (loss == 0.0 and worse > -how.noise * np.log(np.random.random() + 1e-12)):
            copy_state(before, now)
            continue
        loss = new_loss
        if loss < best or loss == 0.0:
            row = whole if loss == 0.0 else 0
            copy_state(now, States(found.slots[row], found.places[row], found.gains[row]))
            best = min(best, loss)
            whole += 1 if loss == 0.0 else 0
            if whole == found.slots.shape[0]:
                break
    return whole

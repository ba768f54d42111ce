"""All places of a unit beside what is placed: exact free intervals on every line, a few places in each. Compiled.

The tables say shapes with: U units, V variants of all units, R rectangles of the largest variant, L lines, S slots (a
variant on a line), I intervals. Lengths are metres.
"""

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np

from processing.ground.arrays import Doubles, Int64s, UInt64s
from processing.ground.kernels import compiled, inner
from processing.layout.solver.field import Field
from processing.layout.solver.free_sets import (
    SKIN_M,
    Outlines,
    add_forbidden,
    add_walls,
    complement,
    merged,
    rects_inside,
)
from processing.layout.solver.steering import ROLE, Spot, score_spot
from processing.layout.solver.units import Unit, Variant
from processing.layout.solver.walk_grid import Walk, copy_rows, rect_distance2

KEPT_INTERVALS = 40
"""Intervals that walls and fixed outlines forbid on a line, at most (chosen: 24 corners make fewer than 20)."""
MOST_PLACES = 4000  # places of one unit that are looked at, at most
MOST_LEVELS = 14  # pieces that a place may be level with, at most
SAME_PLACE_M = 1e-3  # chosen: a millimetre


class Variants(NamedTuple):
    """The ways to put units together."""

    rects: Doubles
    """(V, R, 6): x0, x1, y0, y1 in the unit's frame, underside and top, of footprints and use zones."""
    kinds: Int64s
    """(V, R): their classes (`free_sets`)."""
    n_rects: Int64s
    """(V,): how many there are."""
    widths: Doubles
    """(V,): along the line."""
    bonus: Doubles
    """(V,): how much better than plain, in units of the search's score."""
    mains: Doubles
    """(V, 6): the main piece's x, y, facing x, facing y, half width, half depth in the unit's frame."""


class UnitTable(NamedTuple):
    """Units with all lines they may stand on."""

    variants: Variants
    lines: Doubles
    """(L, 6): first corner, unit direction, length, edge."""
    slots: Int64s
    """(S, 4): variant, line, first interval, how many intervals."""
    intervals: Doubles
    """(I, 2): what walls and fixed outlines forbid on a slot's line."""
    first_slot: Int64s
    """(U + 1,)."""
    roles: Int64s
    """(U,): `steering.ROLE`."""
    near: Doubles
    """(U, 2): the role that a unit stands by, or -1, and how near."""
    losses: Doubles
    """(U,): what is lost where it is left out (`units.loss_of`)."""
    sizes: Doubles
    """(U,): footprints in m2; -1 for rugs."""


class Room(NamedTuple):
    """What stands fast, as the compiled search sees it."""

    walk: Walk
    door_middles: Doubles
    """(D, 2)."""
    windows: Doubles
    """(K, 8): as `field.Floor.windows`."""
    middle: Doubles
    """(2,)."""
    hung: Doubles
    """(K, 8): what hangs on walls, likewise."""
    eyes: Doubles
    """(E, 2): where cameras stand."""
    stood: Doubles
    """(A, 7): anchors (`steering`) of pieces that stand already."""


class Placed(NamedTuple):
    """What is placed in one state: room for all units, of which `counts` are in use."""

    outlines: Outlines
    anchors: Doubles
    """(A, 7)."""
    counts: Int64s
    """(2,): outlines and anchors in use."""
    blocked: UInt64s
    """(rows, words): where no walker's middle can be."""


class Work(NamedTuple):
    """Arrays that are written over and over."""

    slots: Int64s
    """(M,): slot of each place found."""
    places: Doubles
    """(M,): s of each place."""
    scores: Doubles
    """(M,): steering score of each place."""
    forbidden: Doubles
    """(N, 2)."""
    free: Doubles
    """(N, 2)."""
    wanted: Doubles
    """(MOST_LEVELS + 1,)."""
    tried: Doubles
    """(24,): places in one interval."""
    blocked: UInt64s
    """(rows, words): a trial's grid."""
    flood: UInt64s
    """(2, rows, words)."""
    zones: Doubles
    """(N, 4, 2)."""


def variants_of(listed: Sequence[Variant]) -> Variants:
    """Return variants as arrays."""
    rows = [variant.rects() for variant in listed]
    most = max(map(len, rows))
    rects, kinds = np.zeros((len(rows), most, 6)), np.zeros((len(rows), most), dtype=np.int64)
    for v, row in enumerate(rows):
        for r, (rect, kind) in enumerate(row):
            rects[v, r], kinds[v, r] = rect, kind
    mains = [(v.members[0], v.members[0].item.spec.size_m) for v in listed]
    return Variants(
        rects,
        kinds,
        np.array([len(row) for row in rows], dtype=np.int64),
        np.array([v.width_m for v in listed]),
        np.array([v.bonus for v in listed]),
        np.array([[m.x_m, m.y_m, *m.front(), w / 2, d / 2] for m, (w, d, _) in mains], dtype=np.float64),
    )


def unit_table(unit: Unit, field: Field) -> UnitTable:
    """Return the table of one unit in a field."""
    variants = variants_of(unit.variants)
    # Wall lines are for variants at walls, free lines for those of the depth they were made for.
    depths = sorted({round(v.depth_m, 6) for v in unit.variants if not v.at_wall})
    groups = [field.floor.wall_lines, *(field.floor.free_lines(depth) for depth in depths)]
    line_depths = np.concatenate([np.full(len(g), d) for g, d in zip(groups, (-1.0, *depths), strict=True)])
    own_depths = np.array([-1.0 if v.at_wall else round(v.depth_m, 6) for v in unit.variants])
    lines = np.ascontiguousarray(np.concatenate(groups))
    fixed, counts = standing(field.floor.walls, field.fixed, variants, lines, own_depths[:, None] == line_depths)
    which, line = np.nonzero(counts >= 0)
    used = counts[which, line]
    return UnitTable(
        variants,
        lines,
        np.stack([which, line, np.cumsum(used) - used, used], axis=1).astype(np.int64),
        fixed[which, line][np.arange(KEPT_INTERVALS) < used[:, None]],
        np.array([0, len(which)], dtype=np.int64),
        np.array([ROLE.get(unit.role, ROLE["small"])], dtype=np.int64),
        np.array([[ROLE[unit.keeps_to], unit.keeps_within_m] if unit.keeps_to else [-1.0, 0.0]]),
        np.array([unit.loss]),
        np.array([-1.0 if unit.role == "rug" else unit.footprint_m2]),
    )


def joined(tables: Sequence[UnitTable]) -> UnitTable:
    """Return units' tables as one: rows after each other, the numbers in `slots` moved on."""
    most = max(t.variants.rects.shape[1] for t in tables)

    def wide(array: Any) -> Any:
        return np.pad(array, ((0, 0), (0, most - array.shape[1]), *((0, 0),) * (array.ndim - 2)))

    sizes = [[len(t.variants.widths), len(t.lines), len(t.intervals), len(t.slots)] for t in tables]
    before = np.cumsum([[0] * 4, *sizes], axis=0)
    slots = np.concatenate([t.slots + np.array([*b[:3], 0]) for t, b in zip(tables, before, strict=False)])
    rects, kinds = (np.concatenate([wide(t.variants[field]) for t in tables]) for field in (0, 1))
    others = (np.concatenate(parts) for parts in zip(*(t.variants[2:] for t in tables), strict=True))
    lines, _, intervals, _, *rest = (np.concatenate(parts) for parts in zip(*(t[1:] for t in tables), strict=True))
    return UnitTable(Variants(rects, kinds, *others), lines, slots, intervals, before[:, 3].astype(np.int64), *rest)


@inner
def close_outside(walls, line, rects, count, forbidden, gaps):  # type: ignore[no-untyped-def]
    """Append to `forbidden` (N, 2) the gaps in which the rectangles (R, 6) are outside; return how many rows there are.

    No wall is crossed within a gap, so that one place answers for all. The last row of `forbidden` holds the line's
    free length.
    """
    for i in range(complement(forbidden, count, forbidden[-1, 0], gaps)):
        low, high = gaps[i, 0], gaps[i, 1]
        if not rects_inside(walls, line, 0.5 * (low + high), rects):
            forbidden[count, 0], forbidden[count, 1] = low - 3 * SKIN_M, high + 3 * SKIN_M
            count += 1
    return count


@compiled
def standing(walls, fixed, variants, lines, allowed):  # type: ignore[no-untyped-def]
    """Return what walls (W, 4) and fixed outlines forbid: intervals (V, L, KEPT_INTERVALS, 2) and counts (V, L).

    `allowed` (V, L); the count is -1 where a variant does not stand on a line.
    """
    n, most, _ = variants.rects.shape
    out = np.empty((n, lines.shape[0], KEPT_INTERVALS, 2))
    counts = np.full((n, lines.shape[0]), -1, np.int64)
    rows = (walls.shape[0] + fixed.corners.shape[0]) * most + 4
    forbidden, gaps = np.empty((2 * rows + 1, 2)), np.empty((rows, 2))
    for v in range(n):
        rects, kinds = variants.rects[v, : variants.n_rects[v]], variants.kinds[v, : variants.n_rects[v]]
        for k in range(lines.shape[0]):
            if not allowed[v, k] or lines[k, 4] < variants.widths[v] - SKIN_M:
                continue
            count = add_walls(walls, lines[k], rects, forbidden, 0)
            count = add_forbidden(fixed, fixed.classes.size, lines[k], rects, kinds, forbidden, count)
            count = merged(forbidden, count)
            forbidden[-1, 0] = lines[k, 4] - variants.widths[v]
            count = merged(forbidden, close_outside(walls, lines[k], rects, count, forbidden, gaps))
            if count > KEPT_INTERVALS:
                count = KEPT_INTERVALS
                forbidden[count - 1, 1] = 1e300
            copy_rows(forbidden[:count], out[v, k])
            counts[v, k] = count
    return out, counts


@inner
def free_on(table, slot, placed, work):  # type: ignore[no-untyped-def]
    """Write the free intervals of a slot beside what is placed to `work.free`; return how many."""
    v, line = table.slots[slot, 0], table.lines[table.slots[slot, 1]]
    n = table.variants.n_rects[v]
    first, count = table.slots[slot, 2], table.slots[slot, 3]
    for i in range(count):
        work.forbidden[i, 0], work.forbidden[i, 1] = table.intervals[first + i, 0], table.intervals[first + i, 1]
    rects, kinds = table.variants.rects[v, :n], table.variants.kinds[v, :n]
    count = add_forbidden(placed.outlines, placed.counts[0], line, rects, kinds, work.forbidden, count)
    count = merged(work.forbidden, count)
    return complement(work.forbidden, count, line[4] - table.variants.widths[v], work.free)


@inner
def add_new(places, count, s):  # type: ignore[no-untyped-def]
    """Append s to `places` (N,) where it is not there yet; return how many there are."""
    for i in range(count):
        if abs(places[i] - s) < SAME_PLACE_M:
            return count
    if count < places.size:
        places[count] = s
        count += 1
    return count


@inner
def places_in(low, high, fractions, wanted, out):  # type: ignore[no-untyped-def]
    """Write the places tried in a free interval to `out` (N,); return how many.

    They are fractions (F,) of it, and of `wanted` (K,) what lies within it.
    """
    found = 0
    for f in fractions:
        found = add_new(out, found, low + f * (high - low))
    for s in wanted:
        if low < s < high:
            found = add_new(out, found, s)
    return found


@inner
def main_at(table, slot, s, out):  # type: ignore[no-untyped-def]
    """Write x, y, facing x, facing y of a slot's main piece at s to `out` (4,)."""
    main, line = table.variants.mains[table.slots[slot, 0]], table.lines[table.slots[slot, 1]]
    ux, uy = line[2], line[3]
    x, y = s + main[0], main[1]
    out[0], out[1] = line[0] + x * ux - y * uy, line[1] + x * uy + y * ux
    out[2], out[3] = main[2] * ux - main[3] * uy, main[2] * uy + main[3] * ux


@inner
def place_rect(rect, line, s, out):  # type: ignore[no-untyped-def]
    """Write the corners (4, 2) in the room of a unit's rectangle (6,) at s on a line (6,)."""
    for c in range(4):
        x = s + (rect[0] if c in (0, 3) else rect[1])
        y = rect[2] if c < 2 else rect[3]
        out[c, 0] = line[0] + x * line[2] - y * line[3]
        out[c, 1] = line[1] + x * line[3] + y * line[2]


@inner
def keeps_near(table, u, slot, s, anchors):  # type: ignore[no-untyped-def]
    """Return whether a unit's main piece at s stands as near to an anchor (A, 7) of its host's role as it has to."""
    if table.near[u, 0] < 0:
        return True
    near2 = table.near[u, 1] * table.near[u, 1]
    own, other = np.empty((4, 2)), np.empty((4, 2))
    place_rect(table.variants.rects[table.slots[slot, 0], 0], table.lines[table.slots[slot, 1]], s, own)
    for a in range(anchors.shape[0]):
        if anchors[a, 4] != table.near[u, 0]:
            continue
        x, y, fx, fy, w, d = anchors[a, 0], anchors[a, 1], anchors[a, 2], anchors[a, 3], anchors[a, 5], anchors[a, 6]
        for c in range(4):
            across, ahead = (-w if c in (0, 3) else w), (-d if c < 2 else d)
            other[c, 0] = x + across * fy + ahead * fx
            other[c, 1] = y - across * fx + ahead * fy
        # Two rectangles that do not overlap are nearest at a corner of one of them.
        for c in range(4):
            if (
                rect_distance2(other, own[c, 0], own[c, 1]) <= near2
                or rect_distance2(own, other[c, 0], other[c, 1]) <= near2
            ):
                return True
    return False


@inner
def score_at(room, table, u, slot, s, gap, anchors):  # type: ignore[no-untyped-def]
    """Return the score of a unit's slot at s in the free interval `gap` (low, high), beside anchors (A, 7)."""
    v, line = table.slots[slot, 0], table.lines[table.slots[slot, 1]]
    main, at = table.variants.mains[v], np.empty(4)
    main_at(table, slot, s, at)
    ends = int(s - gap[0] < SAME_PLACE_M) + int(gap[1] - s < SAME_PLACE_M)
    centred = 1.0 if abs(s - 0.5 * (line[4] - table.variants.widths[v])) < SAME_PLACE_M else 0.0
    # A gap too narrow to use beside the unit costs: better flush or well away.
    sliver = 0.0
    for left in (s - gap[0], gap[1] - s):
        sliver += 0.25 if 0.02 < left < 0.35 else 0.0
    x, half = s + main[0], main[4] * abs(main[3]) + main[5] * abs(main[2])  # of its width, or of its depth
    spot = Spot(at[0], at[1], at[2], at[3], int(line[5]), x - half, x + half, ends, centred)
    return table.variants.bonus[v] - sliver + score_spot(table.roles[u], spot, room, anchors)


@compiled
def places_of(room, table, u, placed, fractions, work):  # type: ignore[no-untyped-def]
    """Write all places of a unit beside what is placed to `work.slots`, `places`, `scores`; return how many.

    `fractions` (F,): of each free interval; besides, its line's middle and places level with pieces that stand.
    """
    found = 0
    anchors = placed.anchors[: placed.counts[1]]
    levels = min(anchors.shape[0], MOST_LEVELS)
    for slot in range(table.first_slot[u], table.first_slot[u + 1]):
        v, line = table.slots[slot, 0], table.lines[table.slots[slot, 1]]
        n_free = free_on(table, slot, placed, work)
        work.wanted[0] = 0.5 * (line[4] - table.variants.widths[v])
        for a in range(levels):
            along = (anchors[a, 0] - line[0]) * line[2] + (anchors[a, 1] - line[1]) * line[3]
            work.wanted[a + 1] = along - table.variants.mains[v, 0]
        for i in range(n_free):
            gap = (work.free[i, 0], work.free[i, 1])
            for p in range(places_in(gap[0], gap[1], fractions, work.wanted[: levels + 1], work.tried)):
                s = work.tried[p]
                if found == work.scores.size:
                    return found
                if keeps_near(table, u, slot, s, anchors):
                    work.slots[found], work.places[found] = slot, s
                    work.scores[found] = score_at(room, table, u, slot, s, gap, anchors)
                    found += 1
    return found


def make_placed(room: Room, table: UnitTable) -> Placed:
    """Return the empty state of a room, with space for all units of a table."""
    units = len(table.roles)
    rows = 4 + units * table.variants.rects.shape[1]
    anchors = np.zeros((units + len(room.stood), 7))
    anchors[: len(room.stood)] = room.stood
    outlines = Outlines(np.zeros((rows, 4, 2)), np.zeros((rows, 2)), np.zeros(rows, dtype=np.int64))
    return Placed(outlines, anchors, np.array([0, len(room.stood)], dtype=np.int64), room.walk.blocked.copy())


def make_work(room: Room, table: UnitTable) -> Work:
    """Return arrays to work in, large enough for a table's units."""
    rows = 4 + len(table.roles) * table.variants.rects.shape[1]
    blocked = room.walk.blocked
    return Work(
        np.zeros(MOST_PLACES, dtype=np.int64),
        np.zeros(MOST_PLACES),
        np.zeros(MOST_PLACES),
        np.zeros((KEPT_INTERVALS + rows * table.variants.rects.shape[1] + 4, 2)),
        np.zeros((2 * KEPT_INTERVALS, 2)),
        np.zeros(MOST_LEVELS + 1),
        np.zeros(24),
        np.zeros_like(blocked),
        np.zeros((2, *blocked.shape), dtype=np.uint64),
        np.zeros((rows, 4, 2)),
    )

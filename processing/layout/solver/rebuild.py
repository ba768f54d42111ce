"""Crowded rooms: one state at a time, units taken out and placed anew, until everything has a place. Compiled (numba).

Every round takes out a few units at random, places first what had no place, then what was taken out, each at the best
of a few places by a noisy score, all paths kept. A round that leaves out no more than the last is kept.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import numpy.typing as npt
from numba import njit

from processing.ground.arrays import Doubles
from processing.layout.solver.beam import add_unit, copy_grid, copy_outline, stamp_bodies
from processing.layout.solver.expand import KEPT_INTERVALS, try_places
from processing.layout.solver.free_sets import MEETS, ZONE, add_forbidden, complement, merged
from processing.layout.solver.walk_grid import connected

TRIED_PLACES = 4
MOST_PLACES = 4000
MOST_UNITS = 48


class RoomArrays(NamedTuple):
    """What stands fast."""

    blocked: npt.NDArray[np.uint64]
    grid: Doubles
    doors: Doubles
    door_middles: Doubles
    windows: Doubles
    middle: Doubles
    stood: Doubles
    radius2: float
    reach: float


class UnitTable(NamedTuple):
    """All units of a packing: rows of variants and of slots (a variant on a line with what stands fast there)."""

    first_slot: Doubles
    """(U + 1,)."""
    slots: Doubles
    """(S, 4): variant, line, first interval, how many."""
    intervals: Doubles
    lines: Doubles
    rects: Doubles
    kinds: Doubles
    n_rects: Doubles
    widths: Doubles
    bonus: Doubles
    anchor_at: Doubles
    anchor_to: Doubles
    half: Doubles
    roles: Doubles
    near: Doubles
    """(U, 2): role it stands by or -1, and how near."""
    losses: Doubles
    sizes: Doubles
    """(U,): footprints; rugs -1."""


@njit(cache=True)
def anchor_of(table, u, slot, s, out):  # type: ignore[no-untyped-def]
    """Write a placed unit's anchor row (`soft`)."""
    v, line = table.slots[slot, 0], table.lines[table.slots[slot, 1]]
    ox, oy, ux, uy = line[0], line[1], line[2], line[3]
    ax, ay = s + table.anchor_at[v, 0], table.anchor_at[v, 1]
    tx, ty = table.anchor_to[v, 0], table.anchor_to[v, 1]
    out[0], out[1] = ox + ax * ux - ay * uy, oy + ax * uy + ay * ux
    out[2], out[3] = tx * ux - ty * uy, tx * uy + ty * ux
    out[4], out[5], out[6] = table.roles[u], table.half[v, 0], table.half[v, 1]


@njit(cache=True)
def places_of(room, table, u, dyn, heights, classes, count, anchors, n_anchors, fractions, index, place, score):  # type: ignore[no-untyped-def]
    """Write all places of a unit beside what is placed; return how many."""
    found = 0
    scratch = np.empty((KEPT_INTERVALS + dyn.shape[0] * table.rects.shape[1] + 4, 2))
    free, places, wanted = np.empty((KEPT_INTERVALS + 40, 2)), np.empty(24), np.empty(16)
    near = (int(table.near[u, 0]), table.near[u, 1])
    for k in range(table.first_slot[u], table.first_slot[u + 1]):
        v, line = table.slots[k, 0], table.lines[table.slots[k, 1]]
        own, kind = table.rects[v, : table.n_rects[v]], table.kinds[v, : table.n_rects[v]]
        n = table.slots[k, 3]
        for i in range(n):
            scratch[i, 0] = table.intervals[table.slots[k, 2] + i, 0]
            scratch[i, 1] = table.intervals[table.slots[k, 2] + i, 1]
        n = add_forbidden(
            dyn, heights, classes, count, line[0], line[1], line[2], line[3], own, kind, MEETS, scratch, n
        )
        n = merged(scratch, n)
        longest = line[4] - table.widths[v]
        n_free = complement(scratch, n, 0.0, longest, free)
        found = try_places(
            free, n_free, line, own, table.bonus[v], table.anchor_at[v], table.anchor_to[v], table.half[v],
            table.roles[u], near, longest, anchors, n_anchors, fractions, room.door_middles, room.windows,
            room.middle, 0, v, k, index, place, score, found, places, wanted,
        )  # fmt: skip
    return found


@njit(cache=True)
def best_rows(score, found, noise, rows):  # type: ignore[no-untyped-def]
    """Write the rows of the best noisy scores, best first; return how many."""
    kept = 0
    for i in range(found):
        score[i] += noise * np.random.standard_normal()
        if kept == rows.size and score[i] <= score[rows[kept - 1]]:
            continue
        j = kept if kept < rows.size else kept - 1
        while j > 0 and score[rows[j - 1]] < score[i]:
            rows[j] = rows[j - 1]
            j -= 1
        rows[j] = i
        kept = min(kept + 1, rows.size)
    return kept


@njit(cache=True)
def add_at(table, slot, s, dyn, heights, classes, count):  # type: ignore[no-untyped-def]
    """Append a unit's outlines; return how many there are then."""
    v, line = table.slots[slot, 0], table.lines[table.slots[slot, 1]]
    n = table.n_rects[v]
    return add_unit(table.rects[v, :n], table.kinds[v, :n], line, s, dyn, heights, classes, count)


@njit(cache=True)
def walkable(room, blocked, dyn, classes, count, work, zones):  # type: ignore[no-untyped-def]
    """Tell whether all doors and use zones are joined."""
    n_zones = 0
    for r in range(count):
        if classes[r] == ZONE:
            copy_outline(dyn[r], zones[n_zones])
            n_zones += 1
    x0, y0, cell = room.grid[0], room.grid[1], room.grid[2]
    doors = room.doors
    return connected(blocked, work, doors, doors.shape[0], zones, n_zones, x0, y0, cell, room.reach)


@njit(cache=True)
def order_of(table, slot_of, taken, order):  # type: ignore[no-untyped-def]
    """Write the units to place: what had no place first, then by size with chance; guests after all hosts."""
    count = table.first_slot.size - 1
    keys = np.empty(count)
    found = 0
    for u in range(count):
        if slot_of[u] >= 0 and not taken[u]:
            continue
        keys[u] = table.sizes[u] + 0.8 * np.random.random() + (3.0 if slot_of[u] < 0 else 0.0)
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


@njit(cache=True)
def take_out(table, slot_of, most, taken):  # type: ignore[no-untyped-def]
    """Mark up to `most` placed units at random, with those that stand by them; rugs always, as they follow the rest."""
    count = slot_of.size
    for u in range(count):
        taken[u] = table.sizes[u] < 0
    for _ in range(np.random.randint(1, most + 1)):
        u = np.random.randint(0, count)
        taken[u] = True
        for g in range(count):
            if table.near[g, 0] >= 0 and int(table.near[g, 0]) == table.roles[u]:
                taken[g] = True


@njit(cache=True)
def loss_left(table, slot_of):  # type: ignore[no-untyped-def]
    """Return the loss of what has no place."""
    total = 0.0
    for u in range(slot_of.size):
        if slot_of[u] < 0:
            total += table.losses[u]
    return total


@njit(cache=True)
def one_round(room, table, slot_of, s_of, gain_of, taken, noise, fractions, dyn, heights, classes, blocked, scratch):  # type: ignore[no-untyped-def]
    """Place what has no place or was taken out, in place of slot_of, s_of and gain_of."""
    trial, work, zones, index, place, score = scratch
    units = slot_of.size
    order, rows, anchors = np.empty(units, np.int64), np.empty(TRIED_PLACES, np.int64), np.empty((MOST_UNITS, 7))
    n_order = order_of(table, slot_of, taken, order)
    copy_grid(room.blocked, blocked)
    count, n_anchors = 0, room.stood.shape[0]
    anchors[:n_anchors] = room.stood
    x0, y0, cell = room.grid[0], room.grid[1], room.grid[2]
    for u in range(units):
        if slot_of[u] >= 0 and not taken[u]:
            end = add_at(table, slot_of[u], s_of[u], dyn, heights, classes, count)
            stamp_bodies(blocked, dyn, heights, classes, count, end, x0, y0, cell, room.radius2)
            anchor_of(table, u, slot_of[u], s_of[u], anchors[n_anchors])
            count, n_anchors = end, n_anchors + 1
    for i in range(n_order):
        u = order[i]
        slot_of[u], gain_of[u] = -1, 0.0
        found = places_of(
            room, table, u, dyn, heights, classes, count, anchors, n_anchors, fractions, index, place, score
        )  # fmt: skip
        for j in range(best_rows(score, found, noise, rows)):
            slot, s = index[rows[j], 2], place[rows[j]]
            end = add_at(table, slot, s, dyn, heights, classes, count)
            copy_grid(blocked, trial)
            stamp_bodies(trial, dyn, heights, classes, count, end, x0, y0, cell, room.radius2)
            if walkable(room, trial, dyn, classes, end, work, zones):
                copy_grid(trial, blocked)
                slot_of[u], s_of[u], gain_of[u] = slot, s, score[rows[j]]
                anchor_of(table, u, slot, s, anchors[n_anchors])
                count, n_anchors = end, n_anchors + 1
                break


@njit(cache=True)
def rebuild(room, table, seed, rounds, most_out, patience, noise, fractions, enough, slots, places, gains):  # type: ignore[no-untyped-def]
    """Run rounds; write the best state so far to row 0 and, once all is placed, every further whole one to the next.

    slots, places, gains: (N, U). Ends after `rounds`, or with `enough` whole states; begins anew after `patience`
    rounds without a gain. Whole states follow each other as in annealing at a temperature of `noise`. Returns how many
    rows are whole (0: row 0 is the best that leaves something out).
    """
    np.random.seed(seed)
    units = table.first_slot.size - 1
    rows = 4 + units * table.rects.shape[1]
    dyn, heights, classes = np.empty((rows, 4, 2)), np.empty((rows, 2)), np.empty(rows, np.int64)
    blocked = np.empty_like(room.blocked)
    scratch = (
        np.empty_like(room.blocked), np.empty((2, *room.blocked.shape), np.uint64),
        np.empty((rows, 4, 2)), np.empty((MOST_PLACES, 3), np.int64), np.empty(MOST_PLACES), np.empty(MOST_PLACES),
    )  # fmt: skip
    slot_of, s_of, gain_of = np.full(units, -1), np.zeros(units), np.zeros(units)
    was_slot, was_s, was_gain = slot_of.copy(), s_of.copy(), gain_of.copy()
    taken = np.zeros(units, np.bool_)
    loss, best, idle, whole = loss_left(table, slot_of), 1e300, 0, 0
    for _ in range(rounds):
        if idle > patience and whole == 0:
            slot_of[:] = -1
            loss, idle = loss_left(table, slot_of), 0
        was_slot[:], was_s[:], was_gain[:] = slot_of, s_of, gain_of
        take_out(table, slot_of, most_out, taken)
        one_round(room, table, slot_of, s_of, gain_of, taken, noise, fractions, dyn, heights, classes, blocked, scratch)
        now = loss_left(table, slot_of)
        idle = 0 if now < loss - 1e-9 else idle + 1
        worse = np.sum(was_gain) - np.sum(gain_of)
        if now > loss + 1e-9 or (loss == 0.0 and worse > -noise * np.log(np.random.random() + 1e-12)):
            slot_of[:], s_of[:], gain_of[:] = was_slot, was_s, was_gain
            continue
        loss = now
        if now < best or (now == 0.0 and whole < slots.shape[0]):
            row = whole if now == 0.0 else 0
            slots[row], places[row], gains[row] = slot_of, s_of, gain_of
            best = min(best, now)
            whole += 1 if now == 0.0 else 0
            if whole >= enough:
                break
    return whole

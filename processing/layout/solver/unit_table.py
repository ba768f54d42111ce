"""A packing's units as one table for the compiled rounds of `rebuild`, and states back from it."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from processing.layout.solver.grouping import Packing
from processing.layout.solver.rebuild import UnitTable
from processing.layout.solver.states import DROPPED, Choice, Found, UnitArrays

Origin = tuple[np.ndarray, np.ndarray]
"""The first variant and the first line of each unit."""


def unit_table(units: Sequence[UnitArrays], packing: Packing) -> tuple[UnitTable, Origin]:
    """Return all units' rows after each other, and where each unit's begin."""
    widest = max(u.rects.shape[1] for u in units)
    first_v = np.cumsum([0, *(len(u.rects) for u in units)])
    first_l = np.cumsum([0, *(len(u.lines) for u in units)])
    slots, intervals, first_slot, used = [], [], [0], 0
    for number, u in enumerate(units):
        v, line = np.nonzero(u.fixed_counts >= 0)
        counts = u.fixed_counts[v, line]
        begin = used + np.concatenate([[0], np.cumsum(counts)])
        slots.append(np.stack([v + first_v[number], line + first_l[number], begin[:-1], counts], axis=1))
        intervals.append(u.fixed[v, line][np.arange(u.fixed.shape[2]) < counts[:, None]])
        used = int(begin[-1])
        first_slot.append(first_slot[-1] + len(v))
    table = UnitTable(
        np.array(first_slot), np.concatenate(slots), np.concatenate(intervals),
        np.concatenate([u.lines for u in units]),
        np.concatenate([np.pad(u.rects, ((0, 0), (0, widest - u.rects.shape[1]), (0, 0))) for u in units]),
        np.concatenate([np.pad(u.kinds, ((0, 0), (0, widest - u.kinds.shape[1]))) for u in units]),
        np.concatenate([u.n_rects for u in units]), np.concatenate([u.widths for u in units]),
        np.concatenate([u.bonus for u in units]), np.concatenate([u.anchor_at for u in units]),
        np.concatenate([u.anchor_to for u in units]), np.concatenate([u.half for u in units]),
        np.array([u.role for u in units]), np.array([u.near for u in units], dtype=np.float64),
        np.array([unit.loss for unit in packing.units]),
        np.array([-1.0 if unit.role == "rug" else unit.footprint_m2 for unit in packing.units]),
    )  # fmt: skip
    return table, (first_v, first_l)


def all_found(
    packing: Packing, table: UnitTable, origin: Origin, slots: np.ndarray, places: np.ndarray, gains: np.ndarray
) -> list[Found]:
    """Return rows (n, units) of `rebuild` as states."""
    lines = [tuple(line) for line in table.lines.tolist()]
    rows = table.slots[:, :2].tolist()
    first = origin[0].tolist()
    losses = [DROPPED * unit.loss for unit in packing.units]
    states = []
    for row_slots, row_places, row_gains in zip(slots.tolist(), places.tolist(), gains.tolist(), strict=True):
        choices, dropped, score = [], [], 0.0
        for u, slot in enumerate(row_slots):
            if slot < 0:
                dropped.append(u)
                score -= losses[u]
                continue
            variant, line = rows[slot]
            choices.append(Choice(u, variant - first[u], lines[line], row_places[u]))
            score += row_gains[u]
        states.append(Found(tuple(choices), tuple(dropped), score))
    return states

"""One step of the search, compiled: from places sorted by score to the states that go on, paths checked."""

from __future__ import annotations

import numpy as np
from numba import njit

from processing.layout.solver.free_sets import BODY, RUG, ZONE
from processing.layout.solver.walk_grid import connected, stamp

WALKER_M = 2.0


@njit(cache=True)
def place_rect(rect, ox, oy, ux, uy, s, out):  # type: ignore[no-untyped-def]
    """Write the corners (4, 2) of a unit's rectangle in the room."""
    for c in range(4):
        x = s + (rect[0] if c in (0, 3) else rect[1])
        y = rect[2] if c < 2 else rect[3]
        out[c, 0] = ox + x * ux - y * uy
        out[c, 1] = oy + x * uy + y * ux


@njit(cache=True)
def add_unit(rects, kinds, line, s, dyn, heights, classes, count):  # type: ignore[no-untyped-def]
    """Append a unit's rectangles to a state's outlines; return how many it has then."""
    for r in range(rects.shape[0]):
        place_rect(rects[r], line[0], line[1], line[2], line[3], s, dyn[count])
        heights[count, 0], heights[count, 1] = rects[r, 4], rects[r, 5]
        classes[count] = kinds[r]
        count += 1
    return count


@njit(cache=True)
def stamp_bodies(blocked, dyn, heights, classes, first, end, x0, y0, cell, radius2):  # type: ignore[no-untyped-def]
    """Mark where no walker's middle can be for the bodies among outlines first..end - 1."""
    for r in range(first, end):
        if classes[r] == BODY and heights[r, 0] < WALKER_M:
            stamp(blocked, dyn[r], x0, y0, cell, radius2)


@njit(cache=True)
def copy_outline(old, new):  # type: ignore[no-untyped-def]
    """Copy four corners."""
    for c in range(4):
        new[c, 0], new[c, 1] = old[c, 0], old[c, 1]


@njit(cache=True)
def copy_state(dyn, heights, classes, count, new_dyn, new_heights, new_classes):  # type: ignore[no-untyped-def]
    """Copy the first `count` outlines of a state."""
    for r in range(count):
        copy_outline(dyn[r], new_dyn[r])
        new_heights[r, 0], new_heights[r, 1] = heights[r, 0], heights[r, 1]
        new_classes[r] = classes[r]


@njit(cache=True)
def copy_grid(old, new):  # type: ignore[no-untyped-def]
    """Copy a grid."""
    for i in range(old.shape[0]):
        for j in range(old.shape[1]):
            new[i, j] = old[i, j]


@njit(cache=True)
def zones_of(dyn, classes, count, zones):  # type: ignore[no-untyped-def]
    """Copy the use zones among the first `count` outlines; return how many."""
    found = 0
    for r in range(count):
        if classes[r] == ZONE:
            copy_outline(dyn[r], zones[found])
            found += 1
    return found


@njit(cache=True)
def select(  # type: ignore[no-untyped-def]
    order, index, place, strata, n_strata, most, per_parent, per_stratum, most_checks,
    rects, kinds, n_rects, lines, dyn, heights, classes, dyn_n, blocked, doors, grid, radius2, reach,
    new_dyn, new_heights, new_classes, new_n, new_blocked, accepted,
):  # fmt: skip
    """Fill the next states with the best rows that keep all paths; return how many.

    grid: x0, y0, cell. Quotas: children a parent, states a stratum, paths checked in all.
    """
    found, checks = 0, 0
    x0, y0, cell = grid[0], grid[1], grid[2]
    children = np.zeros(dyn.shape[0], dtype=np.int64)
    in_stratum = np.zeros(n_strata, dtype=np.int64)
    work = np.empty((2, *blocked.shape[1:]), dtype=np.uint64)
    zones = np.empty((dyn.shape[1], 4, 2))
    for row in order:
        b, v, k = index[row, 0], index[row, 1], index[row, 2]
        if found == most or checks == most_checks:
            break
        if children[b] >= per_parent or in_stratum[strata[row]] >= per_stratum:
            continue
        checks += 1
        before = dyn_n[b]
        copy_state(dyn[b], heights[b], classes[b], before, new_dyn[found], new_heights[found], new_classes[found])
        count = add_unit(
            rects[v, : n_rects[v]], kinds[v, : n_rects[v]], lines[k], place[row],
            new_dyn[found], new_heights[found], new_classes[found], before,
        )  # fmt: skip
        copy_grid(blocked[b], new_blocked[found])
        stamp_bodies(
            new_blocked[found], new_dyn[found], new_heights[found], new_classes[found], before, count, x0, y0, cell,
            radius2,
        )  # fmt: skip
        n_zones = zones_of(new_dyn[found], new_classes[found], count, zones)
        if not connected(
            new_blocked[found], work, doors, doors.shape[0], zones, n_zones, x0, y0, cell, reach
        ):  # fmt: skip
            continue
        new_n[found] = count
        accepted[found] = row
        children[b] += 1
        in_stratum[strata[row]] += 1
        found += 1
    return found


__all__ = ["BODY", "RUG", "ZONE", "add_unit", "place_rect", "select", "stamp_bodies"]

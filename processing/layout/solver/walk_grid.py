"""Where a walker of a given width can go, on a grid whose answer 'there is a path' is a proof. Compiled (numba).

A cell is free when its middle is at least sqrt(r^2 + (h/2)^2) from every wall and piece (r half the path, h the cell):
then every point between two neighbouring free middles is at least r away, so that a chain of them is a path of the full
width. 'No path' is no proof (a gap may be up to h wider than the path and be missed): the exact test decides then.
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt
from numba import njit

from processing.layout.solver.free_sets import inside_walls

# Grids of one bit a cell, for floods: rows of 64-bit words (rows, words), lowest bit first. Compiled (numba).
#
# A row is flooded a word at a time, by doubling steps, so that a whole room takes microseconds.


WORD = 64
_ZERO, _ONE, _ALL = np.uint64(0), np.uint64(1), np.uint64(0xFFFFFFFFFFFFFFFF)
_TOP = np.uint64(63)


def packed(cells: npt.NDArray[np.bool_]) -> npt.NDArray[np.uint64]:
    """Return a grid (rows, columns) as words; what is past the last column is set (blocked)."""
    rows, columns = cells.shape
    words = -(-columns // WORD)
    whole = np.ones((rows, words * WORD), dtype=np.bool_)
    whole[:, :columns] = cells
    told = np.packbits(whole, axis=1, bitorder="little").reshape(rows, words, 8).astype(np.uint64)
    return np.asarray((told << (8 * np.arange(8, dtype=np.uint64))).sum(axis=2, dtype=np.uint64))


@njit(cache=True)
def between(first, last, word):  # type: ignore[no-untyped-def]
    """Return the bits of columns first..last (inclusive) that lie in a word."""
    low, high = max(first - WORD * word, 0), min(last - WORD * word, WORD - 1)
    if low > high:
        return _ZERO
    return (_ALL >> np.uint64(WORD - 1 - (high - low))) << np.uint64(low)


@njit(cache=True)
def upwards(seeds, free):  # type: ignore[no-untyped-def]
    """Return the free bits that seeds (free bits too) reach towards higher columns."""
    for step in (1, 2, 4, 8, 16, 32):
        seeds |= free & (seeds << np.uint64(step))
        free &= free << np.uint64(step)
    return seeds


@njit(cache=True)
def downwards(seeds, free):  # type: ignore[no-untyped-def]
    """Return the free bits that seeds reach towards lower columns."""
    for step in (1, 2, 4, 8, 16, 32):
        seeds |= free & (seeds >> np.uint64(step))
        free &= free >> np.uint64(step)
    return seeds


@njit(cache=True)
def fill_row(reached, free):  # type: ignore[no-untyped-def]
    """Let what is reached of a row (words,) spread along its free runs."""
    words = reached.size
    carry = _ZERO
    for w in range(words):
        seeds = reached[w] | (carry & free[w])
        reached[w] = upwards(seeds, free[w]) if seeds != _ZERO else _ZERO
        carry = reached[w] >> _TOP
    carry = _ZERO
    for w in range(words - 1, -1, -1):
        seeds = reached[w] | ((carry << _TOP) & free[w])
        reached[w] = downwards(seeds, free[w]) if seeds != _ZERO else _ZERO
        carry = reached[w] & _ONE


@njit(cache=True)
def take_from(reached, free, i, j):  # type: ignore[no-untyped-def]
    """Let row j's reached cells spread to row i; tell whether any is new."""
    new = False
    for w in range(reached.shape[1]):
        fresh = reached[j, w] & free[i, w] & ~reached[i, w]
        if fresh != _ZERO:
            reached[i, w] |= fresh
            new = True
    if new:
        fill_row(reached[i], free[i])
    return new


@njit(cache=True)
def spread(reached, free, row):  # type: ignore[no-untyped-def]
    """Let what is reached in one row spread over four neighbours through the free cells (rows, words)."""
    rows = free.shape[0]
    fill_row(reached[row], free[row])
    low, high = row, row
    changed = True
    while changed:
        changed = False
        for i in range(max(1, low), rows):
            if take_from(reached, free, i, i - 1):
                changed, high = True, max(high, i)
            elif i > high:
                break
        for i in range(min(rows - 2, high), -1, -1):
            if take_from(reached, free, i, i + 1):
                changed, low = True, min(low, i)
            elif i < low:
                break


@njit(cache=True)
def count_bits(word):  # type: ignore[no-untyped-def]
    """Return how many bits of a word are set."""
    count = 0
    while word != _ZERO:
        word &= word - _ONE
        count += 1
    return count


@njit(cache=True)
def lowest(word):  # type: ignore[no-untyped-def]
    """Return a word's lowest set bit alone."""
    return word & (~word + _ONE)


_NONE = np.uint64(0)
TOUCH_M = 0.05
"""A walker has reached a use zone when overlapping it by this much."""


@njit(cache=True)
def rect_distance2(corners, px, py):  # type: ignore[no-untyped-def]
    """Return the squared distance of a point to a filled rectangle given by its corners (4, 2) in ring order."""
    ax, ay = corners[1, 0] - corners[0, 0], corners[1, 1] - corners[0, 1]
    bx, by = corners[3, 0] - corners[0, 0], corners[3, 1] - corners[0, 1]
    la, lb = np.sqrt(ax * ax + ay * ay), np.sqrt(bx * bx + by * by)
    dx, dy = px - corners[0, 0], py - corners[0, 1]
    u, v = (dx * ax + dy * ay) / la, (dx * bx + dy * by) / lb
    ou = max(0.0, -u, u - la)
    ov = max(0.0, -v, v - lb)
    return ou * ou + ov * ov


@njit(cache=True)
def wall_clearance2(walls, x0, y0, cell, rows, columns):  # type: ignore[no-untyped-def]
    """Return the squared distance to the walls at cell middles (rows, columns); -1 outside the room."""
    out = np.empty((rows, columns))
    for i in range(rows):
        y = y0 + (i + 0.5) * cell
        for j in range(columns):
            x = x0 + (j + 0.5) * cell
            if not inside_walls(walls, x, y):
                out[i, j] = -1.0
                continue
            best = 1e300
            for k in range(walls.shape[0]):
                ax, ay = walls[k, 0], walls[k, 1]
                dx, dy = walls[k, 2] - ax, walls[k, 3] - ay
                t = ((x - ax) * dx + (y - ay) * dy) / (dx * dx + dy * dy)
                t = min(1.0, max(0.0, t))
                ex, ey = ax + t * dx - x, ay + t * dy - y
                best = min(best, ex * ex + ey * ey)
            out[i, j] = best
    return out


@njit(cache=True)
def span_within(corners, y, radius):  # type: ignore[no-untyped-def]
    """Return (low, high) of the x at height y that are at most `radius` from a convex outline; low > high for none.

    The outline grown by a disc is bounded by arcs around its corners and by its edges moved outwards; edges moved
    inwards lie within it too, so that the way round does not matter.
    """
    low, high = 1e300, -1e300
    for c in range(corners.shape[0]):
        ax, ay = corners[c, 0], corners[c, 1]
        d = c + 1 if c + 1 < corners.shape[0] else 0
        ex, ey = corners[d, 0] - ax, corners[d, 1] - ay
        off = y - ay
        if abs(off) <= radius:
            half = np.sqrt(radius * radius - off * off)
            low, high = min(low, ax - half), max(high, ax + half)
        if abs(ey) < 1e-12:
            continue
        grow = radius / np.sqrt(ex * ex + ey * ey)
        for sign in (-1.0, 1.0):
            t = (off + sign * grow * ex) / ey
            if 0.0 <= t <= 1.0:
                x = ax + t * ex + sign * grow * ey
                low, high = min(low, x), max(high, x)
    return low, high


@njit(cache=True)
def rows_within(corners, radius, y0, cell, rows):  # type: ignore[no-untyped-def]
    """Return (first, end) of the rows whose middles may be within `radius` of an outline."""
    low, high = corners[0, 1], corners[0, 1]
    for c in range(1, corners.shape[0]):
        low, high = min(low, corners[c, 1]), max(high, corners[c, 1])
    first = max(0, int(np.floor((low - radius - y0) / cell)))
    return first, min(rows, int(np.ceil((high + radius - y0) / cell)) + 1)


@njit(cache=True)
def columns_within(corners, i, radius, x0, y0, cell, words):  # type: ignore[no-untyped-def]
    """Return (first, last) of row i's columns with middles within `radius` of an outline; first > last for none."""
    low, high = span_within(corners, y0 + (i + 0.5) * cell, radius)
    if low > high:
        return 0, -1
    first = int(np.ceil((low - x0) / cell - 0.5))
    last = int(np.floor((high - x0) / cell - 0.5))
    return max(0, first), min(WORD * words - 1, last)


@njit(cache=True)
def stamp(blocked, corners, x0, y0, cell, radius2):  # type: ignore[no-untyped-def]
    """Mark the cells whose middles are nearer than the radius to a convex outline."""
    radius = np.sqrt(radius2)
    rows, words = blocked.shape
    first, end = rows_within(corners, radius, y0, cell, rows)
    for i in range(first, end):
        a, b = columns_within(corners, i, radius, x0, y0, cell, words)
        if a <= b:
            for w in range(a // WORD, b // WORD + 1):
                blocked[i, w] |= between(a, b, w)


@njit(cache=True)
def touches(reached, corners, x0, y0, cell, reach):  # type: ignore[no-untyped-def]
    """Tell whether a reached cell's middle lies within `reach` of a convex outline."""
    rows, words = reached.shape
    first, end = rows_within(corners, reach, y0, cell, rows)
    for i in range(first, end):
        a, b = columns_within(corners, i, reach, x0, y0, cell, words)
        if a <= b:
            for w in range(a // WORD, b // WORD + 1):
                if reached[i, w] & between(a, b, w) != _NONE:
                    return True
    return False


@njit(cache=True)
def all_touched(reached, outlines, first, end, x0, y0, cell, reach):  # type: ignore[no-untyped-def]
    """Tell whether reached cells touch each of the outlines first..end - 1."""
    k = first
    while k < end and touches(reached, outlines[k], x0, y0, cell, reach):
        k += 1
    return k >= end


@njit(cache=True)
def flood(free, reached, corners, x0, y0, cell):  # type: ignore[no-untyped-def]
    """Mark in `reached` the free cells connected to the first free one in an outline; tell whether there is one.

    Only one patch: a door's floor may be cut in two, and all that is served must share one of them.
    """
    rows, words = free.shape
    first, end = rows_within(corners, 0.0, y0, cell, rows)
    for i in range(first, end):
        a, b = columns_within(corners, i, 0.0, x0, y0, cell, words)
        for w in range(max(a, 0) // WORD, b // WORD + 1):
            seeds = free[i, w] & between(a, b, w)
            if seeds != _NONE:
                reached[i, w] = lowest(seeds)
                spread(reached, free, i)
                return True
    return False


@njit(cache=True)
def connected(blocked, work, doors, n_doors, zones, n_zones, x0, y0, cell, reach):  # type: ignore[no-untyped-def]
    """Tell whether one connected patch serves all doors and zones; always so where no doors are to be reached.

    blocked (rows, words) bits, work (2, rows, words), doors (n, 4, 2), zones (m, 4, 2), reach: how near a walker's
    middle comes to a zone.
    """
    if n_doors == 0:
        return True
    free, reached = work[0], work[1]
    for i in range(free.shape[0]):
        for w in range(free.shape[1]):
            free[i, w] = ~blocked[i, w]
    for _ in range(4):
        reached[:] = _NONE
        if not flood(free, reached, doors[0], x0, y0, cell):
            return False
        if all_touched(reached, doors, 1, n_doors, x0, y0, cell, 0.0) and all_touched(
            reached, zones, 0, n_zones, x0, y0, cell, reach
        ):
            return True
        for i in range(free.shape[0]):
            for w in range(free.shape[1]):
                free[i, w] &= ~reached[i, w]
    return False

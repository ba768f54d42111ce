"""Where a walker of a given width can go, on a grid whose answer 'there is a path' is a proof. Compiled (numba).

A cell is free when its middle is at least sqrt(r^2 + (h/2)^2) from every wall and piece (r half the path, h the cell):
then every point between two neighbouring free middles is at least r away, so that a chain of them is a path of the full
width. 'No path' is no proof (a gap may be up to h wider than the path and be missed): the exact test decides then.

A grid has one bit a cell: rows of 64-bit words (rows, words), lowest bit first. A row is flooded a word at a time, by
doubling steps, so that a whole room takes microseconds.
"""

from typing import NamedTuple

import numpy as np

from processing.ground.arrays import Doubles, Flags, UInt64s
from processing.ground.kernels import compiled, inner
from processing.layout.solver.free_sets import inside_walls

WORD = 64  # bits of a word
TOUCH_M = 0.05  # a walker has reached a use zone when overlapping it by this much (chosen; the judge asks for the same)
MOST_PATCHES = 4
"""Patches of the first door's floor that are tried (chosen: furniture cuts a door's floor in two, hardly in five)."""
_ZERO, _ONE, _ALL = np.uint64(0), np.uint64(1), np.uint64(0xFFFFFFFFFFFFFFFF)
_TOP = np.uint64(63)

"""A grid of bits, (rows, words)."""


class Grid(NamedTuple):
    """Where the cells lie: the middle of cell (i, j) is at (x0 + (j + 1/2) cell, y0 + (i + 1/2) cell), metres."""

    x0: float
    y0: float
    cell: float


class Walk(NamedTuple):
    """What paths are checked against in the empty room."""

    grid: Grid
    blocked: UInt64s
    """(rows, words): bits of cells where no walker's middle can be."""
    doors: Doubles
    """(D, 4, 2) metres: the floor before each door that has to be reached; none: paths are not looked at."""
    radius: float
    """Metres that a walker's middle keeps from walls and pieces."""
    reach: float
    """Metres within which a walker's middle serves a use zone."""


def packed(cells: Flags) -> UInt64s:
    """Return a grid (rows, columns) as words, shape (rows, words); what is past the last column is set (blocked)."""
    rows, columns = cells.shape
    words = -(-columns // WORD)
    padded = np.ones((rows, words * WORD), dtype=np.bool_)
    padded[:, :columns] = cells
    as_bytes = np.packbits(padded, axis=1, bitorder="little").reshape(rows, words, 8).astype(np.uint64)
    bits: UInt64s = (as_bytes << (8 * np.arange(8, dtype=np.uint64))).sum(axis=2, dtype=np.uint64)
    return bits


@inner
def copy_rows(old, new):  # type: ignore[no-untyped-def]
    """Copy an array (N, K) to the first N rows of another; assigned whole, numba compiles its words of error too."""
    for i in range(old.shape[0]):
        for j in range(old.shape[1]):
            new[i, j] = old[i, j]


@inner
def between(first, last, word):  # type: ignore[no-untyped-def]
    """Return the bits of columns first..last (inclusive) that lie in word number `word` of a row."""
    low, high = max(first - WORD * word, 0), min(last - WORD * word, WORD - 1)
    if low > high:
        return _ZERO
    return (_ALL >> np.uint64(WORD - 1 - (high - low))) << np.uint64(low)


@inner
def upwards(seeds, free):  # type: ignore[no-untyped-def]
    """Return the free bits that seeds (free bits too) reach towards higher columns."""
    for step in (1, 2, 4, 8, 16, 32):
        seeds |= free & (seeds << np.uint64(step))
        free &= free << np.uint64(step)
    return seeds


@inner
def downwards(seeds, free):  # type: ignore[no-untyped-def]
    """Return the free bits that seeds reach towards lower columns."""
    for step in (1, 2, 4, 8, 16, 32):
        seeds |= free & (seeds >> np.uint64(step))
        free &= free >> np.uint64(step)
    return seeds


@inner
def fill_row(reached, free):  # type: ignore[no-untyped-def]
    """Let the reached bits of a row, shape (words,), spread along its free runs."""
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


@inner
def take_from(reached, free, i, j):  # type: ignore[no-untyped-def]
    """Let row j's reached cells spread to row i of grids (rows, words); return whether any is new."""
    new = False
    for w in range(reached.shape[1]):
        fresh = reached[j, w] & free[i, w] & ~reached[i, w]
        if fresh != _ZERO:
            reached[i, w] |= fresh
            new = True
    if new:
        fill_row(reached[i], free[i])
    return new


@compiled
def spread(reached, free, row):  # type: ignore[no-untyped-def]
    """Let what is reached in one row spread over four neighbours through the free cells, grids (rows, words)."""
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


@compiled
def count_bits(word):  # type: ignore[no-untyped-def]
    """Return how many bits of a word are set."""
    count = 0
    while word != _ZERO:
        word &= word - _ONE
        count += 1
    return count


@compiled
def lowest(word):  # type: ignore[no-untyped-def]
    """Return a word's lowest set bit alone."""
    return word & (~word + _ONE)


@compiled
def rect_distance2(corners, px, py):  # type: ignore[no-untyped-def]
    """Return the squared distance of a point (m2) to a filled rectangle: corners (4, 2) m in ring order."""
    ax, ay = corners[1, 0] - corners[0, 0], corners[1, 1] - corners[0, 1]
    bx, by = corners[3, 0] - corners[0, 0], corners[3, 1] - corners[0, 1]
    la, lb = np.sqrt(ax * ax + ay * ay), np.sqrt(bx * bx + by * by)
    dx, dy = px - corners[0, 0], py - corners[0, 1]
    u, v = (dx * ax + dy * ay) / la, (dx * bx + dy * by) / lb
    ou = max(0.0, -u, u - la)
    ov = max(0.0, -v, v - lb)
    return ou * ou + ov * ov


@compiled
def wall_clearance2(walls, grid, rows, columns):  # type: ignore[no-untyped-def]
    """Return the squared distance in m2 to the walls (W, 4) at cell middles, (rows, columns); -1 outside the room."""
    out = np.empty((rows, columns))
    for i in range(rows):
        y = grid.y0 + (i + 0.5) * grid.cell
        for j in range(columns):
            x = grid.x0 + (j + 0.5) * grid.cell
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


@inner
def span_within(corners, y, radius):  # type: ignore[no-untyped-def]
    """Return (low, high) of the x at height y at most `radius` m from a convex (C, 2) outline; low > high: none.

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


@inner
def rows_within(corners, radius, grid, rows):  # type: ignore[no-untyped-def]
    """Return (first, end) of the rows whose middles may be within `radius` metres of an outline (C, 2)."""
    low, high = corners[0, 1], corners[0, 1]
    for c in range(1, corners.shape[0]):
        low, high = min(low, corners[c, 1]), max(high, corners[c, 1])
    first = max(0, int(np.floor((low - radius - grid.y0) / grid.cell)))
    return first, min(rows, int(np.ceil((high + radius - grid.y0) / grid.cell)) + 1)


@inner
def columns_within(corners, i, radius, grid, words):  # type: ignore[no-untyped-def]
    """Return (first, last) of row i's columns with middles within `radius` of an outline (C, 2); first > last: none."""
    low, high = span_within(corners, grid.y0 + (i + 0.5) * grid.cell, radius)
    if low > high:
        return 0, -1
    first = int(np.ceil((low - grid.x0) / grid.cell - 0.5))
    last = int(np.floor((high - grid.x0) / grid.cell - 0.5))
    return max(0, first), min(WORD * words - 1, last)


@compiled
def stamp(blocked, corners, grid, radius):  # type: ignore[no-untyped-def]
    """Set the bits of `blocked` (rows, words) of middles are nearer than `radius` to a convex (C, 2) outline."""
    rows, words = blocked.shape
    first, end = rows_within(corners, radius, grid, rows)
    for i in range(first, end):
        a, b = columns_within(corners, i, radius, grid, words)
        if a <= b:
            for w in range(a // WORD, b // WORD + 1):
                blocked[i, w] |= between(a, b, w)


@compiled
def touches(reached, corners, grid, reach):  # type: ignore[no-untyped-def]
    """Return whether a reached cell's middle, (rows, words) bits, lies within `reach` of a convex (C, 2) outline."""
    rows, words = reached.shape
    first, end = rows_within(corners, reach, grid, rows)
    for i in range(first, end):
        a, b = columns_within(corners, i, reach, grid, words)
        if a <= b:
            for w in range(a // WORD, b // WORD + 1):
                if reached[i, w] & between(a, b, w) != _ZERO:
                    return True
    return False


@inner
def all_touched(reached, outlines, grid, reach):  # type: ignore[no-untyped-def]
    """Return whether reached cells (rows, words) come within `reach` metres of each of the outlines (K, 4, 2)."""
    served = 0
    while served < outlines.shape[0] and touches(reached, outlines[served], grid, reach):
        served += 1
    return served == outlines.shape[0]


@inner
def flood(free, reached, corners, grid):  # type: ignore[no-untyped-def]
    """Mark in `reached` the free cells connected to the first free one in an outline (C, 2); return if there is one.

    Only one patch: a door's floor may be cut in two, and all that is served must share one of them.
    """
    rows, words = free.shape
    first, end = rows_within(corners, 0.0, grid, rows)
    for i in range(first, end):
        a, b = columns_within(corners, i, 0.0, grid, words)
        for w in range(max(a, 0) // WORD, b // WORD + 1):
            seeds = free[i, w] & between(a, b, w)
            if seeds != _ZERO:
                reached[i, w] = lowest(seeds)
                spread(reached, free, i)
                return True
    return False


@compiled
def connected(walk, blocked, zones, work):  # type: ignore[no-untyped-def]
    """Return whether one connected patch serves all doors and zones; always so where no doors are to be reached.

    `blocked` (rows, words) bits, `zones` (K, 4, 2) metres, `work` (2, rows, words) is overwritten.
    """
    if walk.doors.shape[0] == 0:
        return True
    free, reached = work[0], work[1]
    for i in range(free.shape[0]):
        for w in range(free.shape[1]):
            free[i, w] = ~blocked[i, w]
    # Each round floods one patch of the first door's floor; one that serves not all is taken away for the next round.
    for _ in range(MOST_PATCHES):
        reached[:] = _ZERO
        if not flood(free, reached, walk.doors[0], walk.grid):
            return False
        if all_touched(reached, walk.doors[1:], walk.grid, 0.0) and all_touched(reached, zones, walk.grid, walk.reach):
            return True
        for i in range(free.shape[0]):
            for w in range(free.shape[1]):
                free[i, w] &= ~reached[i, w]
    return False

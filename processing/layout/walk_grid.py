"""Where a walker of a given width can go, on a grid whose answer 'there is a path' is a proof. Compiled (numba).

A cell is free when its middle is at least sqrt(r^2 + (h/2)^2) from every wall and piece (r half the path, h the cell):
then every point between two neighbouring free middles is at least r away, so that a chain of them is a path of the full
width. 'No path' is no proof (a gap may be up to h wider than the path and be missed): the exact test decides then.
"""

from __future__ import annotations

import numpy as np
from numba import njit

from processing.layout.free_sets import inside_walls

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
def window(corners, margin, x0, y0, cell, rows, columns):  # type: ignore[no-untyped-def]
    """Return the rows and columns (first, end, first, end) of the cells around an outline."""
    low_x, low_y, high_x, high_y = corners[0, 0], corners[0, 1], corners[0, 0], corners[0, 1]
    for c in range(1, corners.shape[0]):
        low_x, high_x = min(low_x, corners[c, 0]), max(high_x, corners[c, 0])
        low_y, high_y = min(low_y, corners[c, 1]), max(high_y, corners[c, 1])
    i0 = max(0, int(np.floor((low_y - margin - y0) / cell)))
    i1 = min(rows, int(np.ceil((high_y + margin - y0) / cell)) + 1)
    j0 = max(0, int(np.floor((low_x - margin - x0) / cell)))
    j1 = min(columns, int(np.ceil((high_x + margin - x0) / cell)) + 1)
    return i0, i1, j0, j1


@njit(cache=True)
def stamp(blocked, corners, x0, y0, cell, radius2):  # type: ignore[no-untyped-def]
    """Mark the cells whose middles are nearer than the radius to a rectangle."""
    r = np.sqrt(radius2)
    rows, columns = blocked.shape
    i0, i1, j0, j1 = window(corners, r, x0, y0, cell, rows, columns)
    for i in range(i0, i1):
        for j in range(j0, j1):
            if blocked[i, j] == 0 and rect_distance2(corners, x0 + (j + 0.5) * cell, y0 + (i + 0.5) * cell) < radius2:
                blocked[i, j] = 1


@njit(cache=True)
def touches(reached, corners, x0, y0, cell, reach):  # type: ignore[no-untyped-def]
    """Tell whether a reached cell's middle lies within `reach` of a rectangle."""
    rows, columns = reached.shape
    i0, i1, j0, j1 = window(corners, reach, x0, y0, cell, rows, columns)
    for i in range(i0, i1):
        for j in range(j0, j1):
            if reached[i, j] != 2:
                continue
            if rect_distance2(corners, x0 + (j + 0.5) * cell, y0 + (i + 0.5) * cell) <= reach * reach:
                return True
    return False


@njit(cache=True)
def all_touched(reached, outlines, first, end, x0, y0, cell, reach):  # type: ignore[no-untyped-def]
    """Tell whether reached cells touch each of the rectangles first..end - 1."""
    k = first
    while k < end and touches(reached, outlines[k], x0, y0, cell, reach):
        k += 1
    return k >= end


@njit(cache=True)
def spread(grid, i, j, stack):  # type: ignore[no-untyped-def]
    """Mark (2) the free cells connected over four neighbours to cell (i, j); return how many."""
    rows, columns = grid.shape
    grid[i, j] = 2
    stack[0] = i * columns + j
    top, count = 1, 1
    while top > 0:
        top -= 1
        i2, j2 = stack[top] // columns, stack[top] % columns
        for d in range(4):
            a = i2 + (d == 0) - (d == 1)
            b = j2 + (d == 2) - (d == 3)
            if 0 <= a < rows and 0 <= b < columns and grid[a, b] == 0:
                grid[a, b] = 2
                stack[top] = a * columns + b
                top += 1
                count += 1
    return count


@njit(cache=True)
def flood(grid, corners, x0, y0, cell, stack):  # type: ignore[no-untyped-def]
    """Mark (2) the free cells (0) connected to the first free one in a rectangle; return how many.

    Only one patch: a door's floor may be cut in two, and all that is served must share one of them.
    """
    rows, columns = grid.shape
    i0, i1, j0, j1 = window(corners, 0.0, x0, y0, cell, rows, columns)
    for i in range(i0, i1):
        for j in range(j0, j1):
            if grid[i, j] != 0:
                continue
            if rect_distance2(corners, x0 + (j + 0.5) * cell, y0 + (i + 0.5) * cell) == 0.0:
                return spread(grid, i, j, stack)
    return 0


@njit(cache=True)
def connected(blocked, work, stack, doors, n_doors, zones, n_zones, x0, y0, cell, reach):  # type: ignore[no-untyped-def]
    """Return the cells reached where one connected patch serves all doors and zones, else -1; 0 for no doors to reach.

    blocked (rows, columns) uint8, doors (n, 4, 2), zones (m, 4, 2), reach: how near a walker's middle comes to a zone.
    """
    if n_doors == 0:
        return 0
    for i in range(work.shape[0]):
        for j in range(work.shape[1]):
            work[i, j] = blocked[i, j]
    for _ in range(4):
        count = flood(work, doors[0], x0, y0, cell, stack)
        if count == 0:
            return -1
        if all_touched(work, doors, 1, n_doors, x0, y0, cell, 0.0) and all_touched(
            work, zones, 0, n_zones, x0, y0, cell, reach
        ):
            return count
        for i in range(work.shape[0]):
            for j in range(work.shape[1]):
                if work[i, j] == 2:
                    work[i, j] = 1
    return -1

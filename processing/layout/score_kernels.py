"""Scores that look at the whole floor, compiled (numba): the largest free circle, and floor in one piece."""

from __future__ import annotations

import numpy as np
from numba import njit

from processing.layout.walk_bits import WORD, count_bits, lowest, spread
from processing.layout.walk_grid import stamp


@njit(cache=True)
def box_corners(box, out):  # type: ignore[no-untyped-def]
    """Write the corners (4, 2) of a box (x, y, cos, sin, half width, half depth)."""
    for c in range(4):
        u = -box[4] if c in (0, 3) else box[4]
        v = -box[5] if c < 2 else box[5]
        out[c, 0] = box[0] + u * box[2] - v * box[3]
        out[c, 1] = box[1] + u * box[3] + v * box[2]


@njit(cache=True)
def largest_circle(points, clear, boxes):  # type: ignore[no-untyped-def]
    """Return the radius of the largest circle around one of the points (n, 2) that walls (clear) and boxes leave."""
    best = 0.0
    for i in range(points.shape[0]):
        if clear[i] <= best:
            continue
        least = clear[i]
        for k in range(boxes.shape[0]):
            dx, dy = points[i, 0] - boxes[k, 0], points[i, 1] - boxes[k, 1]
            u = abs(dx * boxes[k, 2] + dy * boxes[k, 3]) - boxes[k, 4]
            v = abs(dy * boxes[k, 2] - dx * boxes[k, 3]) - boxes[k, 5]
            gap = np.sqrt(max(u, 0.0) ** 2 + max(v, 0.0) ** 2) if max(u, v) > 0 else max(u, v)
            least = min(least, gap)
            if least <= best:
                break
        best = max(best, least)
    return best


@njit(cache=True)
def share_in_one_piece(clearance2, x0, y0, cell, radius, boxes):  # type: ignore[no-untyped-def]
    """Return the share, in the largest part, of the cells where a walker's middle may be (radius from walls, boxes)."""
    rows, columns = clearance2.shape
    free = np.zeros((rows, (columns + WORD - 1) // WORD), dtype=np.uint64)
    blocked, reached = np.zeros_like(free), np.zeros_like(free)
    corners = np.empty((4, 2))
    for k in range(boxes.shape[0]):
        box_corners(boxes[k], corners)
        stamp(blocked, corners, x0, y0, cell, radius * radius)
    for i in range(rows):
        for j in range(columns):
            if clearance2[i, j] >= radius * radius:
                free[i, j // WORD] |= np.uint64(1) << np.uint64(j % WORD)
    total, best = 0, 0
    for i in range(rows):
        for w in range(free.shape[1]):
            free[i, w] &= ~blocked[i, w]
    for i in range(rows):
        for w in range(free.shape[1]):
            while free[i, w] != np.uint64(0):
                reached[:] = np.uint64(0)
                reached[i, w] = lowest(free[i, w])
                spread(reached, free, i)
                count = take_away(free, reached)
                total += count
                best = max(best, count)
    return best / total if total > 0 else 0.0


@njit(cache=True)
def take_away(free, reached):  # type: ignore[no-untyped-def]
    """Clear the reached bits of a grid; return how many there were."""
    count = 0
    for i in range(free.shape[0]):
        for w in range(free.shape[1]):
            free[i, w] &= ~reached[i, w]
            count += count_bits(reached[i, w])
    return count


__all__ = ["box_corners", "largest_circle", "share_in_one_piece"]

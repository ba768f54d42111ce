"""Exact free intervals: where along a line a set of rectangles may stand. Compiled (numba), float64, metres.

A unit's rectangles move together along a line (a wall, or any line in the room) by s. An obstacle forbids the open
interval of s in which its interior meets a rectangle's: the obstacle's extent along the line within the rectangle's
strip, widened by the rectangle. Walls are obstacles too, so only one point is tested besides to know it in the room.
Contact is free: a piece may touch walls and other pieces. Strips are open by `SKIN_M`.

Classes of obstacles: 0 piece, 1 use zone, 2 door, 3 window, 4 rug, 5 place kept free. Of rectangles: 0, 1, 4.
"""

from __future__ import annotations

import numpy as np
from numba import njit

SKIN_M = 1e-7
"""Overlaps thinner than this are contact."""
BODY, ZONE, DOOR, WINDOW, RUG, KEPT = 0, 1, 2, 3, 4, 5

_MEETS = np.zeros((6, 6), dtype=np.bool_)
"""Which class of rectangle (first) an obstacle's class forbids, given that their heights overlap."""
for _rect, _obstacle in ((0, 0), (0, 1), (0, 2), (0, 3), (0, 5), (1, 0), (4, 2), (4, 4), (4, 5)):
    _MEETS[_rect, _obstacle] = True
MEETS = _MEETS


@njit(cache=True)
def extent_in_strip(xs, ys, count, y0, y1):  # type: ignore[no-untyped-def]
    """Return (low, high) of a convex outline's x within the open strip y0 < y < y1; low > high where it has none."""
    low, high = 1e300, -1e300
    lowest, highest = 1e300, -1e300
    for i in range(count):
        lowest = min(lowest, ys[i])
        highest = max(highest, ys[i])
    if highest <= y0 + SKIN_M or lowest >= y1 - SKIN_M:
        return low, high
    for i in range(count):
        j = i + 1 if i + 1 < count else 0
        xa, ya, xb, yb = xs[i], ys[i], xs[j], ys[j]
        if ya > yb:
            xa, ya, xb, yb = xb, yb, xa, ya
        if yb < y0 or ya > y1:
            continue
        ta = 0.0 if ya >= y0 else (y0 - ya) / (yb - ya)
        tb = 1.0 if yb <= y1 else (y1 - ya) / (yb - ya)
        for x in (xa + ta * (xb - xa), xa + tb * (xb - xa)):
            low = min(low, x)
            high = max(high, x)
    return low, high


@njit(cache=True)
def strip_of(rects):  # type: ignore[no-untyped-def]
    """Return (low, high) of the open strip along the line that a set of rectangles moves in."""
    nearest, farthest = 1e300, -1e300
    for r in range(rects.shape[0]):
        nearest, farthest = min(nearest, rects[r, 2] + SKIN_M), max(farthest, rects[r, 3] - SKIN_M)
    return nearest, farthest


@njit(cache=True)
def add_forbidden(outlines, heights, classes, count, ox, oy, ux, uy, rects, kinds, meets, out, found):  # type: ignore[no-untyped-def]
    """Append what `count` convex outlines (k, v, 2) forbid to out (m, 2) from row `found`; return how many rows."""
    corners = outlines.shape[1]
    xs, ys = np.empty(corners), np.empty(corners)
    nearest, farthest = strip_of(rects)
    for k in range(count):
        lowest, highest = 1e300, -1e300
        for c in range(corners):
            ys[c] = (outlines[k, c, 1] - oy) * ux - (outlines[k, c, 0] - ox) * uy
            lowest, highest = min(lowest, ys[c]), max(highest, ys[c])
        if highest <= nearest or lowest >= farthest:
            continue
        for c in range(corners):
            xs[c] = (outlines[k, c, 0] - ox) * ux + (outlines[k, c, 1] - oy) * uy
        for r in range(rects.shape[0]):
            if not meets[kinds[r], classes[k]]:
                continue
            if heights[k, 0] >= rects[r, 5] - SKIN_M or heights[k, 1] <= rects[r, 4] + SKIN_M:
                continue
            low, high = extent_in_strip(xs, ys, corners, rects[r, 2], rects[r, 3])
            if low <= high and found < out.shape[0]:
                out[found, 0] = low - rects[r, 1]
                out[found, 1] = high - rects[r, 0]
                found += 1
    return found


@njit(cache=True)
def add_walls(walls, ox, oy, ux, uy, rects, out, found):  # type: ignore[no-untyped-def]
    """Append the intervals that wall segments (k, 4) forbid to every rectangle."""
    xs, ys = np.empty(2), np.empty(2)
    for k in range(walls.shape[0]):
        for c in range(2):
            dx, dy = walls[k, 2 * c] - ox, walls[k, 2 * c + 1] - oy
            xs[c] = dx * ux + dy * uy
            ys[c] = dy * ux - dx * uy
        for r in range(rects.shape[0]):
            low, high = extent_in_strip(xs, ys, xs.shape[0], rects[r, 2], rects[r, 3])
            if low <= high and found < out.shape[0]:
                out[found, 0] = low - rects[r, 1]
                out[found, 1] = high - rects[r, 0]
                found += 1
    return found


@njit(cache=True)
def merged(intervals, count):  # type: ignore[no-untyped-def]
    """Sort and merge open intervals in place; return how many are left. Those that only touch leave a free point."""
    for i in range(1, count):
        a, b = intervals[i, 0], intervals[i, 1]
        j = i - 1
        while j >= 0 and intervals[j, 0] > a:
            intervals[j + 1, 0], intervals[j + 1, 1] = intervals[j, 0], intervals[j, 1]
            j -= 1
        intervals[j + 1, 0], intervals[j + 1, 1] = a, b
    kept = 0
    for i in range(count):
        if kept and intervals[i, 0] < intervals[kept - 1, 1] - SKIN_M:
            intervals[kept - 1, 1] = max(intervals[kept - 1, 1], intervals[i, 1])
        else:
            intervals[kept, 0], intervals[kept, 1] = intervals[i, 0], intervals[i, 1]
            kept += 1
    return kept


@njit(cache=True)
def complement(forbidden, count, low, high, out):  # type: ignore[no-untyped-def]
    """Write what of [low, high] merged open intervals leave into out (m, 2); return how many closed intervals."""
    found, at = 0, low
    if high < low - SKIN_M:
        return 0
    high = max(high, low)
    for i in range(count):
        if forbidden[i, 1] <= at:
            continue
        if forbidden[i, 0] >= high:
            break
        if forbidden[i, 0] >= at - SKIN_M and found < out.shape[0]:
            out[found, 0] = at
            out[found, 1] = max(at, forbidden[i, 0])
            found += 1
        at = max(at, forbidden[i, 1])
    if at <= high + SKIN_M and found < out.shape[0]:
        out[found, 0] = min(at, high)
        out[found, 1] = high
        found += 1
    return found


@njit(cache=True)
def inside_walls(walls, x, y):  # type: ignore[no-untyped-def]
    """Tell whether a point is in the room (even-odd over all wall segments, columns too)."""
    odd = False
    for k in range(walls.shape[0]):
        xa, ya, xb, yb = walls[k, 0], walls[k, 1], walls[k, 2], walls[k, 3]
        if (ya > y) != (yb > y) and x < xa + (y - ya) * (xb - xa) / (yb - ya):
            odd = not odd
    return odd


@njit(cache=True)
def rects_inside(walls, ox, oy, ux, uy, s, rects):  # type: ignore[no-untyped-def]
    """Tell whether the middles of all rectangles are in the room; with no wall through them, so are they."""
    for r in range(rects.shape[0]):
        x = s + 0.5 * (rects[r, 0] + rects[r, 1])
        y = 0.5 * (rects[r, 2] + rects[r, 3])
        if not inside_walls(walls, ox + x * ux - y * uy, oy + x * uy + y * ux):
            return False
    return True

"""Exact free intervals: where along a line a set of rectangles may stand. Compiled (numba), float64, metres.

A unit's rectangles move together along a line (a wall, or any line in the room) by s. An obstacle forbids the open
interval of s in which its interior meets a rectangle's: the obstacle's extent along the line within the rectangle's
strip, widened by the rectangle. Walls are obstacles too, so only one point is tested besides to know it in the room.
Contact is free: a piece may touch walls and other pieces. Strips are open by `SKIN_M`.

Arrays that all functions share:
`line` (6,): first corner x, y, unit direction x, y, length, edge number; `rects` (R, 6): x0, x1, y0, y1 in the unit's
frame, underside and top; `kinds` (R,) their classes; intervals (M, 2): low and high of s.
"""

from typing import NamedTuple

import numpy as np

from processing.ground.arrays import Doubles, Int64s
from processing.ground.kernels import compiled, inner

SKIN_M = 1e-7  # overlaps thinner than this are contact (chosen: above rounding, below what is measured)
BODY, ZONE, DOOR, WINDOW, RUG, KEPT = 0, 1, 2, 3, 4, 5
"""Classes of obstacles: piece, use zone, door, window, rug, place kept free. Rectangles are pieces, zones or rugs."""

MEETS = np.zeros((6, 6), dtype=np.bool_)
"""Which class of rectangle (first) an obstacle's class forbids, given that their heights overlap."""
for _rect, _obstacle in ((0, 0), (0, 1), (0, 2), (0, 3), (0, 5), (1, 0), (4, 2), (4, 4), (4, 5)):
    MEETS[_rect, _obstacle] = True


class Outlines(NamedTuple):
    """Convex outlines that stand in the room."""

    corners: Doubles
    """(N, 4, 2) metres, ring order."""
    heights: Doubles
    """(N, 2) metres: bottom and top."""
    classes: Int64s
    """(N,)."""


@inner
def extent_in_strip(xs, ys, y0, y1):  # type: ignore[no-untyped-def]
    """Return (low, high) of a convex outline's x within the open strip y0 < y < y1; low > high where it has none.

    `xs`, `ys` (C,): the outline's corners in the line's frame.
    """
    low, high = 1e300, -1e300
    lowest, highest = 1e300, -1e300
    for y in ys:
        lowest, highest = min(lowest, y), max(highest, y)
    if highest <= y0 + SKIN_M or lowest >= y1 - SKIN_M:
        return low, high
    # Each edge is cut to the strip; the ends of what is left bound the extent.
    for i in range(xs.size):
        j = i + 1 if i + 1 < xs.size else 0
        xa, ya, xb, yb = xs[i], ys[i], xs[j], ys[j]
        if ya > yb:
            xa, ya, xb, yb = xb, yb, xa, ya
        if yb < y0 or ya > y1:
            continue
        ta = 0.0 if ya >= y0 else (y0 - ya) / (yb - ya)
        tb = 1.0 if yb <= y1 else (y1 - ya) / (yb - ya)
        for x in (xa + ta * (xb - xa), xa + tb * (xb - xa)):
            low, high = min(low, x), max(high, x)
    return low, high


@compiled
def add_forbidden(outlines, count, line, rects, kinds, out, found):  # type: ignore[no-untyped-def]
    """Append what the first `count` outlines forbid to `out` (M, 2) from row `found`; return how many.

    `outlines`: `Outlines`; `line` (6,), `rects` (R, 6), `kinds` (R,) as in the module's docstring.
    """
    corners = outlines.corners.shape[1]
    ox, oy, ux, uy = line[0], line[1], line[2], line[3]
    xs, ys = np.empty(corners), np.empty(corners)
    nearest, farthest = 1e300, -1e300
    for r in range(rects.shape[0]):
        nearest, farthest = min(nearest, rects[r, 2] + SKIN_M), max(farthest, rects[r, 3] - SKIN_M)
    for k in range(count):
        # Most outlines lie outside the strip in which the unit moves: seen before anything else is computed.
        lowest, highest = 1e300, -1e300
        for c in range(corners):
            dx, dy = outlines.corners[k, c, 0] - ox, outlines.corners[k, c, 1] - oy
            ys[c] = dy * ux - dx * uy
            lowest, highest = min(lowest, ys[c]), max(highest, ys[c])
        if highest <= nearest or lowest >= farthest:
            continue
        for c in range(corners):
            dx, dy = outlines.corners[k, c, 0] - ox, outlines.corners[k, c, 1] - oy
            xs[c] = dx * ux + dy * uy
        for r in range(rects.shape[0]):
            if not MEETS[kinds[r], outlines.classes[k]]:
                continue
            if outlines.heights[k, 0] >= rects[r, 5] - SKIN_M or outlines.heights[k, 1] <= rects[r, 4] + SKIN_M:
                continue
            low, high = extent_in_strip(xs, ys, rects[r, 2], rects[r, 3])
            if low <= high and found < out.shape[0]:
                out[found, 0] = low - rects[r, 1]
                out[found, 1] = high - rects[r, 0]
                found += 1
    return found


@compiled
def add_walls(walls, line, rects, out, found):  # type: ignore[no-untyped-def]
    """Append the intervals that wall segments (W, 4) forbid to every rectangle (R, 6); return how many."""
    ox, oy, ux, uy = line[0], line[1], line[2], line[3]
    xs, ys = np.empty(2), np.empty(2)
    for k in range(walls.shape[0]):
        for c in range(2):
            dx, dy = walls[k, 2 * c] - ox, walls[k, 2 * c + 1] - oy
            xs[c] = dx * ux + dy * uy
            ys[c] = dy * ux - dx * uy
        for r in range(rects.shape[0]):
            low, high = extent_in_strip(xs, ys, rects[r, 2], rects[r, 3])
            if low <= high and found < out.shape[0]:
                out[found, 0] = low - rects[r, 1]
                out[found, 1] = high - rects[r, 0]
                found += 1
    return found


@compiled
def merged(intervals, count):  # type: ignore[no-untyped-def]
    """Sort and merge the first `count` open intervals (M, 2) in place; return how many are left.

    Intervals that only touch leave a free point between them.
    """
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


@compiled
def complement(forbidden, count, high, out):  # type: ignore[no-untyped-def]
    """Write what `count` merged open intervals (M, 2) leave of [0, high] into `out` (K, 2); return how many."""
    found, at = 0, 0.0
    if high < -SKIN_M:
        return 0
    high = max(high, 0.0)
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


@compiled
def inside_walls(walls, x, y):  # type: ignore[no-untyped-def]
    """Return whether a point is in the room (even-odd over all wall segments (W, 4), columns too)."""
    odd = False
    for k in range(walls.shape[0]):
        xa, ya, xb, yb = walls[k, 0], walls[k, 1], walls[k, 2], walls[k, 3]
        if (ya > y) != (yb > y) and x < xa + (y - ya) * (xb - xa) / (yb - ya):
            odd = not odd
    return odd


@compiled
def rects_inside(walls, line, s, rects):  # type: ignore[no-untyped-def]
    """Return whether the middles of all rectangles (R, 6) are in the room; with no wall through them, so are they."""
    for r in range(rects.shape[0]):
        x = s + 0.5 * (rects[r, 0] + rects[r, 1])
        y = 0.5 * (rects[r, 2] + rects[r, 3])
        if not inside_walls(walls, line[0] + x * line[2] - y * line[3], line[1] + x * line[3] + y * line[2]):
            return False
    return True

"""All places of a unit beside what is placed: exact free intervals on every line, a few places in each. Compiled."""

from __future__ import annotations

import numpy as np
from numba import njit

from processing.layout.solver.beam import place_rect
from processing.layout.solver.free_sets import SKIN_M, add_forbidden, add_walls, complement, merged, rects_inside
from processing.layout.solver.soft import score_place
from processing.layout.solver.walk_grid import rect_distance2

KEPT_INTERVALS = 40
MOST_ROWS = 12_000


@njit(cache=True)
def close_outside(walls, line, own, longest, intervals, count, gaps):  # type: ignore[no-untyped-def]
    """Append the gaps between merged intervals in which the rectangles are outside; return how many there are then.

    No wall is crossed within a gap, so that one place tells of all.
    """
    for i in range(complement(intervals, count, 0.0, longest, gaps)):
        low, high = gaps[i, 0], gaps[i, 1]
        if not rects_inside(walls, line[0], line[1], line[2], line[3], 0.5 * (low + high), own):
            intervals[count, 0], intervals[count, 1] = low - 3 * SKIN_M, high + 3 * SKIN_M
            count += 1
    return count


@njit(cache=True)
def standing(walls, outlines, heights, classes, rects, kinds, n_rects, widths, lines, allowed, meets, out, counts):  # type: ignore[no-untyped-def]
    """Write the merged intervals that walls and fixed outlines forbid: out (V, L, K, 2), counts (V, L)."""
    rows = (walls.shape[0] + outlines.shape[0]) * rects.shape[1] + 4
    scratch, gaps = np.empty((2 * rows, 2)), np.empty((rows, 2))
    for v in range(rects.shape[0]):
        own, kind = rects[v, : n_rects[v]], kinds[v, : n_rects[v]]
        for k in range(lines.shape[0]):
            counts[v, k] = -1
            if not allowed[v, k] or lines[k, 4] < widths[v] - SKIN_M:
                continue
            ox, oy, ux, uy = lines[k, 0], lines[k, 1], lines[k, 2], lines[k, 3]
            found = add_walls(walls, ox, oy, ux, uy, own, scratch, 0)
            found = add_forbidden(
                outlines, heights, classes, outlines.shape[0], ox, oy, ux, uy, own, kind, meets, scratch, found
            )
            found = merged(scratch, found)
            found = merged(scratch, close_outside(walls, lines[k], own, lines[k, 4] - widths[v], scratch, found, gaps))
            if found > out.shape[2]:
                found = out.shape[2]
                scratch[found - 1, 1] = 1e300
            for i in range(found):
                out[v, k, i, 0], out[v, k, i, 1] = scratch[i, 0], scratch[i, 1]
            counts[v, k] = found


@njit(cache=True)
def places_in(low, high, fractions, wanted, n_wanted, out):  # type: ignore[no-untyped-def]
    """Write the places tried in a free interval, fractions of it and what is wanted, once each; return how many."""
    found = 0
    for f in fractions:
        s = low + f * (high - low)
        known = False
        for i in range(found):
            known = known or abs(out[i] - s) < 1e-3
        if not known and found < out.shape[0]:
            out[found] = s
            found += 1
    for w in range(n_wanted):
        s = wanted[w]
        if low < s < high:
            known = False
            for i in range(found):
                known = known or abs(out[i] - s) < 1e-3
            if not known and found < out.shape[0]:
                out[found] = s
                found += 1
    return found


@njit(cache=True)
def stands_by(line, s, rect, near, anchors, n_anchors):  # type: ignore[no-untyped-def]
    """Tell whether a unit's first rectangle at s stands within near[1] metres of an anchor of role near[0]."""
    own, other = np.empty((4, 2)), np.empty((4, 2))
    place_rect(rect, line[0], line[1], line[2], line[3], s, own)
    for a in range(n_anchors):
        if int(anchors[a, 4]) != near[0]:
            continue
        x, y, fx, fy, w, d = anchors[a, 0], anchors[a, 1], anchors[a, 2], anchors[a, 3], anchors[a, 5], anchors[a, 6]
        for c in range(4):
            across, ahead = (-w if c in (0, 3) else w), (-d if c < 2 else d)
            other[c, 0] = x + across * fy + ahead * fx
            other[c, 1] = y - across * fx + ahead * fy
        for c in range(4):
            if min(
                rect_distance2(other, own[c, 0], own[c, 1]), rect_distance2(own, other[c, 0], other[c, 1])
            ) <= near[1] * near[1]:  # fmt: skip
                return True
    return False


@njit(cache=True)
def try_places(  # type: ignore[no-untyped-def]
    free, n_free, line, own, bonus, at, to, half, role, near, longest, anchors, n_anchors, fractions, doors,
    windows, middle, b, v, k, out_index, out_place, out_score, found, places, wanted,
):  # fmt: skip
    """Write the rows of one line's free intervals from row `found`; return how many rows there are then."""
    ox, oy, ux, uy = line[0], line[1], line[2], line[3]
    wanted[0] = 0.5 * longest
    n_wanted = 1
    for a in range(min(n_anchors, 14)):
        wanted[n_wanted] = (anchors[a, 0] - ox) * ux + (anchors[a, 1] - oy) * uy - at[0]
        n_wanted += 1
    for i in range(n_free):
        for p in range(places_in(free[i, 0], free[i, 1], fractions, wanted, n_wanted, places)):
            s = places[p]
            if found >= out_score.shape[0]:
                continue
            if near[0] >= 0 and not stands_by(line, s, own[0], near, anchors, n_anchors):
                continue
            ax, ay = s + at[0], at[1]
            ends = int(s - free[i, 0] < 1e-3) + int(free[i, 1] - s < 1e-3)
            sliver = 0.0
            for gap in (s - free[i, 0], free[i, 1] - s):
                sliver += 0.25 if 0.02 < gap < 0.35 else 0.0
            centred = 1.0 if abs(s - 0.5 * longest) < 1e-3 else 0.0
            out_score[found] = bonus - sliver + score_place(
                role, ox + ax * ux - ay * uy, oy + ax * uy + ay * ux, to[0] * ux - to[1] * uy, to[0] * uy + to[1] * ux,
                int(line[5]), ax - half[0], ax + half[0], ends, centred, doors, windows, anchors, n_anchors, middle,
            )  # fmt: skip
            out_index[found, 0], out_index[found, 1], out_index[found, 2] = b, v, k
            out_place[found] = s
            found += 1
    return found


@njit(cache=True)
def expand(  # type: ignore[no-untyped-def]
    rects, kinds, n_rects, widths, bonus, anchor_at, anchor_to, half, role, near, lines, allowed, meets,
    fixed, fixed_counts, dyn, dyn_heights, dyn_classes, dyn_n, anchors, n_anchors, fractions, doors, windows, middle,
    out_index, out_place, out_score,
):  # fmt: skip
    """Write rows (state, variant, line), s and score for every state; return how many."""
    found = 0
    scratch = np.empty((KEPT_INTERVALS + dyn.shape[1] * rects.shape[1] + 4, 2))
    free, places, wanted = np.empty((KEPT_INTERVALS + 40, 2)), np.empty(24), np.empty(16)
    for b in range(dyn.shape[0]):
        for v in range(rects.shape[0]):
            own, kind = rects[v, : n_rects[v]], kinds[v, : n_rects[v]]
            for k in range(lines.shape[0]):
                if fixed_counts[v, k] < 0:
                    continue
                ox, oy, ux, uy = lines[k, 0], lines[k, 1], lines[k, 2], lines[k, 3]
                count = fixed_counts[v, k]
                for i in range(count):
                    scratch[i, 0], scratch[i, 1] = fixed[v, k, i, 0], fixed[v, k, i, 1]
                count = add_forbidden(
                    dyn[b], dyn_heights[b], dyn_classes[b], dyn_n[b], ox, oy, ux, uy, own, kind, meets, scratch, count
                )
                count = merged(scratch, count)
                longest = lines[k, 4] - widths[v]
                n_free = complement(scratch, count, 0.0, longest, free)
                found = try_places(
                    free, n_free, lines[k], own, bonus[v], anchor_at[v], anchor_to[v], half[v], role, near,
                    longest, anchors[b], n_anchors[b], fractions, doors, windows, middle,
                    b, v, k, out_index, out_place, out_score, found, places, wanted,
                )  # fmt: skip
                if found >= out_score.shape[0]:
                    return found
    return found

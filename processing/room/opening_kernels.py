"""How well rectangles on a wall explain what is seen there (compiled); what counts: `processing.room.opening_fit`."""

from __future__ import annotations

from typing import Any

import numba as nb
import numpy as np

APART_TEXELS = 1.5
"""Outlines that are nearer to each other are one."""


@nb.njit(cache=True, nogil=True)
def _summed(table: Any, y: float, x: float) -> float:
    row, column = min(int(y), table.shape[0] - 2), min(int(x), table.shape[1] - 2)
    down, right = y - row, x - column
    above = table[row, column] * (1 - right) + table[row, column + 1] * right
    below = table[row + 1, column] * (1 - right) + table[row + 1, column + 1] * right
    return float(above * (1 - down) + below * down)


@nb.njit(cache=True, nogil=True)
def region(table: Any, px_per_m: float, u0: float, v0: float, u1: float, v1: float) -> float:
    """Return the sum (m2) of a rectangle from running sums (h + 1, w + 1); ends between texels count in part."""
    height, width = table.shape[0] - 1, table.shape[1] - 1
    x0, x1 = min(max(u0 * px_per_m, 0.0), width), min(max(u1 * px_per_m, 0.0), width)
    y0, y1 = min(max(v0 * px_per_m, 0.0), height), min(max(v1 * px_per_m, 0.0), height)
    total = _summed(table, y1, x1) - _summed(table, y0, x1) - _summed(table, y1, x0) + _summed(table, y0, x0)
    return total / px_per_m**2


@nb.njit(cache=True, nogil=True)
def edge(table: Any, px_per_m: float, at_m: float, start_m: float, end_m: float) -> float:
    """Return the sum (m) of edges along a line from running sums (lines, n + 1); 0 at the wall's own ends."""
    at = at_m * px_per_m
    lines, last = table.shape[0], table.shape[1] - 1
    if not 1 < at < lines - 1:
        return 0.0
    place = min(max(at - 0.5, 0.0), lines - 1.001)
    line = int(place)
    share = place - line
    first = int(min(max(np.rint(start_m * px_per_m), 0), last))
    after = int(min(max(np.rint(end_m * px_per_m), 0), last))
    one, other = table[line, after] - table[line, first], table[line + 1, after] - table[line + 1, first]
    return float((one * (1 - share) + other * share) / px_per_m)


@nb.njit(cache=True, nogil=True)
def _shown(eye: Any, recess_m: float, box: Any, out: Any) -> None:
    u0, v0, u1, v1 = box[0], box[1], box[2], box[3]
    if recess_m <= 0:
        out[0], out[1], out[2], out[3] = u0 + recess_m, v0 + recess_m, u1 - recess_m, v1
        return
    k = eye[2] / (eye[2] + recess_m)
    out[0] = max(u0, eye[0] + (u0 - eye[0]) * k)
    out[1] = max(v0, eye[1] + (v0 - eye[1]) * k)
    out[2] = min(u1, eye[0] + (u1 - eye[0]) * k)
    out[3] = min(v1, eye[1] + (v1 - eye[1]) * k)


@nb.njit(cache=True, nogil=True)
def _glass(upright: Any, level: Any, px_per_m: float, frames_m: Any, shown: Any) -> float:
    """Return the edges around the glass, within a frame as wide on all sides as suits best."""
    best = -np.inf
    for frame in frames_m:
        u0, v0, u1, v1 = shown[0] + frame, shown[1] + frame, shown[2] - frame, shown[3] - frame
        found = edge(upright, px_per_m, u0, v0, v1) + edge(upright, px_per_m, u1, v0, v1)
        found += edge(level, px_per_m, v0, u0, u1) + edge(level, px_per_m, v1, u0, u1)
        best = max(best, found)
    return best


@nb.njit(cache=True, nogil=True)
def box_scores(
    votes: Any, upright: Any, level: Any, brighter: Any, px_per_m: float, eye: Any, recess_m: float, weights: Any,
    frames_m: Any, boxes: Any, out: Any,
) -> None:  # fmt: skip
    """Fill the scores (n,) of rectangles (n, 4) in metres.

    ``upright``, ``level``: running sums of edges; ``brighter``: the same of signed ones, towards the right and down.
    ``weights`` (13,): of area, of outer edges (upright, upper, lower), of inner ones likewise, of the glass's, of the
    rectangle's own width and height, and of outer edges that are brighter inside (upright, upper, lower).
    """
    shown = np.empty(4)
    apart = APART_TEXELS / px_per_m
    for i in range(len(boxes)):
        box = boxes[i]
        _shown(eye, recess_m, box, shown)
        seen = region(votes, px_per_m, shown[0], shown[1], shown[2], shown[3])
        # Networks call a reveal now wall, now window.
        total = weights[0] * max(seen, region(votes, px_per_m, box[0], box[1], box[2], box[3]))
        for side in range(4):
            table = level if side % 2 else upright
            start, end = (0, 2) if side % 2 else (1, 3)
            which = 0 if side % 2 == 0 else (side + 1) // 2
            total += weights[4 + which] * edge(table, px_per_m, shown[side], shown[start], shown[end])
            if abs(shown[side] - box[side]) > apart:
                total += weights[1 + which] * edge(table, px_per_m, box[side], box[start], box[end])
            if weights[10 + which] != 0:
                signed = edge(brighter[side % 2], px_per_m, box[side], box[start], box[end])
                total += weights[10 + which] * (signed if side < 2 else -signed)
        if weights[7] != 0:
            total += weights[7] * _glass(upright, level, px_per_m, frames_m, shown)
        out[i] = total + weights[8] * (box[2] - box[0]) + weights[9] * (box[3] - box[1])

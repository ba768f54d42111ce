"""Exact areas of quadrilaterals on a pixel grid: what conservative resampling is made of (compiled).

Each cell of one picture (the *net*) is a quadrilateral in the plane of another (the *plane*). Its overlap with every
pixel that it touches is exact, by the signed areas under its edges, so that overlaps of cells that tile the plane sum
to each pixel's area without gap or excess.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numba as nb
import numpy as np

from processing.ground.arrays import Doubles, Int8s

CLEAR, CUT, HIDDEN = 0, 1, 2
"""Of a corner: in the plane · moved onto the edge of its field · behind it (cells with such a corner are left out)."""


class Net(NamedTuple):
    """Corners of cells in the plane's picture coordinates (pixels), ``parts`` x ``parts`` cells to a pixel."""

    x: Doubles
    """(h * parts + 1, w * parts + 1)."""
    y: Doubles
    state: Int8s
    """`CLEAR`, `CUT` or `HIDDEN`."""
    parts: int


FAR = 1e9
"""Picture coordinates beyond this are as good as hidden, and would overflow an integer."""


@nb.njit(cache=True, nogil=True)
def _add_piece(x0: float, y0: float, x1: float, y1: float, first: int, area: Any, cover: Any) -> None:
    """Add an edge's piece within one row: in each column the area to its right, and the height that later ones get.

    ``area`` and ``cover`` belong to columns from ``first``; an edge left of them covers all, one right of them nothing.
    """
    count = area.shape[0]
    if x0 == x1 or np.floor(x0) == np.floor(x1):
        i = int(np.floor(x0)) - first
        if i < 0:
            cover[0] += y1 - y0
            area[0] += y1 - y0
        elif i < count:
            area[i] += (y1 - y0) * (first + i + 1 - (x0 + x1) / 2)
            cover[i] += y1 - y0
        return
    slope = (y1 - y0) / (x1 - x0)
    low, high = min(x0, x1), max(x0, x1)
    sign = 1.0 if x1 > x0 else -1.0
    if low < first:
        share = (min(high, first) - low) * slope * sign
        cover[0] += share
        area[0] += share
    begin = max(int(np.floor(low)) - first, 0)
    end = min(int(np.floor(high)) - first, count - 1)
    for i in range(begin, end + 1):
        left, right = max(low, first + i), min(high, first + i + 1.0)
        if right <= left:
            continue
        share = (right - left) * slope * sign
        area[i] += share * (first + i + 1 - (left + right) / 2)
        cover[i] += share


@nb.njit(cache=True, nogil=True)
def row_overlaps(px: Any, py: Any, row: int, first: int, area: Any, cover: Any) -> None:
    """Fill ``area`` (W,) with a quadrilateral's signed overlaps with the pixels of a row from column ``first``.

    ``px``, ``py`` (4,): its corners; ``cover`` (W,): scratch.
    """
    area[:] = 0.0
    cover[:] = 0.0
    for k in range(4):
        x0, y0, x1, y1 = px[k], py[k], px[(k + 1) % 4], py[(k + 1) % 4]
        if (y0 <= row and y1 <= row) or (y0 >= row + 1 and y1 >= row + 1) or y0 == y1:
            continue
        t0, t1 = 0.0, 1.0
        toward = 1.0 / (y1 - y0)
        at_top, at_bottom = (row - y0) * toward, (row + 1 - y0) * toward
        t0, t1 = max(t0, min(at_top, at_bottom)), min(t1, max(at_top, at_bottom))
        if t1 <= t0:
            continue
        a = x0 + (x1 - x0) * t0
        b = x0 + (x1 - x0) * t1
        _add_piece(
            a,
            min(max(y0 + (y1 - y0) * t0, row), row + 1),
            b,
            min(max(y0 + (y1 - y0) * t1, row), row + 1),
            first,
            area,
            cover,
        )
    carried = 0.0
    for i in range(area.shape[0]):
        own = area[i]
        area[i] = own + carried
        carried += cover[i]


@nb.njit(cache=True, nogil=True)
def _quad(x: Any, y: Any, state: Any, i: int, j: int, px: Any, py: Any) -> int:
    """Put a cell's corners into ``px``, ``py`` and return the worst of their states."""
    worst = 0
    for k in range(4):
        jj, ii = j + (k == 2 or k == 3), i + (k == 1 or k == 2)
        px[k], py[k] = x[jj, ii], y[jj, ii]
        if state[jj, ii] > worst:
            worst = state[jj, ii]
        if abs(px[k]) > FAR or abs(py[k]) > FAR:
            worst = HIDDEN
    return worst


@nb.njit(cache=True, nogil=True)
def _signed_area(px: Any, py: Any) -> float:
    return float(0.5 * ((px[2] - px[0]) * (py[3] - py[1]) - (px[3] - px[1]) * (py[2] - py[0])))


@nb.njit(cache=True, nogil=True)
def gather(net: Any, plane: Any, density: Any, weights: Any, light: Any, weight: Any) -> None:
    """Add to each target cell the plane's light: the ``net`` is the target (h, w), the plane the source.

    ``plane`` (H, W, C), ``density`` (H, W) steradians per pixel area, ``weights`` (H, W) 0..1. Added to
    ``light`` (h, w, C) and ``weight`` (h, w), float64.
    """
    x, y, state, parts = net
    height, width, channels = plane.shape
    px, py = np.empty(4), np.empty(4)
    area, cover = np.empty(width), np.empty(width)
    for j in range(x.shape[0] - 1):
        for i in range(x.shape[1] - 1):
            if _quad(x, y, state, i, j, px, py) == HIDDEN:
                continue
            turn = 1.0 if _signed_area(px, py) >= 0 else -1.0
            left, right = max(int(np.floor(px.min())), 0), min(int(np.ceil(px.max())), width)
            if right <= left:
                continue
            for row in range(max(int(np.floor(py.min())), 0), min(int(np.ceil(py.max())), height)):
                row_overlaps(px, py, row, left, area[: right - left], cover[: right - left])
                for n in range(right - left):
                    share = -turn * area[n] * density[row, left + n] * weights[row, left + n]
                    if share <= 0:
                        continue
                    weight[j // parts, i // parts] += share
                    for c in range(channels):
                        light[j // parts, i // parts, c] += share * plane[row, left + n, c]


@nb.njit(cache=True, nogil=True)
def scatter(net: Any, source: Any, solid: Any, weights: Any, density: Any, light: Any, weight: Any) -> None:
    """Hand each source cell's light to the plane's pixels: the ``net`` is the source (h, w, C), the plane the target.

    A cell that lies in the plane's field gives away exactly its ``solid`` angle (h * parts, w * parts); one that the
    field cuts gives by the plane's ``density`` (H, W). ``weights`` (h, w) 0..1. Added to ``light`` (H, W, C) and
    ``weight`` (H, W), float64.
    """
    x, y, state, parts = net
    height, width, channels = light.shape
    px, py = np.empty(4), np.empty(4)
    area, cover = np.empty(width), np.empty(width)
    for j in range(x.shape[0] - 1):
        for i in range(x.shape[1] - 1):
            sj, si = j // parts, i // parts
            if weights[sj, si] <= 0:
                continue
            worst = _quad(x, y, state, i, j, px, py)
            signed = _signed_area(px, py)
            if worst == HIDDEN or signed == 0:
                continue
            turn = -1.0 if signed >= 0 else 1.0
            per_area = solid[j, i] / abs(signed)
            left, right = max(int(np.floor(px.min())), 0), min(int(np.ceil(px.max())), width)
            if right <= left:
                continue
            for row in range(max(int(np.floor(py.min())), 0), min(int(np.ceil(py.max())), height)):
                row_overlaps(px, py, row, left, area[: right - left], cover[: right - left])
                for n in range(right - left):
                    share = turn * area[n] * (per_area if worst == CLEAR else density[row, left + n]) * weights[sj, si]
                    if share <= 0:
                        continue
                    weight[row, left + n] += share
                    for c in range(channels):
                        light[row, left + n, c] += share * source[sj, si, c]

"""Exact areas of quadrilaterals on a pixel grid: what conservative resampling is made of (compiled).

Each cell of one picture (the *net*) is a quadrilateral in the plane of another (the *plane*). Its overlap with every
pixel that it touches is exact, by the signed areas under its edges, so that overlaps of cells that tile the plane sum
to each pixel's area without gap or excess.
"""

from typing import Any, NamedTuple

import numpy as np

from processing.ground.arrays import Doubles, Int8s
from processing.ground.kernels import compiled, inner

CLEAR, CUT, HIDDEN = 0, 1, 2
"""Of a corner: in the plane · moved onto the edge of its field · behind it (cells with such a corner are left out)."""
FAR = 1e9  # picture coordinates beyond this are as good as hidden, and would overflow an integer
MOST_BOX_PX = 4.0  # width of a cell in the plane up to which a box may stand for it; chosen: beyond, cells bend

LEAST_FILLED = 0.5  # of the box's area, that the cell's is: less is a sliver, bent or cut. Chosen.


class Net(NamedTuple):
    """Corners of cells in the plane's picture coordinates (pixels), ``parts`` x ``parts`` cells to a pixel."""

    x: Doubles
    """(h * parts + 1, w * parts + 1)."""
    y: Doubles
    state: Int8s
    """`CLEAR`, `CUT` or `HIDDEN`."""
    parts: int


@inner
def _add_piece(x0: float, y0: float, x1: float, y1: float, first: int, count: int, area: Any, cover: Any) -> None:
    """Add an edge's piece within one row: in each column the area to its right, and the height that later ones get.

    The first ``count`` of ``area`` and ``cover`` belong to columns from ``first``; an edge left of them covers all, one
    right of them nothing."""
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


@inner
def row_overlaps(px: Any, py: Any, row: int, first: int, count: int, area: Any, cover: Any) -> None:
    """Fill ``area`` (W,) with a quadrilateral's signed overlaps with ``count`` pixels of a row from column ``first``.

    ``px``, ``py`` (4,): its corners; ``cover`` (W,): scratch.
    """
    for i in range(count):
        area[i] = cover[i] = 0.0
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
        at_a = min(max(y0 + (y1 - y0) * t0, row), row + 1)
        at_b = min(max(y0 + (y1 - y0) * t1, row), row + 1)
        _add_piece(a, at_a, b, at_b, first, count, area, cover)
    carried = 0.0
    for i in range(count):
        own = area[i]
        area[i] = own + carried
        carried += cover[i]


@inner
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


@inner
def _signed_area(px: Any, py: Any) -> float:
    return float(0.5 * ((px[2] - px[0]) * (py[3] - py[1]) - (px[3] - px[1]) * (py[2] - py[0])))


@inner
def _box(px: Any, py: Any, plane: Any, near: Any, live: int, solid: float, light: Any) -> bool:
    """Add a cell's light by the box that has its middle and its widths, unless something ``near`` wants better.

    A turned or sheared cell and its box agree in their first and second moments: where light changes evenly, exactly.
    Only the first ``live`` channels are not 0 there."""
    x, y = (px[0] + px[1] + px[2] + px[3]) / 4, (py[0] + py[1] + py[2] + py[3]) / 4
    row, column = int(np.floor(y)), int(np.floor(x))
    if row < 0 or column < 0 or row >= plane.shape[0] or column >= plane.shape[1] or near[row, column]:
        return False
    a, b = (px[1] - px[0] + px[2] - px[3]) / 2, (px[3] - px[0] + px[2] - px[1]) / 2
    c, d = (py[1] - py[0] + py[2] - py[3]) / 2, (py[3] - py[0] + py[2] - py[1]) / 2
    wide, high = np.sqrt(a * a + b * b), np.sqrt(c * c + d * d)
    if wide > MOST_BOX_PX or high > MOST_BOX_PX or abs(a * d - b * c) < LEAST_FILLED * wide * high:
        return False
    left, right, top, bottom = x - wide / 2, x + wide / 2, y - high / 2, y + high / 2
    if left < 0 or top < 0 or right > plane.shape[1] or bottom > plane.shape[0]:
        return False
    scale = solid / (wide * high)
    for r in range(int(np.floor(top)), int(np.ceil(bottom))):
        down = (min(bottom, r + 1.0) - max(top, r)) * scale
        for k in range(int(np.floor(left)), int(np.ceil(right))):
            share = down * (min(right, k + 1.0) - max(left, k))
            for channel in range(live):
                light[channel] += share * plane[r, k, channel]
    return True


@inner
def _exact(px: Any, py: Any, plane: Any, density: Any, weights: Any, scratch: Any, light: Any) -> float:
    """Add a cell's light by its overlaps with the plane's pixels and return its solid angle; ``scratch`` (2, W)."""
    height, width, channels = plane.shape
    area, cover = scratch[0], scratch[1]
    turn = 1.0 if _signed_area(px, py) >= 0 else -1.0
    left, right = max(int(np.floor(px.min())), 0), min(int(np.ceil(px.max())), width)
    total = 0.0
    if right <= left:
        return total
    for row in range(max(int(np.floor(py.min())), 0), min(int(np.ceil(py.max())), height)):
        row_overlaps(px, py, row, left, right - left, area, cover)
        for n in range(right - left):
            share = -turn * area[n] * density[row, left + n] * weights[row, left + n]
            if share <= 0:
                continue
            total += share
            for c in range(channels):
                light[c] += share * plane[row, left + n, c]
    return total


@compiled
def gather(net: Any, source: Any, near: Any, live: int, solid: Any, light: Any, weight: Any) -> None:
    """Add to each target cell the plane's light: the ``net`` is the target (h, w), the plane the source.

    ``source``: plane (H, W, C), density (H, W) in steradians per pixel area, weights (H, W) 0..1. ``near`` (H, W):
    whether cells there need exact overlaps; elsewhere, where all weights must be 1 and only the first ``live`` channels
    are not 0, boxes do. ``solid`` (h, w): sr of target cells. Added to ``light`` (h, w, C) and ``weight`` (h, w).
    """
    x, y, state, parts = net
    plane, density, weights = source
    px, py = np.empty(4), np.empty(4)
    scratch, found = np.empty((2, plane.shape[1])), np.empty(plane.shape[2])
    for j in range(x.shape[0] - 1):
        for i in range(x.shape[1] - 1):
            # Cells beyond a fisheye's field, a fifth of a square, are nothing to `finish`.
            worst = _quad(x, y, state, i, j, px, py) if solid[j // parts, i // parts] > 0 else HIDDEN
            if worst == HIDDEN:
                continue
            for c in range(plane.shape[2]):
                found[c] = 0.0
            if parts == 1 and worst == CLEAR and _box(px, py, plane, near, live, solid[j, i], found):
                total = solid[j, i]
            else:
                total = _exact(px, py, plane, density, weights, scratch, found)
            weight[j // parts, i // parts] += total
            for c in range(plane.shape[2]):
                light[j // parts, i // parts, c] += found[c]


@compiled
def finish(light: Any, weight: Any, solid: Any, values: Any, share: Any) -> None:
    """Fill means (h, w, C) and covered shares (h, w) from sums of light and weight.

    What rounding leaves at a cell's corner is no cover; nor are the slivers of target cells beyond a fisheye's field,
    whose corners all fall onto the field's edge.
    """
    for j in range(weight.shape[0]):
        for i in range(weight.shape[1]):
            covered = solid[j, i] > 0 and weight[j, i] > 1e-9 * solid[j, i]
            share[j, i] = min(weight[j, i] / solid[j, i], 1.0) if covered else 0.0
            for c in range(light.shape[2]):
                values[j, i, c] = light[j, i, c] / weight[j, i] if covered else 0.0


@compiled
def interval_means(picture: Any, weights: Any, rows: Any, columns: Any, band: Any, values: Any, share: Any) -> None:
    """Fill a band's means (h, w, C) and covered shares (h, w) where overlaps are products of intervals.

    ``rows``, ``columns``: lengths in common of targets and sources, as sparse matrices; ``band``: its first target row,
    and the whole cells of each row.
    """
    width, channels = picture.shape[1], picture.shape[2]
    light, known = np.empty((width, channels)), np.empty(width)
    for j in range(values.shape[0]):
        light[:] = 0.0
        known[:] = 0.0
        for n in range(rows[0][band[0] + j], rows[0][band[0] + j + 1]):
            row, part = rows[1][n], rows[2][n]
            for x in range(width):
                weight = part * weights[row, x]
                known[x] += weight
                for c in range(channels):
                    light[x, c] += weight * picture[row, x, c]
        cell = band[1][band[0] + j]
        for i in range(values.shape[1]):
            total = 0.0
            for n in range(columns[0][i], columns[0][i + 1]):
                total += columns[2][n] * known[columns[1][n]]
            covered = cell > 0 and total > 1e-9 * cell
            share[j, i] = min(total / cell, 1.0) if covered else 0.0
            for c in range(channels):
                mean = 0.0
                for n in range(columns[0][i], columns[0][i + 1]):
                    mean += columns[2][n] * light[columns[1][n], c]
                values[j, i, c] = mean / total if covered else 0.0


@compiled
def turned_corners(way: Any, radii: Any, first: int, x: Any, y: Any, state: Any) -> None:
    """Fill places of one fisheye's corners, rows from ``first`` on, in another that looks the same way.

    ``way``: column, row and radius of the first's axis, whether ``radii`` go by the sine of what they are numbered by;
    column and row of the other's axis; cosine and sine of the turn; relative radius in the first from which the other
    sees nothing. ``radii`` (N,): the other's radius, px, by even steps.
    """
    last = radii.shape[0] - 1
    for j in range(x.shape[0]):
        for i in range(x.shape[1]):
            right, up = (i - way[0]) / way[2], (way[1] - first - j) / way[2]
            r = np.sqrt(right * right + up * up)
            inside = min(r, 1.0)
            step = (np.arcsin(inside) * (2 / np.pi) if way[3] > 0 else inside) * last
            k = min(int(step), last - 1)
            scale = (radii[k] + (radii[k + 1] - radii[k]) * (step - k)) / r if r > 0 else 0.0
            x[j, i] = way[4] + (right * way[6] - up * way[7]) * scale
            y[j, i] = way[5] - (up * way[6] + right * way[7]) * scale
            state[j, i] = CLEAR if inside <= way[8] else CUT


@compiled
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
                row_overlaps(px, py, row, left, right - left, area, cover)
                for n in range(right - left):
                    share = turn * area[n] * (per_area if worst == CLEAR else density[row, left + n]) * weights[sj, si]
                    if share <= 0:
                        continue
                    weight[row, left + n] += share
                    for c in range(channels):
                        light[row, left + n, c] += share * source[sj, si, c]

"""Irradiance brought from a small picture to a large one: only between pixels that see the same surface."""

from __future__ import annotations

import math

import numpy as np
import numpy.typing as npt

from processing.ground.arrays import Floats
from processing.light.solver.kernels import compiled
from processing.light.solver.sight import Sight

REACH_PX = 3
"""How far a large pixel looks for a small one of its own surface."""


def upsampled(
    values: Floats,
    small: Sight,
    large: Sight,
    *,
    wraps: bool,
    first_row: int = 0,
    rows: int | None = None,
    among: npt.NDArray[np.bool_] | None = None,
) -> tuple[Floats, npt.NDArray[np.bool_]]:
    """Return values (n, k) for the large picture's pixels, and which (n,) found no small pixel of their own surface.

    ``values`` is (h, w, k) for the small picture; both must have the same geometry but for their size. ``large`` may be
    a band of whole rows: from ``first_row`` on, of ``rows`` in all. Pixels that are not ``among`` (n,) stay 0.
    """
    wanted = large.solid if among is None else large.solid & among
    out, missed = np.zeros((len(large.label), values.shape[2]), np.float32), np.zeros(len(large.label), bool)
    _spread(
        *(np.ascontiguousarray(values), small.label.reshape(small.shape), small.normal.reshape(*small.shape, 3)),
        *(small.point.reshape(*small.shape, 3), large.label, large.normal, large.point),
        *(np.array([first_row, rows or large.shape[0], large.shape[1]]), wraps, wanted, out, missed),
    )
    return out, missed


@compiled
def likeness_of(label, other, normal, others_normal, point, others_point) -> float:  # type: ignore[no-untyped-def]
    """Return how much one pixel tells of another: 0 for another surface, less the more the two are turned apart."""
    if label != other:
        return 0.0
    turned = normal[0] * others_normal[0] + normal[1] * others_normal[1] + normal[2] * others_normal[2]
    if turned < 0.7:
        return 0.0
    lift = far2 = 0.0
    for c in range(3):
        step = others_point[c] - point[c]
        lift += step * normal[c]
        far2 += step * step
    if abs(lift) > 0.01 + 0.3 * math.sqrt(far2):
        return 0.0
    return float(turned**8)


@compiled
def _sum(low, high, y, x, wraps, values, labels, normals, points, label, normal, point, total):  # type: ignore[no-untyped-def]
    """Fill ``total`` (1 + k,) with the weight and weighted values of the alike among small pixels around (y, x).

    From ``low`` to ``high`` about the pixel before: the four around by their share, a wider reach by nearness.
    """
    total[:] = 0.0
    rows, columns = labels.shape
    for r in range(max(math.floor(y) + low, 0), min(math.floor(y) + high, rows)):
        for c in range(math.floor(x) + low, math.floor(x) + high):
            if (c < 0 or c >= columns) and not wraps:
                continue
            k = c % columns
            share = likeness_of(label, labels[r, k], normal, normals[r, k], point, points[r, k])
            if share == 0.0:
                continue
            if low == 0:
                share *= (1 - abs(y - r)) * (1 - abs(x - c)) + 1e-4
            else:
                share /= (0.01 + (y - r) ** 2 + (x - c) ** 2) ** 2
            total[0] += share
            for channel in range(total.shape[0] - 1):
                total[1 + channel] += share * values[r, k, channel]


@compiled
def _spread(values, labels, normals, points, label, normal, point, shape, wraps, wanted, out, missed):  # type: ignore[no-untyped-def]
    rows, columns = labels.shape
    total = np.zeros(1 + values.shape[2])
    for i in range(label.shape[0]):
        if not wanted[i]:
            continue
        y = (shape[0] + i // shape[2] + 0.5) * rows / shape[1] - 0.5
        x = (i % shape[2] + 0.5) * columns / shape[2] - 0.5
        _sum(0, 2, y, x, wraps, values, labels, normals, points, label[i], normal[i], point[i], total)
        if total[0] == 0:
            low, high = 1 - REACH_PX, 1 + REACH_PX
            _sum(low, high, y, x, wraps, values, labels, normals, points, label[i], normal[i], point[i], total)
        missed[i] = total[0] == 0
        if total[0] > 0:
            for channel in range(values.shape[2]):
                out[i, channel] = total[1 + channel] / total[0]

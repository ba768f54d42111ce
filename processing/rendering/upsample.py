"""Irradiance brought from a small picture to a large one: only between pixels that see the same surface."""

from __future__ import annotations

import math

import numpy as np

from processing.rendering.kernels import compiled
from processing.rendering.scene import Floats
from processing.rendering.sight import Sight

REACH_PX = 3
"""How far a large pixel looks for a small one of its own surface."""


def upsampled(
    values: Floats, small: Sight, large: Sight, *, wraps: bool, first_row: int = 0, rows: int | None = None
) -> tuple[Floats, np.ndarray]:
    """Return values (n, 3) for the large picture's pixels, and which (n,) found no small pixel of their own surface.

    ``values`` is (h, w, 3) for the small picture; both must have the same geometry but for their size. ``large`` may be
    a band of whole rows: from ``first_row`` on, of ``rows`` in all.
    """
    out, missed = np.zeros((len(large.label), 3), np.float32), np.zeros(len(large.label), bool)
    _spread(
        *(np.ascontiguousarray(values), small.label.reshape(small.shape), small.normal.reshape(*small.shape, 3)),
        *(small.point.reshape(*small.shape, 3), large.label, large.normal, large.point),
        *(np.array([first_row, rows or large.shape[0], large.shape[1]]), wraps, out, missed),
    )
    return out, missed


@compiled
def _likeness(label, other, normal, others_normal, point, others_point) -> float:  # type: ignore[no-untyped-def]
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
    return turned**8


@compiled
def _spread(values, labels, normals, points, label, normal, point, shape, wraps, out, missed):  # type: ignore[no-untyped-def]
    rows, columns = labels.shape
    for i in range(label.shape[0]):
        if label[i] < 0:
            continue
        y = (shape[0] + i // shape[2] + 0.5) * rows / shape[1] - 0.5
        x = (i % shape[2] + 0.5) * columns / shape[2] - 0.5
        r0, c0 = math.floor(y), math.floor(x)
        total = red = green = blue = 0.0
        for step in range(2):
            # First the four pixels around, by their share; where none is alike, the nearest alike.
            low, high = (0, 2) if step == 0 else (1 - REACH_PX, 1 + REACH_PX)
            for r in range(r0 + low, r0 + high):
                for c in range(c0 + low, c0 + high):
                    if r < 0 or r >= rows or ((c < 0 or c >= columns) and not wraps):
                        continue
                    k = c % columns
                    like = _likeness(label[i], labels[r, k], normal[i], normals[r, k], point[i], points[r, k])
                    if like == 0.0:
                        continue
                    if step == 0:
                        share = like * ((1 - abs(y - r)) * (1 - abs(x - c)) + 1e-4)
                    else:
                        share = like / (0.01 + (y - r) ** 2 + (x - c) ** 2) ** 2
                    total += share
                    red += share * values[r, k, 0]
                    green += share * values[r, k, 1]
                    blue += share * values[r, k, 2]
            if total > 0:
                break
        if total > 0:
            out[i, 0], out[i, 1], out[i, 2] = red / total, green / total, blue / total
        else:
            missed[i] = True

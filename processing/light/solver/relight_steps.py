"""Which pixels of a small picture tell what a large one's pixels are worth: found once, used for every light."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from processing.ground.arrays import Floats
from processing.light.solver.kernels import compiled
from processing.light.solver.sight import Sight
from processing.light.solver.upsample import REACH_PX, likeness_of

MOST = 4


@dataclass(frozen=True)
class Steps:
    """For each large pixel up to `MOST` small ones of its own surface, and their weights (sum 1, or 0)."""

    index: npt.NDArray[np.int32]
    weight: Floats

    @classmethod
    def of(cls, small: Sight, full: Sight) -> Steps:
        """Return the steps between two panoramas from the same place."""
        count = len(full.label)
        index, weight = np.zeros((count, MOST), np.int32), np.zeros((count, MOST), np.float32)
        _find(
            *(small.label.reshape(small.shape), small.normal.reshape(*small.shape, 3)),
            *(small.point.reshape(*small.shape, 3), full.label, full.normal, full.point),
            *(np.array(full.shape), index, weight),
        )
        return cls(index, weight)

    def apply(self, values: Floats) -> Floats:
        """Return values (h, w, 3) for all large pixels: (n, 3)."""
        out = np.zeros((len(self.index), 3), np.float32)
        _apply(np.ascontiguousarray(values.reshape(-1, 3)), self.index, self.weight, out)
        return out


@compiled
def _apply(values, index, weight, out):  # type: ignore[no-untyped-def]
    for i in range(index.shape[0]):
        for k in range(index.shape[1]):
            w = weight[i, k]
            if w > 0:
                j = index[i, k]
                for c in range(3):
                    out[i, c] += w * values[j, c]


@compiled
def _keep(index, weight, at, share):  # type: ignore[no-untyped-def]
    """Keep one more pixel, in place of the least."""
    least = 0
    for k in range(1, weight.shape[0]):
        if weight[k] < weight[least]:
            least = k
    if share > weight[least]:
        index[least] = at
        weight[least] = share


@compiled
def _around(y, x, attempt, labels, normals, points, label, normal, point, index, weight):  # type: ignore[no-untyped-def]
    """Keep the best small pixels about (y, x); ``attempt`` 0: the four around, 1: wider, 2: any that is solid."""
    rows, columns = labels.shape
    top, left = math.floor(y), math.floor(x)
    low, high = (0, 2) if attempt == 0 else (1 - REACH_PX, 1 + REACH_PX)
    for r in range(max(top + low, 0), min(top + high, rows)):
        for column in range(left + low, left + high):
            c = column % columns
            if labels[r, c] < 0:
                continue
            share = 1.0
            if attempt < 2:
                share = likeness_of(label, labels[r, c], normal, normals[r, c], point, points[r, c])
            if attempt == 0:
                share *= (1 - abs(y - r)) * (1 - abs(x - column)) + 1e-4
            else:
                share /= (0.01 + (y - r) ** 2 + (x - column) ** 2) ** 2
            _keep(index, weight, r * columns + c, share)


@compiled
def _find(labels, normals, points, label, normal, point, shape, index, weight):  # type: ignore[no-untyped-def]
    for i in range(label.shape[0]):
        if label[i] < 0:
            continue
        y = (i // shape[1] + 0.5) * labels.shape[0] / shape[0] - 0.5
        x = (i % shape[1] + 0.5) * labels.shape[1] / shape[1] - 0.5
        total = 0.0
        # Rather any solid pixel, however different, than darkness.
        for attempt in range(3):
            _around(y, x, attempt, labels, normals, points, label[i], normal[i], point[i], index[i], weight[i])
            total = weight[i].sum()
            if total > 0:
                break
        if total > 0:
            weight[i] /= total

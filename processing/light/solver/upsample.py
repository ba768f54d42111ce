"""Irradiance brought from a small picture to a large one: only between pixels that see the same surface."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from processing.ground.arrays import Flags, Floats, Int32s
from processing.light.solver.kernels import compiled
from processing.light.solver.sight import Sight

REACH_PX = 3
"""How far a large pixel looks for small ones of its own surface."""
MOST = 4
"""Small pixels that a large one is made of."""


class _Seen(NamedTuple):
    """What pixels see, for compiled loops: of the small picture (h, w, ...), of the large one (N, ...)."""

    label: Int32s
    normal: Floats
    point: Floats


@dataclass(frozen=True)
class Steps:
    """For each large pixel (N) up to `MOST` small ones of its own surface: found once, used for every light."""

    index: Int32s
    """(N, MOST): flat index of the small pixels."""
    weight: Floats
    """(N, MOST): sum 1, or 0 where there are none."""

    @classmethod
    def of(
        cls,
        small: Sight,
        large: Sight,
        wanted: Flags,
        first_row: int,
        high: int,
        *,
        wraps: bool,
        any_solid: bool,
    ) -> Steps:
        """Return the steps between two pictures of the same geometry but for their size.

        ``large`` may be a band of whole rows: from ``first_row`` on, of ``high`` in all. Pixels that are not ``wanted``
        (N,) have no steps. ``wraps``: a panorama, whose left and right edges meet. ``any_solid``: rather any solid
        pixel, however different, than none.
        """
        count = len(large.label)
        index, weight = np.zeros((count, MOST), np.int32), np.zeros((count, MOST), np.float32)
        seen = _Seen(
            small.label.reshape(small.shape),
            small.normal.reshape(*small.shape, 3),
            small.point.reshape(*small.shape, 3),
        )
        shape = np.array([first_row, high, large.shape[1], 3 if any_solid else 2])
        _find(seen, _Seen(large.label, large.normal, large.point), shape, wraps, wanted, index, weight)
        return cls(index, weight)

    def apply(self, values: Floats) -> Floats:
        """Return ``values`` (h, w, K) of the small picture for all large pixels: (N, K)."""
        out = np.zeros((len(self.index), values.shape[2]), np.float32)
        _apply(np.ascontiguousarray(values.reshape(-1, values.shape[2])), self.index, self.weight, out)
        return out

    @property
    def missed(self) -> Flags:
        """(N,): large pixels that have no small pixel of their own surface near."""
        flags: Flags = self.weight[:, 0] + self.weight[:, 1] + self.weight[:, 2] + self.weight[:, 3] == 0
        return flags


def upsampled(
    values: Floats,
    small: Sight,
    large: Sight,
    *,
    wraps: bool,
    first_row: int = 0,
    rows: int | None = None,
    among: Flags | None = None,
) -> tuple[Floats, Flags]:
    """Return values (N, K) for the large picture's pixels, and which (N,) have no small pixel of their own surface.

    ``values`` is (h, w, K) for the small picture; both must have the same geometry but for their size. ``large`` may be
    a band of whole rows: from ``first_row`` on, of ``rows`` in all. Pixels that are not ``among`` (N,) stay 0.
    """
    wanted = large.solid if among is None else large.solid & among
    steps = Steps.of(small, large, wanted, first_row, rows or large.shape[0], wraps=wraps, any_solid=False)
    return steps.apply(values), steps.missed & wanted


@compiled
def _apply(values, index, weight, out):  # type: ignore[no-untyped-def]
    for i in range(index.shape[0]):
        for k in range(index.shape[1]):
            w = weight[i, k]
            if w > 0:
                j = index[i, k]
                for c in range(values.shape[1]):
                    out[i, c] += w * values[j, c]


@compiled
def _likeness(label, other, normal, others_normal, point, others_point) -> float:  # type: ignore[no-untyped-def]
    """Return how much one pixel says of another: 0 for another surface, less the more the two are turned apart."""
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
def _around(small, large, i, place, attempt, wraps, index, weight):  # type: ignore[no-untyped-def]
    """Keep the best small pixels about ``place`` (y, x); ``attempt`` 0: the four around, 1: wider, 2: any solid one."""
    y, x = place
    rows, columns = small.label.shape
    top, left = math.floor(y), math.floor(x)
    low, high = (1 - REACH_PX, 1 + REACH_PX) if attempt > 0 else (0, 2)
    label, normal, point = large.label[i], large.normal[i], large.point[i]
    for r in range(max(top + low, 0), min(top + high, rows)):
        for column in range(left + low, left + high):
            if (column < 0 or column >= columns) and not wraps:
                continue
            c = column % columns
            if attempt < 2:
                share = _likeness(label, small.label[r, c], normal, small.normal[r, c], point, small.point[r, c])
            else:
                share = 1.0 if small.label[r, c] >= 0 else 0.0
            if share == 0.0:
                continue
            if attempt > 0:
                share /= (0.01 + (y - r) ** 2 + (x - column) ** 2) ** 2
            else:
                share *= (1 - abs(y - r)) * (1 - abs(x - column)) + 1e-4
            _keep(index, weight, r * columns + c, share)


@compiled
def _find(small, large, shape, wraps, wanted, index, weight):  # type: ignore[no-untyped-def]
    """Fill the steps of all wanted pixels; ``shape`` (4,): first row, rows in all, columns, attempts."""
    for i in range(large.label.shape[0]):
        if not wanted[i]:
            continue
        y = (shape[0] + i // shape[2] + 0.5) * small.label.shape[0] / shape[1] - 0.5
        x = (i % shape[2] + 0.5) * small.label.shape[1] / shape[2] - 0.5
        total = 0.0
        for attempt in range(shape[3]):
            _around(small, large, i, (y, x), attempt, wraps, index[i], weight[i])
            total = weight[i].sum()
            if total > 0:
                break
        if total > 0:
            weight[i] /= total

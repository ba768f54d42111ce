"""Irradiance shared by pixels that see the same surface: from a small picture to a large one, and among neighbours.

Both are found once and serve every light (`Steps`, `Neighbours`).
"""

import math
from dataclasses import dataclass
from typing import NamedTuple, Self

import numpy as np

from processing.ground.arrays import Bytes, Flags, Floats, Int32s
from processing.ground.kernels import compiled, inlined
from processing.light.solver.sight import Sight
from processing.sphere import Equirectangular, pixels

REACH_PX = 3  # how far a large pixel looks for small ones of its own surface
MOST = 4  # small pixels that a large one is made of
ALIKE = 0.9, 0.7
"""Cosine between normals from which a small pixel says something of a large one: where what none shows is looked at
itself, and where any will do. By 0.7 everywhere bevels and grooves took turns in their own light and their face's."""
RADIUS_PX = 3  # of the neighbours over which irradiance is smoothed; chosen (benchmark relight)
NEARNESS = 0.2  # of the harmonic mean distance of what a place sees: over it, irradiance hardly changes (Ward 1988)


class _Seen(NamedTuple):
    """What pixels see, for compiled loops: of the small picture (H, W, ...), of the large one (N, ...)."""

    label: Int32s
    normal: Floats
    point: Floats


class Places(NamedTuple):
    """Where pixels (N) lie in a large picture."""

    row: Int32s
    column: Int32s
    high: int
    wide: int

    @classmethod
    def whole(cls, shape: tuple[int, int], first_row: int = 0, high: int | None = None) -> Self:
        """Return the places of a picture of ``shape``, or of a band of whole rows of one ``high`` in all."""
        row, column = np.divmod(np.arange(shape[0] * shape[1], dtype=np.int32), np.int32(shape[1]))
        return cls(row + np.int32(first_row), column, high or shape[0], shape[1])

    @classmethod
    def along(cls, rays: Floats, high: int) -> Self:
        """Return where unit rays (N, 3) lie in a panorama so ``high``: of a view that sees a part of it."""
        x, y, _ = pixels(Equirectangular(2 * high, high), rays)
        return cls(y.astype(np.int32), x.astype(np.int32), high, 2 * high)


@dataclass(frozen=True)
class Steps:
    """For each large pixel (N) up to `MOST` small ones of its own surface: found once, used for every light."""

    index: Int32s
    """(N, MOST): flat index of the small pixels."""
    weight: Floats
    """(N, MOST): sum 1, or 0 where there are none."""

    @classmethod
    def of(cls, small: Sight, large: Sight, wanted: Flags, places: Places, *, wraps: bool, any_solid: bool) -> Self:
        """Return the steps between two pictures of the same geometry but for their size.

        ``large`` may be any of the large picture's pixels, at ``places``. Pixels that are not ``wanted`` (N,) have no
        steps. ``wraps``: a panorama, whose left and right edges meet. ``any_solid``: rather any solid pixel, however
        different, than none.
        """
        count = len(large.label)
        index, weight = np.zeros((count, MOST), np.int32), np.zeros((count, MOST), np.float32)
        shape = small.shape
        seen = _Seen(small.label.reshape(shape), small.normal.reshape(*shape, 3), small.point.reshape(*shape, 3))
        attempts = 3 if any_solid else 2
        _find(seen, _Seen(large.label, large.normal, large.point), places, attempts, wraps, wanted, index, weight)
        return cls(index, weight)

    def apply(self, values: Floats) -> Floats:
        """Return ``values`` (H, W, K) of the small picture for all large pixels: (N, K)."""
        out = np.zeros((len(self.index), values.shape[2]), np.float32)
        _apply(np.ascontiguousarray(values.reshape(-1, values.shape[2])), self.index, self.weight, out)
        return out

    @property
    def missed(self) -> Flags:
        """(N,): large pixels that have no small pixel of their own surface near."""
        flags: Flags = self.weight[:, 0] + self.weight[:, 1] + self.weight[:, 2] + self.weight[:, 3] == 0
        return flags


def upsampled(
    values: Floats, small: Sight, large: Sight, *, wraps: bool, places: Places | None = None, among: Flags | None = None
) -> tuple[Floats, Flags]:
    """Return values (N, K) for the large picture's pixels, and which (N,) have no small pixel of their own surface.

    ``values`` is (H, W, K) for the small picture; both must have the same geometry but for their size. ``large`` may be
    some of the picture's pixels, at ``places``; None: all. Pixels that are not ``among`` (N,) stay 0.
    """
    wanted = large.solid if among is None else large.solid & among
    steps = Steps.of(small, large, wanted, places or Places.whole(large.shape), wraps=wraps, any_solid=False)
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


@inlined
def _likeness(small, r, c, large, i, least) -> float:  # type: ignore[no-untyped-def]
    """Return how much small pixel (r, c) says of large pixel i: 0 for another surface, less the more they are turned.

    Numbers one by one, no slices: a view of an array costs as much as all the rest."""
    if large.label[i] != small.label[r, c]:
        return 0.0
    turned = lift = far2 = np.float32(0)
    for k in range(3):
        turned += large.normal[i, k] * small.normal[r, c, k]
        step = small.point[r, c, k] - large.point[i, k]
        lift += step * large.normal[i, k]
        far2 += step * step
    if turned < least or abs(lift) > 0.01 + 0.3 * math.sqrt(far2):
        return 0.0
    turned *= turned
    turned *= turned
    return float(turned * turned)


@inlined
def _keep(index, weight, i, at, share):  # type: ignore[no-untyped-def]
    """Keep one more pixel of large pixel i, in place of the least."""
    least = 0
    for k in range(1, weight.shape[1]):
        if weight[i, k] < weight[i, least]:
            least = k
    if share > weight[i, least]:
        index[i, least] = at
        weight[i, least] = share


@inlined
def _around(seen, i, place, attempt, wraps, index, weight):  # type: ignore[no-untyped-def]
    """Keep the best small pixels about ``place`` (y, x); ``attempt`` 0: the four around, 1: wider, 2: any solid one."""
    (small, large, least), (y, x) = seen, place
    rows, columns = small.label.shape
    top, left = math.floor(y), math.floor(x)
    low, high = (1 - REACH_PX, 1 + REACH_PX) if attempt > 0 else (0, 2)
    kept = 0
    for r in range(max(top + low, 0), min(top + high, rows)):
        for column in range(left + low, left + high):
            c = column
            if column < 0 or column >= columns:
                if not wraps:
                    continue
                c = column % columns
            if attempt < 2:
                share = _likeness(small, r, c, large, i, least)
            else:
                share = 1.0 if small.label[r, c] >= 0 else 0.0
            if share == 0.0:
                continue
            if attempt > 0:
                share /= (0.01 + (y - r) ** 2 + (x - column) ** 2) ** 2
                _keep(index, weight, i, r * columns + c, share)
            else:  # at most four: there is room for all
                weight[i, kept] = share * ((1 - abs(y - r)) * (1 - abs(x - column)) + 1e-4)
                index[i, kept] = r * columns + c
                kept += 1


@compiled
def _find(small, large, places, attempts, wraps, wanted, index, weight):  # type: ignore[no-untyped-def]
    """Fill the steps of all wanted pixels."""
    least = ALIKE[1] if attempts == 3 else ALIKE[0]
    down, across = small.label.shape[0] / places.high, small.label.shape[1] / places.wide
    for i in range(large.label.shape[0]):
        if not wanted[i]:
            continue
        y, x = (places.row[i] + 0.5) * down - 0.5, (places.column[i] + 0.5) * across - 0.5
        total = np.float32(0)
        for attempt in range(attempts):
            _around((small, large, least), i, (y, x), attempt, wraps, index, weight)
            for k in range(weight.shape[1]):
                total += weight[i, k]
            if total > 0:
                break
        if total > 0:
            for k in range(weight.shape[1]):
                weight[i, k] /= total


@dataclass(frozen=True)
class Neighbours:
    """How much of each neighbour goes into a pixel's mean: a denoiser far cheaper than a learned one, and less good."""

    weight: Bytes
    """(h, w, (2 `RADIUS_PX` + 1)^2): 0 to 255, 255 for itself; 0 where nothing solid is seen."""
    step: int = 1

    @classmethod
    def of(cls, sight: Sight, distance_m: Floats, step: int = 1) -> Self:
        """Return the neighbours in a panorama, every ``step`` pixels.

        ``distance_m`` (N,): harmonic mean distance of what a place sees; it scales how far neighbours count.
        """
        weight = np.zeros((*sight.shape, (2 * RADIUS_PX + 1) ** 2), np.uint8)
        shape = (*sight.shape, 3)
        seen = _Seen(sight.label.reshape(sight.shape), sight.normal.reshape(shape), sight.point.reshape(shape))
        _weigh(seen, NEARNESS * distance_m.reshape(sight.shape), step, weight)
        return cls(weight, step)

    def smooth(self, values: Floats, apart: float = math.inf) -> Floats:
        """Return the means (H, W, 3) of ``values`` (H, W, 3) over neighbours, 0 where nothing solid is seen.

        Those that differ by ``apart`` (relative) count half, others less.
        """
        out, side = np.zeros_like(values), RADIUS_PX * self.step
        around = np.concatenate([values[:, -side:], values, values[:, :side]], axis=1)
        _smooth(around, self.weight, self.step, np.float32(1 / apart), out)
        return out


@compiled
def _weigh(seen, near_m, step_px, weight):  # type: ignore[no-untyped-def]
    """Fill `Neighbours.weight`: none for another surface, another direction or off the plane; else less with distance
    against ``near_m`` (H, W), over which irradiance changes there."""
    rows, columns = seen.label.shape
    side = 2 * RADIUS_PX + 1
    for y in range(rows):
        for x in range(columns):
            if seen.label[y, x] < 0:
                continue
            for dy in range(-RADIUS_PX, RADIUS_PX + 1):
                for dx in range(-RADIUS_PX, RADIUS_PX + 1):
                    r, c = y + dy * step_px, (x + dx * step_px) % columns
                    if r < 0 or r >= rows:
                        continue
                    if seen.label[r, c] != seen.label[y, x]:
                        continue
                    turned = lift = far2 = 0.0
                    for k in range(3):
                        turned += seen.normal[y, x, k] * seen.normal[r, c, k]
                        step = seen.point[r, c, k] - seen.point[y, x, k]
                        lift += step * seen.normal[y, x, k]
                        far2 += step * step
                    if turned < 0.9 or abs(lift) > 0.01 + 0.1 * math.sqrt(far2):
                        continue
                    share = 255 * math.exp(-0.5 * far2 / max(near_m[y, x] * near_m[y, x], 1e-8))
                    weight[y, x, (dy + RADIUS_PX) * side + dx + RADIUS_PX] = int(share + 0.5)


@compiled
def _smooth(values, weight, step_px, alike, out):  # type: ignore[no-untyped-def]
    """Fill the weighted means of ``values`` (h, w + 2 sides, 3), whose columns go on beyond both sides."""
    rows, columns = out.shape[0], out.shape[1]
    side, beyond = 2 * RADIUS_PX + 1, RADIUS_PX * step_px
    for y in range(rows):
        for x in range(columns):
            if weight[y, x, RADIUS_PX * side + RADIUS_PX] == 0:
                continue
            total = a = b = c = np.float32(0)
            own = values[y, x + beyond, 0] + values[y, x + beyond, 1] + values[y, x + beyond, 2]
            scale = alike / max(own, np.float32(1e-20))
            for at in range(side * side):
                w = np.float32(weight[y, x, at])
                if w == 0:
                    continue
                r, k = y + (at // side - RADIUS_PX) * step_px, x + at % side * step_px
                away = (values[r, k, 0] + values[r, k, 1] + values[r, k, 2] - own) * scale
                w /= np.float32(1) + away * away * away * away
                total += w
                a += w * values[r, k, 0]
                b += w * values[r, k, 1]
                c += w * values[r, k, 2]
            out[y, x, 0], out[y, x, 1], out[y, x, 2] = a / total, b / total, c / total

"""Maps between a panorama and its views; those that cut views are kept."""

import math
from dataclasses import dataclass
from functools import lru_cache, partial
from typing import Any

import cv2
import numpy as np
import numpy.typing as npt

from processing.ground.arrays import Doubles, Floats, Indices
from processing.ground.kernels import compiled, inner
from processing.ground.threads import FORGET
from processing.sphere import Equirectangular, Perspective, pixels, point_directions, view_axes

# Where the pixels of a perspective view lie in a panorama, ten times as fast as by the general way (compiled).
#
# The two angles are found by a polynomial of our own, fitted once: good to 1e-10 rad, which is 1e-7 pixel.

_FOLD = math.tan(math.pi / 8)  # arctan is fitted up to here, and folded above
KEPT = 8  # maps, of which the least recently used go: a report's views, which all states share, are 6 of 66 MB (chosen)
EDGE_SAMPLES = 65  # along a view's edge; chosen


def _fitted() -> tuple[float, ...]:
    """Return coefficients of arctan(t) / t in t squared, for t up to tan(pi / 8)."""
    nodes = (np.cos((np.arange(64) + 0.5) / 64 * math.pi) + 1) / 2 * _FOLD**2
    t = np.sqrt(nodes)
    series = np.polynomial.Chebyshev.fit(nodes, np.arctan(t) / t, 7, domain=[0, _FOLD**2])
    return tuple(float(c) for c in series.convert(kind=np.polynomial.Polynomial).coef)


_C0, _C1, _C2, _C3, _C4, _C5, _C6, _C7 = _fitted()


def view_in_panorama(panorama: Equirectangular, view: Perspective) -> tuple[Floats, Floats]:
    """Return columns and rows (h, w) of a view's pixel centres, counted from the first pixel's centre, float32.

    Columns are in [-0.5, width - 0.5), rows in [-0.5, height - 0.5]. h and w are the view's (H, W).
    """
    x = np.empty((view.height_px, view.width_px), dtype=np.float32)
    y = np.empty_like(x)
    axes = view_axes(view)
    # Turned by the panorama's own yaw, so that its middle column lies at longitude 0.
    sine, cosine = math.sin(panorama.yaw_rad), math.cos(panorama.yaw_rad)
    turned = np.stack([axes[:, 0] * cosine - axes[:, 1] * sine, axes[:, 0] * sine + axes[:, 1] * cosine, axes[:, 2]], 1)
    _fill(np.ascontiguousarray(turned), view.focal_px, panorama.width_px, panorama.height_px, x, y)
    return x, y


@partial(inner, inline="always")
def _angle(rise: float, run: float) -> float:
    """Return arctan2(rise, run) without branches; 0 for (0, 0)."""
    high, low = max(abs(rise), abs(run)), min(abs(rise), abs(run))
    t = low / max(high, 1e-300)
    folded = t > _FOLD
    t = (t - 1.0) / (t + 1.0) if folded else t
    z = t * t
    found = t * (_C0 + z * (_C1 + z * (_C2 + z * (_C3 + z * (_C4 + z * (_C5 + z * (_C6 + z * _C7)))))))
    found = found + math.pi / 4 if folded else found
    found = math.pi / 2 - found if abs(rise) > abs(run) else found
    found = math.pi - found if run < 0 else found
    return -found if rise < 0 else found


@compiled
def _fill(axes: Any, focal_px: float, width: int, height: int, x: Any, y: Any) -> None:
    per_turn, per_half = width / (2 * math.pi), height / math.pi
    for j in range(x.shape[0]):
        up = x.shape[0] / 2 - j - 0.5
        base_x = up * axes[1, 0] + focal_px * axes[2, 0]
        base_y = up * axes[1, 1] + focal_px * axes[2, 1]
        base_z = up * axes[1, 2] + focal_px * axes[2, 2]
        for i in range(x.shape[1]):
            right = i + 0.5 - x.shape[1] / 2
            dx, dy, dz = base_x + right * axes[0, 0], base_y + right * axes[0, 1], base_z + right * axes[0, 2]
            column = _angle(dx, dy) * per_turn + width / 2 - 0.5
            # Exactly behind is the first column, not one beyond the last.
            x[j, i] = column - width if column >= width - 0.5 else column
            y[j, i] = height / 2 - 0.5 - _angle(dz, math.sqrt(dx * dx + dy * dy)) * per_half


@dataclass(frozen=True)
class PolarPixels:
    """A view's pixels within half a row of a pole: their four neighbours lie on both sides of it."""

    view_rows: Indices
    view_columns: Indices
    rows: Indices
    """(n, 4) in the panorama."""
    columns: Indices
    weights: Doubles
    """(n, 4)."""


@dataclass(frozen=True)
class CutMap:
    """For OpenCV's remap with a wrapping border; ``polar`` is to be set right afterwards."""

    first: npt.NDArray[Any]
    second: npt.NDArray[Any]
    polar: PolarPixels | None


@dataclass(frozen=True)
class StitchMap:
    """Where a block of the panorama lies in a view: rows first..first + h, columns (counted on over the seam)."""

    first_row: int
    first_column: int
    x: Floats
    y: Floats
    weight: Floats
    """Feathered, 0 where the view does not see."""


@lru_cache(KEPT)
def cut_map(panorama: Equirectangular, view: Perspective, *, fixed: bool) -> CutMap:
    """Return the map that cuts a view; ``fixed``: in OpenCV's fixed-point form, faster for integer pictures."""
    first, second = view_in_panorama(panorama, view)
    polar = _polar_pixels(panorama, first, second)
    return CutMap(*cv2.convertMaps(first, second, cv2.CV_16SC2), polar) if fixed else CutMap(first, second, polar)


FORGET.append(cut_map.cache_clear)


def _polar_pixels(panorama: Equirectangular, x: Floats, y: Floats) -> PolarPixels | None:
    if y.min() >= 0 and y.max() <= panorama.height_px - 1:
        return None
    view_rows, view_columns = np.nonzero((y < 0) | (y > panorama.height_px - 1))
    at_x, at_y = (a[view_rows, view_columns].astype(np.float64) for a in (x, y))
    low = np.floor(at_y).astype(np.intp)
    share = at_y - low
    rows, columns, weights = [], [], []
    for row, weight in ((low, 1 - share), (low + 1, share)):
        beyond = (row < 0) | (row >= panorama.height_px)
        # Over the pole one comes down half way round.
        across = at_x + np.where(beyond, panorama.width_px / 2, 0.0)
        left = np.floor(across).astype(np.intp)
        inside = np.where(row < 0, -1 - row, np.where(beyond, 2 * panorama.height_px - 1 - row, row))
        for step, part in ((0, 1 - (across - left)), (1, across - left)):
            rows.append(inside)
            columns.append((left + step) % panorama.width_px)
            weights.append(weight * part)
    return PolarPixels(view_rows, view_columns, *(np.stack(a, axis=1) for a in (rows, columns, weights)))


def stitch_map(view: Perspective, target: Equirectangular) -> StitchMap:
    """Return where the target's pixels lie in a view, for the block of it that the view may see."""
    first_row, last_row, first_column, last_column = _block(view, target)
    d, _ = point_directions(
        target, np.arange(first_column, last_column) + 0.5, (np.arange(first_row, last_row) + 0.5)[:, None]
    )
    x, y, seen = pixels(view, d)
    weight = np.where(seen, _tent(x / view.width_px) * _tent(y / view.height_px), 0.0)
    in_x, in_y = (np.where(seen, value - 0.5, -1.0).astype(np.float32) for value in (x, y))
    return StitchMap(first_row, first_column, in_x, in_y, weight.astype(np.float32))


def _tent(share: Doubles) -> Doubles:
    """Return 1 in the middle, falling to a little above 0 at the edges: who alone sees a pixel must fill it."""
    return np.asarray(np.maximum(1 - np.abs(2 * share - 1), 1e-4))


def _block(view: Perspective, target: Equirectangular) -> tuple[int, int, int, int]:
    """Return first and last (exclusive) row and column that hold all the view sees; columns may pass the seam."""
    width, height = target.width_px, target.height_px
    along = np.linspace(0, 1, EDGE_SAMPLES)
    zero, one = np.zeros_like(along), np.ones_like(along)
    edge_x = np.concatenate([along, one, along, zero]) * view.width_px
    edge_y = np.concatenate([zero, along, one, along]) * view.height_px
    x, y, _ = pixels(target, point_directions(view, edge_x, edge_y)[0])
    # Between two samples an edge bulges by less than the step between them.
    slack = 2 + math.ceil(np.abs(np.diff(y)).max())
    first_row, last_row = max(0, math.floor(y.min()) - slack), min(height, math.ceil(y.max()) + slack)
    up, down = (pixels(view, np.array([0.0, 0.0, z]))[2].item() for z in (1, -1))
    first_row, last_row = (0 if up else first_row), (height if down else last_row)
    from_axis = (x - (math.remainder(view.yaw_rad - target.yaw_rad, 2 * math.pi) / (2 * math.pi) + 0.5) * width) % width
    from_axis = np.where(from_axis > width / 2, from_axis - width, from_axis)
    reach = np.abs(from_axis).max() + 2 + np.abs(np.diff(from_axis)).max()
    if up or down or 2 * reach >= width - 1:
        return first_row, last_row, 0, width
    middle = (math.remainder(view.yaw_rad - target.yaw_rad, 2 * math.pi) / (2 * math.pi) + 0.5) * width
    return first_row, last_row, math.floor(middle - reach), math.ceil(middle + reach)

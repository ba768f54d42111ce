"""Values known in some places, spread over a hole as a stretched skin lies: no peaks, no edges (Laplace's equation).

Solved from coarse to fine: averages of the known places, then a few sweeps at each size.
"""

from __future__ import annotations

from processing.ground.arrays import Flags, Floats

import cv2
import numpy as np


SWEEPS = 6
_CROSS = np.array([[0, 1, 0], [1, 0, 1], [0, 1, 0]], np.float32) / 4


def spread(values: Floats, given: Flags) -> Floats:
    """Return (h, w[, c]): ``values`` where given, elsewhere the membrane through them; zeros where none is given."""
    if not given.any():
        return np.zeros_like(values)
    picture = np.where(given if values.ndim == 2 else given[..., None], values, 0).astype(np.float32)
    return _level(picture, given.astype(np.float32))


def _level(values: Floats, share: Floats) -> Floats:
    """``share`` tells how much of each pixel is given; ``values`` are already multiplied by it."""
    fixed = share > 0
    own = values / _as(np.maximum(share, 1e-12), values)
    if fixed.all() or min(share.shape) < 2:
        mean = values.reshape(-1, *values.shape[2:]).sum(axis=0) / max(float(share.sum()), 1e-12)
        return np.asarray(np.where(_as(fixed, values), own, mean), np.float32)
    height, width = share.shape
    small = (max(1, (width + 1) // 2), max(1, (height + 1) // 2))
    even = (0, height % 2, 0, width % 2)
    coarse = _level(
        _halved(values, even, small),
        _halved(share, even, small),
    )
    up = cv2.resize(coarse, (small[0] * 2, small[1] * 2), interpolation=cv2.INTER_LINEAR)
    up = up.reshape(small[1] * 2, small[0] * 2, *values.shape[2:])[:height, :width]
    out = np.where(_as(fixed, values), own, up).astype(np.float32)
    for _ in range(SWEEPS):
        swept = cv2.filter2D(out, -1, _CROSS, borderType=cv2.BORDER_REPLICATE).reshape(out.shape)
        out = np.where(_as(fixed, values), own, swept)
    return np.asarray(out, np.float32)


def _halved(picture: Floats, even: tuple[int, int, int, int], size: tuple[int, int]) -> Floats:
    """Return the means of squares of four; what ``even`` adds at the lower and right edge counts as not given."""
    padded = cv2.copyMakeBorder(picture, *even, cv2.BORDER_CONSTANT, value=0)
    small = cv2.resize(padded, size, interpolation=cv2.INTER_AREA)
    return np.asarray(small.reshape(size[1], size[0], *picture.shape[2:]), np.float32)


def _as(flat: Floats | Flags, like: Floats) -> Floats:
    return np.asarray(flat if like.ndim == 2 else flat[..., None])

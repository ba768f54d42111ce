"""Cubic interpolation (Keys 1981, a = -1/2: exact for quadratics), exact weights, held within its 16 pixels (compiled).

OpenCV's cubic has a = -3/4 and rounds positions to 1/32 pixel: 0.05 of a pixel's step of error, more than linear.
"""

from __future__ import annotations

from processing.ground.arrays import Floats

from typing import Any

import numba as nb
import numpy as np
import numpy.typing as npt



def cubic_samples(picture: Floats, x: Floats, y: Floats) -> Floats:
    """Return (h, w, C) samples of a float32 picture (H, W, C); ``x``, ``y`` (h, w) count from the first pixel's centre.

    Beyond the borders the last pixel is repeated. No sample is outside the range of the 16 pixels it is made of.
    """
    out = np.empty((*x.shape, picture.shape[2]), dtype=np.float32)
    _sample(np.ascontiguousarray(picture), x, y, out)
    return out


@nb.njit(cache=True, nogil=True)
def _weights(t: float, into: Any) -> None:
    into[0] = t * (-0.5 + t * (1.0 - 0.5 * t))
    into[1] = 1.0 + t * t * (-2.5 + 1.5 * t)
    into[2] = t * (0.5 + t * (2.0 - 1.5 * t))
    into[3] = t * t * (-0.5 + 0.5 * t)


@nb.njit(cache=True, nogil=True)
def _sample(picture: Any, x: Any, y: Any, out: Any) -> None:
    height, width, channels = picture.shape
    across, down = np.empty(4), np.empty(4)
    column, row = np.empty(4, np.int64), np.empty(4, np.int64)
    for j in range(x.shape[0]):
        for i in range(x.shape[1]):
            fx, fy = np.floor(x[j, i]), np.floor(y[j, i])
            _weights(x[j, i] - fx, across)
            _weights(y[j, i] - fy, down)
            for k in range(4):
                column[k] = min(max(int(fx) + k - 1, 0), width - 1)
                row[k] = min(max(int(fy) + k - 1, 0), height - 1)
            for c in range(channels):
                total, low, high = 0.0, np.inf, -np.inf
                for v in range(4):
                    line = 0.0
                    for u in range(4):
                        value = picture[row[v], column[u], c]
                        line += across[u] * value
                        low, high = min(low, value), max(high, value)
                    total += down[v] * line
                out[j, i, c] = min(max(total, low), high)

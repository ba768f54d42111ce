"""Robertson, Borman, Stevenson: Estimation-theoretic approach to dynamic range enhancement (2003)."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from processing.calibration.response.samples import ChannelSamples
from processing.ground.arrays import Doubles

_ROUNDS, _ENOUGH = 200, 1e-5
_PIXELS = (4, 0, 8, 2, 6)
"""Of each patch."""


def robertson(data: ChannelSamples, log2_times: Doubles) -> Doubles:
    """Return log2 exposure (256,), 0 at code 128.

    Light and curve in turn (their eq. 8 and 10), summed in float64; codes that no pixel shows are interpolated, not
    divided by their count of 0.
    """
    codes = data.pixels[:, _PIXELS].astype(np.int64)
    times = np.exp2(log2_times - log2_times.mean())[data.frame][:, None]
    weight = bell(np.arange(256.0))[codes]
    count = np.bincount(codes.ravel(), minlength=256)
    seen = np.flatnonzero(count)
    every = np.arange(256)
    curve = (every + 0.5) / 128.5
    bottom = np.maximum(np.add.reduceat(weight * times**2, data.starts, axis=0), 1e-300)
    for _ in range(_ROUNDS):
        light = np.add.reduceat(weight * times * curve[codes], data.starts, axis=0) / bottom
        total = np.bincount(codes.ravel(), (times * light[data.sample]).ravel(), minlength=256)
        fresh = _filled(total[seen] / count[seen], seen, every)
        fresh /= max(float(fresh[128]), 1e-300)
        change = float(np.abs(fresh - curve)[16:240].max())
        curve = fresh
        if change < _ENOUGH:
            break
    return np.asarray(np.log2(np.maximum(curve, 1e-9)), dtype=np.float64)


def _filled(values: Doubles, seen: npt.NDArray[np.int64], every: npt.NDArray[np.int64]) -> Doubles:
    """Return values at every code: interpolated between those seen, in proportion to the code beyond."""
    inside = np.interp(every, seen, values)
    beyond = np.where(every < seen[0], (every + 0.5) / (seen[0] + 0.5), (every + 0.5) / (seen[-1] + 0.5))
    return np.asarray(np.where((every < seen[0]) | (every > seen[-1]), inside * beyond, inside))


def bell(codes: Doubles) -> Doubles:
    """Return their weight, shifted and scaled to 0 at codes 0 and 255 and 1 in the middle."""
    end = np.exp(-4.0)
    return np.asarray((np.exp(-4 * ((codes - 127.5) / 127.5) ** 2) - end) / (1 - end))

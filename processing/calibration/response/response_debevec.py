"""Debevec, Malik: Recovering high dynamic range radiance maps from photographs (SIGGRAPH 1997), eq. 3 to 5."""

from __future__ import annotations

import numpy as np

from processing.calibration.response.samples import ChannelSamples
from processing.ground.arrays import Doubles

PATCHES = 500
SMOOTHNESS = 30.0
"""Their lambda; 10 with 70 pixels leaves 0.026 stop of error on the reference bracket."""


def debevec_malik(data: ChannelSamples, log2_times: Doubles, smoothness: float = SMOOTHNESS) -> Doubles:
    """Return log2 exposure (256,), 0 at code 128.

    In float64, by orthogonal decomposition of the rows from which each pixel's light is projected out; the hat weights
    run from 0 to 1, which keeps the condition near 3000 instead of 90,000. Codes 0 and 255 weigh nothing and are
    continued in a straight line.
    """
    from scipy.linalg import qr

    part = data.part(PATCHES)
    codes = part.pixels[:, 4].astype(np.int64)
    weight = hat(np.arange(256.0))
    own = weight[codes]
    rows = np.zeros((len(codes), 256))
    rows[np.arange(len(codes)), codes] = own
    right = own * log2_times[part.frame]
    total = np.maximum(np.add.reduceat(own**2, part.starts), 1e-12)
    mean_rows = np.add.reduceat(rows * own[:, None], part.starts, axis=0) / total[:, None]
    mean_right = np.add.reduceat(right * own, part.starts) / total
    rows -= own[:, None] * mean_rows[part.sample]
    right -= own * mean_right[part.sample]
    smooth = np.zeros((254, 256))
    for z in range(1, 255):
        smooth[z - 1, z - 1 : z + 2] = smoothness * weight[z] * np.array([1.0, -2.0, 1.0])
    gauge = np.zeros((1, 256))
    gauge[0, 128] = 1.0
    both = np.column_stack([np.concatenate([rows, smooth, gauge]), np.concatenate([right, np.zeros(255)])])
    triangle = qr(both, mode="r", overwrite_a=True, check_finite=False)[0][:257]
    # Of the least norm: codes 0 and 255 are in no row.
    answer = np.linalg.lstsq(triangle[:, :256], triangle[:, 256], rcond=1e-12)[0]
    answer[0], answer[255] = 2 * answer[1] - answer[2], 2 * answer[254] - answer[253]
    return np.asarray(answer - answer[128], dtype=np.float64)


def hat(codes: Doubles) -> Doubles:
    """Return their weight, 0 at codes 0 and 255 and 1 in the middle."""
    return np.asarray(np.minimum(codes, 255 - codes) / 127.5)

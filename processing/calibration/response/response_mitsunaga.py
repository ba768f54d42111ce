"""Mitsunaga, Nayar: Radiometric self calibration (CVPR 1999): a polynomial, from ratios of neighbouring exposures."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from processing.calibration.response.samples import ChannelSamples
from processing.ground.arrays import Doubles

ORDERS = range(3, 9)
_LOW, _HIGH = 4.0, 251.0
_GAIN = 0.97
"""A higher order must lower the error on pairs that were not fitted by so much."""


def mitsunaga_nayar(data: ChannelSamples, log2_times: Doubles) -> Doubles:
    """Return log2 exposure (256,), 0 at code 255: f(1) = 1 is their gauge.

    The polynomial is solved over Chebyshev polynomials in float64 (powers of the code are ill-conditioned); its order
    is the one that predicts held-out pairs best. Where it falls to 0 or below it is continued in a straight line.
    """
    first, second = _neighbours(data, log2_times)
    longer, shorter = data.mean[first] / 255, data.mean[second] / 255
    ratio = np.exp2(log2_times[data.frame[first]] - log2_times[data.frame[second]])
    held = np.arange(len(ratio)) % 2 == 0
    chosen, best = ORDERS[0], np.inf
    for order in ORDERS:
        answer = _solve(longer[held], shorter[held], ratio[held], order)
        error = float(np.mean((_value(answer, longer[~held]) - ratio[~held] * _value(answer, shorter[~held])) ** 2))
        if error < _GAIN * best:
            chosen, best = order, error
    answer = _solve(longer, shorter, ratio, chosen)
    linear = _value(answer, np.arange(256) / 255)
    rising = np.flatnonzero((linear[:-1] <= 0) | (np.diff(linear) <= 0))
    # From the last code of the lower half that does not rise, straight down to half a code's light at code 0.
    start = int(rising[rising < 128].max(initial=-1)) + 1
    toe = linear[start] * (np.arange(start) + 0.5) / (start + 0.5)
    linear = np.concatenate([toe, linear[start:]])
    return np.asarray(np.log2(np.maximum(linear, 1e-9)), dtype=np.float64)


def _neighbours(data: ChannelSamples, log2_times: Doubles) -> tuple[npt.NDArray[np.int64], npt.NDArray[np.int64]]:
    order = np.lexsort((-log2_times[data.frame], data.sample))
    usable = (data.mean >= _LOW) & (data.mean <= _HIGH)
    first, second = order[:-1], order[1:]
    same = (data.sample[first] == data.sample[second]) & usable[first] & usable[second]
    return first[same], second[same]


def _terms(x: Doubles, order: int) -> Doubles:
    """Return (n, order): T_n - 1 for n = 1..order, so that every sum of them added to 1 is 1 at x = 1."""
    return np.asarray(np.polynomial.chebyshev.chebvander(2 * x - 1, order)[:, 1:] - 1)


def _value(answer: Doubles, x: Doubles) -> Doubles:
    return np.asarray(1 + _terms(x, len(answer)) @ answer)


def _solve(longer: Doubles, shorter: Doubles, ratio: Doubles, order: int) -> Doubles:
    rows = _terms(longer, order) - ratio[:, None] * _terms(shorter, order)
    return np.asarray(np.linalg.lstsq(rows, ratio - 1, rcond=None)[0], dtype=np.float64)

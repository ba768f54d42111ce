"""A camera's noise from the bracket itself: how far codes are from what another exposure of the same patch predicts.

Two frames of one still patch differ by noise alone, whatever its texture: the longer exposure predicts the shorter
one's code, and the variance about that prediction is a known linear function of the photon, read and coding terms of
both (EMVA 1288's noise equation, carried through the response).
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from processing.calibration.response.fit import CodeNoise, FineCurve
from processing.calibration.response.samples import ChannelSamples
from processing.ground.arrays import Doubles

_LOW, _HIGH = 5.0, 250.0
_LEAST_LONG = 8.0
"""Codes of the longer exposure that predict."""
_BINS = 40
_LEAST = 20
"""Differences that a bin must hold."""
_TRIM = 4.0
_ROUNDS = 4


def fit_noise(
    data: ChannelSamples, fine: FineCurve, log2_times: Doubles, *, least_code_variance: float, pixels: int = 0
) -> CodeNoise | None:
    """Return the noise of ``pixels`` single pixels of each patch, or with 0 of the patches' means.

    None where too few patches tell.
    """
    longer, shorter = _pairs(data, log2_times)
    step = log2_times[data.frame[shorter]] - log2_times[data.frame[longer]]
    places = [4, 0, 8, 2, 6, 1, 3, 5, 7][:pixels]
    columns = [data.pixels[:, place].astype(np.float64) for place in places] if pixels else [data.mean]
    long_codes = np.concatenate([codes[longer] for codes in columns])
    short_codes = np.concatenate([codes[shorter] for codes in columns])
    at_long, slope_long, _ = fine.at(long_codes)
    predicted = fine.code(at_long + np.tile(step, len(columns)))
    use = (long_codes < _HIGH) & (long_codes > _LEAST_LONG) & (predicted > _LOW) & (predicted < _HIGH)
    if use.sum() < _LEAST:
        return None
    terms = _terms(at_long[use], slope_long[use], predicted[use], fine)
    return _solve((short_codes - predicted)[use], terms, predicted[use], least_code_variance)


def _pairs(data: ChannelSamples, log2_times: Doubles) -> tuple[npt.NDArray[np.int64], npt.NDArray[np.int64]]:
    """Return observations of the same patch in neighbouring exposures: the longer, and the next shorter one."""
    order = np.lexsort((-log2_times[data.frame], data.sample))
    same = data.sample[order[1:]] == data.sample[order[:-1]]
    return order[:-1][same], order[1:][same]


def _terms(at_long: Doubles, slope_long: Doubles, predicted: Doubles, fine: FineCurve) -> Doubles:
    """Return (n, 3): variance of the difference, in squared codes, for a unit of photon, read2 and code variance."""
    at_short, slope_short, _ = fine.at(predicted)
    x_long, x_short = np.exp2(at_long), np.exp2(at_short)
    codes_per_log = 1 / (np.log(2.0) * slope_short)  # d code / d ln x in the shorter frame
    ratio = slope_long / slope_short  # a code there is so many here
    photon = codes_per_log**2 * (1 / x_short + 1 / x_long)
    read = codes_per_log**2 * (1 / x_short**2 + 1 / x_long**2)
    return np.stack([photon, read, 1 + ratio**2], axis=1)


def _solve(difference: Doubles, terms: Doubles, predicted: Doubles, least: float) -> CodeNoise | None:
    """Fit mean squares over bins of the code, each weighed by its own variance, terms not below 0."""
    from scipy.optimize import nnls

    root = np.minimum((np.sqrt(predicted / 256) * _BINS).astype(np.int64), _BINS - 1)
    centre = np.zeros(_BINS)
    limit = np.zeros(_BINS)
    count = np.bincount(root, minlength=_BINS)
    for b in np.flatnonzero(count >= _LEAST):
        mine = difference[root == b]
        centre[b] = np.median(mine)
        limit[b] = _TRIM * max(1.4826 * float(np.median(np.abs(mine - centre[b]))), 0.3)
    kept = np.abs(difference - centre[root]) < limit[root]
    count = np.bincount(root[kept], minlength=_BINS)
    full = count >= _LEAST
    if full.sum() < 4:
        return None
    square = np.bincount(root[kept], (difference - centre[root])[kept] ** 2, _BINS)[full] / count[full]
    columns = np.stack([np.bincount(root[kept], t[kept], _BINS)[full] / count[full] for t in terms.T], axis=1)
    offset = least * columns[:, 2]
    answer = np.array([0.0, 0.0, 1.0])
    for _ in range(_ROUNDS):
        expected = np.maximum(columns @ answer + (offset if _ else 0), 1e-9)
        weight = np.sqrt(count[full] / 2) / expected
        size = np.maximum((columns * weight[:, None]).max(axis=0), 1e-300)
        answer = nnls(columns * weight[:, None] / size, np.maximum(square - offset, 0) * weight)[0] / size
    return CodeNoise(float(answer[0]), float(answer[1]), float(answer[2] + least))

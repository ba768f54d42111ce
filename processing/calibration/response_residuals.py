"""How well a curve fits its bracket, code by code: what the report plots, and the uncertainty of named methods."""

from __future__ import annotations

from processing.ground.arrays import Doubles

from dataclasses import dataclass
from typing import TypeAlias

import numpy as np
import numpy.typing as npt

from processing.calibration.response_curve import ResponseCurve
from processing.calibration.response_fit import FineCurve, PatchNoise, weigh
from processing.calibration.response_samples import Samples


BIN_CODES = 8
_LEAST = 10


@dataclass(frozen=True)
class CodeResiduals:
    """Residuals in stops by code: what a patch's light is in one frame less what its other frames say."""

    codes: Doubles
    """(32,) middle of each bin of 8 codes."""
    mean_stops: Doubles
    """(3, 32): 0 for a right curve; NaN never: 0 where `count` is 0."""
    spread_stops: Doubles
    """(3, 32) robust standard deviation of one patch."""
    count: npt.NDArray[np.int64]
    """(3, 32) patches."""


def residuals_by_code(samples: Samples, curve: ResponseCurve, log2_times: Doubles | None = None) -> CodeResiduals:
    """Return the residuals of samples under a curve; ``log2_times`` if they are not those given with the samples."""
    times = samples.log2_times if log2_times is None else log2_times
    n_bins = 256 // BIN_CODES
    mean, spread = np.zeros((3, n_bins)), np.zeros((3, n_bins))
    count = np.zeros((3, n_bins), dtype=np.int64)
    for c, data in enumerate(samples.channels):
        if data.n_samples == 0:
            continue
        found = weigh(data, FineCurve.of(curve.log2_exposure[c]), times, PatchNoise())
        used = found.weight > 0
        bins = np.minimum(found.predicted[used] / BIN_CODES, n_bins - 1).astype(np.int64)
        residual = found.residual[used]
        count[c] = np.bincount(bins, minlength=n_bins)
        for b in np.flatnonzero(count[c]):
            mine = residual[bins == b]
            mean[c, b] = np.median(mine)
            spread[c, b] = 1.4826 * np.median(np.abs(mine - mean[c, b]))
    middle = (np.arange(n_bins, dtype=np.float64) + 0.5) * BIN_CODES
    return CodeResiduals(middle, mean, spread, count)


def sigma_from_residuals(residuals: CodeResiduals) -> Doubles:
    """Return the standard uncertainty (3, 256) that residuals show: bias and standard error, smooth over codes."""
    error = residuals.spread_stops / np.sqrt(np.maximum(residuals.count, 1))
    sigma = np.hypot(residuals.mean_stops, error)
    out = np.empty((3, 256))
    for c in range(3):
        good = residuals.count[c] >= _LEAST
        middle = residuals.codes[good]
        if middle.size == 0:
            out[c] = 1.0
            continue
        beyond = np.maximum(np.maximum(middle[0] - np.arange(256), np.arange(256) - middle[-1]), 0.0)
        out[c] = np.interp(np.arange(256), middle, sigma[c, good]) + 0.02 * beyond
    return out

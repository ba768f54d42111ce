"""What a response curve is: from picture codes to relative exposure, per channel, with its uncertainty."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from processing.ground.arrays import Doubles


@dataclass(frozen=True)
class ResponseCurve:
    """Exposure that gives each code: ``log2_exposure[channel, code]`` in stops, strictly increasing in the code.

    Gauge: the exposure is relative; ``log2_exposure[c, gauge_code]`` is fixed by the method. ``sigma_log2`` is the
    standard uncertainty of the shape, relative to the point ``sigma_code`` (0 there); ``balance_sigma`` that of each
    channel as a whole, which matters for colour only. The radiance of code z in a frame of t seconds is
    ``2 ** log2_exposure[c, z] / t``. Codes outside ``low[c]..high[c]`` are extrapolated: not for merging.
    """

    log2_exposure: Doubles
    """(3, N): N = 256 for 8-bit frames; 16-bit and raw frames are linear and have no table (``linear``)."""
    sigma_log2: Doubles
    """(3, N)."""
    low: tuple[int, int, int]
    high: tuple[int, int, int]
    gauge_code: int = 128
    sigma_code: int = 128
    balance_sigma: tuple[float, float, float] = (0.0, 0.0, 0.0)
    """Stops between ``sigma_code`` and the gauge."""
    method: str = "daylit"
    n_samples: int = 0
    """Pixel samples that the fit used."""
    residual_stops: float = 0.0
    """Robust rms residual of the fit."""

    @property
    def exposure(self) -> Doubles:
        """Return linear exposure (3, N)."""
        return np.asarray(np.exp2(self.log2_exposure))

    @property
    def log2_slope(self) -> Doubles:
        """Return stops per code (3, N), by central differences; positive."""
        return np.asarray(np.gradient(self.log2_exposure, axis=1))


# The camera's noise as the merge needs it: how uncertain is the exposure behind each code.


@dataclass(frozen=True)
class NoiseModel:
    """Variance of the linear exposure x (in the response curve's gauge), per channel.

    ``var(x) = photon[c] * x + read[c] ** 2`` before the codes, plus quantisation and coding noise of
    ``code_variance[c]`` squared codes through the response's slope. Photon noise: EMVA 1288; of rounding: 1/12.
    """

    photon: tuple[float, float, float]
    read: tuple[float, float, float]
    code_variance: tuple[float, float, float] = (1 / 12, 1 / 12, 1 / 12)

    def relative_variance(self, curve: ResponseCurve) -> Doubles:
        """Return var(x) / x2 for each code, (3, N): what the merge weighs by."""
        x = curve.exposure
        slope = curve.log2_slope * np.log(2.0)  # d ln x / d code
        photon, read, codes = (np.array(v)[:, None] for v in (self.photon, self.read, self.code_variance))
        return np.asarray(photon / x + (read / x) ** 2 + codes * slope**2)

"""What a response curve is: from picture codes to relative exposure, per channel, with its uncertainty."""

from __future__ import annotations

from processing.ground.arrays import Doubles

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt



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

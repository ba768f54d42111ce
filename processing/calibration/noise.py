"""The camera's noise as the merge needs it: how uncertain is the exposure behind each code."""

from __future__ import annotations

from processing.ground.arrays import Doubles

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from processing.calibration.response_curve import ResponseCurve



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

"""How sure a fitted curve is, code by code, relative to its gauge."""

from __future__ import annotations

from processing.ground.arrays import Doubles

from typing import TypeAlias

import numpy as np
import numpy.typing as npt

from processing.calibration.response_basis import spline_basis
from processing.calibration.response_daylit import ChannelFit


MODEL_CODES = 0.1
"""Of the standard deviation of one pixel's coding: how far a smooth curve may be from the camera's mean code (kinks of
the tone curve, coders that drop what is small). Measured on simulated cameras of training seeds."""
_BEYOND = 0.003, 0.02
"""Stops a code that the continuation above and below the data adds."""


def curve_sigma(fit: ChannelFit, gauge: int) -> Doubles:
    """Return the standard uncertainty (256,), 0 at the gauge code: of the fit, of the model, and of what is beyond."""
    rows = spline_basis().codes
    inside = np.clip(np.arange(256), fit.low, min(fit.high + 3, 255))
    rows = rows[inside] - rows[inside[gauge]]
    covered = np.einsum("zi,ij,zj->z", rows, fit.solution.covariance, rows)
    covered = np.maximum(covered, 0.0) * max(fit.solution.scale2, 1.0)
    slope = np.gradient(fit.log2)
    model = (MODEL_CODES * slope) ** 2 * fit.noise.pixel.code
    codes = np.arange(256)
    beyond = _BEYOND[0] * np.maximum(codes - fit.high, 0) + _BEYOND[1] * np.maximum(fit.low - codes, 0)
    sigma = np.sqrt(covered + model + model[gauge] + (beyond - beyond[gauge]) ** 2)
    sigma[gauge] = 0.0
    return np.asarray(sigma)

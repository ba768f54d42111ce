"""What a curve is relative to, and how to change it.

A bracket tells a curve of each channel but for a factor. We choose 1 at code 255, where the curve is continued by a
few codes: cameras balance their channels so that a saturated sensor comes out white. Of the gauges measured on
simulated cameras whose channels have tone curves of their own it keeps colours best (docs/calibration.md).
"""

from __future__ import annotations

from processing.ground.arrays import Doubles

from collections.abc import Sequence
from dataclasses import replace
from typing import TypeAlias

import numpy as np
import numpy.typing as npt

from processing.calibration.noise import NoiseModel
from processing.calibration.response_curve import ResponseCurve
from processing.errors import ParameterError


WHITE_CODE, MIDDLE_CODE = 255, 128
LEAST_HIGH = 235
"""Code that the frames must reach in all channels for the white gauge."""


def regauge(curve: ResponseCurve, factors: Sequence[float]) -> ResponseCurve:
    """Return the curve with each channel's exposure multiplied by a factor: from a neutral reference (board, chart).

    The uncertainty stays relative to the same code.

    Raises
    ------
    ParameterError
        Factors that are not three positive numbers.
    """
    return replace(curve, log2_exposure=curve.log2_exposure + np.log2(_three(factors))[:, None])


def regauge_noise(noise: NoiseModel, factors: Sequence[float]) -> NoiseModel:
    """Return the noise model that belongs to `regauge`'s curve."""
    by = _three(factors)
    photon, read = by * noise.photon, by * noise.read
    return replace(
        noise,
        photon=(float(photon[0]), float(photon[1]), float(photon[2])),
        read=(float(read[0]), float(read[1]), float(read[2])),
    )


def neutral_factors(seen_rgb: Sequence[float]) -> tuple[float, float, float]:
    """Return the factors that make a linear RGB value neutral and leave its green as it is."""
    rgb = _three(seen_rgb)
    return float(rgb[1] / rgb[0]), 1.0, float(rgb[1] / rgb[2])


def _three(values: Sequence[float]) -> Doubles:
    found = np.asarray(values, dtype=np.float64)
    if found.shape != (3,) or not (np.isfinite(found).all() and (found > 0).all()):
        raise ParameterError(f"{tuple(values)} are not three factors above 0", where="response gauge")
    return found

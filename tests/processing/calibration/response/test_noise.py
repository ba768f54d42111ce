"""Noise estimated from a bracket against the simulated sensor's own."""

from __future__ import annotations

import numpy as np
import pytest

from benchmarks.photometry.synthetic_bracket import REFERENCE_SENSOR
from processing.calibration.response.curve import NoiseModel, ResponseCurve
from processing.calibration.response.response import estimate_noise
from processing.calibration.response.samples import Bracket8
from processing.errors import ResponseError
from tests.conftest import LONG
from tests.processing.calibration.response.response_cases import fitted, made, truth


def true_noise(noise: float = 1.0) -> NoiseModel:
    full_well, read = REFERENCE_SENSOR.full_well_e / noise**2, REFERENCE_SENSOR.read_noise_e / noise
    return NoiseModel((1 / full_well,) * 3, (read / full_well,) * 3)


def true_curve() -> ResponseCurve:
    return ResponseCurve(truth(), np.zeros((3, 256)), (5, 5, 5), (250, 250, 250), 255)


@pytest.mark.sweep
@pytest.mark.parametrize("noise", [3.0, 1.0] if LONG else [3.0])
def test_relative_noise_at_each_code(noise: float) -> None:
    source = made(35, noise=noise)
    found = estimate_noise([Bracket8(source.frames, source.true_s)], true_curve())
    ratio = found.relative_variance(true_curve()) / true_noise(noise).relative_variance(true_curve())
    assert np.abs(np.sqrt(ratio[:, 12:230]) - 1).max() < 0.15


def test_joint_estimate_is_as_good() -> None:
    fit = fitted()
    ratio = fit.noise.relative_variance(fit.curve) / true_noise().relative_variance(true_curve())
    assert np.abs(np.sqrt(ratio[:, 12:230]) - 1).max() < 0.15
    assert min(fit.noise.code_variance) >= 1 / 12 - 1e-12


def test_too_little_is_refused() -> None:
    black = np.zeros((50, 50, 3), dtype=np.uint8)
    with pytest.raises(ResponseError):
        estimate_noise([Bracket8([black, black], (1.0, 0.5))], true_curve())

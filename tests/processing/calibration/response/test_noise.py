"""Noise estimated from a bracket against the simulated sensor's own."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from mocks.optics.synthetic_bracket import REFERENCE_SENSOR
from processing.calibration.response.curve import NoiseModel, ResponseCurve
from processing.calibration.response.quality import neutral_factors, regauge, regauge_noise
from processing.calibration.response.response import Bracket8, estimate_noise
from processing.errors import ParameterError, ResponseError
from tests.processing.calibration.response.response_cases import fitted, made, truth


def true_noise(noise: float = 1.0) -> NoiseModel:
    full_well, read = REFERENCE_SENSOR.full_well_e / noise**2, REFERENCE_SENSOR.read_noise_e / noise
    return NoiseModel((1 / full_well,) * 3, (read / full_well,) * 3)


def true_curve() -> ResponseCurve:
    return ResponseCurve(truth(), np.zeros((3, 256)), (5, 5, 5), (250, 250, 250), 255)


@pytest.mark.parametrize("noise", [1.0, 3.0])
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


def test_another_gauge_changes_no_relative_noise() -> None:
    factors = (0.5, 1.0, 3.0)
    before = true_noise().relative_variance(true_curve())
    after = regauge_noise(true_noise(), factors).relative_variance(regauge(true_curve(), factors))
    assert np.allclose(before, after)
    assert np.allclose(regauge(true_curve(), factors).exposure[:, 255], factors)


def test_neutral_factors_make_grey() -> None:
    seen = (0.2, 0.25, 0.4)
    assert np.allclose(np.multiply(seen, neutral_factors(seen)), 0.25)
    for bad in ((0.0, 1.0, 1.0), (1.0, float("nan"), 1.0), (1.0, 1.0)):
        with pytest.raises(ParameterError):
            regauge(true_curve(), bad)


def test_curve_keeps_its_other_facts() -> None:
    curve = replace(true_curve(), method="robertson")
    assert regauge(curve, (1.0, 2.0, 1.0)).method == "robertson"

"""The all-weather sky: against values of Radiance's gendaylit, and what it must look like."""

from __future__ import annotations

import math

import numpy as np
import pytest

from processing.relighting.weather import clearness, coefficients, relative_luminance


@pytest.mark.parametrize(
    ("elevation_deg", "normal_w", "diffuse_w", "expected"),
    [
        (40, 700, 100, (-0.975, -0.211, 14.59, -3.911, 0.588)),
        (40, 0, 150, (0.877, -0.575, 0.607, -0.470, -0.0245)),
        (20, 300, 120, (-1.213, -0.644, 11.32, -3.184, 0.0318)),
        (60, 850, 60, (-1.005, -0.226, 22.63, -6.350, 1.269)),
    ],
)
def test_coefficients_are_those_of_gendaylit(elevation_deg, normal_w, diffuse_w, expected) -> None:
    zenith = math.radians(90 - elevation_deg)
    mass = 1 / (math.sin(math.radians(elevation_deg)) + 0.15 * (elevation_deg + 3.885) ** -1.253)
    found = coefficients(clearness(diffuse_w, normal_w, zenith), diffuse_w * mass / 1367, zenith)
    assert found == pytest.approx(expected, rel=0.06, abs=0.02)


def test_clear_skies_are_brightest_around_the_sun_and_overcast_ones_above() -> None:
    rays = np.array([[0.0, 0, 1], [0, 0.7071, 0.7071], [0, -0.7071, 0.7071], [0, 0.9998, 0.02], [0, 1, 0]])
    sun = (0.0, math.sqrt(0.5), math.sqrt(0.5))
    clear = relative_luminance(rays, sun, coefficients(8.0, 0.1, math.pi / 4))
    assert clear.argmax() == 1
    assert clear[1] > 5 * clear[2]
    overcast = relative_luminance(rays, sun, coefficients(1.0, 0.2, math.pi / 4))
    assert overcast[0] > overcast[3]
    assert overcast[1] == pytest.approx(overcast[2], rel=0.4)


def test_every_sky_is_finite_and_not_negative() -> None:
    rays = np.random.default_rng(1).normal(size=(500, 3))
    rays[:, 2] = np.abs(rays[:, 2])
    rays /= np.linalg.norm(rays, axis=1, keepdims=True)
    for epsilon in (1.0, 1.06, 1.07, 1.3, 1.7, 2.2, 3.0, 5.0, 7.0, 50.0):
        for brightness in (0.0, 0.01, 0.1, 0.4, 0.8):
            for zenith in (0.0, 0.7, 1.5):
                sun = (math.sin(zenith), 0.0, math.cos(zenith))
                found = relative_luminance(rays, sun, coefficients(epsilon, brightness, zenith))
                assert np.isfinite(found).all()
                assert (found >= 0).all()

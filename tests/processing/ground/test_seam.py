"""Masks on the sphere: components round the seam, growth in angles, at the poles too."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from processing.ground import seam
from processing.ground.seam import components, grown, resized, share_of_sphere, smoothed
from processing.sphere import Equirectangular, directions, pixels

ROWS = 46


def test_a_component_goes_round_the_seam() -> None:
    mask = np.zeros((20, 40), bool)
    mask[5, :3] = mask[6, -3:] = True
    mask[12, 10:14] = True
    count, labels = components(mask)
    assert count == 2
    assert labels[5, 0] == labels[6, -1] != labels[12, 12]
    assert (labels[~mask] == 0).all()


def test_all_pixels_of_a_pole_s_row_meet() -> None:
    mask = np.zeros((20, 40), bool)
    mask[-3:, 4] = mask[-3:, 24] = True
    assert components(mask)[0] == 1
    assert components(np.zeros((4, 8), bool))[0] == 0
    assert components(np.ones((4, 8), bool))[0] == 1


@settings(max_examples=20, deadline=None)
@given(longitude=st.floats(-math.pi, math.pi), latitude=st.floats(-1.57, 1.57), angle=st.floats(0.1, 0.4))
def test_growth_is_a_disc_on_the_sphere_wherever_it_is(longitude: float, latitude: float, angle: float) -> None:
    geometry = Equirectangular(2 * ROWS, ROWS)
    centre = np.array(
        [math.cos(latitude) * math.sin(longitude), math.cos(latitude) * math.cos(longitude), math.sin(latitude)]
    )
    x, y, _ = pixels(geometry, centre)
    mask = np.zeros((ROWS, 2 * ROWS), bool)
    row, column = min(int(y), ROWS - 1), int(x) % (2 * ROWS)
    mask[row, column] = True
    d, _ = directions(geometry)
    away = np.arccos(np.clip(d @ d[row, column], -1, 1))
    found = grown(mask, angle)
    assert found[away < angle - 1e-6].all()
    assert not found[away > angle + 1e-6].any()


def test_growing_nothing_and_by_nothing() -> None:
    mask = np.zeros((8, 16), bool)
    assert not grown(mask, 0.5).any()
    mask[3, 3] = True
    np.testing.assert_array_equal(grown(mask, 0.0), mask)


def test_shares_are_by_solid_angle() -> None:
    mask = np.zeros((ROWS, 2 * ROWS), bool)
    mask[: ROWS // 2] = True
    assert share_of_sphere(mask) == pytest.approx(0.5, abs=1e-12)
    assert share_of_sphere(np.ones((4, 8), bool)) == pytest.approx(1.0)


def test_resizing_and_smoothing_go_round_and_keep_what_is_even() -> None:
    even = np.full((16, 32, 2), 0.7, np.float32)
    for shape in ((16, 32), (8, 16), (48, 96)):
        np.testing.assert_allclose(resized(even, shape), 0.7, rtol=1e-5)
    np.testing.assert_allclose(smoothed(even, 0.3), 0.7, rtol=1e-5)
    spot = np.zeros((16, 32), np.float32)
    spot[8, 0] = 1.0
    assert smoothed(spot, 0.3)[8, -1] == pytest.approx(smoothed(spot, 0.3)[8, 1])
    large = resized(spot, (32, 64))
    assert large[16, -1] == pytest.approx(large[16, 2], abs=1e-6)
    many = np.ones((17, 34, 8), np.float32)
    for shape in ((8, 17), (40, 90)):
        assert resized(many, shape).shape == (*shape, 8)
        apart = np.stack([resized(many[..., k], shape) for k in range(8)], axis=-1)
        np.testing.assert_allclose(resized(many, shape), apart, atol=1e-6)


@pytest.mark.parametrize("shape", [(128, 256), (127, 254, 2)])
def test_a_wide_gaussian_is_worked_out_at_half_the_size_to_two_percent(monkeypatch, shape: tuple[int, ...]) -> None:
    values = np.random.default_rng(0).random(shape).astype(np.float32)
    values[shape[0] // 3 :, : shape[1] // 2] += 2
    halved: list[tuple[int, int]] = []
    monkeypatch.setattr(seam, "resized", lambda one, size: halved.append(size) or resized(one, size))
    wide_rad, narrow_rad = 20 / 128 * math.pi, 5 / 128 * math.pi
    found, narrow = smoothed(values, wide_rad), smoothed(values, narrow_rad)
    assert min(halved) == (32, 64)  # by two halvings to a standard deviation of five pixels
    monkeypatch.setattr(seam, "WIDE_PX", math.inf)
    off = np.abs(found - smoothed(values, wide_rad)) / np.ptp(values)
    assert off.max() < 0.02
    assert np.median(off) < 0.004
    np.testing.assert_array_equal(narrow, smoothed(values, narrow_rad))

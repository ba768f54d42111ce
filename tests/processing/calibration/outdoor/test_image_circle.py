"""The image circle found in simulated brackets, through dark skies, flare and noise; and refused where none is seen."""

from __future__ import annotations

import math

import numpy as np
import numpy.typing as npt
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st

from processing.calibration.outdoor.lens import ImageCircle, find_image_circle
from processing.errors import LensError

SIZE = (480, 320)


def scene(
    centre: tuple[float, float], radius: float, *, inside: float = 120.0, surround: float = 2.0, seed: int = 0
) -> npt.NDArray[np.uint8]:
    """Return codes of a mottled scene inside a circle, area-sampled at its edge, with noise."""
    rng = np.random.default_rng(seed)
    x, y = np.arange(SIZE[0]) + 0.5, np.arange(SIZE[1])[:, None] + 0.5
    cover = np.clip(radius + 0.5 - np.hypot(x - centre[0], y - centre[1]), 0, 1)
    mottled = inside * (0.7 + 0.3 * np.sin(x / 17.0) * np.cos(y / 23.0))
    picture = surround + cover * mottled + rng.normal(0, 1.0, cover.shape)
    return np.repeat(np.clip(picture, 0, 255).astype(np.uint8)[..., None], 3, axis=-1)


@settings(max_examples=12, deadline=None)
@example(dx=1.25, dy=3.0, radius=90.0, inside=41.0, seed=3)
@given(
    dx=st.floats(-15, 15),
    dy=st.floats(-8, 8),
    radius=st.floats(90, 140),
    inside=st.floats(30, 220),
    seed=st.integers(0, 99),
)
def test_circle_is_found_to_a_part_of_a_pixel(dx: float, dy: float, radius: float, inside: float, seed: int) -> None:
    found = find_image_circle(scene((240 + dx, 160 + dy), radius, inside=inside, seed=seed))
    assert found.size_px == SIZE
    assert math.dist(found.centre_px, (240 + dx, 160 + dy)) < 0.4
    assert abs(found.radius_px - radius) < 0.5
    assert found.sigma_px < 0.5
    assert found.support > 0.5


def test_a_bracket_with_dark_and_clipped_frames() -> None:
    good = scene((243.0, 158.5), 131.0)
    frames = [np.zeros_like(good), good, np.full_like(good, 255), (good // 12).astype(np.uint8)]
    found = find_image_circle(frames)
    assert math.dist(found.centre_px, (243.0, 158.5)) < 0.3
    assert abs(found.radius_px - 131.0) < 0.5


def test_a_third_of_the_sky_dark_and_flare_outside() -> None:
    picture = scene((240.0, 160.0), 130.0).astype(float)
    x, y = np.arange(SIZE[0]) + 0.5, np.arange(SIZE[1])[:, None] + 0.5
    picture[(np.arctan2(y - 160, x - 240) > 0.5) & (np.arctan2(y - 160, x - 240) < 2.6)] = 2.0
    flare = np.hypot(x - 420, y - 60)[..., None]
    picture += 150 * np.exp(-((flare / 25.0) ** 2))
    picture[:, 400:410] += 60.0
    found = find_image_circle(np.clip(picture, 0, 255).astype(np.uint8))
    assert math.dist(found.centre_px, (240.0, 160.0)) < 1.0
    assert abs(found.radius_px - 130.0) < 1.0


def test_an_edge_that_stray_light_makes_flat() -> None:
    """A full-frame bracket of a fisheye was refused: no edge within three of its pixels was steep enough."""
    x, y = np.arange(3000) + 0.5, np.arange(2000)[:, None] + 0.5
    beyond = np.hypot(x - 1510, y - 990) - 960
    field = (1 + 0.3 * np.sin(x / 170) * np.cos(y / 230)) * np.clip(0.5 - beyond / 48, 0, 1)
    picture = (field + 0.12 * np.exp(-np.clip(beyond, 0, None) / 300)).astype(np.float32)
    found = find_image_circle(picture)
    assert math.dist(found.centre_px, (1510, 990)) < 8
    assert abs(found.radius_px - 960) < 24
    assert found.size_px == (3000, 2000)


def test_a_linear_picture_with_a_sun() -> None:
    picture = scene((240.0, 160.0), 130.0).astype(np.float32) * 40
    picture[100:103, 200:203] = 1e9
    found = find_image_circle(picture)
    assert abs(found.radius_px - 130.0) < 0.6


@pytest.mark.parametrize("level", [0, 3, 255])
def test_nothing_to_see_is_refused(level: int) -> None:
    with pytest.raises(LensError, match="no image circle"):
        find_image_circle(np.full((120, 180, 3), level, dtype=np.uint8))


def test_noise_and_full_frames_are_refused() -> None:
    rng = np.random.default_rng(1)
    with pytest.raises(LensError):
        find_image_circle(rng.integers(0, 30, (120, 180, 3)).astype(np.uint8))
    with pytest.raises(LensError, match="different sizes"):
        find_image_circle([np.zeros((40, 60), np.uint8), np.zeros((60, 40), np.uint8)])
    with pytest.raises(LensError, match="no picture"):
        find_image_circle(np.zeros((4, 4), np.uint8))


def test_nan_in_a_linear_picture_does_not_spread() -> None:
    picture = scene((240.0, 160.0), 130.0).astype(np.float32)
    picture[::37, ::41] = np.nan
    assert abs(find_image_circle(picture).radius_px - 130.0) < 0.8


def test_a_circle_scales_with_its_picture() -> None:
    circle = ImageCircle((2400.0, 1600.0), 1300.0, (4800, 3200), 0.5)
    small = circle.scaled((480, 320))
    assert small.centre_px == (240.0, 160.0)
    assert small.radius_px == 130.0
    with pytest.raises(LensError, match="circle of a 4800x3200"):
        circle.scaled((480, 480))

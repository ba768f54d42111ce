"""What the compact network is shown."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from processing.errors import ParameterError
from processing.segmentation.embedded import MIDDLE, SEEN_HEIGHT_PX, SEEN_WIDTH_PX, curve, network_picture


def room(rows: int = 64) -> np.ndarray:
    rng = np.random.default_rng(3)
    picture = np.full((rows, 2 * rows, 3), 0.4, np.float32)
    picture[rows // 2 :] *= (0.5, 0.4, 0.3)
    picture[rows // 4 : rows // 2, rows // 2 : rows] = 5.0
    return picture * rng.uniform(0.9, 1.1, picture.shape).astype(np.float32)


@pytest.mark.parametrize("rows", [4, 5, 17, 64, 128, 200, 512])
def test_any_size_gives_the_same_small_picture(rows: int) -> None:
    shown = network_picture(room(rows))
    assert shown.shape == (SEEN_HEIGHT_PX, SEEN_WIDTH_PX, 3)
    assert shown.dtype == np.float32
    assert 0 <= shown.min() <= shown.max() < 1


@given(scale=st.floats(1e-20, 1e20))
@settings(max_examples=25, deadline=None)
def test_the_scale_does_not_matter(scale: float) -> None:
    picture = room(32).astype(np.float64)
    np.testing.assert_allclose(network_picture(picture * scale), network_picture(picture), atol=2e-4)


def test_the_sun_stays_in_its_pixel() -> None:
    picture = room(512)
    plain = network_picture(picture)
    picture[200, 402] = 1.6e9 / 500
    with_sun = network_picture(picture)
    changed = np.abs(with_sun - plain).max(axis=2) > 1e-3
    assert changed.sum() == 1
    assert changed[100, 201]


def test_black_stays_black_and_a_median_is_middle_grey() -> None:
    assert not network_picture(np.zeros((16, 32, 3), np.float32)).any()
    grey = network_picture(np.full((16, 32, 3), 123.0, np.float32))
    np.testing.assert_allclose(grey, curve(np.float32(MIDDLE)), atol=1e-5)


def test_black_caps_do_not_change_the_exposure() -> None:
    whole = np.full((64, 128, 3), 0.3, np.float32)
    capped = whole.copy()
    capped[:24] = 0
    capped[50:] = 0
    assert network_picture(capped)[128, 256, 0] == pytest.approx(network_picture(whole)[128, 256, 0], abs=1e-6)


def test_the_seam_is_whole_in_pictures_smaller_than_the_copy() -> None:
    picture = room(16)
    turned = network_picture(np.roll(picture, 8, axis=1))
    np.testing.assert_allclose(turned, np.roll(network_picture(picture), 128, axis=1), atol=1e-5)


@pytest.mark.parametrize("bad", [np.nan, np.inf, -1e-6])
def test_values_that_light_cannot_have_are_refused(bad: float) -> None:
    picture = room(32)
    picture[7, 9, 1] = bad
    with pytest.raises(ParameterError, match="rows 0 to 31"):
        network_picture(picture)


@pytest.mark.parametrize("shape", [(32, 64), (32, 64, 4), (3, 8, 3), (0, 0, 3)])
def test_shapes_are_checked(shape: tuple[int, ...]) -> None:
    with pytest.raises(ParameterError, match="shape"):
        network_picture(np.ones(shape, np.float32))

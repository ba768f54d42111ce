"""False colours: order, ends, no data, legends; previews and their files."""

from __future__ import annotations

import io
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from PIL import Image

from processing.errors import ParameterError
from processing.pictures.false_colour import (
    GHOST_COLOUR,
    NO_DATA,
    VALIDITY_COLOURS,
    display_range,
    false_colour,
    legend,
    legend_ticks,
    uncertainty_picture,
    validity_overlay,
    with_legend,
)
from processing.pictures.images import Validity, luminance_cd_m2
from processing.pictures.preview import KEY, jpeg_bytes, png_bytes, preview_rgb8, write_mask

ENDS = st.tuples(st.floats(1e-6, 1e8), st.floats(1.01, 1e9)).map(lambda pair: (pair[0], pair[0] * pair[1]))


def test_scale_is_logarithmic_and_ends_are_kept() -> None:
    values = np.geomspace(1, 1000, 256)[None]
    table = false_colour(values, 1, 1000)[0]
    ratio = false_colour(np.array([[0.001, 1, 31.6227766, 1000, 1.6e9]]), 1, 1000)[0]
    np.testing.assert_array_equal(ratio[0], ratio[1])
    np.testing.assert_array_equal(ratio[3], ratio[4])
    assert np.abs(ratio[2].astype(int) - table[128]).max() <= 4
    assert len({tuple(colour) for colour in table}) > 200


def test_viridis_grows_lighter() -> None:
    lightness = luminance_cd_m2(false_colour(np.geomspace(1, 100, 64)[None], 1, 100, colours="viridis")[0])
    assert (np.diff(lightness) > -1).all()
    assert lightness[-1] > 3 * lightness[0]


def test_no_data_is_grey() -> None:
    shown = false_colour(np.array([[0.0, -1.0, np.nan, np.inf]]), 1, 10)
    assert (shown == np.array(NO_DATA, np.uint8)).all()
    assert (uncertainty_picture(np.full((2, 3), np.inf, np.float32)) == np.array(NO_DATA, np.uint8)).all()


@pytest.mark.parametrize(("low", "high"), [(0, 1), (-1, 1), (2, 2), (3, 2), (np.nan, 1), (1, np.inf)])
def test_scales_that_are_none(low: float, high: float) -> None:
    with pytest.raises(ParameterError):
        false_colour(np.ones((2, 2)), low, high)
    with pytest.raises(ParameterError):
        legend(low, high, "cd/m2", 100)
    with pytest.raises(ParameterError):
        false_colour(np.ones((2, 2)), 1, 2, colours="rainbow")


@settings(max_examples=80, deadline=None)
@given(st.lists(st.floats(0, 1.7e9, width=32), min_size=1, max_size=30))
def test_display_range_holds_the_values(values: list[float]) -> None:
    low, high = display_range(np.array(values))
    assert 0 < low < high
    lit = [v for v in values if v > 0]
    if lit and min(lit) > 1e-30:
        assert low <= min(lit) * (1 + 1e-6)
        assert max(lit) <= high * (1 + 1e-6)
    for end in (low, high):
        assert f"{end:.6e}"[:3] in ("1.0", "3.0")


@settings(max_examples=80, deadline=None)
@given(ENDS, st.integers(0, 60))
def test_ticks_are_round_inside_and_fit(ends: tuple[float, float], room: int) -> None:
    ticks = legend_ticks(*ends, room)
    assert len(ticks) <= max(room, 2)
    assert ticks == sorted(ticks)
    assert all(ends[0] * (1 - 1e-8) <= t <= ends[1] * (1 + 1e-8) for t in ticks)
    assert all(f"{t:.0e}"[0] in "1235" for t in ticks)


def test_legend_stands_beside_the_picture() -> None:
    picture = false_colour(np.geomspace(1, 1000, 200 * 300).reshape(200, 300), 1, 1000)
    scale = legend(1, 1000, "cd/m2", 200)
    whole = with_legend(picture, scale)
    assert whole.shape == (200, 300 + scale.shape[1], 3)
    np.testing.assert_array_equal(whole[:, :300], picture)
    tiny = with_legend(picture[:5], legend(1, 1000, "cd/m2", 5))
    assert tiny.shape[0] == 80
    np.testing.assert_array_equal(legend(1, 1000, "cd/m2", 200), scale)


def test_overlay_shows_what_pixels_are_worth() -> None:
    rgb8 = np.full((20, 30, 3), 120, np.uint8)
    validity = np.zeros((20, 30), np.uint8)
    for row, code in enumerate(VALIDITY_COLOURS):
        validity[row] = code
    ghost = np.zeros((20, 30), np.uint8)
    ghost[10:15, 10:20] = 4
    shown = validity_overlay(rgb8, validity, ghost)
    for row, colour in enumerate(VALIDITY_COLOURS.values()):
        assert tuple(shown[row, 0]) == colour
    assert tuple(shown[10, 10]) == GHOST_COLOUR
    assert shown[12, 15, 1] > shown[12, 15, 0]
    assert tuple(shown[8, 0]) == (96, 96, 96)
    assert int(max(VALIDITY_COLOURS)) == max(Validity)


def test_preview_of_grey_and_of_ends() -> None:
    flat = preview_rgb8(np.full((8, 16, 3), 50.0, np.float32))
    linear = KEY * (1 + KEY) / (1 + KEY)
    expected = 255 * (1.055 * linear ** (1 / 2.4) - 0.055)
    assert abs(int(flat[0, 0, 0]) - expected) <= 1
    assert (preview_rgb8(np.zeros((8, 16, 3), np.float32)) == 0).all()
    sun = np.full((64, 128, 3), 1.0, np.float32)
    sun[0, 0] = 1.6e9
    shown = preview_rgb8(sun)
    assert (shown[0, 0] == 255).all()
    assert 80 < shown[10, 10, 0] < 200


def test_preview_keeps_the_order_of_light() -> None:
    ramp = np.repeat(np.geomspace(0.01, 1e5, 200, dtype=np.float32)[None, :, None], 3, axis=2)
    assert (np.diff(preview_rgb8(ramp)[0, :, 1].astype(int)) >= 0).all()


def test_jpeg_and_png_files(tmp_path: Path) -> None:
    ramp = np.linspace(0.5, 3, 32 * 64, dtype=np.float32).reshape(32, 64, 1)
    rgb8 = preview_rgb8(np.repeat(ramp, 3, axis=2))
    data = jpeg_bytes(rgb8)
    assert data == jpeg_bytes(rgb8)
    with Image.open(io.BytesIO(data)) as opened:
        assert np.abs(np.asarray(opened).astype(int) - rgb8).max() <= 3
    mask = rgb8[..., 0] > 100
    write_mask(tmp_path / "m.png", mask)
    with Image.open(tmp_path / "m.png") as opened:
        np.testing.assert_array_equal(np.asarray(opened), mask * 255)
    assert png_bytes(rgb8) == png_bytes(rgb8)
    for wrong in (rgb8[..., :2], rgb8.astype(np.float32), rgb8[:0]):
        with pytest.raises(ParameterError):
            jpeg_bytes(wrong)

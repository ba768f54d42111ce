"""Numbers in the page: exact to what is stated, at every end, and the other half's arithmetic."""

from __future__ import annotations

import base64
import zlib

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from processing.report.states import (
    LARGEST_ERROR,
    LEAST,
    NO_VALUE,
    SHAPE,
    STEP,
    luminance_codes,
    packed,
    picture_codes,
    uncertainty_codes,
)


def luminance_of(codes: np.ndarray) -> np.ndarray:
    """What the page reads out of codes."""
    return np.where(codes == NO_VALUE, np.nan, LEAST * np.exp((codes.astype(np.float64) - 1) * STEP))


def unpacked(text: str, shape: tuple[int, int], size: int) -> np.ndarray:
    """The inverse of `packed`, the way the page does it."""
    planes = np.frombuffer(zlib.decompress(base64.b64decode(text)), np.uint8).reshape(size, -1).astype(np.int64)
    folded = planes[0] if size == 1 else planes[0] * 256 + planes[1]
    difference = np.where(folded & 1, -((folded + 1) >> 1), folded >> 1).reshape(shape)
    return difference.cumsum(axis=1) % (1 << (8 * size))


@settings(max_examples=100, deadline=None)
@given(st.floats(LEAST, 1e20))
def test_luminance_is_as_exact_as_stated(value: float) -> None:
    found = float(luminance_of(luminance_codes(np.array(value))))
    assert abs(found / value - 1) <= LARGEST_ERROR * 1.0001


def test_luminance_at_its_ends() -> None:
    codes = luminance_codes(np.array([0.0, -1.0, np.nan, np.inf, 1e-9, 1.6e9]))
    assert list(codes[:4]) == [NO_VALUE] * 4
    assert luminance_of(codes[4:5])[0] == pytest.approx(LEAST)
    assert luminance_of(codes[5:])[0] == pytest.approx(1.6e9, rel=LARGEST_ERROR)
    assert np.isnan(luminance_of(codes[:1])[0])


@settings(max_examples=50, deadline=None)
@given(st.floats(1e-4, 10.0))
def test_uncertainty_to_a_few_per_cent_of_itself(value: float) -> None:
    code = int(uncertainty_codes(np.array(value)))
    assert 1e-4 * 1e5 ** ((code - 1) / 254) == pytest.approx(value, rel=0.024)


def test_unknown_uncertainty_has_no_code() -> None:
    assert list(uncertainty_codes(np.array([np.inf, np.nan, 0.0, 1e3]))) == [0, 0, 1, 255]


@pytest.mark.parametrize("size", [1, 2])
def test_maps_come_back_bit_by_bit(size: int) -> None:
    kind = np.uint8 if size == 1 else np.uint16
    rng = np.random.default_rng(3)
    codes = rng.integers(0, np.iinfo(kind).max, (7, 13), endpoint=True).astype(kind)
    codes[0, :4] = (0, np.iinfo(kind).max, 0, np.iinfo(kind).max // 2)
    assert (unpacked(packed(codes), codes.shape, size) == codes).all()


def test_pictures_keep_thirteen_stops_to_either_side() -> None:
    middle = 50.0
    stops = np.arange(-13.0, 13.1, 0.5)
    light = (middle * 2**stops).astype(np.float32)
    codes = picture_codes(np.repeat(light[None, :, None], 3, axis=2), middle)[0, :, 0].astype(float)
    assert (np.diff(codes) >= 0).all()
    back = middle * (codes / np.maximum(255 - codes, 0.25)) ** (1 / SHAPE)
    error = np.abs(np.log2(np.maximum(back, 1e-9) / light))
    assert error[np.abs(stops) <= 5].max() < 0.06
    assert error[np.abs(stops) <= 2].max() < 0.025
    assert codes[np.abs(stops) <= 9][::4].tolist() == sorted(set(codes[np.abs(stops) <= 9][::4])), "2 stops are seen"
    assert (codes[0], codes[-1]) == (0, 255)
    assert picture_codes(np.full((1, 1, 3), 1.6e9, np.float32), middle).min() == 255

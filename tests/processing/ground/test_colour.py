"""Our few lines of colour against colour-science."""

from __future__ import annotations

import warnings
from typing import Any

import numpy as np
import pytest

from processing.ground.colour import (
    LUMINANCE_WEIGHTS,
    RGB_OF_XYZ,
    XYZ_OF_RGB,
    colour_temperature_k,
    lab_of_linear,
    linear_of_srgb,
    luminance_cd_m2,
    srgb_decoded,
    srgb_encoded,
    srgb_of_linear,
)

LIGHT = np.linspace(0, 1, 4001)


@pytest.fixture(scope="module")
def colour() -> Any:
    """A second: every worker collects this file, one runs it."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        import colour

    return colour


def test_the_curve_is_that_of_the_standard(colour: Any) -> None:
    # colour-science keeps the knees where both branches meet to 1e-8; IEC 61966-2-1 rounds them.
    np.testing.assert_allclose(srgb_encoded(LIGHT), colour.models.eotf_inverse_sRGB(LIGHT), atol=1e-7)
    np.testing.assert_allclose(srgb_decoded(LIGHT), colour.models.eotf_sRGB(LIGHT), atol=1e-7)
    np.testing.assert_allclose(srgb_decoded(srgb_encoded(LIGHT)), LIGHT, atol=1e-7)


@pytest.mark.parametrize("dtype", [np.float32, np.float64])
def test_the_curve_keeps_the_type(dtype: type) -> None:
    assert srgb_encoded(LIGHT.astype(dtype)).dtype == dtype
    assert srgb_decoded(LIGHT.astype(dtype)).dtype == dtype


def test_bytes_come_back(colour: Any) -> None:
    codes = np.arange(256, dtype=np.uint8)
    assert (srgb_of_linear(linear_of_srgb(codes)) == codes).all()
    assert srgb_of_linear([-1.0, 0.0, 1.0, 7.0]).tolist() == [0, 0, 255, 255]
    exact = np.rint(255 * colour.models.eotf_inverse_sRGB(LIGHT))
    assert np.abs(srgb_of_linear(LIGHT).astype(int) - exact).max() <= 1
    deep = np.array([0, 1, 257, 65535], np.uint16)
    np.testing.assert_allclose(linear_of_srgb(deep), colour.models.eotf_sRGB(deep / 65535), rtol=1e-5)


def test_matrices(colour: Any) -> None:
    space = colour.RGB_COLOURSPACES["ITU-R BT.709"]
    exact = colour.models.normalised_primary_matrix(space.primaries, space.whitepoint)
    np.testing.assert_allclose(XYZ_OF_RGB, exact, atol=1e-9)
    np.testing.assert_allclose(RGB_OF_XYZ, np.linalg.inv(exact), atol=1e-8)
    np.testing.assert_allclose(LUMINANCE_WEIGHTS, exact[1], atol=1e-4)
    assert luminance_cd_m2([[10.0, 20.0, 30.0]]) == pytest.approx(2.127 + 14.302 + 2.166)
    assert sum(LUMINANCE_WEIGHTS) == pytest.approx(1)


def test_lab_is_relative_to_the_white(colour: Any) -> None:
    rgb = np.random.default_rng(3).uniform(0.01, 1, (24, 3))
    white = np.array([1.0, 1.0, 1.0])
    xyz = colour.RGB_to_XYZ(rgb, "sRGB", apply_cctf_decoding=False)
    np.testing.assert_allclose(lab_of_linear(rgb, white), colour.XYZ_to_Lab(xyz), atol=0.05)
    np.testing.assert_allclose(lab_of_linear(white[None] * 7, white * 7), [[100, 0, 0]], atol=1e-6)


def rgb_of_uv(colour: Any, uv: np.ndarray) -> np.ndarray:
    """Return linear RGB of luminance 1 with these u, v of 1960."""
    x, y = colour.UCS_uv_to_xy(uv).T
    return np.stack([x / y, np.ones_like(y), (1 - x - y) / y], axis=-1) @ np.array(RGB_OF_XYZ).T


@pytest.mark.parametrize("duv", [-0.02, 0.0, 0.02])
def test_colour_temperature_against_ohno(colour: Any, duv: float) -> None:
    kelvin = np.geomspace(2000, 20_000, 60)
    uv = np.array([colour.temperature.CCT_to_uv_Ohno2013(np.array([t, duv])) for t in kelvin])
    found, meaningful = colour_temperature_k(rgb_of_uv(colour, uv)[None])
    assert meaningful.all()
    np.testing.assert_allclose(found[0], kelvin, rtol=1e-3)


def test_far_from_the_locus_and_black_mean_nothing() -> None:
    picture = np.array([[[1, 0, 0], [0, 1, 0], [0, 0, 1], [0, 0, 0], [1, 1, 1]]], np.float32)
    found, meaningful = colour_temperature_k(picture)
    assert meaningful[0].tolist() == [False, False, False, False, True]
    assert (found[0, :4] == 0).all()
    assert found[0, 4] == pytest.approx(6504, abs=8)


def test_brightness_does_not_matter() -> None:
    rgb = np.random.default_rng(1).uniform(0.3, 1, (20, 30, 3))
    np.testing.assert_allclose(colour_temperature_k(rgb * 1.6e9)[0], colour_temperature_k(rgb)[0], rtol=1e-4)

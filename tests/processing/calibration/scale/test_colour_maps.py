"""Chromaticity and CCT against colour-science."""

from __future__ import annotations

import warnings

import numpy as np
import pytest

from processing.calibration.scale.colour_maps import XYZ_OF_RGB, cct_map, chromaticity, uniform_chromaticity

with warnings.catch_warnings():
    warnings.simplefilter("ignore")
    import colour


def rgb_of_uv(uv: np.ndarray) -> np.ndarray:
    """Return linear RGB of luminance 1 with these u, v of 1960."""
    x, y = colour.UCS_uv_to_xy(uv).T
    xyz = np.stack([x / y, np.ones_like(y), (1 - x - y) / y], axis=-1)
    return xyz @ np.linalg.inv(np.array(XYZ_OF_RGB)).T


@pytest.mark.parametrize("duv", [-0.02, -0.01, 0.0, 0.01, 0.02])
def test_cct_against_ohno(duv: float) -> None:
    kelvin = np.geomspace(2000, 20_000, 60)
    uv = np.array([colour.temperature.CCT_to_uv_Ohno2013(np.array([t, duv])) for t in kelvin])
    rgb = rgb_of_uv(uv)[None]
    found = cct_map(rgb)
    assert found.meaningful.all()
    np.testing.assert_allclose(found.cct_k[0], kelvin, atol=1.0)
    np.testing.assert_allclose(found.duv[0], duv, atol=5e-6)


def test_daylight_white() -> None:
    found = cct_map(np.ones((1, 1, 3)))
    assert found.cct_k[0, 0] == pytest.approx(6504, abs=5)
    assert found.duv[0, 0] == pytest.approx(0.0032, abs=2e-4)


def test_far_from_the_locus_and_black_mean_nothing() -> None:
    picture = np.array([[[1, 0, 0], [0, 1, 0], [0, 0, 1], [0, 0, 0], [1, 1, 1]]], np.float32)
    found = cct_map(picture)
    assert found.meaningful[0].tolist() == [False, False, False, False, True]
    assert (found.cct_k[0, :4] == 0).all()
    assert np.isfinite(found.cct_k).all()
    assert np.isfinite(found.duv).all()


def test_brightness_does_not_matter() -> None:
    rng = np.random.default_rng(1)
    rgb = rng.uniform(0.3, 1, (20, 30, 3))
    np.testing.assert_allclose(cct_map(rgb * 1.6e9).cct_k, cct_map(rgb).cct_k, rtol=1e-4)


def test_chromaticity_against_colour_science() -> None:
    rgb = np.random.default_rng(2).uniform(0.01, 1, (50, 3))
    xyz = colour.RGB_to_XYZ(rgb, "sRGB", apply_cctf_decoding=False)
    xy, exists = chromaticity(rgb)
    assert exists.all()
    np.testing.assert_allclose(xy, colour.XYZ_to_xy(xyz), atol=2e-4)
    uv, _ = uniform_chromaticity(rgb)
    np.testing.assert_allclose(uv, colour.xy_to_Luv_uv(colour.XYZ_to_xy(xyz)), atol=2e-4)
    black, exists = chromaticity(np.zeros((2, 2, 3)))
    assert not exists.any()
    assert (black == 0).all()

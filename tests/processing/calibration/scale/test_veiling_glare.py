"""Veiling glare: its kernel found around the image circle, taken off with its doubt; bounded by dark places."""

from __future__ import annotations

import math

import numpy as np
import pytest

from processing.calibration.scale.glare_fit import GlareKernel
from processing.calibration.scale.veiling_glare import (
    bound_from_darkest,
    kernel_from_surround,
    kernel_modes,
    without_glare,
)
from processing.errors import LensError, ParameterError
from processing.pictures.images import LuminanceImage, Validity, luminance_cd_m2
from processing.pictures.modes import widened
from processing.sphere import Equirectangular, Fisheye, LensMapping
from tests.processing.pictures.picture_strategies import luminance_image

WIDE, HIGH, RADIUS, EVEN = 180, 120, 50.0, 0.01
LENS = Fisheye(WIDE, HIGH, LensMapping.EQUISOLID, RADIUS, math.pi / 2)
NOTHING = tuple((0.0,) * 4 for _ in range(4))


def taken(near: float = 0.0, even: float = EVEN) -> tuple[np.ndarray, np.ndarray]:
    """Return an uncropped picture with a window, what it would be without glare: Gaussian of 9 degrees, and even."""
    y, x = np.indices((HIGH, WIDE)) + 0.5
    inside = np.hypot(x - WIDE / 2, y - HIGH / 2) < RADIUS
    scene = np.where(inside, 20.0, 0.0)
    scene[14:30, 85:95] = 3000.0
    sigma = 5.0
    spread = [np.exp(-0.5 * ((np.arange(n)[:, None] - np.arange(n)) / sigma) ** 2) for n in (HIGH, WIDE)]
    halo = spread[0] @ scene @ spread[1] / (2 * math.pi * sigma**2)
    seen = (1 - near - even) * scene + near * halo + even * scene[inside].mean()
    return np.repeat(seen[..., None], 3, 2).astype(np.float32), np.repeat(scene[..., None], 3, 2)


def kernel_of(picture: np.ndarray) -> GlareKernel:
    return kernel_from_surround(picture, np.zeros((HIGH, WIDE), np.uint8), LENS)


def as_image(picture: np.ndarray, validity: np.ndarray | None = None) -> LuminanceImage:
    flat = np.zeros((HIGH, WIDE), np.uint8) if validity is None else validity
    return LuminanceImage(picture, np.full(flat.shape, 0.01, np.float32), flat, LENS, 0.0)


def test_an_even_veil_is_found_and_taken_off() -> None:
    picture, scene = taken()
    kernel = kernel_of(picture)
    assert kernel.shares[-1] == pytest.approx(EVEN, rel=0.02)
    assert sum(kernel.shares[:-1]) < 0.1 * EVEN
    assert kernel.index == pytest.approx(EVEN, rel=0.02)
    clean = without_glare(as_image(picture), kernel)
    inside = scene[..., 0] > 0
    np.testing.assert_allclose(clean.rgb[inside], scene[inside], rtol=0.01)
    # Light is neither lost nor made.
    assert clean.rgb[inside].mean() == pytest.approx(picture[inside].mean(), rel=1e-3)


def test_a_halo_of_another_family_is_less_near_the_window_and_stays_within_its_doubt() -> None:
    picture, scene = taken(near=0.012, even=0.0005)
    kernel = kernel_of(picture)
    image = as_image(picture)
    clean = widened(without_glare(image, kernel), kernel_modes(without_glare(image, kernel), kernel))
    near = np.zeros((HIGH, WIDE), bool)
    near[16:28, 77:83] = near[16:28, 97:103] = True
    near &= scene[..., 0] == 20.0
    before, after = (np.abs(one[near][:, 0] / 20 - 1) for one in (picture, clean.rgb))
    assert np.median(after) < 0.9 * np.median(before)
    assert np.mean(after <= 1.96 * clean.uncertainty[near]) > 0.9


@pytest.mark.parametrize("shown", [300.0, 1000.0])
@pytest.mark.parametrize("near", [0.0, 0.012])
def test_what_a_clipped_light_scatters_is_estimated_with_the_shares_and_stays_within_its_doubt(
    shown: float, near: float
) -> None:
    picture, scene = taken(near=near, even=0.002)
    validity = np.where(picture[..., 0] > shown, Validity.CLIPPED, Validity.VALID).astype(np.uint8)
    cut = np.minimum(picture, np.float32(shown))
    kernel = kernel_from_surround(cut, validity, LENS)
    assert sum(kernel.hidden) > 0
    clean = without_glare(as_image(cut, validity), kernel)
    clean = widened(clean, kernel_modes(clean, kernel))
    dark = (scene[..., 0] == 20.0) & (validity == Validity.VALID)
    before, after = (np.abs(one[dark][:, 0] / 20 - 1) for one in (cut, clean.rgb))
    assert np.median(after) < 0.9 * np.median(before)
    assert np.mean(after <= 1.96 * clean.uncertainty[dark]) > 0.9


def test_cropped_or_unusable_surround_is_refused() -> None:
    picture, _ = taken()
    with pytest.raises(LensError, match="0 usable"):
        kernel_from_surround(picture, np.full((HIGH, WIDE), Validity.DARK, np.uint8), LENS)
    with pytest.raises(LensError, match="0 usable"):
        kernel_from_surround(picture, np.full((HIGH, WIDE), Validity.CLIPPED, np.uint8), LENS)
    beyond = Fisheye(WIDE, HIGH, LensMapping.EQUISOLID, 120.0, math.pi / 2)
    with pytest.raises(LensError):
        kernel_from_surround(picture, np.zeros((HIGH, WIDE), np.uint8), beyond)


def test_a_surround_too_dark_to_measure_is_no_veil() -> None:
    picture, _ = taken()
    validity = np.zeros((HIGH, WIDE), np.uint8)
    validity[:60] = Validity.DARK
    with pytest.raises(LensError, match="of the surround"):
        kernel_from_surround(picture, validity, LENS)


def test_values_that_light_cannot_have_are_refused() -> None:
    picture, _ = taken()
    kernel = kernel_of(picture)
    for bad in (np.nan, np.inf):
        broken = picture.copy()
        broken[60, 90] = bad
        with pytest.raises(ParameterError):
            kernel_of(broken)
        with pytest.raises(ParameterError):
            without_glare(as_image(broken), kernel)
    for shares in ((-0.1, 0, 0, 0), (np.nan, 0, 0, 0)):
        with pytest.raises(ParameterError):
            without_glare(as_image(picture), GlareKernel(shares, NOTHING, 0.0, 0.0))


def test_what_falls_below_the_glare_is_dark_and_pixels_without_light_stay() -> None:
    picture, _ = taken()
    picture[70:74, 80:84] = 0.1
    validity = np.zeros((HIGH, WIDE), np.uint8)
    validity[80:84, 80:84] = Validity.CLIPPED
    validity[90:94, 80:84] = Validity.OUTSIDE
    image = as_image(picture, validity)
    kernel = kernel_of(picture)
    clean = without_glare(image, kernel)
    assert (clean.rgb[71:73, 81:83] == 0).all()
    assert (clean.validity[70:74, 80:84] == Validity.DARK).all()
    assert np.isinf(clean.uncertainty[71:73, 81:83]).all()
    assert (clean.validity[80:84, 80:84] == Validity.CLIPPED).all()
    np.testing.assert_array_equal(clean.rgb[90:94, 80:84], picture[90:94, 80:84])
    assert np.isfinite(clean.rgb).all()
    lit = clean.rgb.min(axis=-1) > 0
    assert (clean.uncertainty[lit] >= 0.01 - 1e-6).all()


def test_a_picture_without_light_has_no_glare() -> None:
    black = np.zeros((HIGH, WIDE, 3), np.float32)
    kernel = kernel_of(black)
    assert kernel.shares == (0.0,) * 4
    assert (without_glare(as_image(black), kernel).rgb == 0).all()


def test_a_panorama_keeps_its_light_and_darkens_beside_a_lamp() -> None:
    rgb = np.full((48, 96, 3), 10.0, np.float32)
    rgb[22:26, 46:50] = 5000.0
    image = luminance_image(rgb)
    assert isinstance(image.geometry, Equirectangular)
    clean = without_glare(image, GlareKernel((0.02, 0.0, 0.0, 0.0), NOTHING, 0.0, 0.02))
    weights = np.cos((0.5 - (np.arange(48) + 0.5) / 48) * math.pi)[:, None]
    light = [float((luminance_cd_m2(one) * weights).sum()) for one in (image.rgb, clean.rgb)]
    assert light[1] == pytest.approx(light[0], rel=2e-3)
    assert clean.rgb[24, 53, 0] < 0.9 * clean.rgb[24, 5, 0]


def test_the_darkest_place_bounds_the_veil() -> None:
    rgb = np.random.default_rng(0).uniform(50, 300, (60, 120, 3)).astype(np.float32)
    rgb[10:13, 10:13] = 4.0
    veil, index = bound_from_darkest(luminance_image(rgb))
    assert veil == pytest.approx(4.0)
    assert index == pytest.approx(4.0 / luminance_cd_m2(rgb).mean(), rel=1e-3)
    assert bound_from_darkest(luminance_image(np.zeros((40, 80, 3)))) == (0.0, 0.0)
    nothing = luminance_image(rgb, validity=np.full((60, 120), Validity.CLIPPED, np.uint8))
    with pytest.raises(LensError):
        bound_from_darkest(nothing)

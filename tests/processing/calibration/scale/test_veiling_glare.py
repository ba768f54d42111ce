"""Veiling glare: found around the image circle, bounded by dark places, subtracted with its doubt."""

from __future__ import annotations

import numpy as np
import pytest

from processing.calibration.scale.veiling_glare import subtract_veil, veil_bound_from_darkest, veil_from_surround
from processing.errors import LensError, ParameterError
from processing.pictures.images import LuminanceImage, Validity, luminance_cd_m2
from tests.processing.pictures.picture_strategies import luminance_image

SIZE, RADIUS, VEIL = 120, 45.0, (2.0, 2.5, 3.0)


def veiled(seed: int = 0, noise: float = 0.05) -> tuple[np.ndarray, np.ndarray]:
    """Return an uncropped fisheye picture with a veil over all of it, and its scene without."""
    rng = np.random.default_rng(seed)
    radius = np.hypot(*(np.indices((SIZE, SIZE)) + 0.5 - SIZE / 2))
    scene = np.where(radius[..., None] < RADIUS, rng.uniform(50, 300, (SIZE, SIZE, 1)), 0.0)
    picture = (scene + np.array(VEIL)) * (1 + noise * rng.standard_normal((SIZE, SIZE, 3)))
    return picture.clip(0).astype(np.float32), scene


def test_veil_around_the_image_circle() -> None:
    picture, scene = veiled()
    found = veil_from_surround(picture, np.zeros((SIZE, SIZE), np.uint8), (SIZE / 2, SIZE / 2), RADIUS)
    np.testing.assert_allclose(found.veil_rgb, VEIL, rtol=0.01)
    field = float(scene[scene > 0].mean())
    assert found.index == pytest.approx(float(luminance_cd_m2(VEIL)) / field, rel=0.05)
    assert not found.upper_bound
    assert 0.01 < found.uncertainty < 0.1


def test_cropped_or_unusable_surround_is_refused() -> None:
    picture, _ = veiled()
    with pytest.raises(LensError, match="0 usable"):
        veil_from_surround(picture, np.full((SIZE, SIZE), Validity.DARK, np.uint8), (60, 60), RADIUS)
    with pytest.raises(LensError):
        veil_from_surround(picture, np.zeros((SIZE, SIZE), np.uint8), (60, 60), 90.0)
    with pytest.raises(LensError):
        veil_from_surround(picture, np.zeros((SIZE, SIZE), np.uint8), (-900, 60), 45.0)


def test_a_surround_too_dark_to_measure_is_no_veil() -> None:
    picture, _ = veiled(noise=0.5)
    light = luminance_cd_m2(picture)
    middle = (SIZE / 2, SIZE / 2)
    surround = np.hypot(*(np.indices((SIZE, SIZE)) + 0.5 - SIZE / 2)) > 1.06 * RADIUS
    for share in (0.1, 0.9):
        # As a merge does: what falls below some level is dark, and the bright ones by chance are left.
        level = np.quantile(light[surround], share)
        validity = np.where(light < level, np.uint8(Validity.DARK), np.uint8(Validity.VALID))
        if share > 0.5:
            with pytest.raises(LensError, match="90 % of the surround"):
                veil_from_surround(picture, validity, middle, RADIUS)
        else:
            np.testing.assert_allclose(veil_from_surround(picture, validity, middle, RADIUS).veil_rgb, VEIL, rtol=0.03)


def test_subtraction_gives_the_scene_back() -> None:
    picture, scene = veiled(noise=0.0)
    image = luminance_image(picture)
    found = veil_from_surround(picture, image.validity, (SIZE / 2, SIZE / 2), RADIUS)
    clean = subtract_veil(image, found)
    inside = scene[..., 0] > 0
    np.testing.assert_allclose(clean.rgb[inside], np.repeat(scene, 3, axis=2)[inside], rtol=1e-5)
    assert (clean.uncertainty[inside] >= image.uncertainty[inside]).all()
    assert (clean.validity[~inside] == Validity.DARK).all()
    assert np.isinf(clean.uncertainty[~inside]).all()
    assert clean.attributes["veil_rgb"] == list(found.veil_rgb)


def test_doubt_of_the_veil_counts_most_where_it_is_dark() -> None:
    rgb = np.full((8, 16, 3), 100.0, np.float32)
    rgb[0] = 4.0
    picture, _ = veiled()
    found = veil_from_surround(picture, np.zeros((SIZE, SIZE), np.uint8), (60, 60), RADIUS)
    clean = subtract_veil(luminance_image(rgb), found)
    assert clean.uncertainty[0, 0] > 3 * clean.uncertainty[4, 0]
    assert np.isfinite(clean.rgb).all()
    assert not np.isnan(clean.uncertainty).any()


def test_outside_and_clipped_pixels_stay_what_they_are() -> None:
    rgb = np.zeros((8, 16, 3), np.float32)
    rgb[:, 8:] = 1.0
    validity = np.full((8, 16), Validity.OUTSIDE, np.uint8)
    validity[:, 8:] = Validity.CLIPPED
    uncertainty = np.full((8, 16), np.inf, np.float32)
    image = luminance_image(rgb, validity=validity, uncertainty=uncertainty)
    picture, _ = veiled()
    clean = subtract_veil(image, veil_from_surround(picture, np.zeros((SIZE, SIZE), np.uint8), (60, 60), RADIUS))
    assert (clean.validity == validity).all()
    assert np.isinf(clean.uncertainty).all()
    assert (clean.rgb == 0).all()


def test_the_darkest_place_bounds_the_veil_and_is_not_subtracted() -> None:
    rgb = np.random.default_rng(0).uniform(50, 300, (60, 120, 3)).astype(np.float32)
    rgb[10:13, 10:13] = 4.0
    image = luminance_image(rgb)
    bound = veil_bound_from_darkest(image)
    np.testing.assert_allclose(bound.veil_rgb, 4.0)
    assert bound.upper_bound
    with pytest.raises(ParameterError):
        subtract_veil(image, bound)
    nothing = luminance_image(rgb, validity=np.full((60, 120), Validity.CLIPPED, np.uint8))
    with pytest.raises(LensError):
        veil_bound_from_darkest(nothing)


def test_black_pictures() -> None:
    black = luminance_image(np.zeros((40, 80, 3)))
    assert veil_bound_from_darkest(black).index == 0
    found = veil_from_surround(black.rgb, black.validity, (40, 20), 10)
    clean: LuminanceImage = subtract_veil(black, found)
    assert (clean.validity == Validity.DARK).all()

"""What all pixels share: stray light by place and the two lenses of one body, from the spot that set the scale."""

from __future__ import annotations

import numpy as np
import pytest

from processing.calibration.scale.photometry import illuminance_lx
from processing.pictures.images import LuminanceImage, luminance_cd_m2
from processing.pictures.modes import SEAM_SIGMA, VEIL_INDEX, camera_modes, relative_error, stray_light, widened
from processing.sphere import Equirectangular

WIDTH, HEIGHT = 192, 96


def room(lamp: float = 0.0) -> LuminanceImage:
    """Everything 100 cd/m2, but for a lamp of 20 degrees on the left of the middle."""
    rgb = np.full((HEIGHT, WIDTH, 3), 100.0, np.float32)
    rgb[40:52, 30:42] += lamp
    zeros = np.zeros((HEIGHT, WIDTH), np.float32)
    return LuminanceImage(rgb, zeros + 1e-6, zeros.astype(np.uint8), Equirectangular(WIDTH, HEIGHT), 0.0)


def of(image: LuminanceImage, mode: object) -> np.ndarray:
    return relative_error(mode, image, luminance_cd_m2(image.rgb))  # type: ignore[arg-type]


def test_stray_light_of_an_even_room_is_its_share_everywhere_and_none_once_the_scale_has_it() -> None:
    image = room()
    assert of(image, stray_light(image, VEIL_INDEX)) == pytest.approx(VEIL_INDEX, rel=1e-3)
    assert np.abs(of(image, stray_light(image, VEIL_INDEX, 100.0))).max() < 1e-5


def test_stray_light_is_stronger_near_a_lamp_and_weak_against_the_lamp_itself() -> None:
    image = room(lamp=50_000)
    found = of(image, stray_light(image, VEIL_INDEX))
    assert found[46, 48] > 3 * found[46, 132]
    assert found[46, 36] < 0.1 * found[46, 48]
    # Rows by themselves are the same.
    part = slice(40, 50)
    mode = stray_light(image, VEIL_INDEX)
    assert np.array_equal(relative_error(mode, image, luminance_cd_m2(image.rgb[part]), part), found[part])
    moved = mode.moved(2.0)
    brighter = LuminanceImage(4 * image.rgb, image.uncertainty, image.validity, image.geometry, 0.0)
    assert of(brighter, moved) == pytest.approx(found, rel=1e-5)


def test_the_lens_that_saw_the_spot_is_sure_and_the_other_is_not() -> None:
    image = room()
    _, seam = camera_modes(image, two_lenses=True, measured=(100.0, np.pi))
    found = of(image, seam)
    assert np.abs(found[48, 2]) < 1e-6
    assert found[48, WIDTH // 2] == pytest.approx(2 * SEAM_SIGMA, rel=1e-3)
    light = illuminance_lx(widened(image, [seam]))
    assert light.shared_lx / light.value_lx == pytest.approx(SEAM_SIGMA, rel=0.05)

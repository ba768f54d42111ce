"""Albedo from a picture, in a closed loop: a rendered room gives back the albedo that it was rendered with."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from processing.errors import AlbedoError
from processing.light.picture.render import render
from processing.light.scene.albedo import MOST_ALBEDO, albedo_of_room
from processing.light.scene.scene import Scene, Sun, plain
from processing.light.solver.irradiance import Effort
from processing.light.solver.sight import albedo_of, sight_of
from processing.light.solver.stage import Stage
from processing.pictures.images import LuminanceImage, Validity
from processing.sphere import Equirectangular
from tests.processing.light.rooms import EYE, box_room, scene_of, uniform_sky

ROWS = 64
GEOMETRY = Equirectangular(2 * ROWS, ROWS)
# Not cleaned: the denoiser loads torch where that is installed, which takes longer than these tests.
LOOK = Effort(texel_m=0.2, patch_samples=64, rows=ROWS, pixel_samples=64, sun_samples=64, clean=False)


def colours(name: str) -> np.ndarray:
    return plain({"floor": (0.35, 0.28, 0.2), "ceiling": (0.85, 0.85, 0.85)}.get(name, (0.6, 0.58, 0.5)))


def picture_of(scene: Scene) -> LuminanceImage:
    rgb = render(scene, GEOMETRY, EYE, effort=LOOK, seed=3).rgb
    return image(rgb)


def image(rgb: np.ndarray) -> LuminanceImage:
    shape = rgb.shape[:2]
    return LuminanceImage(rgb, np.full(shape, 0.02, np.float32), np.zeros(shape, np.uint8), GEOMETRY, 0.02)


@pytest.fixture(scope="module")
def sunny() -> Scene:
    direction = np.array([0.2, -0.75, 0.6]) / np.linalg.norm([0.2, -0.75, 0.6])
    sun = Sun(tuple(direction), (75_000.0, 70_000.0, 60_000.0))
    return scene_of(box_room(), uniform_sky(4000.0, sun), colours, reveal_m=0.2, transmittance={0: (0.7, 0.72, 0.7)})


def test_closed_loop_with_sun(sunny: Scene) -> None:
    look = replace(LOOK, pixel_samples=256)
    rgb = render(sunny, GEOMETRY, EYE, effort=look, seed=3).rgb
    found = albedo_of_room(image(rgb), box_room(), sunny.outdoors, rows=ROWS, effort=look, seed=1)
    stage = Stage.of(sunny, 1.0)
    sight = sight_of(stage, GEOMETRY, EYE)
    plane = (sight.label >= 0) & (sight.label < 6)
    error = np.abs(found.picture.reshape(-1, 3) - albedo_of(stage, sight))[plane]
    assert found.transmittance[0] == pytest.approx((0.7, 0.72, 0.7), abs=0.03)
    assert np.median(error) < 0.025
    assert np.quantile(error, 0.95) < 0.08
    assert np.isfinite(found.picture).all()
    assert found.measured.mean() > 0.8
    # And the recovered room under the same light gives the picture back; bounces multiply what albedo is off by.
    again = render(found.scene, GEOMETRY, EYE, effort=look, seed=5).rgb.reshape(-1, 3)[plane]
    ratio = again.sum(axis=1) / rgb.reshape(-1, 3)[plane].sum(axis=1)
    assert np.median(np.abs(ratio - 1)) < 0.06


def test_clipped_and_filled_pixels_take_their_surroundings(sunny: Scene) -> None:
    picture = picture_of(replace(sunny, outdoors=uniform_sky(4000.0)))
    rgb, validity = picture.rgb.copy(), picture.validity.copy()
    filled = np.zeros(validity.shape, bool)
    validity[30:36, 10:20] = Validity.CLIPPED
    filled[40:50, 60:70] = True
    # Their radiance is made wrong by little, so that the light in the room hardly changes.
    rgb[filled] *= 1.4
    found = albedo_of_room(
        replace(picture, rgb=rgb, validity=validity),
        box_room(),
        uniform_sky(4000.0),
        rows=ROWS,
        effort=LOOK,
        filled=filled,
    )
    stage = Stage.of(sunny, 1.0)
    truth = albedo_of(stage, sight_of(stage, GEOMETRY, EYE)).reshape(ROWS, 2 * ROWS, 3)
    assert not found.measured[filled].any()
    assert (found.uncertainty[filled] == 1).all()
    assert np.median(np.abs(found.picture - truth)[filled]) < 0.03
    assert np.median(np.abs(found.picture - truth)[30:36, 10:20]) < 0.03


def test_albedo_stays_physical_in_a_picture_that_cannot_be() -> None:
    bright = image(np.random.default_rng(1).random((ROWS, 2 * ROWS, 3)).astype(np.float32) ** 8 * 1e9)
    found = albedo_of_room(bright, box_room(), uniform_sky(1.0), rows=ROWS, effort=replace(LOOK, pixel_samples=4))
    assert np.isfinite(found.picture).all()
    assert found.picture.max() <= MOST_ALBEDO


def test_black_and_partial_pictures_are_refused() -> None:
    with pytest.raises(AlbedoError, match="no light"):
        albedo_of_room(image(np.zeros((ROWS, 2 * ROWS, 3), np.float32)), box_room(), uniform_sky(), rows=ROWS)
    square = replace(image(np.ones((ROWS, 2 * ROWS, 3), np.float32)), geometry=Equirectangular(ROWS, ROWS))
    with pytest.raises(AlbedoError, match="not a whole panorama"):
        albedo_of_room(square, box_room(), uniform_sky(), rows=ROWS)

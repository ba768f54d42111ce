"""The outdoor picture turned as the windows show it."""

from __future__ import annotations

import math

import numpy as np
import pytest

from benchmarks.light.render_scenes import sky_outdoors
from processing.ground.room_model import Opening, OpeningKind
from processing.light.picture.render import render
from processing.light.scene.facing import facing_sunlight, outdoors_facing, turned
from processing.light.scene.scene import Outdoors, Sun
from processing.light.solver.irradiance import Effort
from processing.pictures.images import LuminanceImage
from processing.sphere import Equirectangular
from tests.processing.light.rooms import EYE, box_room, scene_of, uniform_sky

ROWS = 256
LOOK = Effort(texel_m=1.0, patch_samples=1, rows=16, pixel_samples=1, clean=False)
ROOM = box_room(window=(0.5, 4.5, 0.5, 2.6)).model_copy(
    update={
        "openings": tuple(
            Opening(kind=OpeningKind.WINDOW, wall=wall, start_m=0.5, end_m=3.5, sill_m=0.5, head_m=2.6)
            for wall in (0, 1)
        )
    }
)


def clouds() -> Outdoors:
    """A sky of blobs, blue between them."""
    rng = np.random.default_rng(3)
    grid = np.kron(rng.uniform(0, 1, (12, 24)), np.ones((8, 8)))

    def radiance(rays: np.ndarray) -> np.ndarray:
        row = np.clip(rays[..., 2] * 95, 0, 95).astype(int)
        column = ((np.arctan2(rays[..., 0], rays[..., 1]) / (2 * np.pi) + 0.5) * 191).astype(int)
        share = grid[row, column][..., None]
        return 500 + share * [8000, 8000, 8000] + (1 - share) * [500, 1000, 3000]

    return sky_outdoors(radiance, rows=96, sun=Sun((0.6, 0.0, 0.8), (5e4, 5e4, 5e4)))


def photograph(sky: Outdoors) -> LuminanceImage:
    rgb = render(scene_of(ROOM, sky, 0.5), Equirectangular(2 * ROWS, ROWS), EYE, effort=LOOK).rgb
    shape = rgb.shape[:2]
    doubt = np.full(shape, 0.02, np.float32)
    return LuminanceImage(rgb, doubt, np.zeros(shape, np.uint8), Equirectangular(2 * ROWS, ROWS), 0.02)


@pytest.fixture(scope="module")
def seen() -> LuminanceImage:
    return photograph(clouds())


@pytest.mark.parametrize("off_deg", [0.0, 75.0, -150.0])
def test_it_is_turned_back(seen: LuminanceImage, off_deg: float) -> None:
    found, result = outdoors_facing(turned(clouds(), math.radians(off_deg)), seen, ROOM)
    assert result is not None
    assert math.degrees(math.remainder(result[0] + math.radians(off_deg), 2 * math.pi)) == pytest.approx(0, abs=4)
    assert found.sun is not None
    assert np.allclose(found.sun.direction, clouds().sun.direction, atol=0.08)  # type: ignore[union-attr]


def test_a_sky_without_information_stays() -> None:
    plain = uniform_sky(3000.0)
    found, result = outdoors_facing(plain, photograph(plain), ROOM)
    assert result is None
    assert found is plain


def test_a_turn_is_as_the_compass_turns() -> None:
    found = turned(clouds(), math.radians(90))
    assert np.allclose(found.sun.direction, (0.0, -0.6, 0.8), atol=1e-6)  # type: ignore[union-attr]


def test_sunlight_in_the_room_turns_the_sun_outdoors() -> None:
    height = math.asin(0.8)
    found, turn = facing_sunlight(clouds(), (math.radians(-20), height + math.radians(3)))
    assert turn == pytest.approx(math.radians(-110))  # the sun stands at +x, 90 degrees from +y
    assert found.sun is not None
    assert math.atan2(*found.sun.direction[:2]) == pytest.approx(math.radians(-20), abs=math.radians(1))
    assert found.sun.direction[2] == pytest.approx(0.8)


@pytest.mark.parametrize("seen", [None, (0.0, 0.2)])
def test_a_sun_that_is_not_that_of_the_room_is_left_out(seen: tuple[float, float] | None) -> None:
    found, turn = facing_sunlight(clouds(), seen)
    assert (found.sun, turn) == (None, None)
    assert np.array_equal(found.rgb, clouds().rgb)


def test_a_sky_without_sun_stays_as_it_is() -> None:
    plain = uniform_sky(3000.0)
    assert facing_sunlight(plain, (0.0, 0.7)) == (plain, None)

"""What must not break a picture: right, or a named refusal; no NaN and no pixel that shines by chance."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from processing.errors import MaterialError, NoBalanceError, SceneError
from processing.light.picture.composite import differential
from processing.light.picture.render import render
from processing.light.scene.scene import Outdoors, Pane, Scene, Sun, plain
from processing.light.solver.irradiance import FIREFLY_TIMES, Effort, without_fireflies
from processing.light.solver.stage import Stage
from processing.sphere import Equirectangular, Perspective
from tests.processing.light.rooms import EYE, box, box_room, scene_of, uniform_sky

SMALL = Effort(texel_m=0.3, patch_samples=32, rows=32, pixel_samples=16, sun_samples=8, clean=False)
GEOMETRY = Equirectangular(64, 32)
ALBEDO = 0.5
WINDOW = (1.5, 3.5, 0.8, 2.3)


def sun_at(lux: float) -> Sun:
    direction = np.array([0.0, -0.8, 0.6])
    x, y, z = (float(v) for v in direction / np.linalg.norm(direction))
    return Sun((x, y, z), (lux, lux, lux))


def picture_of(scene: Scene | Stage, eye=EYE, seed: int = 0) -> np.ndarray:
    rgb = render(scene, GEOMETRY, eye, effort=SMALL, seed=seed).rgb
    assert np.isfinite(rgb).all()
    assert (rgb >= 0).all()
    return rgb


def fireflies(scene: Scene | Stage, eye=EYE, times: float = 10) -> np.ndarray:
    """Return which pixels (H, W) shine far more in one picture than in others of other chance."""
    pictures = np.stack([picture_of(scene, eye, seed)[..., 1] for seed in range(3)])
    return (pictures > times * np.median(pictures, axis=0) + 1e-6).any(axis=0)


def test_sun_in_view_and_a_sky_of_1e9() -> None:
    # The camera looks at the sun through the window; its disc is not drawn, and nothing glitters.
    view = Perspective(32, 24, 1.2, yaw_rad=np.pi, pitch_rad=0.5)
    bare = scene_of(box_room(), Outdoors(np.full((16, 32, 3), 1e3, np.float32), sun_at(1e9)), ALBEDO)
    rgb = render(bare, view, EYE, effort=SMALL).rgb
    assert np.isfinite(rgb).all()
    # No more than full sun on a matte wall, and all light in the room, gives off.
    assert rgb.max() < 1e9 / np.pi
    fierce = replace(bare, outdoors=Outdoors(np.full((16, 32, 3), 1e9, np.float32), sun_at(1e9)))
    assert fireflies(fierce).mean() == 0
    assert picture_of(fierce).max() == pytest.approx(1e9, rel=1e-3)


def test_the_light_of_a_square_centimetre_is_kept_without_fireflies() -> None:
    tiny = scene_of(box_room(window=(2.0, 2.01, 1.5, 1.51)), uniform_sky(1e9, ground=1.0), ALBEDO)
    assert not fireflies(tiny).any()
    # What enters, pi L A, is absorbed by all walls: mean radiance of the room from that balance.
    rgb = picture_of(tiny)[..., 1]
    walls_m2 = 2 * (5 * 4 + 5 * 2.7 + 4 * 2.7)
    entering_lm = np.pi * 1e9 * 1e-4
    indirect = entering_lm * ALBEDO / (walls_m2 * (1 - ALBEDO)) / np.pi
    assert 0.3 * indirect < np.median(rgb) < 3 * indirect


def test_a_hall_of_100_m_gets_darker_away_from_its_window() -> None:
    hall = scene_of(box_room(100.0, 4.0, window=(1.0, 5.0, 0.8, 2.3)), uniform_sky(), ALBEDO)
    coarse = replace(SMALL, texel_m=0.6)
    stage = Stage.of(hall, coarse.texel_m)
    rgb = picture_of(stage, (-45.0, 0.0, 1.6))
    # 90 m from the window it is nearly dark: a ray that finds the lit end by chance must not shine.
    far = (45.0, 0.0, 1.6)
    assert not fireflies(stage, far, times=60).any()
    assert np.median(rgb) > 100 * np.median(picture_of(stage, far))


def test_only_what_shines_by_chance_is_dimmed() -> None:
    one, other = np.ones((9, 9, 3), np.float32), np.ones((9, 9, 3), np.float32)
    one[4, 4], one[2, 6], other[2, 6] = 1e6, 500.0, 400.0
    found = without_fireflies(one, other)
    assert found[4, 4] == pytest.approx([FIREFLY_TIMES] * 3)
    assert np.array_equal(found[2, 6], one[2, 6])
    assert without_fireflies(other, one) is other


def test_one_centimetre_from_a_wall_and_in_a_corner() -> None:
    room = scene_of(box_room(), uniform_sky(), ALBEDO)
    near = picture_of(room, (2.49, 0.0, 1.6))
    assert not fireflies(room, (2.49, 1.99, 0.01)).any()
    # Half of what it sees is the wall, which is as bright as from farther away.
    view = Perspective(8, 8, 0.3, yaw_rad=np.pi / 2)
    far = render(room, view, (1.0, 0.0, 1.6), effort=SMALL).rgb.mean()
    assert near[12:20, 44:52].mean() == pytest.approx(far, rel=0.3)


def test_walls_of_albedo_1_pass_all_light_on_and_black_ones_none() -> None:
    white = scene_of(box_room(), uniform_sky(), 1.0)
    # Nothing is absorbed, so the room is as bright as what is outside: a furnace of 1000 cd/m2.
    found = picture_of(replace(white, outdoors=Outdoors(np.full((16, 32, 3), 1000, np.float32))))
    assert np.median(found) == pytest.approx(1000, rel=0.05)
    assert found.max() < 1500
    shut = scene_of(box_room(window=None), uniform_sky(), 1.0)
    lit = replace(shut.surfaces[1], emission_cd_m2=plain(1.0))
    with pytest.raises(NoBalanceError, match="never absorbed"):
        render(replace(shut, surfaces=(shut.surfaces[0], lit, *shut.surfaces[2:])), GEOMETRY, EYE, effort=SMALL)
    black = picture_of(scene_of(box_room(), uniform_sky(1000.0, sun_at(1e5)), 0.0))
    assert (black[black < 900] == 0).all()


def test_textures_that_are_no_number_are_refused_wherever_they_stand() -> None:
    scene = scene_of(box_room(), uniform_sky(), ALBEDO)
    nan = np.full((2, 2, 3), np.nan, np.float32)
    with pytest.raises(MaterialError, match="surface"):
        replace(scene.surfaces[0], albedo=nan)
    with pytest.raises(MaterialError, match="surface"):
        replace(scene.surfaces[0], emission_cd_m2=nan)
    with pytest.raises(MaterialError, match="outdoors"):
        Outdoors(np.full((16, 32, 3), np.nan, np.float32))
    with pytest.raises(MaterialError, match="pane"):
        Pane(np.zeros(3), np.array([1.0, 0, 0]), np.array([0, 0, 1.0]), (np.nan, 1.0, 1.0))
    with pytest.raises(MaterialError, match="sun"):
        Sun((0.0, 0.0, 1.0), (np.nan, 1.0, 1.0))
    with pytest.raises(SceneError, match="sun"):
        Sun((0.0, 0.0, np.inf), (1.0, 1.0, 1.0))


def test_furniture_through_a_wall_and_around_the_camera() -> None:
    room = scene_of(box_room(), uniform_sky(2000.0, sun_at(7e4)), ALBEDO)
    photograph = render(room, GEOMETRY, EYE, effort=SMALL).rgb
    wardrobe = box((2.5, 0.0, 1.0), (1.0, 1.0, 2.0))
    staged = differential(photograph, room, (wardrobe,), EYE, effort=SMALL)
    assert np.isfinite(staged.rgb).all()
    assert staged.furniture.any()
    assert staged.rgb[staged.furniture].max() < 7e4
    # A box around the camera lets no light in.
    shut = differential(photograph, room, (box((0.0, 0.0, 1.6), (1.0, 1.0, 1.0)),), EYE, effort=SMALL)
    assert np.isfinite(shut.rgb).all()
    assert (shut.rgb[shut.furniture] >= 0).all()

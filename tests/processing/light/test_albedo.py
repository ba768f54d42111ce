"""Albedo from a picture, in a closed loop: a rendered room gives back the albedo that it was rendered with."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from processing.errors import AlbedoError
from processing.light.picture.render import render
from processing.light.scene.albedo import MOST_ALBEDO, PX_PER_M, albedo_of_room, painted
from processing.light.scene.scene import Scene, Sun, plain
from processing.light.scene.sources import measured_windows
from processing.light.solver.irradiance import Effort
from processing.light.solver.sight import FIRST_PART, GLASS, albedo_of, looked_up, seen_outdoors, sight_of
from processing.light.solver.stage import Stage
from processing.light.solver.sun import sun_of
from processing.pictures.images import LuminanceImage, Validity
from processing.sphere import Equirectangular
from processing.surfaces.maps import planes_of
from processing.surfaces.textures import Texture
from tests.conftest import LONG
from tests.processing.light.rooms import EYE, box, box_room, scene_of, uniform_sky

ROWS = 64
GEOMETRY = Equirectangular(2 * ROWS, ROWS)
# Not cleaned: the denoiser loads torch where that is installed, which takes longer than these tests.
RAYS = 64 if LONG else 32
LOOK = Effort(texel_m=0.2, patch_samples=RAYS, rows=ROWS, pixel_samples=RAYS, sun_samples=RAYS, clean=False)


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


@pytest.mark.long
def test_cloth_finer_than_pixels_is_averaged_and_coarser_stays() -> None:
    """A chequer of black and white on a box: 2 mm are grey from 2 m away, as a pixel shows 6 mm; 0.2 m are not."""
    chequer = (np.indices((64, 64)).sum(axis=0) % 2).astype(np.float32)[..., None].repeat(3, axis=2)
    far, spread = box((0.0, 1.5, 1.5), (1.0, 0.1, 1.0), (1.0, 1.0, 1.0), texture=chequer), {}
    for size_m in (0.002, 0.2):
        # Across the front: texels of that size.
        part = replace(far, uv=(far.vertices_m[:, [0, 2]] / (64 * size_m)).astype(np.float32))
        stage = Stage.of(scene_of(box_room(), uniform_sky()).furnished((part,)), 0.5)
        sight = sight_of(stage, Equirectangular(1024, 512), EYE)
        there = (sight.label >= FIRST_PART) & (sight.normal[:, 1] < -0.9)
        assert there.sum() > 1000
        points, seen = albedo_of(stage, sight)[there], albedo_of(stage, sight, math.pi / 512)[there]
        assert seen.mean() == pytest.approx(0.5, abs=0.05)
        assert points.std() > 0.12, "points see texels"
        spread[size_m] = seen.std()
        assert part.texels_per_m == pytest.approx(1 / size_m, rel=0.9)
    assert spread[0.002] < 0.03
    assert spread[0.2] > 0.12


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
    assert all(one.albedo.mean(axis=2).std() < 0.004 for one in found.scene.surfaces[:6]), "painted surfaces are plain"
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


@pytest.mark.parametrize("niche", [False, True])
def test_a_reveal_or_a_sliver_of_a_wall_is_no_lamp(niche: bool) -> None:
    """What no pixel of the small picture shows has no known light: it is not what shines by itself."""
    room = box_room()
    if niche:
        sides = ((2.5, -2.0), (2.5, 1.0), (2.38, 1.0), (2.38, 1.6), (2.5, 1.6), (2.5, 2.0))
        room = room.model_copy(update={"floor": ((-2.5, -2.0), *sides, (-2.5, 2.0))})
    scene, geometry = scene_of(room, uniform_sky(4000.0), colours, reveal_m=0.2), Equirectangular(256, 128)
    rgb = render(scene, geometry, EYE, effort=LOOK, seed=3).rgb
    shape = rgb.shape[:2]
    picture = LuminanceImage(rgb, np.full(shape, 0.02, np.float32), np.zeros(shape, np.uint8), geometry, 0.02)
    found = albedo_of_room(picture, room, scene.outdoors, rows=128, effort=replace(LOOK, rows=24), seed=1)
    assert found.lamps == ()
    assert not any(one.emission_cd_m2.any() for one in found.scene.surfaces)


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


GLASS_SHARE, GLASS_ROWS = np.array([0.7, 0.72, 0.7]), 256
SKY_CD_M2 = 4000.0
COVERS = {
    "clear": lambda u, v, rgb: rgb,
    "a blind, half of the sky": lambda u, v, rgb: np.where(v < 0.25, 350.0, rgb),
    "dark slats": lambda u, v, rgb: np.where(1.5 * v % 0.16 < 0.08, 250.0, rgb),
    "slats as bright as the sky": lambda u, v, rgb: np.where(
        1.5 * v % 0.16 < 0.08, 2750.0 * np.array([1, 0.9, 0.6]), rgb
    ),
    "sheer over two fifths": lambda u, v, rgb: np.where(u < 0.4, 0.75 * rgb + 60, rgb),
    "a curtain in folds over more than half": lambda u, v, rgb: np.where(
        u < 0.58, (0.64 + 0.13 * np.sin(90 * u)) * rgb, rgb
    ),
    "mullions": lambda u, v, rgb: np.where((abs(u - 0.5) < 0.03) | (abs(v - 0.3) < 0.03) | (u < 0.04), 20.0, rgb),
}
"""By name, what glass shows (N, 3), cd/m2, at a share of its width and of its height from the top (N, 1) each."""


def land(rays: np.ndarray, kind: str) -> np.ndarray:
    """Return how many times as bright as usual the ground (N, 1) is along rays: lawn, or a street, lawn and hedge."""
    side = np.sin(6 * np.arctan2(rays[:, :1], -rays[:, 1:2]))
    return np.ones((len(rays), 1)) if kind == "even" else np.where(side > 0.3, 4.0, np.where(side < -0.4, 0.5, 1.3))


@pytest.mark.parametrize("ground", ["even", "street"])
@pytest.mark.parametrize("cover", COVERS)
def test_a_pane_gives_the_camera_what_the_camera_sees_on_it(cover: str, ground: str) -> None:
    """Whatever covers it and stands behind it; and how clear it is is found too, so that no veil stands for the sky."""
    geometry = Equirectangular(2 * GLASS_ROWS, GLASS_ROWS)
    stage = Stage.of(scene_of(box_room(), uniform_sky(SKY_CD_M2), colours, reveal_m=0.2), 0.5)
    sight = sight_of(stage, geometry, EYE)
    glass = np.flatnonzero(sight.label == GLASS)
    rays, (u, v) = sight.rays[glass], stage.scene.panes[0].shares(sight.point[glass])
    outside = looked_up(stage.scene.outdoors.rgb, rays) * np.where(rays[:, 2:] < 0, land(rays, ground), 1)
    through = GLASS_SHARE * outside
    shown = COVERS[cover](u[:, None], v[:, None], through)
    rgb = np.full((len(sight.label), 3), 30.0, np.float32)
    rgb[glass] = shown
    valid = np.ones(sight.shape, bool)
    panes, outdoors, measured = measured_windows(stage, sight, rgb.reshape(*sight.shape, 3), valid, EYE)
    given = seen_outdoors(stage.under(outdoors, panes), sight)[glass]
    for part, near in ((rays[:, 2] > -2, 0.03), (rays[:, 2] > 0.02, 0.1), (rays[:, 2] < -0.02, 0.1)):
        ratio = given[part].mean(axis=0) / shown[part].mean(axis=0)
        assert ratio == pytest.approx(np.ones(3), abs=near), (cover, ground, ratio)
    assert measured
    assert panes[0].transmittance == pytest.approx(GLASS_SHARE, abs=0.03)
    # How clear it is above the horizon; below, a grey blind looks like a grey street.
    high, up = rays[:, 2] > 0.02, panes[0].clear[: round(len(panes[0].clear) * float(v[rays[:, 2] > 0.02].max()))]
    assert up.mean() == pytest.approx((shown == through).all(axis=1)[high].mean(), abs=0.1)


def test_a_tree_behind_the_glass_keeps_skylight_off_and_not_the_sun() -> None:
    sun = Sun(tuple(np.array([0.2, -0.75, 0.6]) / np.linalg.norm([0.2, -0.75, 0.6])), (7e4, 7e4, 7e4))
    stage = Stage.of(scene_of(box_room(), uniform_sky(SKY_CD_M2, sun), colours, reveal_m=0.2), 0.5)
    sight = sight_of(stage, Equirectangular(2 * GLASS_ROWS, GLASS_ROWS), EYE)
    glass = np.flatnonzero(sight.label == GLASS)
    u, v = stage.scene.panes[0].shares(sight.point[glass])
    rgb = np.full((len(sight.label), 3), 30.0, np.float32)
    rgb[glass] = GLASS_SHARE * looked_up(stage.scene.outdoors.rgb, sight.rays[glass])
    post, tree = u < 0.1, np.hypot(u - 0.6, v - 0.45) < 0.22
    rgb[glass[post | tree]] = 150.0
    seen = rgb.reshape(*sight.shape, 3)
    (pane,), outdoors, _ = measured_windows(stage, sight, seen, np.ones(sight.shape, bool), EYE)
    rows, columns = pane.clear.shape
    assert pane.clear[round(0.45 * rows), round(0.6 * columns)] < 0.1
    assert pane.clear_for_sun[1:, round(0.15 * columns) : -1].all()
    assert not pane.clear_for_sun[:, : round(0.05 * columns)].any()
    found, ragged = (stage.under(outdoors, (one,)) for one in (pane, replace(pane, sun_clear=None)))
    assert sun_of(found, sight, 32, 0).sum() > 1.1 * sun_of(ragged, sight, 32, 0).sum()


def wall_as_seen(albedo: np.ndarray, light: np.ndarray, density: np.ndarray | float = 1.0) -> Texture:
    """A wall 4 x 2.6 m in texels of 2 cm, as a picture with noise of 0.3 % shows it in wrong light."""
    noise = np.exp(np.random.default_rng(5).normal(0, 0.003, light.shape))
    values = (albedo * (light * noise)[..., None]).astype(np.float32)
    known = np.ones(light.shape, bool)
    known[60:110, 120:150] = False
    values[~known] = 0
    plane = planes_of(box_room())[2]
    return Texture(plane, PX_PER_M, values, known, np.broadcast_to(np.float32(density), light.shape))


def test_plain_walls_are_plain_and_what_hangs_on_them_stays() -> None:
    v, u = np.mgrid[0:130, 0:200] / 50.0
    wrong = np.exp(0.3 * np.sin(1.5 * u) * np.exp(-v))  # light estimated wrong by a third, and no edge in it
    paint = np.broadcast_to(np.float32((0.7, 0.68, 0.6)), (130, 200, 3)).copy()
    found = painted(wall_as_seen(paint, wrong))
    before = np.abs(wall_as_seen(paint, wrong).values - paint).max()
    assert before > 0.2
    assert np.ptp(found.mean(axis=2)) < 0.005, "one colour, where nobody saw it too"
    picture = paint.copy()
    picture[30:60, 40:80] = (0.2, 0.1, 0.4)
    found = painted(wall_as_seen(picture, wrong))
    assert np.abs(found - picture)[32:58, 42:78].mean() < 0.06
    assert np.median(np.abs(found - picture)) < 0.02, "nor does it change the wall around it"


def test_papered_walls_keep_their_pattern_and_sure_texels_decide() -> None:
    v, u = np.mgrid[0:130, 0:200] / 50.0
    pattern = 0.5 * np.exp(0.15 * np.sign(np.sin(25 * u) * np.sin(25 * v)))[..., None] * np.ones(3)
    wrong = np.exp(0.3 * np.sin(1.5 * u) * np.exp(-v))
    seen = wall_as_seen(pattern, wrong)
    found, known = painted(seen), seen.known
    ratio = np.corrcoef(np.log(found[known].mean(axis=1)), np.log(pattern[known].mean(axis=1)))[0, 1]
    assert ratio > 0.95
    assert np.abs(found - pattern)[known].mean() < 0.6 * np.abs(seen.values - pattern)[known].mean()
    # Two fifths of a wall, seen by a hundred times the pixels, decide against the rest.
    near = u < 1.6
    found = painted(
        wall_as_seen(0.6 * np.ones((130, 200, 3)), np.where(near, 1.0, np.exp(-0.1 * (u - 1.6))), 1 + 99 * near)
    )
    assert found == pytest.approx(0.6, abs=0.01)

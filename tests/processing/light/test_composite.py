"""Furniture in the photograph: what changes, what is kept bit by bit, and the named refusals."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import cv2
import numpy as np
import pytest

from benchmarks.light.render_methods import ibl
from processing.errors import MaterialError, ParameterError, SceneError
from processing.ground.arrays import AnyArray, Flags
from processing.light.picture.change import _WEIGHTS, _Given, _shade_all
from processing.light.picture.coarse import Band
from processing.light.picture.composite import Bare, changed, differential, draw, parted_sun, patches_of_sun
from processing.light.picture.edges import MOST_GAIN, bounded
from processing.light.picture.render import render
from processing.light.scene.room_light import near_sun, with_sunlight
from processing.light.scene.scene import Material, Outdoors, Part, Sun
from processing.light.solver.irradiance import Effort
from processing.pictures.images import LuminanceImage
from processing.sphere import Equirectangular, Perspective
from processing.surfaces.hanging import Hanging
from tests.conftest import LONG
from tests.processing.light.rooms import EYE, box, box_room, scene_of, uniform_sky

ROWS = 64
GEOMETRY = Equirectangular(2 * ROWS, ROWS)
# Not cleaned: the denoiser loads torch where that is installed, which takes longer than these tests.
RAYS = 64 if LONG else 32
LOOK = Effort(texel_m=0.2, patch_samples=RAYS, rows=ROWS, pixel_samples=RAYS, sun_samples=RAYS, clean=False)
TABLE = box((1.2, 0.8, 0.4), (0.8, 0.8, 0.8))


@pytest.fixture(scope="module")
def room():
    return scene_of(box_room(), uniform_sky(4000.0), 0.5, reveal_m=0.2)


@pytest.fixture(scope="module")
def photograph(room) -> np.ndarray:
    return render(room, GEOMETRY, EYE, effort=LOOK, seed=8).rgb


def test_nothing_added_changes_nothing(room, photograph) -> None:
    staged = differential(photograph, room, (), EYE, effort=LOOK)
    assert np.array_equal(staged.rgb, photograph)
    assert staged.kept.all()


def test_differential_is_the_furnished_room_and_keeps_the_window(room, photograph) -> None:
    staged = differential(photograph, room, (TABLE,), EYE, effort=LOOK, seed=2)
    truth = render(room.furnished((TABLE,)), GEOMETRY, EYE, effort=LOOK, seed=9).rgb
    window = ~np.isclose(photograph, 0) & (photograph == photograph.max())
    assert np.array_equal(staged.rgb[staged.kept], photograph[staged.kept])
    assert staged.kept[window.all(axis=2)].all()
    ratio = staged.rgb.sum(axis=2) / truth.sum(axis=2)
    # Both pictures are noisy: single pixels differ by 5 %, their means hardly.
    assert np.median(np.abs(ratio - 1)) < 0.08
    assert staged.rgb.sum() == pytest.approx(truth.sum(), rel=0.01)
    # Pixels at its edges are smooth, as those of a larger picture are that is made small.
    large = render(room.furnished((TABLE,)), Equirectangular(8 * ROWS, 4 * ROWS), EYE, effort=LOOK, seed=9).rgb
    fine = large.reshape(ROWS, 4, 2 * ROWS, 4, 3).mean(axis=(1, 3))
    inside = cv2.erode(staged.furniture.astype(np.uint8), np.ones((3, 3), np.uint8)) > 0
    assert staged.rgb[inside].sum() == pytest.approx(fine[inside].sum(), rel=0.03)
    assert 0.01 < staged.furniture.mean() < 0.2
    # The table darkens the room on average.
    assert _ratio(staged, photograph)[~staged.furniture & ~staged.kept].mean() < 1
    assert np.array_equal(differential(photograph, room, (TABLE,), EYE, effort=LOOK, seed=2).rgb, staged.rgb)


def _ratio(staged, photograph):
    """Return the change of light by pixels (H, W)."""
    return staged.rgb.sum(axis=2) / np.maximum(photograph.sum(axis=2), 1e-6)


FLOOR = np.zeros((ROWS, 2 * ROWS), bool)
FLOOR[ROWS // 2 + 8 :] = True


@cache
def sunny_room():
    """Return a room with the sun on its floor, its picture, and where the sun falls."""
    direction = np.array([0.0, -0.7, 0.7]) / np.linalg.norm([0.7, 0.7])
    room = scene_of(box_room(), uniform_sky(1000.0, Sun(tuple(direction), (7e4, 7e4, 7e4))), 0.5)
    photograph = render(room, GEOMETRY, EYE, effort=LOOK).rgb
    sunny = FLOOR & (photograph[..., 1] > 10 * np.median(photograph[FLOOR]))
    assert sunny.any()
    return room, photograph, sunny


def test_furniture_throws_a_shadow_in_the_sun() -> None:
    room, photograph, _ = sunny_room()
    low = box((0.0, -1.2, 0.1), (0.4, 0.4, 0.2))
    staged = differential(photograph, room, (low,), EYE, effort=LOOK)
    # Pixels beside furniture are mixed with it.
    ratio = _ratio(staged, photograph)[cv2.dilate(staged.furniture.astype(np.uint8), np.ones((3, 3))) == 0]
    assert (ratio < 0.5).any()
    assert ratio.max() <= 4


def rows_of(photograph: LuminanceImage, sun: Flags) -> dict[str, AnyArray]:
    return {name: getattr(photograph, name)[near_sun(sun)] for name in ("rgb", "uncertainty", "validity")}


@pytest.mark.parametrize("first_row", [0, 30, 63])
def test_sun_stands_again_up_to_its_rim_and_what_hides_it_keeps_it_away(first_row: int) -> None:
    # Of 720 rows, 1.5 degrees are 6 and 0.8 degrees 3.
    geometry = Equirectangular(1440, 720)
    light, none = np.ones((720, 1440, 3), np.float32), np.zeros((720, 1440), np.float32)
    image = LuminanceImage(light, none, none.astype(np.uint8), geometry, 0.02)
    sun, hidden = np.zeros((2, 720, 1440), bool)
    sun[11 * first_row : 11 * first_row + 20, 5:90] = True
    hidden[max(11 * first_row - 8, 0) : 11 * first_row + 3, 20:50] = True
    empty = with_sunlight(replace(image, rgb=2 * light), rows_of(image, sun), sun, sun, hidden)

    def wide(mask: np.ndarray, reach_px: int) -> np.ndarray:
        disc = cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (2 * reach_px + 1, 2 * reach_px + 1))
        three = np.concatenate([mask] * 3, axis=1).astype(np.uint8)
        return np.asarray(cv2.dilate(three, disc)[:, 1440:2880] > 0)

    assert np.array_equal(empty.image.rgb[..., 0] == 1, wide(sun, 6) & ~wide(hidden, 3))


@pytest.mark.parametrize("returned", [None, np.ones((45, 90), bool)])
def test_an_emptied_room_without_a_patch_of_sun_stays_as_it_is(returned: Flags | None) -> None:
    light, none = np.ones((180, 360, 3), np.float32), np.zeros((180, 360), np.float32)
    removed = LuminanceImage(light, none, none.astype(np.uint8), Equirectangular(360, 180), 0.02)
    sun = np.zeros((180, 360), bool)
    found = with_sunlight(removed, rows_of(replace(removed, rgb=2 * light), sun), ~sun, sun, sun, returned)
    assert np.array_equal(found.image.rgb, light)
    assert found.sunless is not None
    assert found.sunless.all()


def test_where_the_sun_falls_anew_no_half_shadow_of_the_old_patch_is_left() -> None:
    light, none = np.ones((720, 1440, 3), np.float32), np.zeros((720, 1440), np.float32)
    removed = LuminanceImage(light, none, none.astype(np.uint8), Equirectangular(1440, 720), 0.02)
    sun, shown = np.zeros((720, 1440), bool), light.copy()
    sun[400:440, 100:200] = True
    shown[sun] = 10
    shown[439, 100:200] = 2
    found = with_sunlight(
        removed, rows_of(replace(removed, rgb=shown), sun), sun, sun, sun & False, np.ones((180, 360), bool)
    )
    assert found.sunlit is not None
    assert found.sunlit[405:435, 105:195].all()
    assert not found.sunlit[439, 100:200].any(), "a dark line across the new patch"


def test_of_a_patch_that_was_mostly_hidden_nothing_stands_as_it_was_photographed() -> None:
    """A rest of it stood out of the new patch by its colour, with a rim of its own."""
    light, none = np.ones((360, 720, 3), np.float32), np.zeros((360, 720), np.float32)
    removed = LuminanceImage(light, none, none.astype(np.uint8), Equirectangular(720, 360), 0.02)
    sun, hidden = np.zeros((2, 360, 720), bool)
    sun[200:240, 100:200] = sun[300:320, 400:500] = True
    hidden[200:240, 100:180] = hidden[300:320, 400:420] = True
    found = with_sunlight(removed, rows_of(replace(removed, rgb=10 * light), sun), sun, sun, hidden).sunlit
    assert found is not None
    assert not found[:260].any()
    assert found[305:315, 440:490].all(), "a patch that was hardly hidden stays"


def test_a_patch_of_sun_that_furniture_shades_in_part_falls_anew_as_a_whole() -> None:
    room, photograph, sunny = sunny_room()
    none = np.zeros(sunny.shape, np.float32)
    image = LuminanceImage(photograph, none, none.astype(np.uint8), GEOMETRY, 0.02)
    removed = replace(image, rgb=np.where(sunny[..., None], np.float32(1), photograph))
    empty = with_sunlight(removed, rows_of(image, sunny), sunny, sunny, np.zeros_like(sunny))
    assert np.array_equal(empty.image.rgb, photograph)
    # Where old furniture threw its shade on the patch, removal's picture stands, and the sun falls anew.
    dim = sunny & (np.indices(sunny.shape)[1] < np.median(np.nonzero(sunny)[1]))
    shaded = replace(image, rgb=np.where(dim[..., None], np.float32(0.8), photograph))
    mended = with_sunlight(removed, rows_of(shaded, sunny), sunny, sunny, np.zeros_like(sunny), dim)
    assert mended.sunless is not None
    assert mended.sunless[dim].all()
    assert np.array_equal(mended.image.rgb[dim], removed.rgb[dim])
    assert np.array_equal(mended.image.rgb[sunny & ~dim], photograph[sunny & ~dim])
    bare = Bare.of(room, LOOK)
    shades, away = box((0.0, -0.8, 0.2), (1.0, 0.8, 0.4)), box((2.2, 1.8, 0.1), (0.2, 0.2, 0.2))
    parted, whole = (parted_sun(patches_of_sun(empty.sunlit), sunny.shape, bare, (one,), EYE) for one in (shades, away))
    assert parted is not None
    assert parted[sunny].mean() > 0.5
    assert whole is not None
    assert not whole.any()
    with empty.without(parted) as (rgb, sunless):
        assert sunless is not None
        assert (rgb[sunny & sunless] == 1).all()
        assert np.array_equal(rgb[~sunless], photograph[~sunless])


def test_a_place_that_gets_much_brighter_keeps_its_colour_and_only_sun_that_falls_is_without_bound() -> None:
    """Beside a sunlit wardrobe: as seen, where removal took sun away that does not fall, where it falls."""
    count, most = 3, np.float32((5, 8, 6))
    ones, sun = np.ones((count, 3), np.float32), np.zeros((count, 3), np.float32)
    sun[2] = 2
    nothing, sunless = 0 * ones, np.array([False, True, True])
    light, paint = (ones, most * ones, nothing, sun), (0.5 * ones, nothing, ones[:, 0].copy())
    mirror = np.empty((count, 0), np.float32)
    given = _Given(np.arange(count), np.zeros(count, np.int32), *light, *paint, mirror, sunless)
    photo = np.full((1, count, 3), 100, np.float32)
    band = Band(photo.copy(), *np.zeros((2, 1, count), bool))
    _shade_all(given, _WEIGHTS, photo, band)
    np.testing.assert_allclose(band.shown[0, :2], 100 * MOST_GAIN * np.stack(2 * [most / 8]), rtol=1e-5)
    np.testing.assert_allclose(band.shown[0, 2], 100 * (most + 2), rtol=1e-5)
    np.testing.assert_allclose(bounded(np.stack([most, most / 3])), np.stack([most / 2, most / 3]), rtol=1e-5)


def test_ibl_lights_furniture_by_the_panorama_and_changes_nothing_else(room) -> None:
    even = np.full((ROWS, 2 * ROWS, 3), 100.0, np.float32)
    staged = ibl(even, (TABLE,), EYE, room, samples=64, clean=False)
    assert np.array_equal(staged.rgb[staged.kept], even[staged.kept])
    # A convex thing in even light L shows albedo x L.
    assert staged.rgb[staged.furniture].mean(axis=0) == pytest.approx(np.array([0.5, 0.3, 0.2]) * 100, rel=0.02)


def test_other_places_and_views(room) -> None:
    view = Perspective(48, 32, 1.2, yaw_rad=0.5)
    small = Effort(texel_m=0.3, patch_samples=16, rows=16, pixel_samples=8, sun_samples=8, clean=False)
    rgb = render(room.furnished((TABLE,)), view, (0.5, 0.5, 1.2), effort=small).rgb
    assert rgb.shape == (32, 48, 3)
    assert np.isfinite(rgb).all()
    assert (rgb > 0).all()


def stable(scene, eye=EYE) -> np.ndarray:
    small = Effort(texel_m=0.3, patch_samples=16, rows=32, pixel_samples=8, sun_samples=8, clean=False)
    rgb = render(scene, Equirectangular(64, 32), eye, effort=small).rgb
    assert np.isfinite(rgb).all()
    assert (rgb >= 0).all()
    return rgb


def test_a_window_of_one_square_centimetre_and_a_sun_of_1e9() -> None:
    tiny = box_room(window=(2.0, 2.01, 1.5, 1.51))
    sun = Sun((0.0, -0.8, 0.6), (9e4, 9e4, 9e4))
    rgb = stable(scene_of(tiny, Outdoors(np.full((16, 32, 3), 1e9, np.float32), sun), 0.5))
    # About 2e5 lm enter: no pixel may be brighter than the glass itself.
    assert 0 < np.median(rgb) < 1e6


def test_a_room_of_100_m_a_camera_1_cm_from_a_wall_and_black_walls() -> None:
    stable(scene_of(box_room(100.0, 4.0, window=(40.0, 60.0, 0.8, 2.3)), uniform_sky(), 0.5))
    stable(scene_of(box_room(), uniform_sky(), 0.5), (2.49, 0.0, 1.6))
    rgb = stable(scene_of(box_room(), uniform_sky(), 0.0))
    assert np.median(rgb) == 0


def test_slivers_and_furniture_through_a_wall() -> None:
    angle = np.linspace(0, 2 * np.pi, 1001)[:-1]
    ring = np.column_stack([0.5 * np.cos(angle) + 1, 0.5 * np.sin(angle) + 1, np.full(1000, 0.5)])
    corners = np.vstack([ring, [[1.0, 1.0, 0.5]]])
    index = np.arange(1000)
    faces = np.column_stack([index, (index + 1) % 1000, np.full(1000, 1000)]).astype(np.int32)
    disc = Part("slivers", corners, faces, Material("grey", (0.5, 0.5, 0.5)))
    stable(scene_of(box_room(), uniform_sky(), 0.5).furnished((disc, box((2.5, 0, 1), (1, 1, 1)))))


def test_what_cannot_be_is_refused_by_name(photograph, room) -> None:
    with pytest.raises(MaterialError, match="material rug"):
        Material("rug", (0.5, 0.5, 0.5), np.full((2, 2, 3), np.nan, np.float32))
    with pytest.raises(MaterialError, match="not a number within 0 and 1"):
        Material("white", (1.2, 1, 1))
    with pytest.raises(SceneError, match="part chair"):
        Part("chair", np.full((3, 3), np.nan), np.array([[0, 1, 2]], np.int32), TABLE.material)
    with pytest.raises(SceneError, match="refers to no vertex"):
        Part("chair", np.zeros((3, 3)), np.array([[0, 1, 3]], np.int32), TABLE.material)
    with pytest.raises(ParameterError, match="whole panorama"):
        differential(photograph[:, :10], room, (TABLE,), EYE)
    with pytest.raises(ParameterError, match="light cannot have"):
        differential(np.full_like(photograph, np.nan), room, (TABLE,), EYE)


def test_sunlight_returns_where_removal_took_it() -> None:
    room, photograph, sunny = sunny_room()
    shaded = np.where(sunny[..., None], np.median(photograph[FLOOR], axis=0), photograph).astype(np.float32)
    far = box((2.0, 1.6, 0.2), (0.3, 0.3, 0.4))
    staged = differential(shaded, room, (far,), EYE, effort=LOOK, sunless=sunny)
    back = staged.rgb[sunny & ~staged.furniture][:, 1] / photograph[sunny & ~staged.furniture][:, 1]
    assert np.median(back) == pytest.approx(1, abs=0.3)


def test_a_faint_sun_that_removal_took_away_falls_anew_and_is_taken_away_once() -> None:
    """A half shadow's rim: with and without that sun the model fits what removal left, and only one of them is so."""
    room, _, sunny = sunny_room()
    outdoors = room.outdoors
    assert outdoors.sun is not None
    clouded = replace(room, outdoors=replace(outdoors, sun=None))
    none = render(clouded, GEOMETRY, EYE, effort=LOOK).rgb
    lux = 0.4 * np.pi / 0.5 * float(np.median(none[sunny]) / outdoors.sun.direction[2])
    veiled = replace(room, outdoors=replace(outdoors, sun=replace(outdoors.sun, normal_illuminance_lx=(lux,) * 3)))
    full = render(veiled, GEOMETRY, EYE, effort=LOOK).rgb
    assert 1.2 < np.median((full / none)[sunny]) < 1.6, "so faint that both models fit"
    far, over = box((2.0, 1.6, 0.2), (0.3, 0.3, 0.4)), box((0.0, -1.9, 1.5), (4.0, 0.1, 3.0))
    back = differential(none, veiled, (far,), EYE, effort=LOOK, sunless=sunny)
    where = sunny & ~back.furniture
    assert np.median((back.rgb / full)[where]) == pytest.approx(1, abs=0.1)
    assert np.median((back.rgb / none)[where]) > 1.2
    shaded = differential(none, veiled, (over,), EYE, effort=LOOK, sunless=sunny)
    same = differential(none, clouded, (over,), EYE, effort=LOOK)
    where = sunny & ~shaded.furniture
    assert where.any()
    assert np.median((shaded.rgb / same.rgb)[where]) == pytest.approx(1, abs=0.1)


def test_what_hangs_from_the_ceiling_is_whole_before_what_stands_farther_away(room, photograph) -> None:
    """A lamp took the change of the wall behind it, and a wardrobe at that wall was drawn over it."""
    wardrobe = box((2.0, 0.0, 1.3), (0.8, 2.4, 2.6), (0.1, 0.1, 0.1))
    change = changed(photograph, Bare.of(room, LOOK), (wardrobe,), EYE, effort=LOOK, seed=0)
    staged = draw(change, photograph, None)
    row, column = (one.ravel() for one in np.mgrid[ROWS // 2 - 2 : ROWS // 2 + 4, 94:100])
    assert staged.furniture[row, column].all()
    mount = (6, 96)
    gain = staged.rgb[mount] / photograph[mount]
    assert not np.allclose(gain, 1, atol=1e-3)
    away = np.ones(photograph.shape[:2], bool)
    away[row, column] = False
    for far_m, before in ((1.0, True), (2.3, False)):
        hangs = Hanging(row, column, np.ones(len(row), np.float32), mount, far_m)
        found = draw(change, photograph, None, [hangs])
        assert (not found.furniture[row, column].any()) == before
        shown = photograph[row, column] * gain if before else staged.rgb[row, column]
        assert np.allclose(found.rgb[row, column], shown, rtol=1e-5)
        assert np.array_equal(found.rgb[away], staged.rgb[away])

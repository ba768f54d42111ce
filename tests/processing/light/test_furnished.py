"""Old furniture's shade: stand-ins from its outline, and the light with and without it, in rooms rendered with it."""

from __future__ import annotations

import math
import re
from dataclasses import replace

import cv2
import numpy as np
import pytest

from processing.ground.arrays import Doubles, Flags, Floats
from processing.ground.seam import grown
from processing.light.picture.render import render
from processing.light.scene.albedo import KnownLight, albedo_of_room
from processing.light.scene.furnished import (
    SPREAD,
    FurnishedLight,
    OldFurniture,
    _moved,
    furnished_light,
    guarded,
)
from processing.light.scene.scene import Outdoors, Part, Sun
from processing.light.scene.sources import window_strength
from processing.light.scene.standins import LOW_M, VOXEL_M, standins_of
from processing.light.solver.irradiance import Effort
from processing.light.solver.sight import FIRST_PART, GLASS, seen_outdoors, sight_of
from processing.light.solver.stage import Stage
from processing.pictures.images import LuminanceImage, Validity, luminance_cd_m2
from processing.removal.fill import Others
from processing.removal.lift import Shade, lifted, light_without
from processing.sphere import Equirectangular
from processing.surfaces.maps import FIRST_WALL, FLOOR, surface_maps
from tests.conftest import LONG
from tests.processing.light.rooms import EYE, box, box_room, scene_of, uniform_sky

ROWS = 64
GEOMETRY = Equirectangular(2 * ROWS, ROWS)
RAYS = 128 if LONG else 64
LOOK = Effort(texel_m=0.25, patch_samples=RAYS, rows=ROWS, pixel_samples=2 * RAYS, clean=False)
WORK = Effort(texel_m=0.25, patch_samples=RAYS, rows=ROWS, pixel_samples=RAYS, sun_samples=16)
PLACE, SIZE = (1.1, -0.4, 0.0), (1.2, 2.2, 1.1)
"""Of a cabinet: its corner nearest to the camera and its size, m."""


def colours(name: str) -> Floats:
    return np.full((1, 1, 3), {"floor": 0.3, "ceiling": 0.85}.get(name, 0.65), np.float32)


def cabinet(albedo: float) -> Part:
    middle = tuple(low + size / 2 for low, size in zip(PLACE, SIZE, strict=True))
    return box(middle, SIZE, (albedo,) * 3)


def image(rgb: Floats) -> LuminanceImage:
    shape = rgb.shape[:2]
    return LuminanceImage(rgb, np.full(shape, 0.02, np.float32), np.zeros(shape, np.uint8), GEOMETRY, 0.02)


def pictured(parts: tuple[Part, ...]) -> tuple[LuminanceImage, Flags]:
    """Return the room rendered with parts in it, and where they are seen."""
    scene = replace(scene_of(box_room(), uniform_sky(4000.0), colours, reveal_m=0.2), parts=parts)
    rgb = render(scene, GEOMETRY, EYE, effort=LOOK, seed=5).rgb
    seen = sight_of(Stage.of(scene, 0.5), GEOMETRY, EYE).label >= FIRST_PART
    return image(rgb), seen.reshape(ROWS, 2 * ROWS)


def light_of(picture: LuminanceImage, furniture: Flags, parts: tuple[Part, ...]) -> FurnishedLight:
    old = OldFurniture(furniture, furniture, parts)
    return furnished_light(picture, box_room(), uniform_sky(4000.0), old, rows=ROWS, effort=WORK)


@pytest.fixture(scope="module")
def bare() -> LuminanceImage:
    return pictured(())[0]


@pytest.fixture(scope="module")
def dark() -> tuple[LuminanceImage, Flags]:
    return pictured((cabinet(0.05),))


@pytest.fixture(scope="module")
def found(dark: tuple[LuminanceImage, Flags]) -> FurnishedLight:
    """The light about the black cabinet, its mesh given."""
    return light_of(*dark, (cabinet(0.35),))


def shade_of(found: FurnishedLight) -> Shade:
    return Shade(found.log_change, found.without_lx, found.seen)


def test_what_furniture_took_comes_back(
    bare: LuminanceImage, dark: tuple[LuminanceImage, Flags], found: FurnishedLight
) -> None:
    """The lifted room is the one rendered without the cabinet, which took more than 5 %; so are light and albedo."""
    picture, furniture = dark
    done, change = lifted(picture, furniture, box_room(), shade_of(found), quality="draft")
    true, before, after = (luminance_cd_m2(one.rgb) for one in (bare, picture, done.image))
    seen = found.seen & ~furniture
    assert np.median(np.abs(before / true - 1)[seen]) > 0.05, "there is something to lift"
    assert np.median(np.abs(after / true - 1)[seen]) < 0.03
    assert abs(np.median((after / true - 1)[seen])) < 0.02
    assert np.median(np.abs(after / true - 1)[furniture]) < 0.06
    assert (done.image.uncertainty[seen] >= picture.uncertainty[seen]).all()
    assert change[seen].mean() > 0.03
    known = KnownLight(found.scene, *light_without(shade_of(found), box_room(), ROWS))
    ours = albedo_of_room(done.image, box_room(), known, filled=furniture, rows=ROWS, effort=WORK)
    anew = albedo_of_room(bare, box_room(), uniform_sky(4000.0), rows=ROWS, effort=WORK)
    for plane in range(6):
        there = (surface_maps(box_room(), GEOMETRY).plane == plane) & seen
        light = [np.median(luminance_cd_m2(one.irradiance)[there]) for one in (ours, anew)]
        assert light[0] == pytest.approx(light[1], rel=0.03), "light as in the truly empty room"
        colour = [np.median(one.picture[there].mean(axis=-1)) for one in (ours, anew)]
        # A wall is one colour, decided by what is seen of it: of the one behind the cabinet that is another part.
        behind = furniture[surface_maps(box_room(), GEOMETRY).plane == plane].mean()
        assert colour[0] == pytest.approx(colour[1], rel=0.12 if behind > 0.2 else 0.08)


def test_shade_that_no_standin_explains_is_relit_where_it_was_found(
    bare: LuminanceImage, dark: tuple[LuminanceImage, Flags], found: FurnishedLight
) -> None:
    picture, furniture = dark
    maps = surface_maps(box_room(), GEOMETRY)
    deep = (maps.plane == FLOOR) & grown(furniture, math.radians(12)) & ~furniture
    darker = replace(picture, rgb=np.where(deep[..., None], picture.rgb * np.float32(0.5), picture.rgb))
    true, inner = luminance_cd_m2(bare.rgb), deep & found.seen & ~grown(~deep & ~furniture, math.radians(3))
    off = []
    for shadow in (None, deep):
        done, change = lifted(darker, furniture, box_room(), shade_of(found)._replace(shadow=shadow), quality="draft")
        off.append(float(np.median(luminance_cd_m2(done.image.rgb)[inner] / true[inner])))
    assert off[0] < 0.8, "evened on the floor, in part"
    assert 0.85 < off[1] < 1.1
    assert change[inner].mean() > 0.3, "and is stated"


def test_what_lies_in_deep_shade_is_replaced(dark: tuple[LuminanceImage, Flags], found: FurnishedLight) -> None:
    """A picture shows noise there; lifted, it would show that."""
    picture, furniture = dark
    floor = surface_maps(box_room(), GEOMETRY).plane == FLOOR
    deep = floor & grown(furniture, math.radians(12)) & ~furniture
    inner = deep & ~grown(~deep & ~furniture, math.radians(4))
    noise = np.random.default_rng(3).uniform(0.02, 0.2, picture.rgb.shape).astype(np.float32)
    noisy = replace(picture, rgb=np.where(deep[..., None], picture.rgb * noise, picture.rgb))
    much = np.where(deep[..., None], np.float32(math.log(8)), found.log_change)
    done, change = lifted(noisy, furniture, box_room(), shade_of(found)._replace(log_change=much), quality="draft")
    assert (done.provenance[inner] > 0).all()
    assert not change[inner].any()
    level = luminance_cd_m2(done.image.rgb)
    assert level[inner].std() < 0.25 * level[inner].mean()
    assert (done.provenance[floor & ~grown(deep | furniture, math.radians(4))] == 0).all()


@pytest.mark.long
def test_a_standin_off_by_20_cm_leaves_no_ghost(
    bare: LuminanceImage, dark: tuple[LuminanceImage, Flags], found: FurnishedLight
) -> None:
    picture, furniture = dark
    off = cabinet(0.35)
    moved = light_of(picture, furniture, (replace(off, vertices_m=off.vertices_m + np.array([0.14, 0.14, 0.0])),))
    beside = found.seen & moved.seen & grown(furniture, math.radians(8))
    assert beside.sum() > 100
    apart = np.abs(moved.log_change - found.log_change).mean(axis=-1)[beside]
    assert np.median(apart) < 0.05
    assert np.quantile(apart, 0.9) < 0.15


def test_a_pane_gives_the_camera_what_the_camera_sees_on_it(
    dark: tuple[LuminanceImage, Flags], found: FurnishedLight
) -> None:
    sight = sight_of(Stage.of(found.scene, 0.5), GEOMETRY, EYE)
    glass = sight.label == GLASS
    given = luminance_cd_m2(seen_outdoors(Stage.of(found.scene, 0.5), sight).reshape(ROWS, 2 * ROWS, 3)).ravel()
    assert given[glass].mean() == pytest.approx(luminance_cd_m2(dark[0].rgb).ravel()[glass].mean(), rel=0.05)


def test_what_the_lens_did_not_see_spoils_nothing_around(
    dark: tuple[LuminanceImage, Flags], found: FurnishedLight
) -> None:
    picture, furniture = dark
    rgb, hole = picture.rgb.copy(), np.zeros_like(furniture)
    rim = grown(furniture, math.radians(6)) & ~furniture & (surface_maps(box_room(), GEOMETRY).plane > 1)
    hole.ravel()[np.flatnonzero(rim)[::9]] = True
    rgb[hole] = np.nan
    rgb[30, 40] = np.inf
    broken = replace(picture, rgb=rgb, validity=np.where(hole, np.uint8(Validity.OUTSIDE), picture.validity))
    done, change = lifted(broken, furniture, box_room(), shade_of(found), quality="draft")
    seen = ~hole
    seen[30, 40] = False
    assert np.isfinite(done.image.rgb[seen]).all()
    assert np.isfinite(change).all()


def test_a_window_that_is_hidden_altogether_is_lit_as_the_wall_that_it_is_filled_as() -> None:
    """Nobody saw it; in the room's mean light it would stand out of its dark wall as a bright rectangle."""
    maps = surface_maps(box_room(), GEOMETRY)
    mine = maps.plane == maps.plane[maps.opening >= 0][0]
    light = np.where(mine, 100, 2000)[..., None] * np.ones(3, np.float32)
    hidden = grown(maps.opening >= 0, math.radians(3))
    everywhere = np.ones(mine.shape, bool)
    shade = Shade(np.zeros_like(light), light.astype(np.float32), everywhere)
    done, _ = lifted(image((0.5 * light / math.pi).astype(np.float32)), hidden, box_room(), shade, quality="draft")
    assert luminance_cd_m2(done.image.rgb)[hidden & mine] == pytest.approx(50 / math.pi, rel=0.05)


def test_a_line_along_what_was_removed_fades_on_walls_and_what_is_no_line_stays(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """Rims of a hole on a wall darker by 8 %, as imperfectly lifted shade leaves them; a stripe of 40 % is a thing."""
    rows = 192
    geometry = Equirectangular(2 * rows, rows)
    maps, everywhere = surface_maps(box_room(), geometry), np.ones((rows, 2 * rows), bool)
    bare = np.full((rows, 2 * rows, 3), 50, np.float32)
    hole, stripe = np.zeros((2, rows, 2 * rows), bool)
    middle = int(np.median(np.flatnonzero((maps.plane == 3).any(axis=0) & ~(maps.opening >= 0).any(axis=0))))
    hole[90:112, middle - 22 : middle + 22] = True
    stripe[92:110, middle + 25 : middle + 28] = True
    rim = grown(hole, math.radians(1.2)) & ~hole
    assert (maps.plane[rim | stripe] == 3).all()
    dark = bare * np.where(rim, 0.92, np.where(stripe, 0.6, 1)).astype(np.float32)[..., None]
    picture = replace(image(dark), geometry=geometry)
    light = np.full_like(bare, 200)
    shade = Shade(np.full_like(light, 0.01), light, everywhere)
    done, change = lifted(picture, hole, box_room(), shade, quality="draft")
    with monkeypatch.context() as without:
        without.setattr("processing.removal.lift.MOST_LINE", 1e-9)
        left = lifted(picture, hole, box_room(), shade, quality="draft")[0].image.rgb

    def steep(rgb: Floats) -> float:
        """Return how much luminance changes from pixel to pixel across the rim's outer half."""
        across = np.abs(np.diff(np.log(cv2.GaussianBlur(rgb[..., 1], (0, 0), 1.5)), axis=0))
        return float(across[:, middle - 15 : middle + 15].max(axis=0).mean())

    assert steep(done.image.rgb) < 0.7 * steep(left)
    np.testing.assert_allclose(done.image.rgb[stripe], left[stripe], rtol=0.02)
    far = ~grown(hole, math.radians(6))
    np.testing.assert_allclose(done.image.rgb[far], left[far], rtol=1e-4)
    np.testing.assert_allclose(np.log(done.image.rgb / dark).mean(axis=-1)[~hole], change[~hole], atol=1e-5)


@pytest.mark.long
def test_a_darker_thing_takes_more(found: FurnishedLight) -> None:
    white = light_of(*pictured((cabinet(0.9),)), (cabinet(0.35),))
    gains = [float(np.median(one.log_change.mean(axis=-1)[one.seen])) for one in (white, found)]
    assert gains[0] < 0.5 * gains[1]


def test_without_furniture_nothing_changes(bare: LuminanceImage) -> None:
    nothing = np.zeros((ROWS, 2 * ROWS), bool)
    found = light_of(bare, nothing, ())
    assert not found.log_change.any()
    hole = nothing.copy()
    hole[40:46, 60:68] = True
    shade = Shade(found.log_change, found.without_lx, found.seen)
    done, change = lifted(bare, hole, box_room(), shade, quality="draft")
    assert np.array_equal(done.image.rgb[~hole], bare.rgb[~hole])
    assert not change.any()
    assert np.median(np.abs(luminance_cd_m2(done.image.rgb) / luminance_cd_m2(bare.rgb) - 1)[hole]) < 0.05


def test_windows_are_not_so_strong_that_the_room_is_black() -> None:
    """Where patterns hide how light falls off any strength is as good, and 64 times would leave an albedo of 0.01."""
    windows, rest = np.linspace(20.0, 40.0, 400), np.full(400, 30.0)
    pattern = np.exp(np.random.default_rng(3).normal(0, 0.3, 400))
    radiosity = 0.3 * 60 * windows / windows.mean() * pattern
    best, low, high = window_strength(radiosity, windows, rest, np.ones(400), [np.arange(400)])
    assert best == low == 1.0
    assert 2 < high < 4


@pytest.mark.sweep
@pytest.mark.parametrize("outdoors", [None, uniform_sky(4000.0)] if LONG else [None])
def test_a_patch_that_shines_without_a_known_sun_shines_without_furniture_too(
    bare: LuminanceImage, outdoors: Outdoors | None
) -> None:
    """A patch of sun in a single photograph, or glare: its light in the room was lost with the furniture."""
    spot = bare.rgb.copy()
    spot[44:52, 30:44] *= 12
    nothing = np.zeros((ROWS, 2 * ROWS), bool)
    found = furnished_light(
        image(spot), box_room(), outdoors, OldFurniture(nothing, nothing, ()), rows=ROWS, effort=WORK
    )
    assert found.seen.any()
    assert not found.log_change.any()


def test_windows_and_clipped_pixels_stay_as_they_are(dark: tuple[LuminanceImage, Flags], found: FurnishedLight) -> None:
    picture, furniture = dark
    validity = picture.validity.copy()
    validity[10:14, 5:20] = 1
    clipped = replace(picture, validity=validity)
    done, _ = lifted(clipped, furniture, box_room(), shade_of(found), quality="draft")
    glass = (surface_maps(box_room(), GEOMETRY).opening >= 0) & ~furniture
    for where in (glass, validity == 1):
        assert np.array_equal(done.image.rgb[where], picture.rgb[where])


def test_what_a_removed_lamps_glow_has_clipped_is_filled(
    dark: tuple[LuminanceImage, Flags], found: FurnishedLight, monkeypatch: pytest.MonkeyPatch
) -> None:
    """It would stay white within a wall that is as dark again as without the lamp."""
    picture, furniture = dark
    gain, validity = np.ones_like(picture.rgb), picture.validity.copy()
    gain[10:14, 5:12], validity[10:14, 5:20] = 0.5, 1
    monkeypatch.setattr("processing.removal.lift.relit", lambda *_: gain.copy())
    clipped = replace(picture, validity=validity)
    done, _ = lifted(clipped, furniture, box_room(), shade_of(found), quality="draft")
    assert (done.provenance[10:14, 5:12] > 0).all()
    assert np.array_equal(done.image.rgb[10:14, 12:20], picture.rgb[10:14, 12:20]), "what is clipped else stays"


@pytest.mark.long
def test_the_same_input_gives_the_same_bytes(dark: tuple[LuminanceImage, Flags], found: FurnishedLight) -> None:
    other = light_of(*dark, (cabinet(0.35),))
    assert np.array_equal(found.log_change, other.log_change)
    assert np.array_equal(found.without_lx, other.without_lx)


def test_a_standin_stands_where_the_furniture_does() -> None:
    """From its outline alone: within 20 cm on the near side, within the room, and no more than a third too large."""
    _, furniture = pictured((cabinet(0.3),))
    parts = standins_of(box_room(), furniture)
    assert len(parts) == 1
    low, high = parts[0].vertices_m.min(axis=0), parts[0].vertices_m.max(axis=0)
    assert low[0] == pytest.approx(PLACE[0], abs=0.2)
    assert low[2] < VOXEL_M
    assert LOW_M <= high[2] + VOXEL_M <= SIZE[2] + 0.2, "how high it is, nobody sees: between usual and true"
    stage = Stage.of(replace(scene_of(box_room(), uniform_sky(), colours), parts=parts), 0.5)
    seen = (sight_of(stage, GEOMETRY, EYE).label >= FIRST_PART).reshape(ROWS, 2 * ROWS)
    assert (seen & furniture).sum() > 0.7 * furniture.sum()
    assert (seen & ~furniture).sum() < 0.2 * furniture.sum()


def test_no_standin_where_there_is_no_furniture_or_only_the_tripod() -> None:
    nothing = np.zeros((ROWS, 2 * ROWS), bool)
    assert standins_of(box_room(), nothing) == ()
    nothing[-4:] = True
    assert standins_of(box_room(), nothing) == ()


def test_what_hangs_is_thin_and_at_its_wall() -> None:
    picture = np.zeros((ROWS, 2 * ROWS), bool)
    picture[28:34, 90:100] = True
    (part,) = standins_of(box_room(), picture)
    assert part.vertices_m[:, 2].min() > 1.0
    floor = np.asarray(box_room().floor)
    away = np.minimum(
        np.abs(part.vertices_m[:, :2] - floor.min(axis=0)), np.abs(floor.max(axis=0) - part.vertices_m[:, :2])
    )
    assert away.min(axis=1).max() < 0.3


@pytest.mark.parametrize("true", [1.0, 4.0, 20.0])
def test_windows_strength_follows_from_how_their_light_falls_off(true: float) -> None:
    rng = np.random.default_rng(3)
    groups = [np.arange(100 * k, 100 * (k + 1)) for k in range(4)]
    windows, rest = 10 ** rng.uniform(0, 2, 400), rng.uniform(20, 40, 400)
    albedo = np.repeat([0.2, 0.6, 0.7, 0.85], 100) * np.exp(rng.normal(0, 0.15, 400))
    best, low, high = window_strength(albedo * (true * windows + rest), windows, rest, np.ones(400), groups)
    assert best == pytest.approx(true, rel=0.2)
    assert low <= true * 1.01
    assert high >= true * 0.99


@pytest.mark.sweep
@pytest.mark.parametrize("shown", [0.03, 0.4] if LONG else [0.03])
@pytest.mark.parametrize("furnished", [True, False], ids=["furnished", "empty"])
def test_an_overexposed_sun_is_as_strong_as_the_patches_that_it_lights_say(shown: float, furnished: bool) -> None:
    """Outdoors its disc is cut at a share of what it is; the room's own picture has all of its light."""
    towards = np.array([0.2, -0.75, 0.6]) / np.linalg.norm([0.2, -0.75, 0.6])
    sun = Sun(tuple(towards), (75_000.0, 70_000.0, 60_000.0))
    glass = {0: (0.75, 0.77, 0.75)}
    room = scene_of(box_room(), uniform_sky(4000.0, sun), colours, reveal_m=0.2, transmittance=glass)
    room = replace(room, parts=(cabinet(0.05),) if furnished else ())
    picture = image(render(room, GEOMETRY, EYE, effort=replace(LOOK, sun_samples=32), seed=5).rgb)
    cut = Sun(sun.direction, tuple(shown * one for one in sun.normal_illuminance_lx), clipped=True)
    outdoors = replace(room.outdoors, sun=cut)
    if furnished:
        seen = (sight_of(Stage.of(room, 0.5), GEOMETRY, EYE).label >= FIRST_PART).reshape(ROWS, 2 * ROWS)
        old = OldFurniture(seen, seen, (cabinet(0.35),))
        found = furnished_light(picture, box_room(), outdoors, old, rows=ROWS, effort=WORK)
        scene, notes = found.scene, found.notes
    else:
        albedo = albedo_of_room(picture, box_room(), outdoors, rows=ROWS, effort=WORK)
        scene, notes = albedo.scene, albedo.notes
    solved = scene.outdoors.sun
    assert solved is not None
    assert not solved.clipped
    assert solved.normal_illuminance_lx == pytest.approx(sun.normal_illuminance_lx, rel=0.2)
    note = next(one for one in notes if one.startswith("sun: "))
    low, high = (float(one) for one in re.findall(r"\(([\d.]+) to ([\d.]+)\)", note)[0])
    assert low <= 1 / shown <= high


def test_a_single_photograph_s_room_gets_the_sun_back_that_fell_on_its_furniture() -> None:
    """A black cabinet takes all of a window's sun; the empty room is brighter by what its floor gives back."""
    towards = np.array([0.5, -0.6, 0.6]) / np.linalg.norm([0.5, -0.6, 0.6])
    sun = Sun((float(towards[0]), float(towards[1]), float(towards[2])), (40_000.0, 40_000.0, 40_000.0))
    empty = scene_of(box_room(), uniform_sky(4000.0, sun), colours, reveal_m=0.2)
    full = replace(empty, parts=(box((-0.6, 0.2, 0.4), (1.8, 2.4, 0.8), (0.03,) * 3),))
    truth, picture = (
        image(render(one, GEOMETRY, EYE, effort=replace(LOOK, sun_samples=32), seed=5).rgb) for one in (empty, full)
    )
    furniture = (sight_of(Stage.of(full, 0.5), GEOMETRY, EYE).label >= FIRST_PART).reshape(ROWS, 2 * ROWS)
    old = OldFurniture(furniture, furniture, full.parts)
    plane = surface_maps(box_room(), GEOMETRY).plane
    shade = luminance_cd_m2(picture.rgb)[(plane == FLOOR) & ~furniture]
    times = 40_000.0 / (math.pi * float(np.median(shade)) / 0.3)
    off = []
    for known in (None, (sun.direction, times)):
        found = furnished_light(picture, box_room(), None, old, rows=ROWS, effort=WORK, known_sun=known)
        there = found.seen & (plane != FLOOR)
        true = np.log(luminance_cd_m2(truth.rgb)[there] / luminance_cd_m2(picture.rgb)[there])
        off.append(float(np.median(found.log_change[there].mean(axis=-1) - true)))
    assert off[0] < -0.3, "the sun is missed"
    assert abs(off[1]) < 0.15
    assert any(note.startswith("sun: ") for note in found.notes)


def test_no_sun_comes_back_from_furniture_that_the_photograph_shows_in_the_shade() -> None:
    """Windows that are taken for too large put it in the sun: a room came out 1.6 times as bright as it is."""
    sky, towards = uniform_sky(4000.0), np.array([0.5, -0.6, 0.6]) / np.linalg.norm([0.5, -0.6, 0.6])
    full = scene_of(box_room(), sky, colours, reveal_m=0.2).furnished((box((-0.6, 0.2, 0.4), (1.8, 2.4, 0.8)),))
    picture = image(render(full, GEOMETRY, EYE, effort=LOOK, seed=5).rgb)
    furniture = (sight_of(Stage.of(full, 0.5), GEOMETRY, EYE).label >= FIRST_PART).reshape(ROWS, 2 * ROWS)
    old, known = OldFurniture(furniture, furniture, full.parts), ((*map(float, towards),), 30.0)
    without, with_sun = (
        furnished_light(picture, box_room(), None, old, rows=ROWS, effort=WORK, known_sun=sun).log_change
        for sun in (None, known)
    )
    assert np.median(with_sun) == pytest.approx(np.median(without), abs=0.05)


def test_an_overexposed_sun_that_lights_nothing_seen_stays_a_lower_bound() -> None:
    behind = Sun((0.0, 0.8, 0.6), (2000.0, 2000.0, 2000.0), clipped=True)
    outdoors = uniform_sky(4000.0, behind)
    picture = image(render(scene_of(box_room(), outdoors, colours), GEOMETRY, EYE, effort=LOOK, seed=5).rgb)
    found = albedo_of_room(picture, box_room(), outdoors, rows=ROWS, effort=WORK)
    assert found.scene.outdoors.sun == behind
    assert any("a lower bound" in one for one in found.notes)


def test_a_ghost_is_kept_down() -> None:
    """A local brightening that no shade in the picture answers to is taken back; one that a shade answers to stays."""
    maps = surface_maps(box_room(), GEOMETRY)
    seen = maps.opening < 0
    even = np.full((ROWS, 2 * ROWS), 50.0, np.float32)
    spot = np.zeros(even.shape, bool)
    spot[46:54, 60:72] = True
    log_ratio = np.where(spot, math.log(1.5), 0.1)
    light = np.full(even.shape, 500.0, np.float32)

    def guarded_grey(log_ratio: Doubles, luminance: Floats) -> Doubles:
        return guarded(log_ratio[..., None], log_ratio, (luminance, light), seen, maps)[..., 0]

    ghost = guarded_grey(log_ratio, even)
    assert np.median(ghost[spot & seen]) < 0.2
    # Nor is the colour of that brightening left: the floor would stay green where nothing got brighter.
    coloured = log_ratio[..., None] + np.where(spot, 0.2, 0)[..., None] * (-1, 1, 0)
    apart = np.ptp(guarded(coloured, log_ratio, (even, light), seen, maps), axis=-1)
    assert np.median(apart[spot & seen]) < 0.1
    shaded = np.where(spot, even * math.exp(0.1) / 1.5, even).astype(np.float32)
    assert np.median(guarded_grey(log_ratio, shaded)[spot & seen]) > 0.8 * math.log(1.5)
    assert np.allclose(guarded_grey(log_ratio, shaded)[~spot & seen], 0.1, atol=0.05)
    rug = np.where(spot, 0.4 * even, even).astype(np.float32)
    kept = guarded_grey(np.full(even.shape, 0.1), rug)
    assert np.allclose(kept[seen], 0.1, atol=0.01), "a dark rug in even light is no shade"
    # A brightening that fades out and that nothing answers to: no line where it begins to count.
    fading = 0.1 + 0.2 * np.clip(1 - np.hypot(*np.mgrid[-50 : ROWS - 50, -66 : 2 * ROWS - 66]) / 14, 0, 1)
    same = seen[:, 1:] & seen[:, :-1] & (maps.plane[:, 1:] == maps.plane[:, :-1])
    assert np.abs(np.diff(guarded_grey(fading, even), axis=1))[same].max() < 0.015


def at_level(found: FurnishedLight, level: float) -> FurnishedLight:
    """Return a light whose change is the same everywhere, in a room that usually changes by 0.1 (its floor by 0.2)."""
    change = np.full_like(found.log_change, level)
    return replace(found, log_change=change, prior=0.1, doubt=0.1)


def test_a_change_is_believed_the_less_the_farther_it_is_from_what_rooms_do(found: FurnishedLight) -> None:
    """Each plane moves as one, so that no shade within it is lost; what is far from all rooms says next to nothing."""
    share = []
    for level in (0.2, 0.4, 1.0):
        moved, trust = _moved(at_level(found, level), None)
        share.append(trust)
        for number in np.unique(found.plane):
            assert np.ptp(moved[found.plane == number]) < 1e-6
        assert np.allclose(moved[found.plane != FLOOR], (1 - trust) * (0.1 - level), atol=1e-5)
        assert np.allclose(moved[found.plane == FLOOR], (1 - trust) * (0.2 - level), atol=1e-5)
    assert 0.7 > share[0] > share[1] > share[2]
    assert share[2] < 0.1
    believed = found.believed()
    moved = _moved(found, None)[0]
    assert np.allclose(believed.log_change - found.log_change, np.where(found.seen[..., None], moved, 0), atol=1e-6)
    assert np.allclose(believed.without_lx, found.without_lx * np.exp(moved)), "light and change by the same"
    assert 0 < believed.doubt < SPREAD


def test_what_another_estimate_says_counts_as_much_and_its_distance_is_a_doubt(found: FurnishedLight) -> None:
    """Two that agree are believed as one is; of two that do not the mean, by less. The second may be of any size."""
    first = at_level(found, 0.2)
    believed, doubts = [], []
    for level in (0.2, 0.3, 0.6):
        half = at_level(found, level)
        half = replace(half, log_change=half.log_change[::2, ::2], seen=half.seen[::2, ::2])
        both = first.believed(half)
        walls = found.seen & (found.plane != FLOOR)
        believed.append(float(np.median(both.log_change[walls])))
        doubts.append(both.doubt)
    alone = first.believed()
    assert believed[0] == pytest.approx(np.median(alone.log_change[walls]), abs=1e-3)
    assert doubts[0] == pytest.approx(alone.doubt, abs=1e-3)
    assert doubts[0] < doubts[1] < doubts[2]
    assert believed[0] < believed[1] < 0.25
    assert 0.1 < believed[2] < 0.4


def test_how_uncertain_a_lift_is_is_stated(dark: tuple[LuminanceImage, Flags], found: FurnishedLight) -> None:
    picture, furniture = dark
    stated = [
        lifted(picture, furniture, box_room(), shade_of(found)._replace(doubt=doubt), quality="draft")
        for doubt in (0.0, 0.1)
    ]
    changed = (stated[0][1] != 0) & ~furniture
    less, more = (one.image.uncertainty[changed] for one, _ in stated)
    np.testing.assert_allclose(more, np.hypot(less, 0.1), rtol=1e-4)


def test_light_goes_on_round_the_seam() -> None:
    """What is behind the camera is as it would be ahead: the room turned by half a turn has its light turned."""
    room, rows = box_room(), 128
    behind = room.model_copy(update={"floor": tuple((-x, -y) for x, y in room.floor)})
    maps = [surface_maps(one, Equirectangular(2 * rows, rows)) for one in (room, behind)]
    ahead = np.abs(np.arange(2 * rows) - rows) < 14
    hidden = (np.abs(np.arange(rows) - 70) < 14)[:, None] & ahead
    x = np.linspace(-1.5, 1.5, 2 * rows)
    values = np.broadcast_to(np.exp(x)[:, None], (rows, 2 * rows, 3)).astype(np.float32)
    shown = np.where(hidden[..., None], 0, values)
    shade = Shade(0.1 * shown, 100 * shown, ~hidden)
    turned = Shade(*(np.roll(part, rows, axis=1) for part in shade[:3]))
    (light, doubt), (other, doubts) = (
        light_without(one, which, rows) for one, which in ((shade, room), (turned, behind))
    )
    np.testing.assert_allclose(np.roll(other, rows, axis=1)[hidden], light[hidden], rtol=0.01)
    np.testing.assert_allclose(np.roll(doubts, rows, axis=1)[hidden], doubt[hidden], rtol=0.01)
    ratio, even = np.where(hidden, 0.4, 0.1), values[..., 0]
    seen = [maps[0].plane >= FIRST_WALL, maps[1].plane >= FIRST_WALL]
    lit = np.full(even.shape, 500.0, np.float32)
    there = np.roll(ratio, rows, 1)
    found = guarded(ratio[..., None], ratio, (even, lit), seen[0], maps[0])
    same = guarded(there[..., None], there, (np.roll(even, rows, 1), lit), seen[1], maps[1])
    np.testing.assert_allclose(np.roll(same, rows, axis=1), found, atol=1e-3)


def test_estimated_distances_bring_a_standin_to_where_the_furniture_is() -> None:
    # A table top on thin legs that the mask left out: its lower edge meets the floor far behind it.
    top = box((1.6, 0.2, 0.75), (1.0, 1.6, 0.1), (0.4,) * 3)
    _, seen = pictured((top,))
    scene = replace(scene_of(box_room(), uniform_sky(4000.0), colours), parts=(top,))
    true_m = sight_of(Stage.of(scene, 0.5), GEOMETRY, EYE).distance_m.reshape(ROWS, 2 * ROWS).astype(np.float32)

    def away_m(parts: tuple[Part, ...]) -> Floats:
        sight = sight_of(Stage.of(replace(scene, parts=parts), 0.5), GEOMETRY, EYE)
        return np.asarray(np.abs(sight.distance_m.reshape(true_m.shape) - true_m)[seen], np.float32)

    by_outline, by_distance = away_m(standins_of(box_room(), seen)), away_m(standins_of(box_room(), seen, true_m))
    assert by_distance.mean() < 0.5 * by_outline.mean()
    assert np.quantile(by_distance, 0.9) < 4 * VOXEL_M


def test_a_doors_leaf_before_the_floor_is_not_lifted_as_floor(
    dark: tuple[LuminanceImage, Flags], found: FurnishedLight
) -> None:
    picture, furniture = dark
    floor = (surface_maps(box_room(), GEOMETRY).plane == FLOOR) & ~furniture
    leaf = floor & (np.arange(floor.shape[1]) % 32 < 16)
    done, change = lifted(picture, furniture, box_room(), shade_of(found), others=Others(unlike=leaf), quality="draft")
    assert np.array_equal(done.image.rgb[leaf], picture.rgb[leaf])
    assert change[floor & ~leaf].mean() > 0.03

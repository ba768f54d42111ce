"""The procedural room as the instruments see it: is the light right, whole, and the same everywhere?"""

import math
import pickle
from dataclasses import replace

import numpy as np
import pytest

from benchmarks.light.truth import room_faults
from mocks.optics.picture_cache import PictureCache
from mocks.rooms import world as world_module
from mocks.rooms.light import light as light_module
from mocks.rooms.light.engine import irradiance_at
from mocks.rooms.light.geometry import Geometry
from mocks.rooms.light.light import QUALITIES, Quality, components, lightings
from mocks.rooms.light.sunlight import enters, sun_share
from mocks.rooms.light.transport import load_scene
from mocks.rooms.model import Role, Use
from mocks.rooms.room import make_room
from mocks.rooms.sky import backdrop
from mocks.rooms.sky.sky import CloudDrift
from mocks.rooms.truth import description, equirectangular, point_lights, truth_pictures
from mocks.rooms.world import DEFAULT, RoomWorld, _shipped, baked_light, light_key, room_world
from mocks.worlds.light import LUMINANCE_WEIGHTS, Site
from mocks.worlds.world import meter_luminance_cd_m2, open_world

ROWS = 48


@pytest.fixture(scope="module", autouse=True)
def coarse_skyline():
    """A skyline of an eighth the columns: rooms are looked at, not what stands before their windows; a small sketch."""
    with pytest.MonkeyPatch.context() as context:
        context.setitem(QUALITIES, "sketch", Quality(32, 8))
        context.setattr(light_module, "ENVIRONMENT_ROWS", 32)
        context.setattr(backdrop, "COLUMNS", 512)
        context.setattr(backdrop, "PIXEL_RAD", 2 * math.pi / 512)
        context.setattr(backdrop, "ROWS", round((backdrop.TOP_RAD - backdrop.BOTTOM_RAD) / backdrop.PIXEL_RAD))
        yield


def sunny(use=Use.LIVING, first=0):
    """Return a room with the sun in it."""
    for seed in range(first, first + 40):
        room = make_room(seed, use, sky="clear", lamps_on=False)
        if enters(room.panes, room.sky.disc()):
            return room
    raise AssertionError("no room with sun among 40")


@pytest.fixture(scope="module")
def world():
    return RoomWorld(sunny(), "sketch")


@pytest.fixture(scope="module")
def pictures(world):
    return truth_pictures(world, ROWS)


def luminance(rgb):
    return rgb @ LUMINANCE_WEIGHTS


def test_the_room_is_valid_and_named(world):
    assert room_faults(world.room) == []
    assert world.room == make_room(world.room.seed, "living", sky="clear", lamps_on=False)
    assert world.room.name == f"living-{world.room.seed}"


def test_luminances_are_those_of_a_daylit_room(pictures):
    seen = luminance(pictures.luminance_rgb)
    assert np.isfinite(seen).all()
    assert seen.min() >= 0
    assert 3 < np.median(seen) < 3000
    assert seen.max() > 10 * np.median(seen)


@pytest.mark.long
def test_baked_irradiance_agrees_with_the_renderer_point_by_point(world):
    """The lookup against Mitsuba's own irradiance meter on the very surfaces, sun patches aside."""
    view, room = world.view, world.room
    rays = equirectangular(24).reshape(-1, 3)
    surface = view.surfaces(rays)
    share = view.sunlit(surface)
    flat = np.array([p.surface in ("wall", "floor", "ceiling") for p in view.geometry.parts])
    good = np.flatnonzero(flat[surface.part] & (share == 0))
    chosen = np.random.default_rng(5).choice(good, 12, replace=False)
    scenes = {name: load_scene(view.geometry.parts, light, glossy=False) for name, light in lightings(room).items()}
    ours = view.irradiance(surface, tuple(scenes))[chosen] @ LUMINANCE_WEIGHTS
    theirs = np.zeros(len(chosen))
    for i, k in enumerate(chosen):
        place = tuple(float(v) for v in surface.point[k] + surface.normal[k] * 1e-3)
        normal = tuple(float(v) for v in surface.normal[k])
        rgb = sum(irradiance_at(scene, place, normal, 4096, seed=i) for scene in scenes.values())
        theirs[i] = rgb @ LUMINANCE_WEIGHTS
    error = np.abs(ours / theirs - 1)
    # A sketch of 8 samples; `benchmarks truth` measures the better qualities.
    assert np.median(error) < 0.2, error
    assert abs(math.log(ours.sum() / theirs.sum())) < 0.12


def test_components_add_up_to_the_whole(world):
    moving = replace(world, drift=CloudDrift(amplitude=0.8, seed=3))
    rays = equirectangular(16)
    assert moving.components == ("sky", "sun")
    for site in Site:
        parts = sum(moving.radiance(site, rays, 0.01, i) for i in range(2))
        np.testing.assert_allclose(parts, world.radiance(site, rays, 0.01), rtol=2e-4, atol=1e-3)
    assert moving.weights(0.0) == (1.0, 1.0)
    assert moving.discs(Site.OUTDOOR)[0].component == 1
    levels = np.array([moving.weights(t) for t in range(0, 3600, 20)])
    assert levels[:, 1].min() < 0.6
    assert levels.min() >= 0


def test_the_sun_is_seen_through_glass_only(world):
    (sun,) = world.discs(Site.INDOOR)
    rays = equirectangular(64)
    clear = world.open_sky(Site.INDOOR, rays)
    assert set(np.unique(clear)) == {np.float32(0), np.float32(world.room.glass_transmittance[1])}
    assert 0.001 < (clear > 0).mean() < 0.3
    assert world.open_sky(Site.OUTDOOR, rays).min() == 1
    assert luminance(np.array(sun.radiance_rgb)) > 1e8


def test_sunlight_falls_where_the_window_lets_it(world):
    """A point sees the sun if and only if the straight way there meets nothing."""
    view, disc = world.view, world.room.sky.disc()
    surface = view.surfaces(equirectangular(64).reshape(-1, 3))
    share = sun_share(view.geometry, world.room.panes, disc, surface.point, surface.normal)
    towards = np.broadcast_to(np.array(disc.direction, np.float32), surface.point.shape)
    facing = surface.normal @ np.array(disc.direction, np.float32) > 1e-3
    free = ~view.geometry.blocked(surface.point + surface.normal * np.float32(1e-3), towards)
    sharp = (share == 0) | (share == 1)
    assert 0 < (share > 0.5).sum() < len(share) / 3
    assert ((share == 1) == (free & facing))[sharp].all()


def _grown(mask):
    """Return a mask with all neighbours of its pixels."""
    return sum(np.roll(mask, (i, j), (0, 1)) for i in (-1, 0, 1) for j in (-1, 0, 1)) > 0


def test_emptying_changes_only_what_furniture_and_its_light_reach(world, pictures):
    """4: the same room furnished and emptied differ where furniture is, and little far from it."""
    seen, empty = luminance(pictures.luminance_rgb), luminance(pictures.empty_rgb)
    things = pictures.instance > 0
    edge = _grown(things)
    outdoors = (pictures.albedo.max(axis=-1) == 0) & (pictures.empty_albedo.max(axis=-1) == 0)
    assert outdoors.sum() > 20
    np.testing.assert_allclose(seen[outdoors], empty[outdoors], rtol=1e-5)
    bare = ~edge & (pictures.surface >= 0)
    # What is thinner than a pixel may lie between the places where pixels are looked at.
    change = np.abs(pictures.albedo[bare] - pictures.empty_albedo[bare]).max(axis=-1)
    assert np.quantile(change, 0.99) < 1e-3
    ceiling = bare & (pictures.normal[..., 2] < -0.99) & (pictures.sunlit == 0)
    ratio = seen[ceiling] / empty[ceiling]
    assert 0.5 < np.median(ratio) < 1.15
    assert np.abs(np.log(seen[things] / empty[things])).mean() > 2 * np.abs(np.log(ratio)).mean()


def test_truths_agree_with_one_another(world, pictures):
    rays = equirectangular(ROWS)
    inside = np.isfinite(pictures.depth_m)
    points = np.array(world.room.eye) + rays * np.where(inside, pictures.depth_m, 0)[..., None]
    floor = pictures.surface == pictures.surface_names.index("floor")
    ceiling = pictures.surface == pictures.surface_names.index("ceiling")
    assert np.abs(points[floor][:, 2]).max() < 1e-3
    assert np.abs(points[ceiling][:, 2] - world.room.plan.height_m).max() < 1e-3
    facing = (pictures.normal * rays).sum(axis=-1)
    assert facing[inside].max() <= 1e-3
    np.testing.assert_allclose(np.linalg.norm(pictures.normal[inside], axis=-1), 1, atol=1e-3)
    assert (pictures.instance[pictures.furniture] > 0).all()
    known = {item.instance: item for item in world.room.items}
    assert set(np.unique(pictures.instance)) <= {0, *known}
    assert pictures.tripod.any()
    assert not (pictures.tripod & pictures.furniture).any()
    assert (pictures.ade[pictures.tripod] == -1).all()
    assert 0.02 <= pictures.albedo[inside].max() <= 0.95


def test_luminance_is_albedo_times_irradiance_on_matte_unlit_surfaces(world, pictures):
    matte = np.array([p.material.roughness is None for p in world.view.geometry.parts])
    rays = equirectangular(ROWS).reshape(-1, 3)
    surface = world.view.surfaces(rays)
    light = world.view.irradiance(surface, components(world.room))
    share = world.view.sunlit(surface)
    good = matte[surface.part] & (share == 0)
    expected = luminance(light * surface.albedo / np.float32(math.pi))[good]
    seen = luminance(world.radiance(Site.INDOOR, rays))[surface.ray[good]]
    np.testing.assert_allclose(seen, expected, rtol=1e-3, atol=1e-3)


def test_the_meter_reads_the_board(world):
    board = world.room.board()
    reading = meter_luminance_cd_m2(world, world.board_direction)
    surface = world.view.surfaces(np.array([world.board_direction], np.float32))
    assert world.view.geometry.parts[surface.part[0]].instance == board.instance
    np.testing.assert_allclose(surface.albedo[0], 0.9, atol=0.01)
    light = world.view.irradiance(surface, ("sky", "sun"))
    expected = float(luminance(light * surface.albedo / math.pi)[0])
    assert reading >= 0.8 * expected
    if world.view.sunlit(surface)[0] == 0:
        assert reading <= 1.25 * expected


def test_points_of_known_light_lie_in_the_open_and_brighten_towards_the_window(world):
    lights = point_lights(world.room, samples=256, grid_m=1.5)
    names = [light.name for light in lights]
    assert names[-1] == "outdoors, horizontal"
    assert lights[-1].illuminance_lx > 5000
    assert all(0 < light.illuminance_lx <= 1.1 * lights[-1].illuminance_lx for light in lights)
    assert sum(name.startswith("camera") for name in names) == 4


def test_description_is_plain_json(world):
    import json

    described = json.loads(json.dumps(description(world.room)))
    assert len(described["furniture"]) == len(world.room.items)
    assert described["plan"]["height_m"] == world.room.plan.height_m


def test_light_is_kept_and_found_again(world, tmp_path, monkeypatch):
    cache = PictureCache(tmp_path)
    monkeypatch.setattr(light_module, "ENVIRONMENT_ROWS", 16)
    monkeypatch.setitem(QUALITIES, "sketch", Quality(16, 2))
    room = make_room(1, Use.EMPTY, sky="overcast", lamps_on=False)
    geometry = Geometry(room.parts())
    first = baked_light(room, geometry, "sketch", cache)
    monkeypatch.setattr(world_module, "bake", None)
    again = baked_light(room, geometry, "sketch", cache)
    np.testing.assert_array_equal(first["sky"].irradiance, again["sky"].irradiance)


def test_worlds_are_small_to_send_and_open_by_name(world):
    assert len(pickle.dumps(world)) < 200_000
    assert pickle.loads(pickle.dumps(world)).key == world.key
    assert room_world("bedroom", 7).room == open_world("bedroom-7").room
    assert replace(world, quality="draft").key != world.key
    assert RoomWorld(world.room.emptied()).key != world.key


def test_an_overcast_room_has_no_sun_component():
    room = make_room(2, Use.EMPTY, sky="overcast", lamps_on=False)
    assert components(room) == ("sky",)
    assert all(item.role is Role.EQUIPMENT for item in room.items)
    assert components(replace(room, lamps_on=True)) == ("sky", "lamps")


@pytest.mark.long
def test_noise_does_not_become_gloss(monkeypatch):
    """Two equally bright noisy pictures, matte and glossy: their difference is no light."""
    room = make_room(1, Use.EMPTY, sky="overcast", lamps_on=False)
    shiny = replace(room.finish, floor=replace(room.finish.floor, roughness=0.2))
    room = replace(room, finish=shiny)
    noise = np.random.default_rng(4)

    def noisy(_scene, _eye, sampling, _faces=range(6)):
        side = sampling.cube.side_px
        return np.float32(100) * noise.exponential(1, (6, side, side, 3)).astype(np.float32)

    monkeypatch.setattr(light_module, "render_cube", noisy)
    geometry = Geometry(room.parts())
    baked = light_module.bake(room, geometry, lightings(room)["sky"], light_module.Quality(48, 4))
    floor = np.array([p.surface == "floor" for p in geometry.parts] + [False])
    guide = light_module.Guide.of(geometry, np.array(room.eye, np.float32), light_module.Cube(48))
    assert baked.gloss[floor[guide.part]].mean() < 10


def test_passing_clouds_only_dim_the_sun():
    for seed in range(60):
        drift = CloudDrift(amplitude=0.9, seed=seed)
        levels = np.array([drift.weights(float(t)) for t in range(0, 900, 5)])
        assert levels[0].tolist() == [1.0, 1.0]
        assert levels[:, 1].max() <= 1.0
        assert levels.min() >= 0
        assert levels[:, 0].max() <= 1.12


def test_there_is_no_sky_of_the_night():
    from datetime import UTC, datetime

    from mocks.rooms.sky.daylight import Moment

    with pytest.raises(ValueError, match="below the horizon"):
        make_room(1, Use.EMPTY, moment=Moment(40.44, -79.99, datetime(2023, 6, 21, 5, tzinfo=UTC), 0.0))


def test_a_sample_that_is_not_finite_spoils_only_itself() -> None:
    from mocks.rooms.light.light import _whole

    picture = np.ones((6, 4, 4, 3), np.float32)
    picture[2, 1, 3, 0] = np.nan
    picture[0, 0, 0, 1] = np.inf
    clean, spoilt = _whole(picture)
    assert np.isfinite(clean).all()
    assert spoilt.sum() == 2
    assert spoilt[2, 1, 3]
    assert clean.sum() == (6 * 4 * 4 - 2) * 3


def test_the_demos_light_is_shipped_and_is_that_of_its_room():
    """A change of the room or of baking asks for `python -m mocks.rooms.world`."""
    world = room_world(*DEFAULT)
    assert _shipped(light_key(world.room, world.quality)) is not None
    assert _shipped("another") is None
    assert room_world("bedroom", 7, sky="clear") == world
    assert {room_world("bedroom", 8, sky="clear").quality, room_world("office", 7).quality} == {"standard"}
    assert room_world("bedroom", 7, "draft", "clear").quality == "draft"

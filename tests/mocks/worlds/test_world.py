"""The simulated light: is the room a plausible room, the sky a sky, and are pictures read strictly?"""

import math
import pickle
import sys
from dataclasses import replace
from types import ModuleType

import cv2
import numpy as np
import OpenEXR
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from mocks.rooms.model import Use
from mocks.worlds import room_light
from mocks.worlds.room_light import bake
from mocks.worlds.room_plan import Box, WallRect, plan_room
from mocks.worlds.room_rays import blocked, pane_distance_m, room_faces
from mocks.worlds.textures import PlankFloor
from mocks.worlds.world import (
    BrightDisc,
    HdrWorld,
    LightDrift,
    SimpleRoom,
    SimpleSky,
    Site,
    UniformWorld,
    WorldFileError,
    direction_of,
    luminance_cd_m2,
    meter_luminance_cd_m2,
    open_world,
    read_equirect,
)


def sphere(height):
    """Directions and solid angles of an equirectangular grid."""
    longitude = ((np.arange(2 * height) + 0.5) / (2 * height) - 0.5) * 2 * math.pi
    latitude = (0.5 - (np.arange(height) + 0.5) / height) * math.pi
    lon, lat = np.meshgrid(longitude, latitude)
    directions = np.stack([np.cos(lat) * np.sin(lon), np.cos(lat) * np.cos(lon), np.sin(lat)], axis=-1)
    return directions.astype(np.float32), np.cos(lat) * (math.pi / height) ** 2


@pytest.fixture(scope="module")
def room():
    return SimpleRoom(seed=3)


@pytest.fixture(scope="module")
def panorama(room):
    return room.radiance(Site.INDOOR, sphere(128)[0])


def test_room_luminances_are_those_of_a_daylit_room(panorama):
    luminance = luminance_cd_m2(panorama)
    assert np.isfinite(panorama).all()
    assert panorama.min() >= 0
    assert 0.5 < luminance.min() < 20
    assert 20 < np.median(luminance) < 300
    assert 1000 < luminance.max() < 20000


def test_window_is_the_brightest_part_of_the_wall_ahead(room, panorama):
    window = room.plan.window
    middle = (window.a0 * 0.7 + window.a1 * 0.3, room.plan.high[1], (window.z0 + window.z1) / 2 - 1.6)
    beside = (window.a0 - 0.5, room.plan.high[1], middle[2])
    through = meter_luminance_cd_m2(room, middle)
    assert through > 4 * meter_luminance_cd_m2(room, beside)


def test_sun_makes_a_patch_on_the_floor_much_brighter_than_the_floor_around(room, panorama):
    floor = luminance_cd_m2(panorama[80:])
    assert floor.max() > 15 * np.median(floor)


def test_what_the_window_shows_is_the_sky_outside(room):
    window = room.plan.window
    up = (window.a0 * 0.75 + window.a1 * 0.25, room.plan.high[1], window.z1 - 0.25 - 1.6)
    direction = np.array([up], dtype=np.float32) / np.linalg.norm(up)
    glass = room.open_sky(Site.INDOOR, direction.astype(np.float32))[0]
    inside = room.radiance(Site.INDOOR, direction.astype(np.float32))[0]
    outside = room.radiance(Site.OUTDOOR, direction.astype(np.float32))[0]
    assert glass == pytest.approx(0.65)
    np.testing.assert_allclose(inside, glass * outside, rtol=1e-5)


def test_board_is_white_even_and_known(room):
    board = room.plan.board
    rng = np.random.default_rng(0)
    corner = np.array([board.low[0] + 0.02, board.high[1], board.low[2] + 0.02])
    points = corner + rng.uniform(0, 0.46, (64, 3)) * [1, 0, 1] - [0, 0, 1.6]
    directions = (points / np.linalg.norm(points, axis=1, keepdims=True)).astype(np.float32)
    luminance = luminance_cd_m2(room.radiance(Site.INDOOR, directions))
    np.testing.assert_allclose(luminance, room.board_luminance_cd_m2(), rtol=1e-5)
    assert meter_luminance_cd_m2(room, room.board_direction) == pytest.approx(room.board_luminance_cd_m2(), rel=1e-5)


def empty_room(window=None):
    """A bare room of 5 x 4 x 2.7 m (but for a crumb, since a plan has a board)."""
    plan = plan_room(0)
    crumb = Box((2.0, 1.5, 2.0), (2.001, 1.501, 2.001), (0.5, 0.5, 0.5))
    low, high = (-2.5, -2.0, 0.0), (2.5, 2.0, 2.7)
    return replace(plan, low=low, high=high, boxes=(), board=crumb, window=window or WallRect(0.0, 1e-3, 1.0, 1.001))


def test_white_furnace_adds_what_the_series_says():
    """Closed room of albedo a, evenly lit by E: the bounces add E a / (1 - a) everywhere."""
    plan = empty_room()
    faces = room_faces(plan)
    patches = room_light._grid(faces, 0.38, 0.24)
    albedo = np.full((len(faces), 3), 0.5, dtype=np.float32)
    added = room_light._bounce(plan, patches, albedo, np.ones((len(patches.point), 3), dtype=np.float32))
    np.testing.assert_allclose(added[patches.face < 6], 1.0, rtol=2e-3)


def test_form_factor_of_floor_to_ceiling_is_the_closed_form():
    """0.3506 for two parallel rectangles of 5 x 4 m, 2.7 m apart."""
    plan = empty_room()
    patches = room_light._grid(room_faces(plan), 0.38, 0.24)
    factors = room_light._form_factors(plan, patches)
    floor, ceiling = patches.face == 4, patches.face == 5
    seen = factors[floor][:, ceiling].sum(axis=1)
    mean = float((seen * patches.area_m2[floor]).sum() / patches.area_m2[floor].sum())
    assert mean == pytest.approx(0.3506, rel=0.02)


def test_skylight_on_the_wall_opposite_is_what_an_integral_gives():
    """Window light at one point against a fine numerical integral over the opening."""
    plan = empty_room(WallRect(-0.8, 0.9, 0.9, 2.2))
    sky = SimpleSky()
    faces = room_faces(plan)
    black = np.full((len(faces), 3), 1e-9, dtype=np.float32)
    maps = bake(plan, faces, black, replace(sky, sun_luminance_cd_m2=1e-9))
    face = np.array([2], dtype=np.int32)
    got = float(luminance_cd_m2(maps.at(face, np.array([0.5]), np.array([0.4])))[0])
    x, z = np.meshgrid(np.linspace(-0.8, 0.9, 400), np.linspace(0.9, 2.2, 400))
    way = np.stack([x - 0.0, np.full(x.shape, 4.0), z - 0.4 * 2.7], axis=-1)
    distance2 = (way**2).sum(axis=-1)
    direction = (way / np.sqrt(distance2)[..., None]).astype(np.float32)
    out_x = x + direction[..., 0] / direction[..., 1] * plan.wall_thickness_m
    out_z = z + direction[..., 2] / direction[..., 1] * plan.wall_thickness_m
    clear = pane_distance_m(plan, out_x.astype(np.float32), out_z.astype(np.float32)) > 0
    light = luminance_cd_m2(sky.radiance(direction)) * direction[..., 1] ** 2 / distance2 * clear
    expected = float(light.mean()) * 1.7 * 1.3 * 0.65
    assert got == pytest.approx(expected, rel=0.06)


def test_shadow_test_sees_a_box_between_two_points():
    plan = plan_room(0)
    box = plan.boxes[0]
    middle = (np.array(box.low) + np.array(box.high)) / 2
    before = np.array([[middle[0], middle[1] + 1.0, middle[2]]], dtype=np.float32)
    behind = np.array([[middle[0], middle[1] - 1.0, middle[2]]], dtype=np.float32)
    assert blocked(plan, before, behind)[0]
    assert not blocked(plan, before, before + np.float32(0.2))[0]


@settings(max_examples=40, deadline=None)
@given(st.integers(0, 2**31))
def test_every_seed_leaves_the_camera_free_and_all_furniture_inside(seed):
    plan = plan_room(seed)
    for box in plan.solids:
        assert all(low < high for low, high in zip(box.low, box.high, strict=True))
        assert all(a >= b - 1e-9 for a, b in zip(box.low, plan.low, strict=True))
        assert all(a <= b + 1e-9 for a, b in zip(box.high, plan.high, strict=True))
        gap = [max(low, -high, 0.0) for low, high in zip(box.low[:2], box.high[:2], strict=True)]
        assert math.hypot(*gap) > 0.8
    assert plan.low[0] < plan.window.a0 < plan.window.a1 < plan.high[0]
    assert plan.window.z1 < plan.high[2]


def test_floor_tile_repeats_without_a_seam():
    tile = PlankFloor(seed=5).tile()
    boards = tile.shape[1]
    step_inside = np.median(np.abs(np.diff(tile, axis=0)))
    across_seam = np.median(np.abs(tile[0] - tile[-1]))
    assert tile.shape == (boards, boards, 3)
    assert across_seam < 3 * step_inside


def test_seeds_differ_and_repeat():
    directions = sphere(16)[0]
    one, again = (SimpleRoom(1).radiance(Site.INDOOR, directions) for _ in range(2))
    np.testing.assert_array_equal(one, again)
    assert plan_room(1) != plan_room(2)
    assert SimpleRoom(1).key != SimpleRoom(2).key


def test_room_survives_the_way_to_a_worker(room, panorama):
    copy = pickle.loads(pickle.dumps(room))
    assert copy.key == room.key
    np.testing.assert_array_equal(copy.radiance(Site.INDOOR, sphere(128)[0]), panorama)


def test_sky_gives_the_illuminance_of_a_clear_day():
    directions, weight = sphere(256)
    sky = SimpleSky()
    luminance = luminance_cd_m2(sky.radiance(directions))
    diffuse_lx = float((luminance * np.maximum(directions[..., 2], 0) * weight).sum())
    sun_lx = float(luminance_cd_m2(sky.sun_normal_illuminance_rgb))
    assert 8_000 < diffuse_lx < 20_000
    assert sun_lx == pytest.approx(1e9 * 6.72e-5, rel=0.01)
    assert luminance_cd_m2(np.array(sky.sun.radiance_rgb, np.float32)) == pytest.approx(1e9, rel=1e-5)


def test_disc_covers_its_solid_angle():
    disc = BrightDisc(direction_of(0.4, 0.7), math.radians(5), (1.0, 1.0, 1.0))
    directions, weight = sphere(720)
    assert float(weight[disc.covers(directions)].sum()) == pytest.approx(disc.solid_angle_sr, rel=2e-3)


def test_meter_averages_over_the_spot():
    """Half of the spot on the sun reads half the sun; a spot inside it reads all of it."""
    room = SimpleRoom()
    sun = room.sky.sun_direction
    full = meter_luminance_cd_m2(room, sun, site=Site.OUTDOOR)
    assert full == pytest.approx(1e9, rel=1e-3)
    wide = meter_luminance_cd_m2(room, sun, site=Site.OUTDOOR, spot_deg=1.06)
    assert wide == pytest.approx(0.25e9, rel=0.02)


def test_drift_is_seeded_bounded_and_starts_at_one():
    drift = LightDrift(amplitude=0.1, seed=4)
    factors = [drift.factor(t) for t in range(0, 600, 7)]
    assert factors[0] == 1.0
    assert len({round(f, 6) for f in factors}) > 50
    assert all(0.8 < f < 1.25 for f in factors)
    assert LightDrift(amplitude=0.1, seed=4).factor(33.0) == drift.factor(33.0)
    world = UniformWorld(100.0, drift=drift)
    assert meter_luminance_cd_m2(world, (0, 1, 0), 33.0) == pytest.approx(100 * drift.factor(33.0))


class SunnyWorld(UniformWorld):
    """Grey light that stays, and a disc overhead whose own component is 1, 0.25 from 10 s on."""

    @property
    def components(self):
        return ("sky", "sun")

    def weights(self, t_s):
        return (1.0, 1.0 if t_s < 10 else 0.25)

    def radiance(self, site, directions, pixel_rad=0.0, component=None):
        grey = super().radiance(site, directions)
        return grey if component in (None, 0) else np.zeros_like(grey)

    def discs(self, site):
        return (BrightDisc((0.0, 0.0, 1.0), math.radians(1), (1e6, 1e6, 1e6), component=1),)


def test_meter_weighs_each_component_by_its_time():
    world = SunnyWorld(100.0)
    assert meter_luminance_cd_m2(world, (0, 0, 1)) == pytest.approx(1e6 + 100, rel=1e-6)
    assert meter_luminance_cd_m2(world, (0, 0, 1), 20.0) == pytest.approx(0.25e6 + 100, rel=1e-6)
    assert meter_luminance_cd_m2(world, (0, 1, 0), 20.0) == pytest.approx(100, rel=1e-6)


def test_meter_spot_is_the_mean_over_its_disc():
    """Within 0.1 % of a fine integral where the light changes steeply across the spot."""

    class Slope(UniformWorld):
        def radiance(self, site, directions, pixel_rad=0.0, component=None):
            x = directions[..., :1].astype(np.float64) / math.sin(math.radians(1 / 6))
            return np.repeat(100 * (2 + x + x**2), 3, axis=-1)

    # Over a unit disc the mean of x is 0, that of its square 1/4.
    assert meter_luminance_cd_m2(Slope(), (0, 1, 0)) == pytest.approx(225, rel=1e-3)


def gradient(height=32):
    """A panorama whose colour tells where it looks: red by longitude, green by latitude."""
    row, column = np.mgrid[0:height, 0 : 2 * height]
    return np.stack([(column + 1) / (2 * height), (row + 1) / height, np.full(row.shape, 0.5)], -1).astype(np.float32)


def write_hdr(path, pixels):
    assert cv2.imwrite(str(path), pixels[..., ::-1])
    return path


def write_exr(path, pixels):
    OpenEXR.File({"compression": OpenEXR.ZIP_COMPRESSION, "type": OpenEXR.scanlineimage}, {"RGB": pixels}).write(
        str(path)
    )
    return path


@pytest.mark.parametrize(("write", "suffix", "tolerance"), [(write_hdr, ".hdr", 0.01), (write_exr, ".exr", 1e-5)])
def test_pictures_are_seen_in_their_direction(tmp_path, write, suffix, tolerance):
    pixels = gradient()
    path = write(tmp_path / f"room{suffix}", pixels)
    world = HdrWorld(path, path, scale=10.0, outdoor_scale=20.0)
    ahead = np.array([direction_of(math.radians(1e-3), math.radians(45))], dtype=np.float32)
    right = np.array([direction_of(math.pi / 2, -math.pi / 4)], dtype=np.float32)
    for direction, column, row in ((ahead, 32, 8), (right, 48, 24)):
        expected = pixels[row - 1 : row + 1, column - 1 : column + 1].mean(axis=(0, 1))
        np.testing.assert_allclose(world.radiance(Site.INDOOR, direction)[0], 10 * expected, rtol=tolerance)
        np.testing.assert_allclose(world.radiance(Site.OUTDOOR, direction)[0], 20 * expected, rtol=tolerance)


def test_seam_and_poles_of_a_picture_are_smooth(tmp_path):
    smooth = np.repeat(np.sin(sphere(32)[0][..., :1] * 3) + 2, 3, axis=-1).astype(np.float32)
    path = write_exr(tmp_path / "smooth.exr", smooth)
    world = HdrWorld(path, path, scale=1.0)
    left = np.array([direction_of(-math.pi + 1e-4, 0.3)], dtype=np.float32)
    right = np.array([direction_of(math.pi - 1e-4, 0.3)], dtype=np.float32)
    np.testing.assert_allclose(world.radiance(Site.INDOOR, left), world.radiance(Site.INDOOR, right), rtol=1e-3)
    poles = np.array([[0, 0, 1], [0, 0, -1]], dtype=np.float32)
    np.testing.assert_allclose(world.radiance(Site.INDOOR, poles), 2.0, atol=0.05)


def test_coarse_pixels_see_the_average(tmp_path):
    noise = np.random.default_rng(0).uniform(0, 2, (256, 512, 3)).astype(np.float32)
    path = write_exr(tmp_path / "noise.exr", noise)
    world = HdrWorld(path, path, scale=1.0)
    directions = sphere(16)[0][4:12]
    fine = world.radiance(Site.INDOOR, directions)
    coarse = world.radiance(Site.INDOOR, directions, math.pi / 16)
    assert coarse.std() < 0.2 * fine.std()


def spoilt(value):
    pixels = gradient()
    pixels[3, 3, 1] = value
    return pixels


BAD_FILES = {
    "text": lambda hdr, exr: b"hello",
    "empty": lambda hdr, exr: b"",
    "no resolution": lambda hdr, exr: hdr(gradient()).replace(b"-Y", b"+Y"),
    "huge": lambda hdr, exr: hdr(gradient()).replace(b"-Y 32 +X 64", b"-Y 90000 +X 180000"),
    "square": lambda hdr, exr: hdr(gradient()).replace(b"+X 64", b"+X 32"),
    "short": lambda hdr, exr: hdr(gradient())[:300],
    "nan": lambda hdr, exr: exr(spoilt(np.nan)),
    "infinite": lambda hdr, exr: exr(spoilt(np.inf)),
    "negative": lambda hdr, exr: exr(spoilt(-1.0)),
    "short exr": lambda hdr, exr: exr(gradient())[:300],
    "square exr": lambda hdr, exr: exr(gradient()[:, :32]),
}


@pytest.mark.parametrize("name", BAD_FILES)
def test_pictures_that_cannot_be_light_are_refused(tmp_path, name):
    def hdr(pixels):
        return write_hdr(tmp_path / "good.hdr", pixels).read_bytes()

    def exr(pixels):
        return write_exr(tmp_path / "good.exr", pixels).read_bytes()

    path = tmp_path / "world.bin"
    path.write_bytes(BAD_FILES[name](hdr, exr))
    with pytest.raises(WorldFileError, match=r"world\.bin"):
        open_world(f"{path},{path}")


def test_undershoots_of_lossy_compression_become_black(tmp_path):
    path = write_exr(tmp_path / "dwa.exr", spoilt(-0.001))
    pixels = read_equirect(path)
    assert pixels[3, 3, 1] == 0
    assert pixels.min() == 0


def test_worlds_have_names(tmp_path):
    assert open_world("room:7").key == SimpleRoom(7).key
    assert open_world("uniform:50").key == UniformWorld(50.0).key
    path = write_hdr(tmp_path / "w.hdr", gradient())
    assert isinstance(open_world(f"{path},{path}"), HdrWorld)
    for name in ("castle", "room:x", "chart:x", "uniform:much", "attic-7", "bedroom-x", "bedroom--1", "bedroom-7b"):
        with pytest.raises(WorldFileError):
            open_world(name)


def test_generated_rooms_have_names(monkeypatch):
    """Use and seed go to the generator, which is imported only then."""
    generator = ModuleType("mocks.rooms.world")
    generator.room_world = lambda use, seed: (use, seed)
    monkeypatch.setitem(sys.modules, "mocks.rooms.world", generator)
    names = ("bedroom-7", "living-3", "dining-2", "office-4", "empty-50")
    expected = [(Use.BEDROOM, 7), (Use.LIVING, 3), (Use.DINING, 2), (Use.OFFICE, 4), (Use.EMPTY, 50)]
    assert [open_world(name) for name in names] == expected


def test_key_of_a_picture_world_follows_the_content(tmp_path):
    path = write_hdr(tmp_path / "w.hdr", gradient())
    before = HdrWorld(path, path).key
    write_hdr(path, gradient() * 2)
    assert HdrWorld(path, path).key != before
    assert HdrWorld(path, path, scale=3.0).key != HdrWorld(path, path).key

"""The simulated light: is the room a plausible room, the sky a sky, and are pictures read strictly?"""

import math
import pickle
import sys
from types import ModuleType

import cv2
import numpy as np
import OpenEXR
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from mocks.rooms.model import Use
from mocks.worlds.hdr_world import HdrWorld, read_equirect
from mocks.worlds.light import (
    BrightDisc,
    LightDrift,
    Site,
    UniformWorld,
    WorldFileError,
    direction_of,
    luminance_cd_m2,
)
from mocks.worlds.simple_room import CAMERA_HEIGHT_M, SimpleRoom, cast, plan_room, window_form_factor
from mocks.worlds.sky import SimpleSky
from mocks.worlds.world import meter_luminance_cd_m2, open_world


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
    x0, z0, x1, z1 = room.plan.window
    middle = (x0 * 0.7 + x1 * 0.3, room.plan.high[1], (z0 + z1) / 2 - CAMERA_HEIGHT_M)
    beside = (x0 - 0.5, room.plan.high[1], middle[2])
    through = meter_luminance_cd_m2(room, middle)
    assert through > 4 * meter_luminance_cd_m2(room, beside)


def test_sun_makes_a_patch_on_the_floor_much_brighter_than_the_floor_around(room, panorama):
    floor = luminance_cd_m2(panorama[80:])
    assert floor.max() > 15 * np.median(floor)


def test_what_the_window_shows_is_the_sky_outside(room):
    x0, _, x1, z1 = room.plan.window
    up = (x0 * 0.75 + x1 * 0.25, room.plan.high[1], z1 - 0.25 - CAMERA_HEIGHT_M)
    direction = np.array([up], dtype=np.float32) / np.linalg.norm(up)
    glass = room.open_sky(Site.INDOOR, direction.astype(np.float32))[0]
    inside = room.radiance(Site.INDOOR, direction.astype(np.float32))[0]
    outside = room.radiance(Site.OUTDOOR, direction.astype(np.float32))[0]
    assert glass == pytest.approx(0.65)
    np.testing.assert_allclose(inside, glass * outside, rtol=1e-5)


def test_board_is_white_even_and_known(room):
    board = room.plan.blocks[-1]
    rng = np.random.default_rng(0)
    corner = np.array([board.low[0] + 0.02, board.high[1], board.low[2] + 0.02])
    points = corner + rng.uniform(0, 0.46, (64, 3)) * [1, 0, 1] - [0, 0, 1.6]
    directions = (points / np.linalg.norm(points, axis=1, keepdims=True)).astype(np.float32)
    luminance = luminance_cd_m2(room.radiance(Site.INDOOR, directions))
    np.testing.assert_allclose(luminance, luminance[0], rtol=1e-5)
    assert meter_luminance_cd_m2(room, room.board_direction) == pytest.approx(float(luminance[0]), rel=1e-5)


def corners_of_window(y, x0, x1, z0, z1):
    return np.array([(x, y, z) for x, z in ((x0, z0), (x0, z1), (x1, z1), (x1, z0))], dtype=float)


def test_form_factor_before_a_square_is_the_closed_form():
    """A square of side 2 m, 1 m from a point facing it: four times a corner's rectangle (Howell's catalogue, B-4)."""
    square = corners_of_window(1.0, -1.0, 1.0, -1.0, 1.0)
    point = np.zeros((1, 3), np.float32)
    expected = 4 / math.pi * math.sqrt(0.5) * math.atan(math.sqrt(0.5))
    assert window_form_factor(square, point, 1, 1.0)[0] == pytest.approx(expected, rel=1e-6)
    assert window_form_factor(square, point, 1, -1.0)[0] == 0


@pytest.mark.parametrize(("axis", "sign", "point"), [(0, 1.0, (-2.5, 0.3, 1.0)), (2, 1.0, (0.4, -1.0, 0.0))])
def test_form_factor_is_what_an_integral_gives(axis, sign, point):
    """Seen from a side wall and from the floor, against a fine numerical integral over the opening."""
    x, z = np.meshgrid(-0.8 + 1.7 * (np.arange(400) + 0.5) / 400, 0.9 + 1.3 * (np.arange(400) + 0.5) / 400)
    way = np.stack([x, np.full(x.shape, 2.0), z], axis=-1) - point
    distance2 = (way**2).sum(axis=-1)
    expected = float((sign * way[..., axis] * way[..., 1] / (math.pi * distance2**2)).mean()) * 1.7 * 1.3
    got = window_form_factor(corners_of_window(2.0, -0.8, 0.9, 0.9, 2.2), np.array([point], np.float32), axis, sign)
    assert got[0] == pytest.approx(expected, rel=1e-3)


def test_rays_meet_the_block_before_the_wall():
    plan = plan_room(0)
    assert plan.blocks
    for number, block in enumerate(plan.blocks):
        middle = (np.array(block.low) + np.array(block.high)) / 2 - (0, 0, CAMERA_HEIGHT_M)
        face, point = cast(plan, (middle / np.linalg.norm(middle)).astype(np.float32)[None])
        assert face[0] >= 6
        assert np.linalg.norm(point[0] - (0, 0, CAMERA_HEIGHT_M)) <= np.linalg.norm(middle) + 1e-4, number


def test_sun_and_shadow_fall_where_geometry_says():
    """From a point on the floor in the sun the way to the sun leads through a pane; beside the patch it does not."""
    room = SimpleRoom(3)
    floor = np.stack([*np.meshgrid(np.linspace(-2, 2, 120), np.linspace(-2, 2, 120))], axis=-1).reshape(-1, 2)
    point = np.column_stack([floor, np.zeros(len(floor))]).astype(np.float32)
    lit = room._sunlit(point)
    sun = np.array(room.sky.sun_direction)
    x0, z0, x1, z1 = room.plan.window
    at_glass = point + sun * ((room.plan.high[1] + 0.24 - point[:, 1]) / sun[1])[:, None]
    outside = (at_glass[:, 0] < x0) | (at_glass[:, 0] > x1) | (at_glass[:, 2] < z0) | (at_glass[:, 2] > z1)
    assert (lit == 1).sum() > 50
    assert not lit[outside].any()


@settings(max_examples=40, deadline=None)
@given(st.integers(0, 2**31))
def test_every_seed_leaves_the_camera_free_and_all_furniture_inside(seed):
    plan = plan_room(seed)
    for box in plan.blocks:
        assert all(low < high for low, high in zip(box.low, box.high, strict=True))
        assert all(a >= b - 1e-9 for a, b in zip(box.low, plan.low, strict=True))
        assert all(a <= b + 1e-9 for a, b in zip(box.high, plan.high, strict=True))
        gap = [max(low, -high, 0.0) for low, high in zip(box.low[:2], box.high[:2], strict=True)]
        assert math.hypot(*gap) > 0.8
    x0, z0, x1, z1 = plan.window
    assert plan.low[0] < x0 < x1 < plan.high[0]
    assert plan.low[2] < z0 < z1 < plan.high[2]


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
    """A panorama whose colour is its direction: red by longitude, green by latitude."""
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
    for name in ("castle", "room:x", "chart:x", "uniform:much", "attic-7", "bedroom-x", "bedroom--1", "bedroom-7-dull"):
        with pytest.raises(WorldFileError):
            open_world(name)


def test_generated_rooms_have_names(monkeypatch):
    """Use and seed go to the generator, which is imported only then."""
    generator = ModuleType("mocks.rooms.world")
    generator.room_world = lambda use, seed, sky: (use, seed, *([sky] if sky else []))
    monkeypatch.setitem(sys.modules, "mocks.rooms.world", generator)
    names = ("bedroom-7", "living-3", "dining-2", "office-4", "empty-50", "bedroom-7-clear")
    expected = [(Use.BEDROOM, 7), (Use.LIVING, 3), (Use.DINING, 2), (Use.OFFICE, 4), (Use.EMPTY, 50)]
    expected.append((Use.BEDROOM, 7, "clear"))
    assert [open_world(name) for name in names] == expected


def test_key_of_a_picture_world_follows_the_content(tmp_path):
    path = write_hdr(tmp_path / "w.hdr", gradient())
    before = HdrWorld(path, path).key
    write_hdr(path, gradient() * 2)
    assert HdrWorld(path, path).key != before
    assert HdrWorld(path, path, scale=3.0).key != HdrWorld(path, path).key

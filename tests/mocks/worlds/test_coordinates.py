"""docs/reference/coordinates.md, sentence by sentence."""

import math
import re
from dataclasses import replace
from datetime import UTC, datetime
from pathlib import Path

import numpy as np
import pytest

from mocks.optics.lenses import EquirectangularLens, EquisolidFisheye
from mocks.rooms.light.transport import Lighting, load_scene
from mocks.rooms.model import Material, Part, Role, Use
from mocks.rooms.room import draw_plan, make_room
from mocks.rooms.sky.daylight import Moment, sun_of
from mocks.rooms.sky.sky import Sky
from mocks.rooms.truth import equirectangular
from mocks.worlds.light import SUN_RADIUS_RAD, Site, UniformWorld, direction_of, luminance_cd_m2
from processing.ground.mesh import quad

SIZE = (400, 200)


def pixel_direction(lens, x, y, size=SIZE):
    return lens.directions(np.float32(x), np.float32(y), size)[0]


def test_every_sentence_has_its_test():
    text = (Path(__file__).parents[3] / "docs" / "reference" / "coordinates.md").read_text("utf-8")
    sentences = {int(n) for n in re.findall(r"^(\d+)\. ", text, re.MULTILINE)}
    tests = {int(m[1]) for name in globals() if (m := re.match(r"test_(\d+)_", name))}
    assert sentences == tests


def test_1_right_handed_z_up():
    np.testing.assert_allclose(np.cross(direction_of(math.pi / 2, 0), direction_of(0, 0)), (0, 0, 1), atol=1e-12)


def test_2_camera_over_the_origin():
    room = make_room(3, Use.EMPTY)
    assert room.eye == (0.0, 0.0, 1.6)
    assert all(abs(z) < 1e-9 for p in room.parts() if p.surface == "floor" for z in p.mesh.vertices[:, 2])


@pytest.mark.parametrize("heading_deg", [0, 90, 261])
def test_3_heading_turns_the_compass(heading_deg):
    # Noon in Pittsburgh in June: the sun stands near south (180 degrees).
    moment = Moment(40.44, -79.99, datetime(2023, 6, 21, 17, 20, tzinfo=UTC), math.radians(heading_deg))
    azimuth_rad, elevation_rad = sun_of(moment)
    compass_deg = math.degrees(sun_of(replace(moment, heading_rad=0.0))[0]) % 360
    assert abs(compass_deg - 180) < 10
    expected = math.radians(compass_deg - heading_deg)
    np.testing.assert_allclose(
        direction_of(azimuth_rad, elevation_rad)[:2],
        math.cos(elevation_rad) * np.array([math.sin(expected), math.cos(expected)]),
        atol=1e-6,
    )


def test_4_polygons_turn_left():
    for seed in range(20):
        plan = draw_plan(np.random.default_rng(seed), Use.EMPTY)
        x, y = np.array(plan.polygon).T
        assert (x * np.roll(y, -1) - np.roll(x, -1) * y).sum() > 0
        along, inward = plan.wall_axes(0)
        assert along[0] * inward[1] - along[1] * inward[0] == pytest.approx(1)


def test_5_longitude_grows_to_the_right_from_the_middle():
    lens = EquirectangularLens()
    np.testing.assert_allclose(pixel_direction(lens, 200, 100), (0, 1, 0), atol=1e-6)
    np.testing.assert_allclose(pixel_direction(lens, 300, 100), (1, 0, 0), atol=1e-6)
    np.testing.assert_allclose(equirectangular(100)[50, 100], pixel_direction(lens, 100.5, 50.5, (200, 100)), atol=1e-6)


def test_6_latitude_grows_upwards():
    lens = EquirectangularLens()
    np.testing.assert_allclose(pixel_direction(lens, 200, 0), (0, 0, 1), atol=1e-6)
    assert equirectangular(100)[0, 0, 2] > 0.99
    assert equirectangular(100)[-1, 0, 2] < -0.99


def test_7_pixel_centres_at_half_integers():
    width = 400
    first = equirectangular(width // 2)[width // 4, 0]
    assert math.atan2(first[0], first[1]) == pytest.approx(-math.pi + math.pi / width, abs=1e-5)


def test_8_the_fisheye_looks_up_and_mirrors_the_map():
    lens, size = EquisolidFisheye(), (300, 200)
    np.testing.assert_allclose(pixel_direction(lens, 150, 100, size), (0, 0, 1), atol=1e-6)
    assert pixel_direction(lens, 150, 60, size)[1] > 0.1
    assert pixel_direction(lens, 110, 100, size)[0] > 0.1
    theta, focal_px = 1.0, 8 / 36 * 300
    x, y = lens.pixel_of(direction_of(0.0, math.pi / 2 - theta), size)
    assert math.hypot(x - 150, y - 100) == pytest.approx(2 * focal_px * math.sin(theta / 2), rel=1e-6)


def test_9_rgb_weighs_to_luminance():
    world = UniformWorld(80.0, tint_rgb=(1.0, 0.5, 0.2))
    light = world.radiance(Site.INDOOR, np.array([[0, 1, 0]], np.float32))
    assert float(light[0] @ np.array([0.2127, 0.7151, 0.0722])) == pytest.approx(80, rel=1e-6)
    assert luminance_cd_m2(light)[0] == pytest.approx(80, rel=1e-6)


def test_10_albedo_times_irradiance_over_pi():
    """A level plane under a uniform sky of 1000 cd/m2, E = 1000 pi lx, seen by the renderer."""
    from mocks.rooms.light.cube import Cube
    from mocks.rooms.light.transport import Sampling, render_cube

    ground = Part(
        quad((-50, -50, 0), (100, 0, 0), (0, 100, 0)), Material("grey", (0.4, 0.4, 0.4)), "floor", 3, Role.SHELL
    )
    sky = np.zeros((32, 64, 3), np.float32)
    sky[:16] = 1000
    scene = load_scene([ground], Lighting(environment_rgb=sky), glossy=False)
    down = render_cube(scene, (0.0, 0.0, 1.6), Sampling(Cube(16), 256))[5]
    assert down.mean() == pytest.approx(400, rel=0.02)


def test_11_the_sun_is_half_a_degree_wide():
    sky = Sky()
    disc = sky.disc()
    assert math.degrees(2 * SUN_RADIUS_RAD) == pytest.approx(0.53)
    assert disc.radius_rad == SUN_RADIUS_RAD
    np.testing.assert_allclose(
        np.array(disc.radiance_rgb) * disc.solid_angle_sr, sky.sun_normal_illuminance_rgb, rtol=1e-5
    )


def _overcast_view():
    from mocks.rooms.light.geometry import Geometry
    from mocks.rooms.view import RoomView

    room = make_room(3, Use.EMPTY, sky="overcast", lamps_on=False)
    return RoomView(room, Geometry(room.parts()), {}, 16)


def test_12_depth_runs_along_the_ray():
    surface = _overcast_view().surfaces(np.array([[0, 0.6, -0.8]], np.float32))
    # The floor (or what stands on it) is met at 1.6 / 0.8 = 2 m, not at 1.6 m.
    assert float(surface.hits.distance_m[0] * 0.8 + surface.point[0, 2]) == pytest.approx(1.6, abs=1e-4)


def test_13_normals_look_back_at_the_camera():
    surface = _overcast_view().surfaces(equirectangular(32).reshape(-1, 3))
    assert (np.einsum("ij,ij->i", surface.normal, surface.directions) <= 1e-4).all()

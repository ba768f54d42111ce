from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from shapely import LinearRing, LineString, Polygon

from processing.errors import RoomError
from processing.ground.seam import row_latitudes
from processing.sphere import Equirectangular, directions
from processing.surfaces.maps import (
    CEILING,
    FIRST_WALL,
    FLOOR,
    boundary_latitudes,
    in_sight,
    longitudes,
    opening_map,
    plane_map,
    planes_of,
    surface_maps,
    wall_ranges,
)
from tests.processing.surfaces.rooms import BOX, ELL, model, window

SMALL = Equirectangular(128, 64)


def box_depth(rays: np.ndarray, floor, camera: float, ceiling: float) -> np.ndarray:
    """The nearest of six planes, by slabs: another way than the one under test."""
    low = np.array([floor[0][0], floor[0][1], -camera])
    high = np.array([floor[2][0], floor[2][1], ceiling - camera])
    with np.errstate(divide="ignore"):
        return np.where(rays > 0, high / rays, np.where(rays < 0, low / rays, np.inf)).min(axis=-1)


@pytest.mark.parametrize("yaw", [0.0, 2.5])
def test_depth_of_a_box_is_the_nearest_of_its_six_planes(yaw: float) -> None:
    geometry = Equirectangular(128, 64, yaw)
    rays, _ = directions(geometry)
    maps = surface_maps(model(BOX), geometry)
    np.testing.assert_allclose(maps.depth_m, box_depth(rays, BOX, 1.6, 2.6), rtol=1e-6)


def test_normals_and_planes_of_a_box() -> None:
    maps = surface_maps(model(BOX), SMALL)
    assert set(np.unique(maps.plane)) == {0, 1, 2, 3, 4, 5}
    middle = SMALL.height_px // 2
    ahead, right, left = (maps.plane[middle, c] for c in (64, 96, 32))
    # Wall 0 lies behind, 1 to the right, 2 ahead, 3 to the left.
    assert (ahead, right, left, maps.plane[middle, 0]) == (FIRST_WALL + 2, FIRST_WALL + 1, FIRST_WALL + 3, FIRST_WALL)
    np.testing.assert_allclose(maps.normal[middle, 64], (0, -1, 0), atol=1e-7)
    np.testing.assert_allclose(maps.normal[middle, 96], (-1, 0, 0), atol=1e-7)
    assert (maps.plane[0] == CEILING).all()
    assert (maps.plane[-1] == FLOOR).all()
    np.testing.assert_allclose(maps.normal[-1, 5], (0, 0, 1))
    np.testing.assert_allclose(maps.normal[0, 5], (0, 0, -1))
    rays, _ = directions(SMALL)
    assert ((maps.normal * rays).sum(axis=-1) < 0).all()


@pytest.mark.parametrize("turn", [0.0, 0.3, 2.0])
def test_ranges_of_an_l_are_the_first_crossings_and_hide_the_rest(turn: float) -> None:
    c, s = math.cos(turn), math.sin(turn)
    floor = [(c * x - s * y, s * x + c * y) for x, y in ELL]
    azimuth = longitudes(Equirectangular(90, 45))
    found, wall = wall_ranges(floor, azimuth)
    ring = LinearRing(floor)
    for a, distance, number in zip(azimuth, found, wall, strict=True):
        far = (20 * math.sin(a), 20 * math.cos(a))
        crossing = LineString([(0, 0), far]).intersection(ring)
        nearest = min(math.hypot(p.x, p.y) for p in getattr(crossing, "geoms", [crossing]))
        assert distance == pytest.approx(nearest, rel=1e-9)
        hit = (distance * math.sin(a), distance * math.cos(a))
        edge = LineString([floor[number], floor[(number + 1) % 6]])
        assert edge.distance(LineString([hit, hit])) < 1e-9


def test_no_ray_slips_through_a_corner() -> None:
    azimuth = np.array([math.atan2(x, y) for x, y in (*BOX, *ELL)])
    for floor in (BOX, ELL):
        found, wall = wall_ranges(floor, azimuth)
        assert np.isfinite(found).all()
        assert (wall >= 0).all()


@given(st.integers(0, 10_000))
@settings(max_examples=20, deadline=None)
def test_random_stars_agree_with_crossings(seed: int) -> None:
    rng = np.random.default_rng(seed)
    angles = np.linspace(0, 2 * np.pi, 7, endpoint=False) + rng.uniform(-0.3, 0.3, 7)
    radius = rng.uniform(1, 4, 7)
    floor = np.stack([radius * np.cos(angles), radius * np.sin(angles)], axis=-1)
    found, _ = wall_ranges(floor, rng.uniform(-np.pi, np.pi, 5))
    assert (found >= 0.2).all()
    assert (found <= 4.0001).all()
    room = Polygon(floor)
    spots = rng.uniform(-4, 4, (20, 2))
    assert in_sight(floor, 0.01 * spots).all(), "what is near the camera is seen"
    for spot, seen in zip(spots, in_sight(floor, spots), strict=True):
        line = LineString([(0, 0), spot])
        assert bool(seen) == bool(room.buffer(1e-9).covers(line))


def test_floor_and_ceiling_end_where_the_nearest_wall_stands() -> None:
    room = model(ELL)
    geometry = Equirectangular(256, 128)
    planes, latitude = plane_map(room, geometry), row_latitudes(geometry.height_px)
    up, down = boundary_latitudes(room, longitudes(geometry))
    assert ((planes == FLOOR) == (latitude[:, None] < down)).all()
    assert ((planes == CEILING) == (latitude[:, None] > up)).all()


def test_an_opening_is_seen_on_its_wall_only_and_not_through_another() -> None:
    room = model(ELL, openings=[window(4, 0.5, 1.5), window(1, 0.2, 1.8)])
    geometry = Equirectangular(512, 256)
    maps = surface_maps(room, geometry)
    assert set(np.unique(maps.opening)) == {-1, 0, 1}
    assert (maps.plane[maps.opening == 0] == FIRST_WALL + 4).all()
    rays, _ = directions(geometry)
    heights = 1.6 + (rays * maps.depth_m[..., None])[..., 2]
    inside = maps.opening >= 0
    assert heights[inside].min() >= 0.9
    assert heights[inside].max() <= 2.1
    # The window ahead (y = 5) spans x from -0.5 to 0.5: wall 4 runs from (1, 5) to (-1, 5).
    across = (rays * maps.depth_m[..., None])[..., 0][maps.opening == 0]
    assert -0.5 <= across.min() < -0.43
    assert 0.43 < across.max() <= 0.5


def test_glass_behind_the_wall_s_face_is_seen_smaller_and_shifted_by_its_reveal() -> None:
    """By hand: the wall is 5 m away, glass 0.2 m behind it, so that a place on it is seen at 5 / 5.2 of its height."""
    room, geometry = model(ELL, openings=[window(4, 0.5, 1.5)]), Equirectangular(2048, 1024)
    rays, _ = directions(geometry)
    seen = rays[opening_map(room, geometry, 0.2, 0.06) == 0] * 5.2
    seen /= rays[opening_map(room, geometry, 0.2, 0.06) == 0][:, 1:2]
    assert np.abs(seen[:, 0]).max() == pytest.approx(0.44, abs=0.02)
    assert 1.6 + seen[:, 2].min() == pytest.approx(0.96, abs=0.02)
    assert 1.6 + seen[:, 2].max() == pytest.approx(2.04, abs=0.02)
    assert np.array_equal(opening_map(room, geometry), surface_maps(room, geometry).opening)


def test_camera_close_to_a_wall() -> None:
    floor = ((-0.06, -2.0), (3.0, -2.0), (3.0, 2.0), (-0.06, 2.0))
    geometry = Equirectangular(256, 128)
    rays, _ = directions(geometry)
    found = surface_maps(model(floor), geometry).depth_m
    np.testing.assert_allclose(found, box_depth(rays, floor, 1.6, 2.6), rtol=1e-5)


@pytest.mark.parametrize(
    "room",
    [model(((1.0, 1.0), (3.0, 1.0), (3.0, 3.0), (1.0, 3.0))), model(BOX[::-1]), model(BOX, camera=2.7)],
    ids=["camera outside", "clockwise", "camera above the ceiling"],
)
def test_a_room_that_cannot_stand_is_refused(room) -> None:
    with pytest.raises(RoomError):
        surface_maps(room, SMALL)


def test_planes_are_upright_seen_from_inside() -> None:
    for room in (model(BOX), model(ELL)):
        for plane in planes_of(room):
            # Right x down = away from the viewer, into the wall.
            np.testing.assert_allclose(np.cross(plane.u_axis, plane.v_axis), -plane.normal, atol=1e-12)
            back = plane.coordinates(plane.world(plane.outline_m[:, 0], plane.outline_m[:, 1]))
            np.testing.assert_allclose(back, plane.outline_m, atol=1e-12)
        assert [p.index for p in planes_of(room)] == list(range(len(room.floor) + 2))


def test_the_truth_of_a_simulated_room_is_met() -> None:
    from mocks.rooms.light.geometry import Geometry
    from mocks.rooms.room import make_room

    simulated = make_room(5, "living").emptied()
    room = model(simulated.plan.polygon, ceiling=simulated.plan.height_m)
    geometry = Equirectangular(160, 80)
    rays, _ = directions(geometry)
    hits = Geometry(simulated.parts()).cast(np.array(simulated.eye, np.float32), rays.reshape(-1, 3).astype(np.float32))
    maps = surface_maps(room, geometry)
    difference = np.abs(hits.distance_m.reshape(80, 160) - maps.depth_m)
    # All but windows, doors, skirting, radiators and lamps.
    assert np.median(difference) < 1e-5
    assert np.mean(difference < 0.001) > 0.6

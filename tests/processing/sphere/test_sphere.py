import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from benchmarks.photometry.sphere_light import CUBE_FACES, cube_views
from processing.errors import LensError, ParameterError
from processing.sphere import (
    Equirectangular,
    Fisheye,
    LensMapping,
    Perspective,
    directions,
    pixels,
    point_directions,
)
from tests.processing.sphere.sphere_pictures import equirectangulars, fisheye, geometries, one_of_each


@settings(max_examples=80, deadline=None)
@given(geometries)
def test_pixel_to_direction_to_pixel(geometry):
    d, seen = directions(geometry)
    assert d.dtype == np.float64
    assert d.shape == (geometry.height_px, geometry.width_px, 3)
    np.testing.assert_allclose(np.linalg.norm(d, axis=-1), 1, atol=1e-12)
    x, y, there = pixels(geometry, d)
    assert there[seen].all()
    row, column = np.indices(seen.shape) + 0.5
    # Two roots lie between a pixel at an orthographic circle's edge and its direction.
    np.testing.assert_allclose(x[seen], column[seen], atol=1e-6)
    np.testing.assert_allclose(y[seen], row[seen], atol=1e-6)


@settings(max_examples=60, deadline=None)
@given(geometries, st.lists(st.tuples(*[st.floats(-1, 1)] * 3), min_size=1, max_size=20))
def test_direction_to_pixel_to_direction(geometry, given_directions):
    d = np.array(given_directions)
    d = d[np.linalg.norm(d, axis=1) > 1e-3]
    x, y, seen = pixels(geometry, d)
    assert np.isfinite(x).all()
    assert np.isfinite(y).all()
    back, there = point_directions(geometry, x[seen], y[seen])
    assert there.all()
    np.testing.assert_allclose(back, (d / np.linalg.norm(d, axis=1)[:, None])[seen], atol=1e-7)


@settings(max_examples=50, deadline=None)
@given(equirectangulars, st.integers(-3, 3))
def test_turning_by_whole_columns_rolls_the_picture(panorama, columns):
    step = 2 * math.pi / panorama.width_px
    turned = Equirectangular(panorama.width_px, panorama.height_px, panorama.yaw_rad + columns * step)
    np.testing.assert_allclose(directions(turned)[0], np.roll(directions(panorama)[0], -columns, axis=1), atol=1e-12)


@pytest.mark.parametrize("z", [1.0, -1.0])
def test_poles_and_seam_are_exact(z):
    panorama = Equirectangular(360, 180)
    x, y, seen = pixels(
        panorama, np.array([[0.0, 0.0, z], [-1e-300, -1.0, 0.0], [1e-300, -1.0, 0.0], [0.0, -1.0, 0.0]])
    )
    assert seen.all()
    assert y[0] == (0 if z > 0 else 180)
    assert ((x >= 0) & (x < 360)).all()
    assert np.minimum(x[1:], 360 - x[1:]).max() < 1e-9
    assert (y[1:] == 90).all()


def test_directions_of_any_length_and_of_bands():
    for geometry in one_of_each().values():
        d, _ = directions(geometry)
        for one, other in zip(pixels(geometry, d), pixels(geometry, d * 1e6), strict=True):
            np.testing.assert_allclose(one, other, atol=1e-6)
        np.testing.assert_array_equal(directions(geometry, slice(10, 20))[0], d[10:20])


def test_a_view_rolled_clockwise_sees_the_world_turned_the_other_way():
    view = Perspective(100, 100, math.pi / 2, roll_rad=math.radians(30))
    top, _ = point_directions(view, 50, 0)
    # The camera's up leans to the right.
    np.testing.assert_allclose(top, np.array([0.5, 1, math.cos(math.pi / 6)]) / math.sqrt(2), atol=1e-12)


def test_behind_a_view_nothing_is_seen():
    x, y, seen = pixels(Perspective(10, 10, 1.0), np.array([[0.0, -1.0, 0.0], [1.0, 0.0, 0.0]]))
    assert not seen.any()
    assert (x == -1).all()
    assert (y == -1).all()


def test_outside_a_fisheye_the_direction_is_that_of_its_edge():
    for mapping in LensMapping:
        d, seen = directions(fisheye(mapping, 20, half_field_rad=1.2))
        assert not seen[0, 0]
        assert math.acos(d[0, 0, 2]) == pytest.approx(1.2)


def test_each_mapping_follows_its_formula():
    theta = np.linspace(0, 1.5, 50)
    d = np.stack([np.zeros(50), np.sin(theta), np.cos(theta)], axis=-1)
    laws = {
        LensMapping.EQUIDISTANT: theta / 1.5,
        LensMapping.EQUISOLID: np.sin(theta / 2) / math.sin(0.75),
        LensMapping.STEREOGRAPHIC: np.tan(theta / 2) / math.tan(0.75),
        LensMapping.ORTHOGRAPHIC: np.sin(theta) / math.sin(1.5),
    }
    for mapping, radius in laws.items():
        _, y, _ = pixels(fisheye(mapping, 200, half_field_rad=1.5), d)
        np.testing.assert_allclose(y, 100 - 100 * radius, atol=1e-9)
    _, y, _ = pixels(fisheye(LensMapping.POLYNOMIAL, 200, half_field_rad=1.5), d)
    r = (100 - y) / 100
    np.testing.assert_allclose(1.08 * r - 0.08 * r**3, theta / 1.5, atol=1e-12)


def test_cube_faces_meet_as_named():
    views = dict(zip(CUBE_FACES, cube_views(8), strict=True))
    ahead = {name: point_directions(view, 4, 4)[0] for name, view in views.items()}
    np.testing.assert_allclose(
        np.stack(list(ahead.values())),
        [(0, 1, 0), (1, 0, 0), (0, -1, 0), (-1, 0, 0), (0, 0, 1), (0, 0, -1)],
        atol=1e-12,
    )
    for x in (0, 3, 8):
        front = point_directions(views["front"], [x, x], [0, 8])[0]
        np.testing.assert_allclose(front[0], point_directions(views["up"], x, 8)[0], atol=1e-12)
        np.testing.assert_allclose(front[1], point_directions(views["down"], x, 0)[0], atol=1e-12)


@pytest.mark.parametrize(
    ("error", "make"),
    [
        (ParameterError, lambda: Equirectangular(0, 5)),
        (ParameterError, lambda: Equirectangular(5, 5, math.nan)),
        (ParameterError, lambda: Perspective(5, 5, math.pi)),
        (ParameterError, lambda: Perspective(5, 5, 1.0, yaw_rad=math.inf)),
        (LensError, lambda: fisheye(LensMapping.EQUISOLID, radius_px=0.0)),
        (LensError, lambda: fisheye(LensMapping.ORTHOGRAPHIC, half_field_rad=1.7)),
        (LensError, lambda: fisheye(LensMapping.EQUIDISTANT, half_field_rad=180.0)),
        (LensError, lambda: fisheye(LensMapping.POLYNOMIAL, polynomial=())),
        (LensError, lambda: fisheye(LensMapping.EQUIDISTANT, polynomial=(1.0,))),
        (LensError, lambda: fisheye(LensMapping.POLYNOMIAL, polynomial=(1.0, 0.1))),
        (LensError, lambda: fisheye(LensMapping.POLYNOMIAL, polynomial=(3.0, -2.0))),
        (ParameterError, lambda: fisheye(LensMapping.EQUISOLID, centre_px=(math.nan, 0.0))),
        (ParameterError, lambda: pixels(Equirectangular(4, 2), [[math.nan, 0, 1]])),
        (ParameterError, lambda: pixels(Equirectangular(4, 2), [0.0, 1.0])),
        (ParameterError, lambda: point_directions(Equirectangular(4, 2), math.inf, 0)),
    ],
)
def test_what_cannot_be_is_refused(error, make):
    with pytest.raises(error):
        make()


def test_a_fisheye_may_see_below_the_horizon():
    lens = Fisheye(100, 100, LensMapping.EQUIDISTANT, 50, math.radians(93))
    _, _, seen = pixels(
        lens, np.array([[1.0, 0.0, -math.tan(math.radians(2.9))], [1.0, 0.0, -math.tan(math.radians(3.1))]])
    )
    assert seen.tolist() == [True, False]


@pytest.mark.parametrize("mapping", [LensMapping.EQUIDISTANT, LensMapping.STEREOGRAPHIC])
def test_every_mapping_fits_into_the_sentence(mapping: LensMapping) -> None:
    with pytest.raises(LensError, match=f"^a fisheye, {mapping}, with a half field of 180"):
        fisheye(mapping, half_field_rad=180.0)
    with pytest.raises(LensError, match=f"^a fisheye, {mapping}, with the coefficients"):
        fisheye(mapping, polynomial=(1.0,))

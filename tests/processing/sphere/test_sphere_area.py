import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from benchmarks.photometry.sphere_light import cube_views
from processing.errors import ParameterError
from processing.sphere import (
    Equirectangular,
    Fisheye,
    LensMapping,
    Perspective,
    directions,
    projected_solid_angles,
    solid_angles,
)
from tests.conftest import LONG
from tests.processing.sphere.sphere_pictures import fisheye, geometries, one_of_each

SIZES = (16, 17, 33)


@pytest.mark.parametrize("rows", SIZES)
def test_a_uniform_sphere_gives_4_pi(rows):
    for parts in ([Equirectangular(2 * rows, rows, 0.7)], [Equirectangular(rows, rows)], cube_views(rows)):
        assert sum(solid_angles(p).sum() for p in parts) == pytest.approx(4 * math.pi, rel=1e-12)


@pytest.mark.parametrize("rows", SIZES)
@pytest.mark.parametrize("normal", [(0, 0, 1), (0, 0, -2), (1, 0, 0), (0.3, -0.5, 0.6)])
def test_a_uniform_hemisphere_gives_pi_on_any_plane(rows, normal):
    for parts in ([Equirectangular(2 * rows, rows, 0.7)], [Equirectangular(rows, rows)], cube_views(rows)):
        assert sum(projected_solid_angles(p, normal).sum() for p in parts) == pytest.approx(math.pi, rel=5e-6)


@pytest.mark.sweep
@pytest.mark.parametrize("mapping", list(LensMapping))
@pytest.mark.parametrize("size", [1, 2, 16, 101, *([530] if LONG else [])])
@pytest.mark.parametrize("half_field_rad", [math.pi / 2, 1.1])
def test_a_fisheye_holds_its_cap(mapping, size, half_field_rad):
    lens = fisheye(mapping, size, half_field_rad=half_field_rad, top_azimuth_rad=1.0)
    cells = solid_angles(lens)
    assert cells.min() >= 0
    assert cells.sum() == pytest.approx(2 * math.pi * (1 - math.cos(half_field_rad)), rel=1e-9)
    level = projected_solid_angles(lens, (0, 0, 1)).sum()
    assert level == pytest.approx(math.pi * math.sin(half_field_rad) ** 2, rel=1e-9)


def test_large_fisheyes_are_as_exact():
    for mapping in (LensMapping.EQUIDISTANT, LensMapping.ORTHOGRAPHIC):
        quarter = Fisheye(1030, 1030, mapping, 1030, centre_px=(1030, 1030))
        assert solid_angles(quarter).sum() == pytest.approx(math.pi / 2, rel=1e-6)


def test_a_fisheye_beyond_the_horizon_lights_a_level_plane_by_pi():
    lens = fisheye(LensMapping.EQUIDISTANT, 128, half_field_rad=2.5)
    assert projected_solid_angles(lens, (0, 0, 1)).sum() == pytest.approx(math.pi, rel=1e-5)


def test_half_the_sky_lights_a_facade_by_half_of_pi():
    for mapping in LensMapping:
        found = projected_solid_angles(fisheye(mapping, 64), (0, 1, 0)).sum()
        assert found == pytest.approx(math.pi / 2, rel=2e-5)


def test_cells_agree_with_their_own_fine_division():
    for name, geometry in one_of_each(16).items():
        fine = one_of_each(16 * 12)[name]
        d, _ = directions(fine)
        for normal in ((0, 0, 1), (0.6, -0.3, 0.4)):
            unit = np.array(normal) / np.linalg.norm(normal)
            light = np.where(solid_angles(fine) > 0, solid_angles(fine) * np.maximum(d @ unit, 0), 0)
            coarse = light.reshape(geometry.height_px, 12, geometry.width_px, 12).sum(axis=(1, 3))
            found = projected_solid_angles(geometry, normal)
            # The fine division is the coarser of the two at an orthographic edge, where the cosine falls as a root.
            slack = 4e-2 if name == "orthographic" else 2e-3
            np.testing.assert_allclose(found, coarse, atol=slack * coarse.max(), err_msg=name)
        whole = solid_angles(fine).reshape(geometry.height_px, 12, geometry.width_px, 12).sum(axis=(1, 3))
        np.testing.assert_allclose(solid_angles(geometry), whole, rtol=1e-7, atol=1e-12, err_msg=name)


@settings(max_examples=30, deadline=None)
@given(geometries, st.tuples(*[st.floats(-1, 1)] * 3).filter(lambda n: np.linalg.norm(n) > 0.1))
def test_a_plane_gets_at_most_the_solid_angle(geometry, normal):
    cells, lit = solid_angles(geometry), projected_solid_angles(geometry, normal)
    assert np.isfinite(lit).all()
    assert (lit >= 0).all()
    assert (lit <= cells + 1e-9).all()


def test_a_picture_may_cut_the_circle():
    whole = Fisheye(100, 100, LensMapping.EQUISOLID, 50)
    part = Fisheye(40, 30, LensMapping.EQUISOLID, 50, centre_px=(50 - 30, 50 - 5))
    np.testing.assert_allclose(solid_angles(part), solid_angles(whole)[5:35, 30:70], atol=1e-12)


def test_narrow_views_lose_no_digits():
    view = Perspective(200, 100, math.radians(0.3), 0.4, 1.0, 0.3)
    tiny = math.radians(0.3) ** 2 / 2
    assert solid_angles(view).sum() == pytest.approx(tiny, rel=1e-5)
    spread = solid_angles(view)
    assert spread.max() / spread.min() == pytest.approx(1, abs=1e-4)


@pytest.mark.parametrize("normal", [(0, 0, 0), (math.nan, 0, 1), (1, 2)])
def test_planes_without_a_normal_are_refused(normal):
    with pytest.raises(ParameterError):
        projected_solid_angles(Equirectangular(4, 2), normal)

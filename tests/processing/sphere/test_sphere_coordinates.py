"""docs/reference/coordinates.md holds for processing as for the simulation, and both agree on every direction."""

import math

import numpy as np
import pytest

from mocks.optics.lenses import EquirectangularLens, EquisolidFisheye
from processing.sphere import Equirectangular, Fisheye, LensMapping, directions, pixels, point_directions, solid_angles

SIZE = (180, 120)
X, Y = np.arange(SIZE[0]) + 0.5, (np.arange(SIZE[1]) + 0.5)[:, None]


def as_processing_sees(lens: EquisolidFisheye) -> Fisheye:
    focal_px = lens.focal_length_mm / lens.sensor_width_mm * SIZE[0]
    radius_px = 2 * focal_px * math.sin(lens.half_field_rad / 2)
    return Fisheye(*SIZE, LensMapping.EQUISOLID, radius_px, lens.half_field_rad, top_azimuth_rad=lens.top_azimuth_rad)


@pytest.mark.parametrize("yaw_rad", [0.0, 1.0, -3.0])
def test_panoramas_agree_with_the_simulated_camera(yaw_rad):
    truth, _ = EquirectangularLens(yaw_rad).directions(X, Y, SIZE)
    found, seen = directions(Equirectangular(*SIZE, yaw_rad))
    assert seen.all()
    np.testing.assert_allclose(found, truth, atol=1e-6)
    areas = EquirectangularLens(yaw_rad).solid_angle_sr(X, Y, SIZE)
    np.testing.assert_allclose(solid_angles(Equirectangular(*SIZE, yaw_rad)), areas, rtol=1e-4)


@pytest.mark.parametrize("top_azimuth_rad", [0.0, 0.7, math.pi, -2.0])
@pytest.mark.parametrize("half_field_rad", [math.pi / 2, 1.2])
def test_fisheyes_agree_with_the_simulated_camera(top_azimuth_rad, half_field_rad):
    lens = EquisolidFisheye(half_field_rad=half_field_rad, top_azimuth_rad=top_azimuth_rad)
    truth, seen = lens.directions(X, Y, SIZE)
    ours = as_processing_sees(lens)
    found, ours_seen = directions(ours)
    np.testing.assert_array_equal(ours_seen, seen)
    np.testing.assert_allclose(found[seen], truth[seen], atol=1e-6)
    for direction in ((0.1, 0.5, 0.7), (-0.6, -0.2, 0.5)):
        unit = np.array(direction) / np.linalg.norm(direction)
        x, y, _ = pixels(ours, unit)
        np.testing.assert_allclose((x, y), lens.pixel_of(tuple(unit), SIZE), atol=1e-9)


def test_5_longitude_grows_to_the_right_from_the_middle():
    panorama = Equirectangular(400, 200)
    np.testing.assert_allclose(point_directions(panorama, 200, 100)[0], (0, 1, 0), atol=1e-12)
    np.testing.assert_allclose(point_directions(panorama, 300, 100)[0], (1, 0, 0), atol=1e-12)


def test_6_latitude_grows_upwards():
    np.testing.assert_allclose(point_directions(Equirectangular(400, 200), 200, 0)[0], (0, 0, 1), atol=1e-12)


def test_7_pixel_centres_lie_at_half_integers():
    first = directions(Equirectangular(400, 200))[0][0, 0]
    assert math.atan2(first[0], first[1]) == pytest.approx(-math.pi + math.pi / 400)


def test_8_the_sky_is_seen_from_below():
    for mapping in (
        LensMapping.EQUISOLID,
        LensMapping.EQUIDISTANT,
        LensMapping.ORTHOGRAPHIC,
        LensMapping.STEREOGRAPHIC,
    ):
        sky = Fisheye(100, 100, mapping, 50)
        np.testing.assert_allclose(point_directions(sky, 50, 50)[0], (0, 0, 1), atol=1e-12)
        top, left = point_directions(sky, [50, 0], [0, 50])[0]
        np.testing.assert_allclose(top, (0, 1, 0), atol=1e-7)
        np.testing.assert_allclose(left, (1, 0, 0), atol=1e-7)

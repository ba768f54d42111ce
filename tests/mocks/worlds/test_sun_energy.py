"""The sun in the pictures: its energy is kept through both lenses, wherever it stands, at every picture size."""

import math

import numpy as np
import pytest

from mocks.optics.camera import CANON_5D2, ND3_TINT, THETA_Z1, image_rows, scene_rows
from mocks.worlds.light import BrightDisc, UniformWorld, direction_of
from tests.conftest import LONG


class Sun(UniformWorld):
    """Black but for a disc of the sun's size."""

    def at(self, direction):
        object.__setattr__(self, "disc", BrightDisc(direction, math.radians(0.265), (1.1e9, 1e9, 0.9e9)))
        return self

    def radiance(self, site, directions, pixel_rad=0.0, component=None):
        return np.zeros(directions.shape, dtype=np.float32)

    def discs(self, site):
        return (self.disc,)


def rows_around(optics, direction, size):
    """All rows within 2 degrees and some pixels of the sun, by the distance of picture points."""
    x, y, z = direction
    _, row = optics.lens.pixel_of((x, y, max(z, 0.0)) if optics is CANON_5D2 else direction, size)
    px_per_rad = 8.0 / 36.0 * size[0] if optics is CANON_5D2 else size[1] / math.pi
    reach = 1.5 * math.radians(2) * px_per_rad + 4
    return range(max(int(row - reach), 0), min(int(row + reach) + 1, size[1]))


def flux_of(optics, direction, size):
    """Radiance times solid angle, summed over the rows near the sun, over that of the whole disc (green)."""
    near = rows_around(optics, direction, size)
    light = np.concatenate(
        [
            scene_rows(Sun().at(direction), optics, size, range(first, min(first + 16, near.stop)))[..., 1]
            for first in range(near.start, near.stop, 16)
        ]
    ).astype(float)
    if optics is CANON_5D2:
        total = light.sum() * (36.0 / (8.0 * size[0])) ** 2
    else:
        edges = [math.sin((0.5 - row / size[1]) * math.pi) for row in range(near.start, near.stop + 1)]
        total = float(light.sum(axis=1) @ -np.diff(edges)) * 2 * math.pi / size[0]
    # No pixel is brighter than the sun; one that lies within it, which large pictures have, is as bright.
    assert light.max() < 1.02e9
    if size == optics.full_size:
        assert light.max() == pytest.approx(1e9, rel=0.02)
    return total / (1e9 * 2 * math.pi * (1 - math.cos(math.radians(0.265))))


def some(values, number):
    """All of the values in a long run; in short half of them, others by a number that comes with them."""
    start = int(number) % len(values)
    return values if LONG else [*values, *values][start : start + (len(values) + 1) // 2]


@pytest.mark.sweep
@pytest.mark.parametrize("elevation_deg", [5, 15, 30, 45, 60, 75, 89] if LONG else [5, 45, 89])
def test_suns_energy_is_kept_through_the_fisheye(elevation_deg):
    """To 0.5 % at each elevation, whatever the azimuth and the size of the picture."""
    for azimuth_deg in some((0, 37, 135, 260), elevation_deg):
        direction = direction_of(math.radians(azimuth_deg), math.radians(elevation_deg))
        for size in some(((351, 234), (702, 468), (1404, 936)), azimuth_deg):
            assert flux_of(CANON_5D2, direction, size) == pytest.approx(1, abs=0.005)


@pytest.mark.sweep
@pytest.mark.parametrize(
    ("elevation_deg", "azimuth_deg"), [(5, 37), (89, 20), (30, 190), (60, 300)] if LONG else [(5, 37), (89, 20)]
)
def test_suns_energy_is_kept_at_full_size(elevation_deg, azimuth_deg):
    direction = direction_of(math.radians(azimuth_deg), math.radians(elevation_deg))
    assert flux_of(CANON_5D2, direction, CANON_5D2.full_size) == pytest.approx(1, abs=0.005)
    assert flux_of(THETA_Z1, direction, THETA_Z1.full_size) == pytest.approx(1, abs=0.005)


@pytest.mark.sweep
@pytest.mark.parametrize("elevation_deg", [-89.9, -40, 0, 30, 75, 89.7, 90] if LONG else [-89.9, 30, 90])
def test_suns_energy_is_kept_in_the_panorama(elevation_deg):
    """Poles and seam included (azimuth 180 degrees is the left and the right edge)."""
    for azimuth_deg in some((0, 180, 179.8, -100), elevation_deg):
        direction = direction_of(math.radians(azimuth_deg), math.radians(elevation_deg))
        for size in some(((420, 210), (840, 420), (1680, 840)), azimuth_deg):
            assert flux_of(THETA_Z1, direction, size) == pytest.approx(1, abs=0.005)


@pytest.mark.parametrize(("above_deg", "seen"), [(0.265, 1.0), (0.0, 0.5), (-0.13, 0.204), (-0.3, 0.0)])
def test_sun_at_the_edge_of_the_field_is_cut(above_deg, seen):
    """A setting sun gives the fisheye only the part that is up (a circle's segment)."""
    direction = direction_of(0.3, math.radians(above_deg))
    assert flux_of(CANON_5D2, direction, (2808, 1872)) == pytest.approx(seen, abs=0.03)


def test_sun_reaches_the_image_through_filter_and_falloff():
    """What the sun adds to the image is its flux times ND 3.0, tint and fall-off at that place."""
    direction, size = direction_of(0.8, math.radians(40)), (702, 468)
    image = image_rows(Sun().at(direction), CANON_5D2, size, range(size[1])).astype(float)
    flux = image.sum(axis=(0, 1)) * (36.0 / (8.0 * size[0])) ** 2
    turn, knee_rad, loss = CANON_5D2.lens.vignetting
    theta_rad = math.radians(50)
    falloff = math.cos(turn * theta_rad) * (1 - loss * max(theta_rad - knee_rad, 0) ** 2)
    sun = np.array([1.1e9, 1e9, 0.9e9]) * 2 * math.pi * (1 - math.cos(math.radians(0.265)))
    np.testing.assert_allclose(flux, sun @ np.array(ND3_TINT) * 1e-3 * falloff, rtol=0.005)

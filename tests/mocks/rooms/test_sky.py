"""The simulated sky: absolute light against closed forms and pvlib, CIE values, colours, clouds, ground, maps."""

from __future__ import annotations

import math
import pickle
from collections.abc import Iterator
from dataclasses import replace
from datetime import UTC, datetime

import numpy as np
import pytest

from benchmarks.photometry.sky_anchor import linke_of, pvlib_clear_sky_lx
from mocks.rooms.sky import backdrop
from mocks.rooms.sky import daylight as sky_light
from mocks.rooms.sky.daylight import Moment, draw_moment, sun_distance_au, sun_of
from mocks.rooms.sky.sky import CloudDrift, Sky, draw_sky
from mocks.worlds.light import SUN_RADIUS_RAD, direction_of, luminance_cd_m2
from processing.ground.arrays import Floats
from tests.conftest import LONG

PLAIN = Sky(skyline=False)
OVERCAST = Sky("overcast", cie_type=16, sun_share=0.0, skyline=False)
PAINTED = Sky("intermediate", cie_type=8, cloud_cover=0.6, seed=4)
SITES = [(40.44, -79.99), (1.35, 103.82), (59.33, 18.07), (-33.87, 151.21)]


def towards(azimuth_deg: float, elevation_deg: float) -> Floats:
    direction = direction_of(math.radians(azimuth_deg), math.radians(elevation_deg))
    return np.array([direction], dtype=np.float32)


def whole_sphere(rows: int) -> tuple[Floats, Floats]:
    """Directions of an equirectangular grid in the contract's convention, and their solid angles (rows, 1)."""
    latitude = math.pi / 2 - (np.arange(rows) + 0.5) * math.pi / rows
    longitude = (np.arange(2 * rows) + 0.5) * math.pi / rows - math.pi
    flat = np.cos(latitude)[:, None]
    rising = np.broadcast_to(np.sin(latitude)[:, None], (rows, 2 * rows))
    grid = np.stack([flat * np.sin(longitude), flat * np.cos(longitude), rising], axis=-1)
    return grid.astype(np.float32), (np.cos(latitude) * (math.pi / rows) ** 2).astype(np.float32)[:, None]


def horizontal_lx(radiance: Floats, rows: int) -> float:
    grid, solid_angle = whole_sphere(rows)
    return float((luminance_cd_m2(radiance) * np.maximum(grid[..., 2], 0) * solid_angle).sum(dtype=np.float64))


class TestLuminance:
    def test_overcast_dome_has_the_closed_forms_illuminance(self) -> None:
        zenith = float(luminance_cd_m2(OVERCAST.dome(towards(0, 90)))[0])
        integral = horizontal_lx(OVERCAST.dome(whole_sphere(256)[0]), 256)
        assert integral == pytest.approx(7 * math.pi / 9 * zenith, rel=0.002)
        stated, sun = OVERCAST.horizontal_illuminance_lx()
        assert integral == pytest.approx(stated, rel=0.002)
        assert stated == pytest.approx(300 + 21_000 * math.sin(OVERCAST.sun_elevation_rad))
        assert sun == 0

    @pytest.mark.parametrize("elevation_deg", [5, 20, 42, 70])
    def test_overcast_falls_to_a_third_at_the_horizon(self, elevation_deg: float) -> None:
        zenith, low = (float(luminance_cd_m2(OVERCAST.dome(towards(33, e)))[0]) for e in (90, elevation_deg))
        assert low / zenith == pytest.approx((1 + 2 * math.sin(math.radians(elevation_deg))) / 3, rel=1e-4)

    @pytest.mark.parametrize("cie_type", range(1, 16))
    def test_dome_has_the_standards_relative_luminance(self, cie_type: int) -> None:
        sky = replace(PLAIN, cie_type=cie_type, sun_elevation_rad=math.radians(35))
        a, b, c, d, e = sky_light.PARAMETERS[cie_type]

        def standard(azimuth_deg: float, elevation_deg: float) -> float:
            zenith = math.radians(90 - elevation_deg)
            sun_zenith = math.radians(55)
            apart = math.radians(azimuth_deg) - sky.sun_azimuth_rad
            cosine = math.cos(sun_zenith) * math.cos(zenith) + math.sin(sun_zenith) * math.sin(zenith) * math.cos(apart)
            angle = math.acos(cosine)
            scatter = 1 + c * (math.exp(d * angle) - math.exp(d * math.pi / 2)) + e * cosine**2
            return (1 + a * math.exp(b / math.cos(zenith))) * scatter

        zenith_luminance = float(luminance_cd_m2(sky.dome(towards(0, 90)))[0])
        for azimuth_deg, elevation_deg in ((48, 20), (60, 40), (-132, 30), (-42, 60), (170, 4)):
            found = float(luminance_cd_m2(sky.dome(towards(azimuth_deg, elevation_deg)))[0]) / zenith_luminance
            assert found == pytest.approx(standard(azimuth_deg, elevation_deg) / standard(0, 90), rel=1e-3)

    def test_published_luminances_of_the_clear_standard_sky(self) -> None:
        """Type 12, sun at 60 degrees from the zenith: by hand from table 1 of the standard."""
        sky = replace(PLAIN, sun_elevation_rad=math.radians(30), sun_azimuth_rad=0.0)
        zenith, opposite = (float(luminance_cd_m2(sky.dome(towards(180, e)))[0]) for e in (90, 30))
        scatter_zenith = 1 + 10 * (math.exp(-math.pi) - math.exp(-1.5 * math.pi)) + 0.45 * 0.25
        scatter_opposite = 1 + 10 * (math.exp(-2 * math.pi) - math.exp(-1.5 * math.pi)) + 0.45 * 0.25
        gradation = (1 - math.exp(-0.64)) / (1 - math.exp(-0.32))
        assert opposite / zenith == pytest.approx(gradation * scatter_opposite / scatter_zenith, rel=1e-4)

    @pytest.mark.parametrize("sky", [PLAIN, PAINTED, replace(PAINTED, kind="clear", cloud_cover=0.15), OVERCAST])
    def test_clouds_leave_the_diffuse_illuminance(self, sky: Sky) -> None:
        found = horizontal_lx(sky.dome(whole_sphere(256)[0], math.pi / 256), 256)
        assert found == pytest.approx(sky.horizontal_illuminance_lx()[0], rel=0.005)


class TestSun:
    def test_luminance_overhead_and_low(self) -> None:
        high = replace(PLAIN, sun_elevation_rad=math.radians(89), turbidity=2.0).disc()
        low = replace(PLAIN, sun_elevation_rad=math.radians(8), turbidity=2.0).disc()
        assert high is not None
        assert low is not None
        luminance = [float(luminance_cd_m2(np.array(d.radiance_rgb, np.float32))) for d in (high, low)]
        assert luminance[0] == pytest.approx(1.6e9, rel=0.03)
        assert 1e8 < luminance[1] < 0.5 * luminance[0]
        assert high.radius_rad == SUN_RADIUS_RAD == pytest.approx(math.radians(0.265))
        ratio = [d.radiance_rgb[0] / d.radiance_rgb[2] for d in (high, low)]
        assert ratio[1] > 2 * ratio[0] > 2, "a low sun is redder"

    def test_disc_gives_the_direct_illuminance(self) -> None:
        disc = PLAIN.disc()
        assert disc is not None
        normal_lx = float(luminance_cd_m2(np.array(disc.radiance_rgb, np.float32))) * disc.solid_angle_sr
        assert normal_lx == pytest.approx(float(luminance_cd_m2(PLAIN.sun_normal_illuminance_rgb)), rel=1e-5)
        direct = normal_lx * math.sin(PLAIN.sun_elevation_rad)
        assert direct == pytest.approx(PLAIN.horizontal_illuminance_lx()[1], rel=1e-5)

    def test_clouds_before_the_sun(self) -> None:
        veiled = replace(PAINTED, sun_share=0.25)
        assert veiled.horizontal_illuminance_lx()[1] == pytest.approx(0.25 * PAINTED.horizontal_illuminance_lx()[1])
        assert OVERCAST.disc() is None
        assert replace(PAINTED, sun_share=0.0).disc() is None

    @pytest.mark.parametrize("elevation_deg", [8, 20, 30, 44, 75])
    def test_clouds_beside_a_free_sun_add_little(self, elevation_deg: float) -> None:
        """An intermediate sky's diffuse light and an undimmed sun are no two whole skies."""
        sky = replace(PAINTED, turbidity=1.8, sun_elevation_rad=math.radians(elevation_deg))
        clear = sum(replace(sky, kind="clear").horizontal_illuminance_lx())
        for cover in (0.3, 0.5, 0.75):
            found = sum(replace(sky, cloud_cover=cover).horizontal_illuminance_lx())
            assert 0.95 * clear < found <= 1.1501 * clear
            veiled = sum(replace(sky, cloud_cover=cover, sun_share=0.3).horizontal_illuminance_lx())
            assert veiled < found

    def test_reference_spectrum(self) -> None:
        """ASTM G173's direct beam (air mass 1.5, aerosol 0.084 at 500 nm) integrates to 97.13 klx."""
        aerosol = 0.084 * (550 / 500) ** -1.3
        found = sky_light.normal_illuminance_lx(math.asin(1 / 1.5), 1.27 + 10 * aerosol)
        assert found == pytest.approx(97_130, rel=0.02)


@pytest.mark.parametrize("site", SITES)
@pytest.mark.sweep
@pytest.mark.parametrize("month", [3, 6, 9, 12])
def test_clear_sky_agrees_with_pvlib(site: tuple[float, float], month: int) -> None:
    checked = 0
    for hour in range(24):
        moment = Moment(*site, datetime(2025, month, 21, hour, tzinfo=UTC), 0.0)
        azimuth_rad, elevation_rad = sun_of(moment)
        if not 10 <= math.degrees(elevation_rad) <= 75:
            continue
        for turbidity in (1.8, 2.2, 2.7) if LONG else (1.8, 2.2, 2.7)[hour % 3 :][:1]:
            sky = Sky("clear", azimuth_rad, elevation_rad, turbidity=turbidity, sun_distance_au=sun_distance_au(moment))
            ours = sum(sky.horizontal_illuminance_lx())
            assert ours == pytest.approx(pvlib_clear_sky_lx(moment, linke_of(turbidity)), rel=0.10)
            checked += 1
    assert checked or (month == 12 and site[0] > 55)


@pytest.fixture(scope="class")
def coarse_skyline() -> Iterator[None]:
    """A skyline of an eighth the columns: that it stands there is of interest, not how it looks."""
    with pytest.MonkeyPatch.context() as context:
        context.setattr(backdrop, "COLUMNS", 512)
        context.setattr(backdrop, "PIXEL_RAD", 2 * math.pi / 512)
        context.setattr(backdrop, "ROWS", round((backdrop.TOP_RAD - backdrop.BOTTOM_RAD) / backdrop.PIXEL_RAD))
        yield


@pytest.mark.usefixtures("coarse_skyline")
class TestPicture:
    @pytest.mark.parametrize("sky", [PLAIN, PAINTED, OVERCAST, replace(PAINTED, sun_elevation_rad=math.radians(8))])
    def test_light_is_finite_and_nowhere_negative(self, sky: Sky) -> None:
        awkward = np.array(
            [(0, 0, 1), (0, 0, -1), (0, 1, 0), (0, -1, 0), (-1, 0, 0), (1, 0, -1e-7), sky.sun_direction],
            dtype=np.float32,
        )
        directions = np.concatenate([awkward, whole_sphere(32)[0].reshape(-1, 3)])
        for component in (None, "sky", "sun"):
            light = sky.radiance(directions, 0.0, component)
            assert light.dtype == np.float32
            assert np.isfinite(light).all()
            assert (light >= 0).all()

    def test_components_add_up(self) -> None:
        grid, _ = whole_sphere(64)
        sky, sun = (PAINTED.radiance(grid, 0.05, part) for part in ("sky", "sun"))
        np.testing.assert_allclose(sky + sun, PAINTED.radiance(grid, 0.05), rtol=2e-3, atol=0.5)
        assert not sun[:8].any(), "overhead, all light comes from the dome"
        assert sun[40:].any()

    def test_plain_ground_returns_its_albedo(self) -> None:
        down = PLAIN.radiance(towards(0, -90))
        assert luminance_cd_m2(np.array(PLAIN.ground_albedo, np.float32)) == pytest.approx(0.19, abs=0.02)
        diffuse, direct = PLAIN.horizontal_illuminance_lx()
        expected = 0.19 * (diffuse + direct) / math.pi
        assert float(luminance_cd_m2(down)[0]) == pytest.approx(expected, rel=0.08)
        white = replace(PLAIN, ground_albedo=(1.0, 1.0, 1.0)).radiance(towards(0, -45))
        assert float(luminance_cd_m2(white)[0]) == pytest.approx((diffuse + direct) / math.pi, rel=0.003)

    def test_environment_is_the_mean_of_the_radiance(self) -> None:
        rows, fine = 16, 128
        grid, solid_angle = whole_sphere(fine)
        light = PAINTED.radiance(grid, math.pi / fine) * solid_angle[..., None]
        coarse = whole_sphere(rows)[1][..., None]
        summed = light.reshape(rows, fine // rows, 2 * rows, fine // rows, 3).sum(axis=(1, 3))
        found = PAINTED.environment(rows) * coarse
        assert found.shape == (rows, 2 * rows, 3)
        np.testing.assert_allclose(found.sum(axis=(0, 1)), summed.sum(axis=(0, 1)), rtol=0.01)
        np.testing.assert_allclose(found[:7].sum(axis=(0, 1)), summed[:7].sum(axis=(0, 1)), rtol=0.01)

    def test_environment_of_a_free_dome_keeps_the_illuminance(self) -> None:
        for sky in (PLAIN, OVERCAST):
            found = horizontal_lx(sky.environment(64), 64)
            assert found == pytest.approx(sky.horizontal_illuminance_lx()[0], rel=0.003)

    def test_environment_has_the_sun_where_it_is(self) -> None:
        sky = replace(PLAIN, sun_azimuth_rad=math.radians(90), sun_elevation_rad=math.radians(40))
        bright = luminance_cd_m2(sky.environment(36))
        row, column = np.unravel_index(int(bright.argmax()), bright.shape)
        assert abs(column + 0.5 - 0.75 * 72) <= 1, "+x lies right of the centre"
        assert abs(row + 0.5 - 50 / 180 * 36) <= 1

    def test_blue_overhead_white_at_the_horizon_grey_when_overcast(self) -> None:
        def blueness(sky: Sky, azimuth_deg: float, elevation_deg: float) -> float:
            red, _, blue = sky.dome(towards(azimuth_deg, elevation_deg))[0]
            return float(blue / red)

        assert blueness(PLAIN, -132, 60) > 1.6
        assert blueness(PLAIN, -132, 60) > 1.1 * blueness(PLAIN, -132, 2)
        assert blueness(PLAIN, 48, 44) < 1.5
        assert blueness(OVERCAST, 0, 60) == pytest.approx(1.0, abs=0.1)

    def test_skyline_is_low_and_differs_by_seed(self) -> None:
        ring = np.concatenate([towards(a, 3) for a in range(0, 360, 2)])
        with_street, without = PAINTED.radiance(ring), PAINTED.dome(ring)
        assert (np.abs(with_street - without).max(axis=-1) > 50).mean() > 0.5, "something stands around"
        high = np.concatenate([towards(a, 27) for a in range(0, 360, 2)])
        np.testing.assert_array_equal(PAINTED.radiance(high), PAINTED.dome(high))

    def test_detail_finer_than_the_pixel_is_smoothed(self) -> None:
        grid, _ = whole_sphere(180)
        rough, smooth = (luminance_cd_m2(PAINTED.radiance(grid, pixel)) for pixel in (0.0, 0.2))
        below = slice(130, 170)
        assert smooth[below].std() < 0.6 * rough[below].std()

    def test_the_same_parameters_give_the_same_light_and_key(self) -> None:
        grid, _ = whole_sphere(24)
        again = pickle.loads(pickle.dumps(PAINTED))
        assert again == PAINTED
        assert again.key == PAINTED.key != replace(PAINTED, seed=5).key
        np.testing.assert_array_equal(again.radiance(grid), PAINTED.radiance(grid))


class TestDrawing:
    def test_kinds_come_as_often_as_wished(self) -> None:
        moment = draw_moment(np.random.default_rng([1, 5]))
        kinds = [draw_sky(np.random.default_rng([seed, 6]), moment).kind for seed in range(300)]
        assert kinds.count("clear") == pytest.approx(135, abs=25)
        assert kinds.count("intermediate") == pytest.approx(90, abs=24)

    def test_sun_stands_where_the_moment_says(self) -> None:
        for seed in range(12):
            moment = draw_moment(np.random.default_rng([seed, 5]))
            sky = draw_sky(np.random.default_rng([seed, 6]), moment, "clear")
            compass_rad, _ = sun_of(replace(moment, heading_rad=0.0))
            off = math.remainder(sky.sun_azimuth_rad - (compass_rad - moment.heading_rad), 2 * math.pi)
            assert off == pytest.approx(0, abs=1e-6)
            assert sky.kind == "clear"
            assert sky.disc() is not None

    def test_drawing_repeats(self) -> None:
        moment = draw_moment(np.random.default_rng([2, 5]))
        assert draw_sky(np.random.default_rng(9), moment) == draw_sky(np.random.default_rng(9), moment)


class TestDrift:
    def test_no_amplitude_is_constant(self) -> None:
        assert {CloudDrift().weights(t) for t in range(0, 2000, 50)} == {(1.0, 1.0)}

    def test_starts_at_one_dims_the_sun_and_is_smooth(self) -> None:
        for seed in range(5):
            drift = CloudDrift(0.8, seed=seed)
            assert drift.weights(0.0) == (1.0, 1.0)
            sky, sun = np.array([drift.weights(t) for t in np.arange(0, 2400, 0.5)]).T
            assert sun.max() / sun.min() > 1.5
            assert (sun > 0).all()
            assert sky.max() / sky.min() < 1.15
            assert np.abs(np.diff(sun)).max() < 0.12 * sun.max(), "half a second is never a jump"

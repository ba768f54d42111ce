"""Lenses, filter, sensor: does light become picture values as the parameters say?"""

import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from mocks.optics.camera import CANON_5D2, THETA_Z1, Filter, image_rows, scene_rows
from mocks.optics.lenses import EquirectangularLens, EquisolidFisheye
from mocks.optics.picture_jobs import ImageJob, PictureJob, bands, finish_image, mosaic, render_band
from mocks.optics.picture_jobs import _signals as signals
from mocks.optics.sensor import Exposure, Sensor, ToneCurve, TrueShutter, white_balance_gains
from mocks.worlds.light import BrightDisc, LightDrift, Site, UniformWorld, direction_of, luminance_cd_m2

CAMERAS = [THETA_Z1, CANON_5D2]
SIZES = {"theta_z1": (160, 80), "canon_5d2": (168, 112)}
STOPS = [4, 1, 1 / 4, 1 / 15, 1 / 60, 1 / 250, 1 / 1000, 1 / 4000, 1 / 8000]


class RampWorld(UniformWorld):
    """Grey, from 0 at azimuth -180 degrees to ``luminance_cd_m2`` at 180."""

    def radiance(self, site, directions, pixel_rad=0.0, component=None):
        azimuth = np.arctan2(directions[..., 0], directions[..., 1])
        share = (azimuth / (2 * math.pi) + 0.5) * self.luminance_cd_m2
        return np.repeat(share[..., None], 3, axis=-1).astype(np.float32)


class DiscWorld(UniformWorld):
    """Black but for one disc."""

    disc = BrightDisc(direction_of(0.5, 0.8), math.radians(0.265), (1e9, 1e9, 1e9))

    def radiance(self, site, directions, pixel_rad=0.0, component=None):
        return np.zeros(directions.shape, dtype=np.float32)

    def discs(self, site):
        return (self.disc,)


def write_image(tmp_path, world, optics, size):
    path = tmp_path / "image"
    path.write_bytes(b"")
    job = ImageJob(world, optics, size, path)
    finish_image(job, [render_band(job, rows) for rows in bands(size)])
    return path


def noise_free(optics):
    return replace(optics, sensor=replace(optics.sensor, full_well_e=1e12, read_noise_e=0.0))


def picture_of(tmp_path, world, optics, exposure, *, seed=1, weights=(1.0,)):
    """The camera's 8-bit values before JPEG."""
    size = SIZES[optics.name]
    job = PictureJob(optics, size, write_image(tmp_path, world, optics, size), exposure, weights, seed)
    return np.concatenate([optics.sensor.develop(signal, exposure) for _, signal in signals(job)])


# --- lenses ---


@pytest.mark.parametrize("lens", [EquirectangularLens(yaw_rad=0.6), EquisolidFisheye(top_azimuth_rad=2.1)])
@settings(max_examples=80, deadline=None)
@given(azimuth=st.floats(-3.1, 3.1), elevation=st.floats(0.02, 1.55))
def test_pixel_and_direction_are_inverse(lens, azimuth, elevation):
    size = (672, 448)
    direction = direction_of(azimuth, elevation)
    x, y = lens.pixel_of(direction, size)
    back, seen = lens.directions(np.array([x]), np.array([y]), size)
    assert seen[0]
    np.testing.assert_allclose(back[0], direction, atol=2e-6)


def test_panorama_has_ahead_in_the_middle_and_right_to_the_right():
    lens, size = EquirectangularLens(), (400, 200)
    assert lens.pixel_of((0, 1, 0), size) == pytest.approx((200, 100))
    assert lens.pixel_of((1, 0, 0), size) == pytest.approx((300, 100))
    assert lens.pixel_of((0, 0.6, 0.8), size)[1] < 100


def test_fisheye_looks_up_and_mirrors_the_map():
    """With north (y) at the top, east (x) is at the left, as when one lies on one's back."""
    lens, size = EquisolidFisheye(), (5616, 3744)
    assert lens.pixel_of((0, 0, 1), size) == pytest.approx((2808, 1872))
    x, y = lens.pixel_of(direction_of(0, math.pi / 4), size)
    assert (x, y < 1872) == (pytest.approx(2808), True)
    x, y = lens.pixel_of(direction_of(math.pi / 2, math.pi / 4), size)
    assert (x < 2808, y) == (True, pytest.approx(1872))
    turned = EquisolidFisheye(top_azimuth_rad=math.pi / 2)
    assert turned.pixel_of(direction_of(math.pi / 2, 0.4), size)[0] == pytest.approx(2808)
    assert turned.pixel_of(direction_of(math.pi / 2, 0.4), size)[1] < 1872


def test_fisheye_image_height_is_equisolid_and_the_circle_fits():
    lens, size = EquisolidFisheye(), (5616, 3744)
    _, y = lens.pixel_of(direction_of(0, math.radians(30)), size)
    expected_mm = 2 * 8.0 * math.sin(math.radians(60) / 2)
    assert (1872 - y) * 36.0 / 5616 == pytest.approx(expected_mm, rel=1e-9)
    assert lens.pixel_of(direction_of(1.0, -0.05), size) is None
    _, seen = lens.directions(np.arange(5616) + 0.5, np.array([[0.5]]), size)
    assert not seen.any()


@pytest.mark.parametrize(
    ("lens", "field_sr"), [(EquirectangularLens(), 4 * math.pi), (EquisolidFisheye(), 2 * math.pi)]
)
def test_pixel_solid_angles_sum_to_the_field(lens, field_sr):
    size = (561, 374)
    x, y = np.meshgrid(np.arange(size[0]) + 0.5, np.arange(size[1]) + 0.5)
    assert float(lens.solid_angle_sr(x, y, size).sum()) == pytest.approx(field_sr, rel=2e-4)


@pytest.mark.parametrize("optics", CAMERAS)
def test_falloff_is_one_in_the_middle_and_falls_to_the_edge(optics):
    size = optics.full_size
    middle = optics.lens.falloff(np.array([size[0] / 2]), np.array([size[1] / 2]), size)
    assert middle[0] == pytest.approx(1.0)
    x, y = optics.lens.pixel_of(direction_of(math.pi / 2, 0.001), size)
    assert 0.6 < float(optics.lens.falloff(np.array([x]), np.array([y]), size)[0]) < 0.95


# --- light on the sensor ---


@pytest.mark.parametrize("optics", CAMERAS)
@pytest.mark.parametrize("shutter_s", STOPS)
def test_uniform_light_gives_what_the_exposure_equation_says(tmp_path, optics, shutter_s):
    """x = L t S / (c N2) times fall-off and filter, through the tone curve: within the noise of the mean."""
    optics = replace(optics, filter=replace(optics.filter, density=0.0))
    size = SIZES[optics.name]
    exposure = replace(optics.usual_settings, shutter_s=shutter_s)
    true_s = 2.0 ** round(math.log2(shutter_s))
    luminance = 100.0 if shutter_s < 0.01 else 1.0
    rgb = np.maximum(np.full(3, luminance) @ np.array(optics.filter.tint), 0)
    relative = rgb * true_s * exposure.iso / (120.0 * exposure.f_number**2)
    picture = picture_of(tmp_path, UniformWorld(luminance), optics, exposure)
    row, column = size[1] // 2, size[0] // 2
    patch = picture[row - 8 : row + 8, column - 8 : column + 8].reshape(-1, 3).astype(float)
    for channel, curve in enumerate(optics.sensor.tone):
        signal = relative[channel] * optics.sensor.native_balance[channel]
        electrons = optics.sensor.full_well_e * 100 / exposure.iso
        sigma = math.sqrt(signal / electrons + (optics.sensor.read_noise_e / electrons) ** 2)
        spread = np.array([-1, 0, 1]) * sigma / optics.sensor.native_balance[channel]
        low, expected, high = 255 * curve.encode(relative[channel] + spread)
        # Clipping at black lifts the mean of dark noise; half a step is rounding, 2 % the fall-off in the patch.
        tolerance = 0.6 + 0.02 * expected + 0.5 * (high - low)
        assert patch[:, channel].mean() == pytest.approx(expected, abs=tolerance)


def test_nine_stops_hold_a_room_and_nine_stops_with_filter_hold_the_sun():
    theta, canon = THETA_Z1.sensor, CANON_5D2.sensor
    longest, shortest = (1 / theta.exposure_gain(Exposure(s, 100, 5.6)) for s in (4, 1 / 8000))
    assert longest == pytest.approx(9.4, rel=0.01)
    assert shortest == pytest.approx(3.08e5, rel=0.01)
    sun = 0.001 * max(np.full(3, 1e9) @ np.array(CANON_5D2.filter.tint))
    assert sun < 1.3 * 1 / canon.exposure_gain(Exposure(1 / 8000, 200, 16.0))


def test_response_is_recovered_from_a_ramp(tmp_path):
    """With vignetting, glare and noise off, the picture of a ramp of light is the tone curve itself."""
    optics = noise_free(replace(THETA_Z1, lens=EquirectangularLens(vignetting=()), glare=0.0))
    exposure = Exposure(1 / 60, 100, 5.6)
    full = 1 / optics.sensor.exposure_gain(exposure)
    picture = picture_of(tmp_path, RampWorld(full), optics, exposure)
    ramp = (np.arange(160) + 0.5) / 160
    for channel, curve in enumerate(optics.sensor.tone):
        values = picture[40, :, channel].astype(float)
        assert np.all(np.diff(values) >= 0)
        np.testing.assert_allclose(values[2:-2], 255 * curve.encode(ramp)[2:-2], atol=0.75)
        np.testing.assert_allclose(curve.decode(values[2:-2] / 255), ramp[2:-2], atol=0.01)


@settings(max_examples=50, deadline=None)
@given(gamma=st.floats(1.6, 2.6), toe=st.floats(0.03, 0.2), contrast=st.floats(0, 0.9))
def test_tone_curves_are_monotone_and_invertible(gamma, toe, contrast):
    curve = ToneCurve(gamma, toe, contrast)
    x = np.linspace(0, 1, 500)
    y = curve.encode(x)
    assert y[0] == pytest.approx(0, abs=1e-12)
    assert y[-1] == pytest.approx(1)
    assert np.all(np.diff(y) > 0)
    np.testing.assert_allclose(curve.decode(y), x, atol=2e-5)
    assert curve.table()[0] == 0
    assert curve.table()[-1] == 255


def test_filter_dims_a_thousandfold_and_tints():
    white = CANON_5D2.filter.apply(np.ones((1, 3), dtype=np.float32))[0]
    assert luminance_cd_m2(white) == pytest.approx(1e-3, rel=1e-3)
    assert white[2] < 0.6 * white[0]
    assert Filter().apply(np.full((1, 3), 5.0, dtype=np.float32))[0] == pytest.approx(5.0)


@pytest.mark.parametrize("optics", CAMERAS)
def test_image_is_finite_everywhere_and_black_outside_the_field(optics):
    size = SIZES[optics.name]
    image = image_rows(UniformWorld(100.0), optics, size, range(size[1]))
    assert np.isfinite(image).all()
    _, seen = optics.lens.directions(np.arange(size[0]) + 0.5, np.arange(size[1])[:, None] + 0.5, size)
    assert image[seen].min() > 0
    outside = image[:2] if not seen.all() else np.zeros(1)
    assert outside.max() == 0


def test_bands_join_without_a_seam():
    world, size = RampWorld(100.0), (96, 48)
    whole = image_rows(world, THETA_Z1, size, range(48))
    parts = [image_rows(world, THETA_Z1, size, rows) for rows in (range(17), range(17, 18), range(18, 48))]
    np.testing.assert_array_equal(np.concatenate(parts), whole)


def test_edges_are_averaged():
    """A black and white edge through a pixel gives the share of white, not one or the other."""

    class Half(UniformWorld):
        def radiance(self, site, directions, pixel_rad=0.0, component=None):
            white = directions[..., 0] > math.sin(0.3 * 2 * math.pi / 64)
            return np.repeat(white[..., None], 3, axis=-1).astype(np.float32) * np.float32(100)

    optics = replace(THETA_Z1, full_size=(64, 32))
    light = scene_rows(Half(), optics, (64, 32), range(16, 17))[0, :, 0]
    assert light[31] == 0
    assert light[32] == pytest.approx(70, abs=13)
    assert light[33] == 100


def test_glare_spreads_the_mean_over_the_picture(tmp_path):
    base = noise_free(replace(THETA_Z1, lens=EquirectangularLens(vignetting=()), glare=0.0))
    exposure = Exposure(1 / 60, 100, 5.6)
    full = 1 / base.sensor.exposure_gain(exposure)
    clear = picture_of(tmp_path, RampWorld(full), base, exposure)
    veiled = picture_of(tmp_path, RampWorld(full), replace(base, glare=0.1), exposure)
    decode = base.sensor.tone[1].decode
    dark_clear, dark_veiled = (float(decode(picture[40, 1, 1] / 255)) for picture in (clear, veiled))
    assert dark_veiled - dark_clear * 0.9 == pytest.approx(0.1 * 0.5, abs=0.004)


# --- noise, ends, time ---


@pytest.mark.parametrize("optics", CAMERAS)
def test_noise_is_photon_and_read_noise(optics):
    exposure = replace(optics.usual_settings, shutter_s=1 / 60)
    sensor = optics.sensor
    full = 1 / sensor.exposure_gain(exposure)
    electrons = sensor.full_well_e * 100 / exposure.iso
    for share in (0.0, 0.01, 0.2, 0.6):
        light = np.full((300, 300, 3), share * full, dtype=np.float32)
        signal = sensor.mosaic_signal(light, exposure, np.random.default_rng(5)).astype(float)
        for channel, balance in enumerate(sensor.native_balance):
            mean = share * balance
            variance = mean / electrons + (sensor.read_noise_e / electrons) ** 2
            assert signal[..., channel].mean() == pytest.approx(mean, abs=5 * math.sqrt(variance / 90000))
            assert signal[..., channel].var() == pytest.approx(variance, rel=0.03)


@pytest.mark.parametrize("optics", CAMERAS)
def test_black_is_black_and_too_much_light_is_white(tmp_path, optics):
    exposure = replace(optics.usual_settings, shutter_s=4)
    black = picture_of(tmp_path, UniformWorld(1e-9), optics, exposure)
    assert black.mean() < 1.5
    assert black.max() < 10
    size = SIZES[optics.name]
    white = picture_of(tmp_path, UniformWorld(1e9), optics, exposure)
    assert white[size[1] // 2, size[0] // 2].min() == 255


def test_true_times_are_powers_of_two_behind_the_nominal_ones():
    real = TrueShutter.THIRDS_OF_STOPS
    expected = [4, 1, 1 / 4, 1 / 16, 1 / 64, 1 / 256, 1 / 1024, 1 / 4096, 1 / 8192]
    assert [real.seconds(stop) for stop in STOPS] == pytest.approx(expected, rel=1e-12)
    assert real.seconds(13) == pytest.approx(12.699, rel=1e-4)
    assert real.seconds(1 / 5000) == pytest.approx(2 ** (-37 / 3), rel=1e-9)
    assert TrueShutter.NOMINAL.seconds(1 / 60) == 1 / 60


def test_white_balance_is_neutral_for_its_own_daylight():
    np.testing.assert_allclose(white_balance_gains(6500), 1.0)
    warm = white_balance_gains(5000)
    assert warm[0] < 1 < warm[2]
    cold = white_balance_gains(9000)
    assert cold[2] < 1 < cold[0]


def test_white_balance_turns_the_picture_blue_when_set_too_warm(tmp_path):
    exposure = Exposure(1 / 60, 100, 5.6, color_temperature_k=5000)
    full = 1 / THETA_Z1.sensor.exposure_gain(exposure)
    picture = picture_of(tmp_path, UniformWorld(0.3 * full), THETA_Z1, exposure)
    red, _, blue = picture.reshape(-1, 3).mean(axis=0)
    assert blue > red + 10


def test_weight_scales_the_exposure(tmp_path):
    optics = noise_free(replace(THETA_Z1, lens=EquirectangularLens(vignetting=()), glare=0.0))
    exposure = Exposure(1 / 60, 100, 5.6)
    full = 1 / optics.sensor.exposure_gain(exposure)
    picture = picture_of(tmp_path, UniformWorld(0.2 * full), optics, exposure, weights=(1.5,))
    assert picture[40, 80, 1] == pytest.approx(255 * float(optics.sensor.tone[1].encode(0.3)), abs=0.6)
    assert UniformWorld(1.0, drift=LightDrift(0.1)).weights(0.0) == (1.0,)


def test_components_add_up_to_the_whole(tmp_path):
    """Two planes of weights 1 give the picture that one plane gives: image, veil and disc."""

    class Parts(DiscWorld):
        components = ("sky", "sun")
        disc = replace(DiscWorld.disc, component=1)

        def radiance(self, site, directions, pixel_rad=0.0, component=None):
            share = {None: 1.0, 0: 0.75, 1: 0.25}[component]
            return np.full(directions.shape, 2000 * share, dtype=np.float32)

    class Whole(Parts):
        components = ("light",)
        disc = DiscWorld.disc

        def radiance(self, site, directions, pixel_rad=0.0, component=None):
            return super().radiance(site, directions, pixel_rad)

    optics, exposure = replace(CANON_5D2, glare=0.05), Exposure(4, 200, 16.0)
    parts, whole = (
        picture_of(tmp_path, world, optics, exposure, weights=weights)
        for world, weights in ((Parts(), (1.0, 1.0)), (Whole(), (1.0,)))
    )
    assert np.abs(parts.astype(int) - whole).max() <= 1
    sunless = picture_of(tmp_path, Parts(), optics, exposure, weights=(4 / 3, 0.0))
    x, y = optics.lens.pixel_of(DiscWorld.disc.direction, SIZES["canon_5d2"])
    assert whole[int(y), int(x)].min() > 250
    assert sunless[int(y), int(x)].max() < 150


def test_same_seed_same_noise_other_seed_other_noise(tmp_path):
    exposure = Exposure(1 / 60, 100, 5.6)
    world = UniformWorld(300.0)
    one, again, other = (picture_of(tmp_path, world, THETA_Z1, exposure, seed=seed) for seed in (1, 1, 2))
    np.testing.assert_array_equal(one, again)
    assert not np.array_equal(one, other)


def test_mosaic_counts_lie_between_black_and_white(tmp_path):
    exposure = Exposure(1 / 60, 100, 5.6)
    size = SIZES["theta_z1"]
    sensor: Sensor = THETA_Z1.sensor
    full = 1 / sensor.exposure_gain(exposure)
    image: Path = write_image(tmp_path, UniformWorld(0.5 * full), THETA_Z1, size)
    counts = mosaic(PictureJob(THETA_Z1, size, image, exposure, (1.0,), 3), 2)
    assert counts.shape == (40, 80)
    # The middle of the first lens's picture
    counts = counts[12:28, 12:28]
    green = float(counts[0::2, 1::2].mean())
    red = float(counts[0::2, 0::2].mean())
    white = 2**14 - 1 - sensor.raw_black
    assert green == pytest.approx(sensor.raw_black + 0.5 * white, rel=0.06)
    assert red - sensor.raw_black == pytest.approx((green - sensor.raw_black) * sensor.native_balance[0], rel=0.06)


def test_both_cameras_are_plain_data():
    for optics in CAMERAS:
        assert optics.key == repr(optics)
        assert hash(optics) == hash(replace(optics))
    assert THETA_Z1.site is Site.INDOOR
    assert CANON_5D2.site is Site.OUTDOOR

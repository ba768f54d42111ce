"""Frames measured as an instrument maker would: do statistics alone give back what the optics were set to?

Written from the documented equations, with geometry, tables and constants of its own.
"""

import io
import itertools
import math
from dataclasses import replace
from fractions import Fraction
from functools import cache

import numpy as np
import pytest
from PIL import ExifTags, Image

from mocks.optics.camera import CANON_5D2, ND3_TINT, THETA_Z1, Filter
from mocks.optics.lenses import EquirectangularLens, EquisolidFisheye
from mocks.optics.picture_cache import PictureCache
from mocks.optics.picture_jobs import ImageJob, PictureJob, bands, finish_image, mosaic, render_band
from mocks.optics.picture_jobs import _signals as signals
from mocks.optics.pictures import RenderedShots
from mocks.optics.sensor import Exposure, ToneCurve
from mocks.worlds.light import UniformWorld, direction_of
from mocks.worlds.world import open_world
from tests.conftest import LONG
from tests.mocks.optics.test_pictures import request_for

CAMERAS = [THETA_Z1, CANON_5D2]
NAMES = [optics.name for optics in CAMERAS]
SIZES = {"theta_z1": (256, 128), "canon_5d2": (252, 168)}
TRUE_S = {
    4: 4,
    1: 1,
    1 / 4: 1 / 4,
    1 / 15: 1 / 16,
    1 / 60: 1 / 64,
    1 / 250: 1 / 256,
    1 / 1000: 1 / 1024,
    1 / 4000: 1 / 4096,
    1 / 8000: 1 / 8192,
}
"""True times of the nine nominal stops."""
BARE = Filter()
LUMINANCE = np.array([0.2127, 0.7151, 0.0722])


def plain(optics, **changes):
    """The camera without filter, glare and fall-off, but for ``changes``."""
    lens = replace(optics.lens, vignetting=())
    return replace(optics, **{"lens": lens, "filter": BARE, "glare": 0.0} | changes)


def rendered(folder, world, optics, size):
    path = folder / f"{optics.name}.image"
    path.write_bytes(b"")
    job = ImageJob(world, optics, size, path)
    finish_image(job, [render_band(job, rows) for rows in bands(size)])
    return path


def frames(folder, world, optics, exposure, seeds=(1,), size=None):
    """Frames before JPEG (n, height, width, 3), one for each seed."""
    size = size or SIZES[optics.name]
    image = rendered(folder, world, optics, size)
    jobs = [PictureJob(optics, size, image, exposure, (1.0,), seed) for seed in seeds]
    return np.stack([np.concatenate([optics.sensor.develop(s, exposure) for _, s in signals(job)]) for job in jobs])


def set_to(optics, shutter_s):
    return replace(optics.usual_settings, shutter_s=shutter_s)


def gain_of(optics, shutter_s):
    """Exposure (1 saturates) per cd/m2: t S / (120 N2)."""
    usual = optics.usual_settings
    return TRUE_S[shutter_s] * usual.iso / (120.0 * usual.f_number**2)


def axis_radius(optics, size):
    """Image height of each pixel's centre, 0 on the lens's axis, 1 at 90 degrees; NaN outside."""
    x, y = np.meshgrid(np.arange(size[0]) + 0.5, np.arange(size[1]) + 0.5)
    if optics.name == "canon_5d2":
        edge_px = math.sqrt(2) * 8.0 * size[0] / 36.0
        radius = np.hypot(x - size[0] / 2, y - size[1] / 2) / edge_px
        return np.where(radius <= 1, radius, np.nan)
    longitude, latitude = (x / size[0] - 0.5) * 2 * math.pi, (0.5 - y / size[1]) * math.pi
    off_axis = np.arccos(np.abs(np.cos(latitude) * np.cos(longitude)))
    return math.sqrt(2) * np.sin(off_axis / 2)


def falloff_of(optics, radius):
    """A pupil that turns with the angle, cut by the mount beyond a knee."""
    turn, knee_rad, loss = optics.lens.vignetting
    theta_rad = 2 * np.arcsin(radius / math.sqrt(2))
    return np.cos(turn * theta_rad) * (1 - loss * np.clip(theta_rad - knee_rad, 0, None) ** 2)


def pixel_weights(optics, size):
    """Relative solid angles of the pixels: equal in an equisolid picture, by latitude in a panorama."""
    if optics.name == "canon_5d2":
        return np.ones((size[1], size[0]))
    latitude = (0.5 - (np.arange(size[1]) + 0.5) / size[1]) * math.pi
    return np.repeat(np.cos(latitude)[:, None], size[0], axis=1)


@cache
def expected_value(curve: ToneCurve, full_well_e, read_noise_e, balance, exposure_value, iso):
    """Mean and standard deviation of an 8-bit value: Gauss over the noise, clipped and rounded."""
    signal = min(exposure_value * balance, 4.0)
    electrons = full_well_e * 100 / iso
    sigma = math.sqrt(signal / electrons + (read_noise_e / electrons) ** 2)
    z = np.linspace(-7, 7, 20001)
    weight = np.exp(-(z**2) / 2)
    weight /= weight.sum()
    linear = np.clip(np.minimum(signal + sigma * z, 1) / balance, 0, 1)
    value = np.rint(255 * curve.encode(linear))
    mean = float(weight @ value)
    return mean, math.sqrt(float(weight @ (value - mean) ** 2))


# --- the exposure equation ---


@pytest.mark.parametrize("optics", CAMERAS, ids=NAMES)
@pytest.mark.sweep
@pytest.mark.parametrize("shutter_s", TRUE_S if LONG else [4, 1 / 15, 1 / 250, 1 / 8000])
def test_uniform_100_gives_the_frames_of_the_exposure_equation(tmp_path, optics, shutter_s):
    """Six rings of each frame, each channel: the mean is the equation's, through fall-off, filter, veil, noise,
    clipping and tone curve, to 5 standard errors."""
    size = SIZES[optics.name]
    frame = frames(tmp_path, open_world("uniform:100"), optics, set_to(optics, shutter_s))[0].astype(float)
    radius = axis_radius(optics, size)
    field = np.isfinite(radius)
    tint = np.array(optics.filter.tint).sum(axis=0) * 10**-optics.filter.density
    falloff = falloff_of(optics, radius)
    mean_falloff = np.average(falloff[field], weights=pixel_weights(optics, size)[field])
    light = 100 * ((1 - optics.glare) * falloff + optics.glare * mean_falloff) * gain_of(optics, shutter_s)
    sensor, iso = optics.sensor, optics.usual_settings.iso
    for low in np.linspace(0, 1, 7)[:-1]:
        # A thin ring, so that its mean exposure stands for each pixel's.
        ring = (radius >= low) & (radius < low + 0.04)
        for channel in range(3):
            relative = round(float(light[ring].mean() * tint[channel]), 9)
            kind = (sensor.tone[channel], sensor.full_well_e, sensor.read_noise_e, sensor.native_balance[channel])
            mean, deviation = expected_value(*kind, relative, iso)
            error = deviation / math.sqrt(ring.sum())
            assert frame[ring][:, channel].mean() == pytest.approx(mean, abs=5 * error + 0.06)


@pytest.mark.parametrize("optics", CAMERAS, ids=NAMES)
def test_luminance_is_read_back_from_the_unclipped_stops(tmp_path, optics):
    """The inverse of the known curve gives 100 cd/m2 times the filter in the middle, to 1 %."""
    # Through the filter, 100 cd/m2 is all but black even in 4 s; ten thousand times more is not.
    world = open_world("uniform:100" if optics is THETA_Z1 else "uniform:1e5")
    read = 0
    for shutter_s in TRUE_S:
        exposure = set_to(optics, shutter_s)
        frame = frames(tmp_path, world, replace(optics, glare=0.0), exposure)[0]
        middle = frame[axis_radius(optics, SIZES[optics.name]) < 0.12]
        linear = np.stack([optics.sensor.tone[c].decode(middle[:, c] / 255) for c in range(3)]).mean(axis=1)
        if linear.min() < 0.02 or middle.max() == 255:
            continue
        luminance = float(linear @ LUMINANCE) / gain_of(optics, shutter_s)
        expected = world.luminance_cd_m2 * 10**-optics.filter.density
        assert luminance == pytest.approx(expected, rel=0.01)
        read += 1
    assert read >= 2


@pytest.mark.parametrize("optics", CAMERAS, ids=NAMES)
def test_jpegs_hold_the_same_means(tmp_path, optics):
    """What JPEG does to noise leaves the mean of an even field where it is, to one step (YCbCr in whole numbers)."""
    world = UniformWorld(200.0 if optics is THETA_Z1 else 3e5)
    exposure, size = set_to(optics, 1 / 60 if optics is THETA_Z1 else 1 / 4), SIZES[optics.name]
    shots = RenderedShots(world, optics, cache=PictureCache(tmp_path))
    request = request_for(optics, exposure.shutter_s, width_px=size[0], height_px=size[1])
    jpeg = np.asarray(Image.open(io.BytesIO(shots.jpeg(request))), dtype=float)
    before = frames(tmp_path, world, optics, exposure)[0]
    inner = axis_radius(optics, size) < 0.6
    assert 40 < before[inner].mean() < 220
    np.testing.assert_allclose(jpeg[inner].mean(axis=0), before[inner].mean(axis=0), atol=1.0)


# --- response, noise, fall-off: recovered by statistics ---


class Ramp(UniformWorld):
    """Grey, growing evenly with azimuth from 0 behind on the left to twice the mean behind on the right."""

    def radiance(self, site, directions, pixel_rad=0.0, component=None):
        azimuth = np.arctan2(directions[..., 0], directions[..., 1])
        return np.repeat(((azimuth / math.pi + 1) * self.luminance_cd_m2)[..., None], 3, -1).astype(np.float32)


def test_response_curves_are_recovered_from_noisy_frames(tmp_path):
    """Each channel's own curve, from the mean of 128 x 4 noisy values at each of 512 levels."""
    tone = (ToneCurve(2.2, 0.05, 0.1), ToneCurve(2.4, 0.06, 0.35), ToneCurve(2.0, 0.09, 0.6))
    optics = plain(THETA_Z1, sensor=replace(THETA_Z1.sensor, tone=tone))
    exposure = set_to(optics, 1 / 60)
    world = Ramp(0.5 / gain_of(optics, 1 / 60))
    seen = frames(tmp_path, world, optics, exposure, seeds=range(4), size=(512, 256)).mean(axis=(0, 1))
    level = (np.arange(512) + 0.5) / 512
    for channel in range(3):
        error = np.abs(seen[:, channel] - 255 * tone[channel].encode(level))[8:500]
        assert error.max() < 0.7
        assert np.median(error) < 0.15
    apart = [255 * np.abs(a.encode(level) - b.encode(level)).max() for a, b in itertools.pairwise(tone)]
    assert min(apart) > 10


@pytest.mark.parametrize("optics", CAMERAS, ids=NAMES)
@pytest.mark.sweep
@pytest.mark.parametrize("iso_steps", [4, 1] if LONG else [4])
def test_photon_transfer_gives_gain_and_read_noise(tmp_path, optics, iso_steps):
    """Half the variance of the difference of two raw frames against the mean: slope photon gain, floor read noise."""
    usual = replace(optics.usual_settings, iso=optics.usual_settings.iso * iso_steps, shutter_s=1 / 60)
    bare, sensor, size = plain(optics), optics.sensor, (512, 256)
    electrons = sensor.full_well_e * 100 / usual.iso
    counts_per_e = (2**sensor.raw_bits - 1 - sensor.raw_black) / electrons
    means, variances = [], []
    for share in (0.0, 0.02, 0.1, 0.3, 0.6, 0.85):
        world = UniformWorld(max(share / sensor.exposure_gain(usual), 1e-9))
        image = rendered(tmp_path, world, bare, size)
        jobs = [PictureJob(bare, size, image, usual, (1.0,), seed) for seed in (11, 12)]
        one, two = (mosaic(job, 1)[100:156, 200:312].astype(float) for job in jobs)
        for colour in (np.s_[::2, ::2], np.s_[::2, 1::2], np.s_[1::2, 1::2]):
            means.append(one[colour].mean() - sensor.raw_black)
            variances.append((one[colour] - two[colour]).var() / 2)
    weight = 1 / np.maximum(variances, 1)
    slope, floor = np.polyfit(means, variances, 1, w=weight)
    assert slope == pytest.approx(counts_per_e, rel=0.03)
    read_noise_e = math.sqrt(floor - 1 / 12) / counts_per_e
    assert read_noise_e == pytest.approx(sensor.read_noise_e, rel=0.06)


def test_eight_bits_round_evenly(tmp_path):
    """Without noise, values are off by at most half a step and by 1/12 in the mean square: nothing else is lost."""
    optics = plain(THETA_Z1)
    optics = replace(optics, sensor=replace(optics.sensor, full_well_e=1e12, read_noise_e=0.0))
    world = Ramp(0.5 / gain_of(optics, 1 / 60))
    row = frames(tmp_path, world, optics, set_to(optics, 1 / 60), size=(2048, 64))[0][32]
    level = (np.arange(2048) + 0.5) / 2048
    for channel in range(3):
        error = row[:, channel] - 255 * optics.sensor.tone[channel].encode(level)
        assert np.abs(error).max() < 0.53
        assert (error**2).mean() == pytest.approx(1 / 12, rel=0.05)


@pytest.mark.parametrize("optics", CAMERAS, ids=NAMES)
def test_noise_of_frames_is_photon_read_and_rounding(tmp_path, optics):
    """Variance between eight frames of other seeds: the tone curve's slope squared times the light's, plus rounding."""
    bare, shutter_s = plain(optics), 1 / 60
    seen = frames(tmp_path, UniformWorld(0.3 / gain_of(bare, shutter_s)), bare, set_to(bare, shutter_s), seeds=range(8))
    middle = axis_radius(optics, SIZES[optics.name]) < 0.5
    sensor, electrons = bare.sensor, bare.sensor.full_well_e * 100 / bare.usual_settings.iso
    for channel, curve in enumerate(sensor.tone):
        balance = sensor.native_balance[channel]
        sigma2 = (0.3 * balance / electrons + (sensor.read_noise_e / electrons) ** 2) / balance**2
        low, high = curve.encode([0.299, 0.301])
        expected = (255 * (high - low) / 0.002) ** 2 * sigma2 + 1 / 12
        assert seen[:, middle, channel].var(axis=0, ddof=1).mean() == pytest.approx(expected, rel=0.05)


@pytest.mark.parametrize("optics", CAMERAS, ids=NAMES)
@pytest.mark.parametrize("other", [False, True], ids=["as set", "another"])
def test_falloff_is_recovered_from_a_flat_field(tmp_path, optics, other):
    """Decoded values of an even field, in rings, over those of the middle: the lens's own, to 0.4 %."""
    if other:
        lens = replace(optics.lens, vignetting=(0.35, 0.6, 0.1))
        optics = replace(optics, lens=lens)
    optics = replace(optics, glare=0.0, filter=BARE)
    shutter_s, size = 1 / 60, SIZES[optics.name]
    world = UniformWorld(0.4 / gain_of(optics, shutter_s))
    seen = frames(tmp_path, world, optics, set_to(optics, shutter_s), seeds=range(6))
    linear = optics.sensor.tone[1].decode(seen[..., 1] / 255).mean(axis=0)
    radius = axis_radius(optics, size)
    # The outermost pixels are cut by the edge of the field.
    rings = [(radius >= low) & (radius < min(low + 0.05, 0.985)) for low in np.linspace(0, 0.95, 20)]
    profile = np.array([linear[ring].mean() for ring in rings if ring.any()])
    where = np.array([np.sqrt((radius[ring] ** 2).mean()) for ring in rings if ring.any()])
    np.testing.assert_allclose(profile / 0.4, falloff_of(optics, where), rtol=0.004)
    assert profile[-1] < 0.95 * profile[0]


# --- filter, glare, time ---


def read_rgb(folder, world, optics, shutter_s):
    """Mean linear light of the frame's middle, over time, speed and aperture."""
    frame = frames(folder, world, optics, set_to(optics, shutter_s), seeds=range(3))
    middle = frame[:, axis_radius(optics, SIZES[optics.name]) < 0.3]
    assert 5 < middle.mean() < 250
    linear = [optics.sensor.tone[c].decode(middle[..., c] / 255).mean() for c in range(3)]
    return np.array(linear) / gain_of(optics, shutter_s)


def test_density_and_tint_are_recovered_from_frames_with_and_without_filter(tmp_path):
    """White gives the density, three colours the whole matrix; long exposures through the filter, short ones bare."""
    with_filter, without = replace(CANON_5D2, glare=0.0), replace(CANON_5D2, glare=0.0, filter=BARE)
    colours = [(1.0, 1.0, 1.0), (1.0, 0.5, 0.5), (0.5, 1.0, 0.5), (0.5, 0.5, 1.0)]
    worlds = [UniformWorld(1.2e4, tint_rgb=colour) for colour in colours]
    bare = np.array([read_rgb(tmp_path, world, without, 1 / 250) for world in worlds])
    filtered = np.array([read_rgb(tmp_path, world, with_filter, 4) for world in worlds])
    density = -math.log10(float(filtered[0] @ LUMINANCE) / float(bare[0] @ LUMINANCE))
    assert density == pytest.approx(3.0, abs=0.004)
    matrix, *_ = np.linalg.lstsq(bare, filtered * 1e3, rcond=None)
    np.testing.assert_allclose(matrix, ND3_TINT, atol=0.02)


class BlackSpot(UniformWorld):
    """An even field with a black cap of 12 degrees about an axis: the target for veiling glare (ISO 9358)."""

    def radiance(self, site, directions, pixel_rad=0.0, component=None):
        axis = 2 if site.value == "outdoor" else 1
        black = directions[..., axis] > math.cos(math.radians(12))
        return np.where(black[..., None], 0, super().radiance(site, directions)).astype(np.float32)


@pytest.mark.parametrize("optics", CAMERAS, ids=NAMES)
@pytest.mark.parametrize("glare", [None, 0.02], ids=["as set", "2 %"])
def test_veiling_glare_is_recovered_from_a_black_spot(tmp_path, optics, glare):
    """Light in the black spot, read in a long exposure, over the field's mean light in a short one."""
    optics = plain(optics, glare=optics.glare if glare is None else glare)
    size = SIZES[optics.name]
    world = BlackSpot(0.5 / gain_of(optics, 1 / 250))
    long_s = 1 / 15 if glare else 1 / 4
    radius = axis_radius(optics, size)
    spot = radius < 0.1
    if optics.name == "theta_z1":  # the other fisheye's axis sees no spot
        spot[:, : size[0] // 4] = spot[:, -size[0] // 4 :] = False
    decode = optics.sensor.tone[1].decode
    dark, light = (
        decode(frames(tmp_path, world, optics, set_to(optics, stop))[0][..., 1] / 255) / gain_of(optics, stop)
        for stop in (long_s, 1 / 250)
    )
    weights = pixel_weights(optics, size) * np.isfinite(radius)
    recovered = dark[spot].mean() / np.average(light, weights=weights)
    assert 0.003 <= optics.glare <= 0.02
    assert recovered == pytest.approx(optics.glare, rel=0.02)


@pytest.mark.parametrize("longer", list(TRUE_S)[:-1], ids=lambda s: f"{Fraction(s).limit_denominator(9000)}")
@pytest.mark.parametrize("optics", CAMERAS, ids=NAMES)
def test_true_times_are_recovered_from_exposure_ratios(tmp_path, optics, longer):
    """Two neighbouring stops of one light: the ratio of their decoded means is that of powers of two, to 0.5 %."""
    stops = list(TRUE_S)
    shorter = stops[stops.index(longer) + 1]
    bare = plain(optics)
    world = UniformWorld(0.7 / gain_of(bare, longer))
    means = []
    for stop in (longer, shorter):
        seen = frames(tmp_path, world, bare, set_to(bare, stop))[0][..., 1]
        seen = seen[axis_radius(optics, SIZES[optics.name]) < 0.9]
        means.append(bare.sensor.tone[1].decode(seen / 255).mean())
    assert means[0] / means[1] == pytest.approx(TRUE_S[longer] / TRUE_S[shorter], rel=0.005)


def test_nominal_and_true_times_differ_measurably():
    """Where a marked time is no power of two, the step to its neighbour gives it away."""
    stops = list(TRUE_S)
    nominal = np.array([a / b for a, b in itertools.pairwise(stops)])
    true = np.array([TRUE_S[a] / TRUE_S[b] for a, b in itertools.pairwise(stops)])
    assert list(np.abs(nominal / true - 1) > 0.02) == [False, False, True, False, True, False, False, False]


# --- the file ---

ANNEX_K = [
    16,
    11,
    10,
    16,
    24,
    40,
    51,
    61,
    12,
    12,
    14,
    19,
    26,
    58,
    60,
    55,
    14,
    13,
    16,
    24,
    40,
    57,
    69,
    56,
    14,
    17,
    22,
    29,
    51,
    87,
    80,
    62,
    18,
    22,
    37,
    56,
    68,
    109,
    103,
    77,
    24,
    35,
    55,
    64,
    81,
    104,
    113,
    92,
    49,
    64,
    78,
    87,
    103,
    121,
    120,
    101,
    72,
    92,
    95,
    98,
    112,
    100,
    103,
    99,
]
"""Luminance table of the JPEG standard (ITU-T T.81, table K.1)."""


@pytest.mark.parametrize(
    ("optics", "quality"), [(THETA_Z1, 93), (CANON_5D2, 95), (replace(THETA_Z1, jpeg_quality=80), 80)]
)
def test_jpeg_quality_is_read_back_from_the_tables(tmp_path, optics, quality):
    """Above 50, a quality q scales the standard's table by (200 - 2 q) per cent."""
    shots = RenderedShots(UniformWorld(), optics, cache=PictureCache(tmp_path))
    tables = Image.open(io.BytesIO(shots.jpeg(request_for(optics)))).quantization
    expected = [min(max((value * (200 - 2 * quality) + 50) // 100, 1), 255) for value in ANNEX_K]
    assert sorted(tables[0]) == sorted(expected)
    assert optics.jpeg_quality == quality


@pytest.mark.parametrize("optics", CAMERAS, ids=NAMES)
def test_nine_files_state_nominal_times_and_settings(tmp_path, optics):
    """EXIF holds what is marked on the dial, not what the shutter did; and camera, speed, aperture and date."""
    shots = RenderedShots(UniformWorld(), optics, cache=PictureCache(tmp_path))
    base = ExifTags.Base
    for shutter_s in TRUE_S:
        request = request_for(optics, shutter_s)
        exif = Image.open(io.BytesIO(shots.jpeg(request))).getexif()
        detail = exif.get_ifd(ExifTags.IFD.Exif)
        assert Fraction(detail[base.ExposureTime]) == Fraction(shutter_s).limit_denominator(8000)
        assert detail[base.ISOSpeedRatings] == optics.usual_settings.iso
        assert float(detail[base.FNumber]) == optics.usual_settings.f_number
        assert detail[base.DateTimeOriginal] == "2023:05:19 15:54:07"
        assert exif[base.Model] == request.model


def test_lenses_are_data_that_can_be_read_back():
    """Field, turn and fall-off are parameters: a wider fisheye sees below the horizon."""
    lens = EquisolidFisheye(half_field_rad=math.radians(93))
    assert lens.pixel_of(direction_of(1.0, math.radians(-2)), (5616, 3744)) is not None
    assert EquisolidFisheye().pixel_of(direction_of(1.0, math.radians(-2)), (5616, 3744)) is None
    assert EquirectangularLens(yaw_rad=0.3) == replace(THETA_Z1.lens, yaw_rad=0.3)
    assert Exposure(1 / 60, 100, 5.6).shutter_s == 1 / 60

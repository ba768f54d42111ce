"""Lights that frames clip: beside something that moved, the shortest frame's bound; small ones in coded frames."""

from __future__ import annotations

import cv2
import numpy as np

from benchmarks.hostile.worlds import LENS_BLUR_PX, MATRIX_5D2, HostileCamera, jpeg_file
from benchmarks.photometry.synthetic_bracket import PAPER_TIMES_S, REFERENCE_SENSOR
from mocks.optics.sensor import Exposure
from processing.calibration.merge.merge import MergeOptions, merge
from processing.calibration.response.curve import NoiseModel, ResponseCurve
from processing.pictures.frames import array_frame, jpeg_frame
from processing.pictures.images import Validity, luminance_cd_m2
from processing.sphere import Equirectangular
from tests.processing.calibration.merge.merge_cases import NOISE, true_curve


def test_a_clipped_sun_among_ghosts_keeps_its_bound() -> None:
    rng = np.random.default_rng(5)
    frames = []
    for number, shutter_s in enumerate(PAPER_TIMES_S):
        radiance = np.full((96, 192, 3), 300.0, dtype=np.float32)
        left = 60 + 4 * (number % 3)
        radiance[30:60, left : left + 40] = 9000.0  # a cloud that moves behind the sun
        radiance[40:46, 80:86] = 5e6
        exposure = Exposure(shutter_s, 100, 5.6)
        frames.append(REFERENCE_SENSOR.develop(REFERENCE_SENSOR.mosaic_signal(radiance, exposure, rng), exposure))
    found = merge(
        [array_frame(f, str(i)) for i, f in enumerate(frames)],
        PAPER_TIMES_S,
        true_curve(),
        NOISE,
        geometry=Equirectangular(192, 96),
    ).image
    sun = (slice(41, 45), slice(81, 85))
    assert found.ghost is not None
    assert (found.ghost[30:60, 58:110] > 0).any(), "the cloud moved"
    assert (found.validity[sun] == Validity.CLIPPED).all()
    brightest = float(luminance_cd_m2(found.rgb).max())
    assert luminance_cd_m2(found.rgb[sun]).min() > 0.9 * brightest, "the shortest frame's bound"


def test_a_small_sun_in_a_makers_files_is_as_bright_as_the_shortest_frame_shows_it() -> None:
    """Two pixels wide: demosaicing, sharpening and half-size chroma draw its surround into it, in long frames."""
    scale = np.linspace(0, 1, 256)
    tone = np.stack([scale ** (1 / gamma) for gamma in (2.0, 2.2, 2.4)])
    maker = HostileCamera(
        scale, tone, matrix=MATRIX_5D2, mosaic=True, denoise=True, sharpen=0.4, jpeg=("pillow", 92, "4:2:0")
    )
    sky = np.geomspace(2e-5, 2e-2, 192)[None, :, None] * np.array((0.75, 1.0, 1.4)) * np.ones((96, 1, 1))
    radiance = sky.astype(np.float32)
    radiance[40:42, 41:43] = (0.9, 0.9, 0.45)
    radiance = cv2.GaussianBlur(radiance, (0, 0), LENS_BLUR_PX)
    frames = [maker.developed(radiance * np.float32(8000 * t), k, 0.0) for k, t in enumerate(PAPER_TIMES_S)]
    files = [jpeg_frame(jpeg_file(frame, maker.jpeg), str(k)) for k, frame in enumerate(frames)]
    log2 = np.log2(np.maximum(scale, 0.002)) * np.array([[2.0], [2.2], [2.4]])
    curve = ResponseCurve(log2, np.zeros((3, 256)), (3,) * 3, (252,) * 3)
    noise = NoiseModel((1 / 30000,) * 3, (6 / 30000,) * 3)
    view, bent = Equirectangular(192, 96), MergeOptions(allow_contradiction=True)
    found = merge(files, PAPER_TIMES_S, curve, noise, geometry=view, options=bent).image
    sun = (slice(37, 45), slice(38, 46))
    shown, true = (luminance_cd_m2(light[sun]).sum() for light in (found.rgb / 8000, radiance))
    assert abs(shown / true - 1) < 0.2


def test_a_deep_red_light_of_a_camera_that_mixes_its_channels_is_not_called_clipped() -> None:
    """In frames that show its blue, red is clipped, which voids blue there; in those that count blue is black."""
    scale = np.linspace(0, 1, 256)
    tone = np.stack([scale ** (1 / 2.2)] * 3)
    camera = HostileCamera(scale, tone, matrix=MATRIX_5D2)
    radiance = np.geomspace(2e-4, 0.5, 192)[None, :, None] * np.ones((96, 1, 3))
    radiance[30:60] *= (1.0, 0.1, 0.0015)
    radiance = radiance.astype(np.float32)
    frames = [camera.developed(radiance * np.float32(8000 * t), k, 0.0) for k, t in enumerate(PAPER_TIMES_S)]
    log2 = np.tile(2.2 * np.log2(np.maximum(scale, 0.002)), (3, 1))
    curve = ResponseCurve(log2, np.zeros((3, 256)), (8,) * 3, (252,) * 3, clip_together=True)
    noise = NoiseModel((1 / 30000,) * 3, (6 / 30000,) * 3)
    view, bent = Equirectangular(192, 96), MergeOptions(allow_contradiction=True)
    sources = [array_frame(frame, str(k)) for k, frame in enumerate(frames)]
    found = merge(sources, PAPER_TIMES_S, curve, noise, geometry=view, options=bent).image
    lamp = (slice(32, 58), slice(4, 180))
    assert (found.validity[lamp] == Validity.VALID).mean() > 0.99
    shown, true = luminance_cd_m2(found.rgb[lamp] / 8000), luminance_cd_m2(radiance[lamp])
    assert np.quantile(np.abs(shown / true - 1), 0.9) < 0.1


def test_frames_that_are_white_many_times_over_leave_no_coloured_specks_along_what_is_bright() -> None:
    """Beside clipped channels coding leaves codes of 225 to 250 in them, where the pixel is ten times as bright."""
    scale = np.linspace(0, 1, 256)
    maker = HostileCamera(scale, np.stack([scale ** (1 / 2.2)] * 3), jpeg=("pillow", 92, "4:2:0"))
    rng = np.random.default_rng(2)
    row, column = np.indices((96, 192))
    stripes = ((row + 0.4 * column) % 40 < 14)[..., None] * rng.uniform(0.7, 1.3, (96, 192, 1))
    patch = stripes * np.array((0.02, 0.013, 0.006))
    radiance = np.maximum(cv2.GaussianBlur(patch, (0, 0), LENS_BLUR_PX), 0.0008).astype(np.float32)
    frames = [maker.developed(radiance * np.float32(8000 * t), k, 0.0) for k, t in enumerate(PAPER_TIMES_S)]
    files = [jpeg_frame(jpeg_file(frame, maker.jpeg), str(k)) for k, frame in enumerate(frames)]
    log2 = np.log2(np.maximum(scale, 0.002)) * 2.2 * np.ones((3, 1))
    curve = ResponseCurve(log2, np.zeros((3, 256)), (3,) * 3, (252,) * 3)
    noise = NoiseModel((1 / 30000,) * 3, (6 / 30000,) * 3, (1.0, 1.0, 1.0))
    found = merge(files, PAPER_TIMES_S, curve, noise, geometry=Equirectangular(192, 96)).image
    colour, true = (np.log2(rgb / rgb.sum(axis=2, keepdims=True)) for rgb in (found.rgb, radiance))
    bright = radiance[..., 0] > 0.012
    assert (np.abs(colour - true).max(axis=2) > 0.7)[bright].mean() < 1e-3

"""Numbers at the ends of what can be given: a right result or a typed error, never NaN and never another exception."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from processing.calibration.merge.tables import frame_consistency, merge_tables
from processing.calibration.outdoor.nd_filter import fit_nd_filter
from processing.calibration.response.linear import fit_linear
from processing.calibration.response.response import recover_response
from processing.calibration.response.samples import Bracket8
from processing.calibration.scale.photometry import illuminance_lx
from processing.calibration.scale.veiling_glare import bound_from_darkest
from processing.errors import BracketError, LensError, ParameterError, ResponseError
from processing.figures.figures import eye_view
from processing.pictures.images import LuminanceImage
from processing.sphere import Equirectangular
from tests.processing.calibration.merge.merge_cases import NOISE, bracket, merged, true_curve


@pytest.mark.parametrize("time_s", [1e300, 1e-320, 1e-9, 1e6, float("nan")])
def test_times_no_shutter_has_are_refused(time_s: float) -> None:
    made = bracket()
    times = [*made.true_s[:-1], time_s]
    with pytest.raises(ParameterError):
        merged(made.frames, times)
    linear = [frame.astype(np.uint16) * 257 for frame in made.frames]
    with pytest.raises(ParameterError):
        merged(linear, times)
    with pytest.raises(BracketError):
        recover_response([Bracket8(made.frames, times)])


@pytest.mark.parametrize("value", [float("nan"), float("inf"), -1.0])
@pytest.mark.parametrize("part", ["photon", "read", "code_variance"])
def test_noise_that_cannot_be_is_refused(part: str, value: float) -> None:
    with pytest.raises(ParameterError):
        replace(NOISE, **{part: (value, 1e-4, 1e-4)})


@pytest.mark.parametrize("value", [float("nan"), float("inf"), -1.0, 0.5, 2.0])
def test_a_black_level_that_cannot_be_is_refused(value: float) -> None:
    with pytest.raises(ParameterError, match="black level"):
        replace(NOISE, black=(0.01, value, 0.01))
    assert replace(NOISE, black=(-1e-4, 0.03, 0.0)).black == (-1e-4, 0.03, 0.0)


@pytest.mark.parametrize("time_s", [0.0, -1.0, float("nan"), float("inf")])
@pytest.mark.parametrize("place", [0, 2])
def test_linear_frames_of_times_that_cannot_be_are_refused(place: int, time_s: float) -> None:
    light = np.random.default_rng(2).uniform(0, 60_000, (60, 90, 3))
    times_s = [1.0, 0.25, 0.0625]
    frames = [(light * t + 512).astype(np.uint16) for t in times_s]
    times_s[place] = time_s
    with pytest.raises(ParameterError, match="a time above 0 s each"):
        fit_linear(frames, times_s)
    with pytest.raises(ParameterError, match="a time above 0 s each"):
        fit_linear(frames, times_s[:2])


def test_no_linear_frame_is_refused_and_so_are_frames_that_are_bright_where_the_longer_is_dark() -> None:
    with pytest.raises(ParameterError, match="0 frames"):
        fit_linear([], [])
    light = np.random.default_rng(2).uniform(0, 60_000, (60, 90, 3))
    turned_on = [np.where(light < 10_000, 100 if t == 1 else 60_000, light * t).astype(np.uint16) for t in (1, 0.25)]
    with pytest.raises(ResponseError, match="same light"):
        fit_linear(turned_on, (1.0, 0.25))


@pytest.mark.parametrize("value", [float("nan"), float("inf"), -1.0])
def test_a_curve_whose_uncertainty_cannot_be_is_refused(value: float) -> None:
    curve = true_curve()
    sigma = curve.sigma_log2.copy()
    sigma[1, 100] = value
    with pytest.raises(ParameterError):
        merged(bracket().frames, bracket().true_s, replace(curve, sigma_log2=sigma))


def test_frames_without_pixels_and_threads_below_one_are_refused() -> None:
    with pytest.raises(BracketError):
        recover_response([Bracket8([np.zeros((0, 0, 3), np.uint8)] * 3, (1.0, 0.5, 0.25))])
    with pytest.raises(ParameterError):
        merged(bracket().frames, bracket().true_s, workers=-1)


def test_one_time_for_all_frames_is_refused() -> None:
    with pytest.raises(ResponseError, match="one exposure time"):
        recover_response([Bracket8(bracket().frames, [0.1] * 9)])


@pytest.mark.parametrize("code", [0, 512, 65535])
def test_linear_frames_without_light_or_all_of_it_are_refused(code: int) -> None:
    with pytest.raises(ResponseError):
        fit_linear([np.full((40, 60, 3), code, np.uint16)] * 3, (1.0, 0.25, 0.0625))


@pytest.mark.parametrize("times_s", [(1.0,), (1.0, 1.0, 1.0), (1.0, 0.25, 0.0625)])
def test_linear_frames_of_few_or_equal_times_give_finite_numbers_or_an_error(times_s: tuple[float, ...]) -> None:
    light = np.random.default_rng(2).uniform(0, 60_000, (60, 90, 3))
    frames = [(light * t / times_s[0] + 512).astype(np.uint16) for t in times_s]
    if len(times_s) == 1:
        with pytest.raises(ResponseError):
            fit_linear(frames, times_s)
        return
    fit = fit_linear(frames, times_s, 0.0)
    assert np.isfinite([*fit.times_s, *fit.time_sigma, *fit.noise.photon, *fit.noise.read, *fit.noise.black]).all()
    if times_s[1] != times_s[0]:
        assert np.array(fit.noise.black) * 65535 == pytest.approx(512, abs=1)
        assert fit.times_s == pytest.approx(times_s, rel=1e-3)


@pytest.mark.parametrize("patches", [np.full((24, 3), 0.5), np.full((24, 3), 1e30), np.full((24, 3), 1e308)])
def test_patches_that_fit_no_filter_are_refused(patches: np.ndarray) -> None:
    with pytest.raises(LensError):
        fit_nd_filter(patches * 1e-3, patches)


@pytest.mark.parametrize("value", [float("nan"), float("inf"), -5.0])
def test_pictures_of_impossible_light_give_no_figure(value: float) -> None:
    rgb = np.full((32, 64, 3), value, np.float32)
    ones = np.full((32, 64), 0.01, np.float32)
    image = LuminanceImage(rgb, ones, np.zeros((32, 64), np.uint8), Equirectangular(64, 32), 0.0)
    for figure in (illuminance_lx, bound_from_darkest, lambda one: eye_view(one, 0.0, 16)):
        with pytest.raises(ParameterError):
            figure(image)


def test_two_all_but_white_frames_set_no_offset() -> None:
    rng = np.random.default_rng(5)
    curve = true_curve()
    # White but for a few pixels, whose codes at the top a scene's tone mapping has bent by half a stop.
    codes = rng.integers(241, 247, (180, 360, 1)).repeat(3, axis=2)
    shorter = np.stack(
        [np.interp(row[codes[..., c]] - 1.5, row, range(256)) for c, row in enumerate(curve.log2_exposure)]
    )
    frames = [codes.astype(np.uint8), np.moveaxis(np.rint(shorter), 0, -1).astype(np.uint8)]
    for frame in frames:
        frame[:150] = 255
    tables = merge_tables(curve, NOISE, np.array([4.0, 1.0]), np.zeros(2), 0.0)
    assert frame_consistency(frames, tables).offset.tolist() == [0.0, 0.0]

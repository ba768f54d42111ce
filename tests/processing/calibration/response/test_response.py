"""Response curves against the simulated camera's own tone curves."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest

from mocks.optics.sensor import TrueShutter
from processing.calibration.response.bracket_fit import support
from processing.calibration.response.response import recover_response, residuals_by_code
from processing.calibration.response.samples import Bracket8, take_samples
from processing.errors import BracketError, ResponseError
from tests.conftest import LONG
from tests.processing.calibration.response.response_cases import (
    TIMES_S,
    bracket,
    errors,
    fitted,
    is_sound,
    made,
    rms,
    truth,
)


def test_curve_is_right_to_a_few_thousandths_of_a_stop() -> None:
    fit = fitted()
    assert is_sound(fit)
    assert rms(fit.curve) < 0.005
    assert fit.warnings == ()
    assert min(fit.curve.high) > 240
    assert max(fit.curve.low) < 6


def test_exposure_1_is_white_so_that_channels_are_in_balance() -> None:
    curve = fitted().curve
    assert np.allclose(curve.log2_exposure[:, 255], 0)
    balance = (curve.log2_exposure - truth())[:, 20:236].mean(axis=1)
    assert np.ptp(balance) < 0.03


def test_stated_uncertainty_covers_the_error() -> None:
    shares = []
    for seed in (31, 32):
        curve = fitted(seed).curve
        error = curve.log2_exposure - truth()
        error -= error[:, curve.sigma_code][:, None]
        z = np.abs(error / np.maximum(curve.sigma_log2, 1e-12))[:, 5:251]
        shares.append([(z < 1).mean(), (z < 2).mean()])
    one, two = np.mean(shares, axis=0)
    assert one > 0.6
    assert two > 0.9


@pytest.mark.sweep
@pytest.mark.usefixtures("few_patches")
def test_a_shutter_is_as_sure_as_the_frames_show_it() -> None:
    shot = bracket(31)
    times = np.array(shot.times_s) * 2 ** np.random.default_rng(800_004).normal(0, 0.05, len(shot.times_s))
    assert fitted(31).scatter_stops < 0.012
    assert 0.02 < recover_response([Bracket8(shot.frames, times.tolist())]).scatter_stops < 0.1


@pytest.mark.long
def test_two_brackets_agree_and_together_are_no_worse() -> None:
    first, second = (fitted(seed).curve for seed in (31, 32))
    difference = first.log2_exposure - second.log2_exposure
    difference -= difference[:, 128][:, None]
    z = np.abs(difference / np.maximum(np.hypot(first.sigma_log2, second.sigma_log2), 1e-12))[:, 5:251]
    assert (z < 2).mean() > 0.9
    both = recover_response([bracket(31), bracket(32)])
    assert len(both.times_s) == 18
    assert rms(both.curve) < 0.005


@pytest.mark.long
def test_same_input_same_curve() -> None:
    first, second = fitted(), recover_response([bracket()])
    assert np.array_equal(first.curve.log2_exposure, second.curve.log2_exposure)
    assert first.noise == second.noise


def test_order_and_repetition_of_frames_change_nothing() -> None:
    plain = fitted()
    twice = recover_response([bracket(frames=(3, 0, 8, 1, 7, 2, 6, 5, 4, 2, 3))])
    assert np.abs(plain.curve.log2_exposure - twice.curve.log2_exposure).max() < 1e-6
    assert len(twice.warnings) == 2
    assert "frame 9 is the same picture" in twice.warnings[0]


@pytest.mark.sweep
@pytest.mark.parametrize("frames", [(3, 4, 5), (0, 2, 4, 6, 8), (7, 8)] if LONG else [(3, 4, 5)])
@pytest.mark.usefixtures("few_patches")
def test_missing_stops_cost_little(frames: tuple[int, ...]) -> None:
    fit = recover_response([bracket(frames=frames)])
    assert is_sound(fit)
    assert rms(fit.curve, max(fit.curve.low), min(fit.curve.high)) < 0.03


@pytest.mark.long
def test_ten_times_the_noise_is_stated() -> None:
    source = made(33, noise=10.0)
    curve = recover_response([Bracket8(source.frames, source.true_s)]).curve
    error = curve.log2_exposure - truth()
    error -= error[:, 128][:, None]
    z = np.abs(error / np.maximum(curve.sigma_log2, 1e-12))[:, 20:236]
    assert (z < 2).mean() > 0.8


@pytest.mark.sweep
@pytest.mark.usefixtures("few_patches")
def test_moved_pixels_and_blocks_are_left_out() -> None:
    rng = np.random.default_rng(1)
    frames = [frame.copy() for frame in made().frames]
    for j, frame in enumerate(frames):
        moved = rng.random(frame.shape[:2]) < 0.01
        frame[moved] = rng.integers(0, 256, (int(moved.sum()), 3))
        y, x = (j // 3) * 90, (j % 3) * 300
        frame[y : y + 60, x : x + 120] = made().frames[8 - j][y : y + 60, x : x + 120]
    fit = recover_response([Bracket8(frames, made().true_s)])
    assert rms(fit.curve) < 0.02


@pytest.mark.sweep
@pytest.mark.parametrize(("frame", "factor"), [(0, 0.5), (4, 1.26), (8, 0.5)] if LONG else [(4, 1.26)])
@pytest.mark.usefixtures("few_patches")
def test_a_wrong_time_is_named_and_put_right(frame: int, factor: float) -> None:
    times = list(made().true_s)
    times[frame] *= factor
    names = [f"{k}.jpg" for k in range(9)]
    fit = recover_response([Bracket8(made().frames, times, names=names)])
    assert list(fit.wrong_times) == [frame]
    assert fit.warnings[0].startswith(f"{frame}.jpg: its time")
    assert fit.times_s[frame] == pytest.approx(made().true_s[frame], rel=0.01)
    assert rms(fit.curve) < 0.006


@pytest.mark.long
def test_one_wrong_time_is_an_entry_though_times_are_estimated() -> None:
    times = np.array(made().true_s)
    one = times * np.where(np.arange(9) == 3, 2**0.4, 1)
    fit = recover_response([Bracket8(made().frames, tuple(one))], estimate_times=True)
    assert list(fit.wrong_times) == [3]
    assert np.log2(np.array(fit.times_s) / times) == pytest.approx(np.zeros(9), abs=0.02)


@pytest.mark.sweep
@pytest.mark.usefixtures("few_patches")
def test_several_wrong_times_are_a_shutter_that_scatters() -> None:
    times = np.array(made().true_s)
    scattered = times * np.exp2([0.15, -0.2, 0.25, -0.3, 0.1, 0.3, -0.25, 0.2, -0.15])
    fit = recover_response([Bracket8(made().frames, tuple(scattered))], estimate_times=True)
    left = np.log2(np.array(fit.times_s) / times)
    assert left - np.median(left) == pytest.approx(np.zeros(9), abs=0.12)
    assert rms(fit.curve) < 0.06
    assert any("the shutter scatters" in warning for warning in fit.warnings)
    assert min(np.abs(fit.time_sigma)) == 0
    assert max(fit.time_sigma) > 0.01


@pytest.mark.sweep
@pytest.mark.usefixtures("few_patches")
def test_true_times_behind_nominal_ones_are_found() -> None:
    source = made(34, TrueShutter.THIRDS_OF_STOPS)
    nominal = Bracket8(source.frames, source.nominal_s)
    fit = recover_response([nominal], estimate_times=True)
    assert np.allclose(fit.times_s, source.true_s, rtol=2e-3)
    assert rms(fit.curve) < 0.006
    as_given = recover_response([nominal])
    assert as_given.times_s == pytest.approx(source.nominal_s)
    assert any("'thirds'" in warning for warning in as_given.warnings)


@pytest.mark.long
def test_nominal_times_that_are_true_stay() -> None:
    fit = recover_response([bracket()], estimate_times=True)
    assert fit.times_s == pytest.approx(TIMES_S, rel=1e-9)


EVEN = [np.full((60, 80, 3), code, dtype=np.uint8) for code in (220, 120, 60, 30)]


NO_CURVE: dict[str, Callable[[], tuple[list[np.ndarray], tuple[float, ...]]]] = {
    "white": lambda: ([np.full((60, 80, 3), 255, dtype=np.uint8)] * 3, (1.0, 0.25, 0.0625)),
    "black": lambda: ([np.zeros((60, 80, 3), dtype=np.uint8)] * 3, (1.0, 0.25, 0.0625)),
    "one frame": lambda: (EVEN[:1], (1.0,)),
    "even": lambda: (EVEN, (1.0, 0.25, 0.0625, 1 / 64)),
    "one picture": lambda: ([EVEN[1]] * 3, (1.0, 0.25, 0.0625)),
    "one time": lambda: ([EVEN[1]] * 3, (1.0, 1.0, 1.0)),
    "one pixel": lambda: ([frame[:1, :1] for frame in EVEN], (1.0, 0.25, 0.0625, 1 / 64)),
    "reversed": lambda: (list(made().frames), tuple(reversed(made().true_s))),
    "far apart": lambda: ([made().frames[j] for j in (0, 4, 8)], tuple(made().true_s[j] for j in (0, 4, 8))),
}
"""Made when they are asked for: every worker collects this file, one runs it."""


@pytest.mark.parametrize("case", NO_CURVE)
def test_what_cannot_determine_a_curve_is_refused(case: str) -> None:
    frames, times = NO_CURVE[case]()
    with pytest.raises(ResponseError) as caught:
        recover_response([Bracket8(frames, times)])
    assert caught.value.advice


def test_what_is_no_bracket_is_refused() -> None:
    good = made().frames
    for bad in (
        Bracket8([], []),
        Bracket8(good[:2], (1.0,)),
        Bracket8([good[0], good[1][:50]], (1.0, 0.5)),
        Bracket8(good[:2], (1.0, float("nan"))),
        Bracket8(good[:2], (1.0, 0.0)),
        Bracket8([frame.astype(np.uint16) for frame in good[:2]], (1.0, 0.5)),
    ):
        with pytest.raises(BracketError):
            recover_response([bad])
    with pytest.raises(BracketError):
        recover_response([])


def test_residuals_show_a_wrong_curve() -> None:
    fit = fitted()
    samples = take_samples([bracket()])
    right = residuals_by_code(samples, fit.curve)
    seen = right.count > 30
    assert np.abs(right.mean_stops[seen]).max() < 0.04
    bent = fit.curve.log2_exposure + 0.1 * np.sin(np.arange(256) / 12)
    rising = np.maximum.accumulate(bent, axis=1) + np.arange(256) * 1e-6
    wrong = residuals_by_code(samples, type(fit.curve)(rising, fit.curve.sigma_log2, fit.curve.low, fit.curve.high))
    assert np.abs(wrong.mean_stops[seen]).max() > 0.05
    assert np.isfinite(wrong.mean_stops).all()


def test_error_helper_sees_an_error() -> None:
    curve = fitted().curve
    assert np.abs(errors(curve)).max() < 0.05


def test_few_codes_are_enough_for_a_curve_and_very_few_are_not() -> None:
    def every_patch_near(codes: int) -> np.ndarray:
        return np.repeat(60.0 + np.arange(codes), 5)

    assert support(every_patch_near(30), "blue") == (58, 91)
    with pytest.raises(ResponseError, match="only 19 different codes"):
        support(every_patch_near(15), "blue")

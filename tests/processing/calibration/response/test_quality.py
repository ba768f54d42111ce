"""The check of a session's bracket against the profile's curve, and the ends of the fit."""

from __future__ import annotations

from dataclasses import replace
from functools import lru_cache

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from benchmarks.photometry.synthetic_bracket import REFERENCE_SENSOR, synthetic_bracket
from mocks.optics.sensor import ToneCurve
from processing.calibration.response.response import ResponseFit, check_response, recover_response
from processing.calibration.response.samples import Bracket8
from processing.errors import BracketError, ResponseError
from tests.processing.calibration.response.response_cases import SIZE, bracket, fitted, is_sound, made


@lru_cache(maxsize=1)
def profile() -> ResponseFit:
    return fitted(31)


def test_the_same_camera_has_not_drifted() -> None:
    check = check_response(profile().curve, profile().noise, bracket(32))
    assert not check.drifted
    assert check.drift_stops < 0.02
    assert check.warnings == ()
    assert check.noise_ratio == pytest.approx(1.0, abs=0.2)


def test_small_decode_will_do() -> None:
    small = [frame[::4, ::4].copy() for frame in made(32).frames]
    check = check_response(profile().curve, profile().noise, Bracket8(small, made(32).true_s))
    assert not check.drifted


def test_another_tone_curve_has_drifted_by_a_stated_size() -> None:
    tone = tuple(ToneCurve(contrast=0.6) for _ in range(3))
    other = synthetic_bracket(SIZE, 36, sensor=replace(REFERENCE_SENSOR, tone=(tone[0], tone[1], tone[2])))
    check = check_response(profile().curve, profile().noise, Bracket8(other.frames, other.true_s))
    assert check.drifted
    assert check.drift_stops > 0.03
    assert "drifted by" in check.warnings[0]


def test_frames_without_information_are_refused() -> None:
    black = np.zeros((60, 60, 3), dtype=np.uint8)
    with pytest.raises(ResponseError):
        check_response(profile().curve, profile().noise, Bracket8([black, black], (1.0, 0.25)))


@given(
    seed=st.integers(0, 2**16),
    count=st.integers(1, 5),
    height=st.integers(1, 70),
    width=st.integers(1, 70),
    kind=st.sampled_from(["random", "steps", "real", "two"]),
)
@settings(max_examples=25, deadline=None)
def test_any_frames_give_a_sound_curve_or_a_named_refusal(
    seed: int, count: int, height: int, width: int, kind: str
) -> None:
    rng = np.random.default_rng(seed)
    times = np.exp2(rng.uniform(-12, 2, count))
    light = np.exp2(rng.uniform(-8, 8, (height, width, 3)))
    frames = {
        "random": lambda _: rng.integers(0, 256, (height, width, 3)),
        "steps": lambda t: np.clip(255 * (light * t) ** 0.45, 0, 255),
        "two": lambda _: rng.choice([0, 255], (height, width, 3)),
        "real": lambda t: made(31).frames[int(np.argmin(np.abs(np.array(made(31).true_s) - t)))][:height, :width],
    }[kind]
    try:
        fit = recover_response([Bracket8([np.asarray(frames(t)).astype(np.uint8) for t in times], list(times))])
    except (ResponseError, BracketError):
        return
    assert is_sound(fit)

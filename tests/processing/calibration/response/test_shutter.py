"""Shutter rules: the powers of two behind dial times, and choosing among rules by evidence."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from processing.calibration.response.shutter import (
    ShutterRule,
    TimeEvidence,
    camera_rule,
    estimate_times,
    find_wrong_time,
    refine_times,
    true_time_s,
)
from processing.errors import ParameterError

NOMINAL = (4.0, 1.0, 1 / 4, 1 / 15, 1 / 60, 1 / 250, 1 / 1000)


def evidence(
    true_log2: np.ndarray, given_log2: np.ndarray, weight: float = 1e6, *, curve: bool = False
) -> TimeEvidence:
    """Frames whose neighbours are compared with the precision ``weight``; behind a ``curve`` times' slope hides."""
    count = len(true_log2)
    step = np.diff(np.eye(count), axis=0)
    matrix = weight * step.T @ step
    if curve:
        slope = matrix @ (given_log2 - given_log2.mean())
        matrix -= np.outer(slope, slope) / (slope @ (given_log2 - given_log2.mean()))
    return TimeEvidence(matrix, matrix @ (true_log2 - given_log2), np.zeros(count, dtype=np.int64))


@pytest.mark.parametrize(
    ("nominal", "true"),
    [
        (1 / 60, 1 / 64),
        (13.0, 2 ** (11 / 3)),
        (3.2, 2 ** (5 / 3)),
        (1 / 4000, 1 / 4096),
        (1 / 15, 1 / 16),
        (0.8, 2 ** -(1 / 3)),
    ],
)
def test_thirds(nominal: float, true: float) -> None:
    assert true_time_s(nominal, ShutterRule.THIRDS) == pytest.approx(true, rel=1e-12)
    assert true_time_s(nominal, ShutterRule.NOMINAL) == nominal


@pytest.mark.parametrize("nominal", [31.0, 45.0, 60.0, 90.0, 120.0])
def test_times_that_no_dial_has_are_as_counted(nominal: float) -> None:
    assert all(true_time_s(nominal, rule) == nominal for rule in ShutterRule)
    assert true_time_s(30.0, ShutterRule.THIRDS) == 32.0


def test_halves_and_cameras() -> None:
    assert true_time_s(1 / 45, ShutterRule.HALVES) == pytest.approx(2**-5.5)
    assert camera_rule("canon eos 5d mark II ") is ShutterRule.THIRDS
    assert camera_rule("another camera") is None


@given(st.floats(1e-6, 1e4))
@settings(max_examples=40)
def test_true_time_is_near_and_stays(time_s: float) -> None:
    for rule, most in ((ShutterRule.THIRDS, 1 / 6), (ShutterRule.HALVES, 1 / 4)):
        true = true_time_s(time_s, rule)
        assert abs(np.log2(true / time_s)) <= most + 1e-9
        assert true_time_s(true, rule) == pytest.approx(true, rel=1e-12)


@pytest.mark.parametrize("bad", [0.0, -1.0, float("nan"), float("inf")])
def test_no_time(bad: float) -> None:
    with pytest.raises(ParameterError):
        true_time_s(bad, ShutterRule.THIRDS)


def test_the_rule_is_chosen_by_evidence() -> None:
    given_log2 = np.log2(NOMINAL)
    for rule in (ShutterRule.NOMINAL, ShutterRule.THIRDS):
        true = np.log2([true_time_s(t, rule) for t in NOMINAL])
        found = estimate_times(evidence(true, given_log2), NOMINAL)
        assert found.rule is rule
        assert found.decided
        assert not found.off_rule
        assert found.times_s == pytest.approx(tuple(np.exp2(true)))
        assert all(0 <= s < 0.01 for s in found.sigma)


def test_without_evidence_the_rule_asked_for_stays() -> None:
    count = len(NOMINAL)
    nothing = TimeEvidence(np.zeros((count, count)), np.zeros(count), np.zeros(count, dtype=np.int64))
    for prior in (ShutterRule.NOMINAL, ShutterRule.THIRDS):
        found = estimate_times(nothing, NOMINAL, prior=prior)
        assert found.rule is prior
        assert not found.decided
        assert not found.off_rule
        assert np.isfinite(found.sigma).all()


def test_a_shutter_clearly_off_its_rule_is_followed_for_the_most_part() -> None:
    """Frames determine times but for a common slope, which a shutter's tolerance shares out among all frames."""
    given_log2 = np.log2(NOMINAL)
    off = np.zeros(len(NOMINAL))
    off[[1, 5]] = 0.2, -0.2
    found = estimate_times(evidence(given_log2 + off, given_log2, curve=True), NOMINAL)
    assert found.off_rule
    moved = np.log2(np.array(found.times_s) / NOMINAL)
    assert (moved[[1, 5]] / off[[1, 5]] > 0.6).all()
    assert moved[1] - moved[0] == pytest.approx(0.2, abs=0.03)


@pytest.mark.parametrize("middle", [0.0, 0.5])
def test_a_shutter_that_scatters_is_estimated_whichever_frame_is_off_most(middle: float) -> None:
    given_log2 = np.log2(NOMINAL)
    off = np.array([0.1, -0.2, 0.15, middle, -0.1, 0.2, -0.15])
    # What frames leave open, a common slope, is not asked for.
    slope = given_log2 - given_log2.mean()
    off -= slope * (off @ slope) / (slope @ slope)
    found = estimate_times(evidence(given_log2 + off, given_log2, curve=True), NOMINAL)
    assert found.off_rule
    left = np.log2(np.array(found.times_s) / NOMINAL) - off
    assert left - left[3] == pytest.approx(np.zeros(len(NOMINAL)), abs=0.03)
    assert 0.01 < max(found.sigma) < 0.15


def test_three_frames_show_no_scatter() -> None:
    given_log2 = np.log2(NOMINAL)
    full = evidence(given_log2 + np.array([0.1, -0.2, 0.3, 0, -0.3, 0.2, -0.1]), given_log2, curve=True)
    assert estimate_times(full, NOMINAL).off_rule
    silent = np.arange(len(NOMINAL)) >= 3
    full.matrix[silent], full.matrix[:, silent], full.right[silent] = 0, 0, 0
    assert not estimate_times(full, NOMINAL).off_rule


@pytest.mark.parametrize("frame", [1, 2, 4])
def test_one_wrong_time_is_no_scatter_of_the_shutter(frame: int) -> None:
    given_log2 = np.log2(NOMINAL)
    wrong = given_log2 + 0.5 * (np.arange(len(NOMINAL)) == frame)
    assert not estimate_times(evidence(wrong, given_log2, curve=True), NOMINAL).off_rule


def test_a_frame_that_shows_nothing_does_not_make_up_for_all_the_others_stretch() -> None:
    """A curve's prior pulls at the slope that frames do not show; the times given hold it."""
    given_log2 = np.log2(NOMINAL)
    stretched = 0.02 * (given_log2 - given_log2[3])
    result = evidence(given_log2 + stretched, given_log2)
    for part in (result.matrix, result.right):
        part[0] = 0.0
    result.matrix[:, 0] = 0.0
    found = estimate_times(result, NOMINAL)
    assert np.abs(np.log2(np.array(found.times_s) / NOMINAL)).max() < 0.02


def test_a_small_change_is_doubt_and_no_other_time() -> None:
    given_log2 = np.log2(NOMINAL)
    off = np.zeros(len(NOMINAL))
    off[[1, 5]] = 0.03, -0.03
    found = estimate_times(evidence(given_log2 + off, given_log2), NOMINAL)
    assert not found.off_rule
    assert found.times_s == pytest.approx(NOMINAL)
    assert min(found.sigma[1], found.sigma[5]) > 0.01


def test_a_wrong_time_is_found_and_small_ones_are_not() -> None:
    given_log2 = np.log2(NOMINAL)
    wrong = given_log2.copy()
    wrong[2] += 1.0
    found = find_wrong_time(evidence(given_log2, wrong))
    assert found is not None
    assert found[0] == 2
    assert found[1] == pytest.approx(-1.0, abs=1e-6)
    assert refine_times(evidence(given_log2, wrong), (2,))[2] == pytest.approx(-1.0, abs=1e-6)
    wrong[2] = given_log2[2] + 0.05
    assert find_wrong_time(evidence(given_log2, wrong)) is None
    assert find_wrong_time(evidence(given_log2[:3], given_log2[:3] + np.array([0.0, 1.0, 0.0]))) is None
    assert not refine_times(evidence(given_log2, wrong), ()).any()


def test_frames_that_say_nothing_do_not_help_to_call_a_time_wrong() -> None:
    given_log2 = np.log2(NOMINAL)
    wrong = given_log2 + np.array([0, 0, 1.0, 0, 0, 0, 0])
    full = evidence(given_log2, wrong)
    for informative, named in ((4, True), (3, False)):
        silent = ~np.isin(np.arange(len(NOMINAL)), np.arange(1, 1 + informative))
        matrix, right = full.matrix.copy(), full.right.copy()
        matrix[silent], matrix[:, silent], right[silent] = 0, 0, 0
        found = find_wrong_time(TimeEvidence(matrix, right, full.bracket_of_frame))
        assert (found is not None) is named
        # One that is known to be wrong says no more of the others' times than one that is black.
        assert find_wrong_time(TimeEvidence(matrix, right, full.bracket_of_frame), (1,)) is None

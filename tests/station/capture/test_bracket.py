"""Plans, the adaptive rule, and what people type."""

from __future__ import annotations

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from station.capture.bracket import (
    PAPER_STOPS_S,
    CameraCost,
    estimate_bracket,
    parse_shutter,
    plan_bracket,
    useless_because,
)
from station.errors import UsageError
from station.session.session import FrameStatistics, Side, shutter_label

BOTH = (Side.INDOOR, Side.OUTDOOR)


def stats(clipped: float, dark: float) -> FrameStatistics:
    return FrameStatistics(mean_frac=0.5, clipped_frac=clipped, dark_frac=dark)


def test_full_plan_is_the_papers_short_to_long() -> None:
    plan = plan_bracket(PAPER_STOPS_S, "full", BOTH)
    assert plan.stops_s == PAPER_STOPS_S
    assert [plan.stops_s[i] for i in plan.order] == sorted(PAPER_STOPS_S)


def test_adaptive_plan_goes_outwards() -> None:
    assert plan_bracket(PAPER_STOPS_S, "adaptive", BOTH).order == (4, 3, 5, 2, 6, 1, 7, 0, 8)


@given(st.lists(st.floats(1 / 8000, 30), min_size=1, max_size=20, unique=True), st.sampled_from(["full", "adaptive"]))
def test_every_stop_is_taken_once(stops_s: list[float], mode: str) -> None:
    plan = plan_bracket(stops_s, mode, BOTH)  # type: ignore[arg-type]
    assert sorted(plan.order) == list(range(len(stops_s)))
    assert list(plan.stops_s) == sorted(stops_s, reverse=True)


@pytest.mark.parametrize("stops_s", [(), (1.0, 1.0), (0.0,), (-1.0,), (1e9,), (float("nan"),), (1e-7,)])
def test_impossible_plans_are_refused(stops_s: tuple[float, ...]) -> None:
    with pytest.raises(UsageError):
        plan_bracket(stops_s, "full", BOTH)


def test_remaining_keeps_order_and_sides() -> None:
    plan = plan_bracket((1.0, 0.25, 0.1), "full", BOTH)
    assert plan.remaining({Side.INDOOR: [0, 2], Side.OUTDOOR: [2]}) == ((2, BOTH), (0, (Side.INDOOR,)))
    assert plan.remaining({}) == ()


def test_shorter_is_useless_once_nothing_is_clipped() -> None:
    assert useless_because(5, {4: stats(0.0, 0.3)}, PAPER_STOPS_S) == "already nothing clipped at stop 4"
    assert useless_because(5, {4: stats(0.01, 0.3)}, PAPER_STOPS_S) is None


def test_longer_is_useless_once_nothing_is_dark() -> None:
    assert useless_because(3, {4: stats(0.1, 0.0)}, PAPER_STOPS_S) == "already nothing dark at stop 4"
    assert useless_because(3, {4: stats(0.1, 0.2)}, PAPER_STOPS_S) is None


def test_the_sun_keeps_every_short_stop() -> None:
    frames = {4: stats(0.1, 0.0), 5: stats(0.01, 0.1), 6: stats(1e-4, 0.2), 7: stats(1e-5, 0.4)}
    assert useless_because(8, frames, PAPER_STOPS_S) is None


def test_a_further_exposure_is_longer_than_all_though_its_index_comes_behind() -> None:
    stops_s = (*PAPER_STOPS_S, 15.0)
    assert useless_because(0, {9: stats(0.3, 0.0)}, stops_s) is None, "nothing dark in a longer one says nothing"
    assert useless_because(0, {9: stats(0.0, 0.0)}, stops_s) == "already nothing clipped at stop 9"


def test_nothing_known_nothing_skipped() -> None:
    assert all(useless_because(stop, {}, PAPER_STOPS_S) is None for stop in range(9))


@pytest.mark.parametrize(("text", "seconds"), [("4", 4), ("0.25", 0.25), ("1/60", 1 / 60), (" 1/8000 s", 1 / 8000)])
def test_shutter_text(text: str, seconds: float) -> None:
    assert math.isclose(parse_shutter(text), seconds)


@given(st.text(max_size=12))
def test_any_text_is_a_time_or_a_usage_error(text: str) -> None:
    try:
        assert 1e-6 < parse_shutter(text) < 3600
    except UsageError:
        pass


@pytest.mark.parametrize("shutter_s", PAPER_STOPS_S)
def test_labels_read_back(shutter_s: float) -> None:
    assert math.isclose(parse_shutter(shutter_label(shutter_s)), shutter_s, rel_tol=1e-9)


def test_estimate_counts_what_cannot_hide() -> None:
    plan = plan_bracket((2.0, 1.0), "full", (Side.INDOOR,))
    cost = CameraCost(overhead_s=0.5, frame_bytes=1000, rate_bytes_s=1000.0)
    estimate = estimate_bracket(plan, {Side.INDOOR: cost}, reading_s=(3.0, 3.0))
    # 1 + 2 s of exposure, 2 x 0.5 s overhead, first frame's second hidden behind the 2 s exposure,
    # the last frame's second hidden behind the last reading
    assert estimate.exposures_s == pytest.approx(4.0)
    assert estimate.unhidden_transfer_s == pytest.approx(1.0)
    assert estimate.total_s == pytest.approx(3.0 + 4.0 + 3.0)


def test_estimate_without_overlap_leaves_everything_to_the_end() -> None:
    plan = plan_bracket((2.0, 1.0, 0.5), "full", (Side.INDOOR,))
    cost = CameraCost(overhead_s=0.0, frame_bytes=1000, rate_bytes_s=1000.0, overlaps=False)
    assert estimate_bracket(plan, {Side.INDOOR: cost}).unhidden_transfer_s == pytest.approx(3.0)


def test_estimate_waits_for_the_slower_camera() -> None:
    plan = plan_bracket((1.0,), "full", BOTH)
    costs = {Side.INDOOR: CameraCost(0.1, 1, 1e9), Side.OUTDOOR: CameraCost(0.7, 1, 1e9)}
    assert estimate_bracket(plan, costs).exposures_s == pytest.approx(1.7)

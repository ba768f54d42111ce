"""What is said of the time left: from runs of the same size, of others, and of none."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from processing.running.progress import FILE_NAME, KEPT_RUNS, Pace, PastSeconds, expected_from, left_s


def test_runs_of_the_same_size_count_by_their_median() -> None:
    assert expected_from([(10.0, 20.0), (12.0, 20.0), (60.0, 20.0)], 20.0) == pytest.approx(12)
    assert expected_from([(10.0, 20.0)], 22.0) == pytest.approx(11), "nearly the same size: in proportion"
    runs = [(1.0, 1.0), (100.0, 400.0), (110.0, 400.0)]
    assert expected_from(runs, 400.0) == pytest.approx(105), "runs of other sizes do not count"


def test_other_sizes_grow_as_runs_have_shown() -> None:
    """A stage that costs 10 s whatever the size, one in proportion, and one of which only one size is known."""
    assert expected_from([(10.0, 10.0), (10.0, 40.0)], 160.0) == pytest.approx(10)
    assert expected_from([(10.0, 10.0), (40.0, 40.0)], 160.0) == pytest.approx(160)
    assert expected_from([(10.0, 10.0), (20.0, 40.0)], 20.0) == pytest.approx(10 * 2**0.5)
    assert expected_from([(10.0, 10.0)], 160.0) == pytest.approx(40), "between 10 and 160"
    assert expected_from([(10.0, 10.0), (5.0, 40.0)], 160.0) == pytest.approx(5), "noise is no growth below none"
    assert expected_from([(3.0, 0.0)], 0.05) == pytest.approx(3)


def test_a_quarter_size_session_does_not_frighten() -> None:
    """A room estimated in 8 s at 1/16 of the pixels takes 12 s at full size: not 16 times as long."""
    said = expected_from([(8.0, 12.7)], 203.2)
    assert 12 / 4 < said < 12 * 4


def test_a_stage_that_never_ran_states_nothing_at_its_beginning() -> None:
    assert left_s([], None, 30.0, 0.01) is None
    assert left_s([], None, 30.0, 0.5) == pytest.approx(30)
    assert left_s([10.0], 100.0, 30.0, 0.0) == pytest.approx(80)
    assert left_s([10.0], 100.0, 50.0, 0.5) == pytest.approx(60)
    assert left_s([None], 100.0, 30.0, 0.5) is None


def test_runs_are_kept_and_what_is_no_run_is_forgotten(tmp_path: Path) -> None:
    past = PastSeconds(tmp_path / "state")
    for seconds in range(KEPT_RUNS + 3):
        past.add("room 2", float(seconds), 10.0)
    past.save()
    again = PastSeconds(tmp_path / "state")
    assert again.expected_s("room 2", 10.0) == pytest.approx(3 + KEPT_RUNS // 2)
    assert again.expected_s("room 3", 10.0) is None
    for text in ('{"room 2": [0.25, 0.3]}', '{"room 2": [["a", 1]]}', "[]", "{", '{"room 2": [[1, 2, 3]]}'):
        (tmp_path / "state" / FILE_NAME).write_text(text)
        assert PastSeconds(tmp_path / "state").expected_s("room 2", 10.0) is None
    (tmp_path / "state" / FILE_NAME).write_text(json.dumps({"room 2": [[4, 10]]}))
    assert PastSeconds(tmp_path / "state").expected_s("room 2", 10.0) == pytest.approx(4)


def test_a_run_on_a_freer_computer_expects_less_of_what_is_left() -> None:
    pace = Pace()
    assert pace.of(60.0) == 60.0
    assert pace.of(None) is None
    pace.add(5.0, None)
    assert pace.of(60.0) == 60.0
    pace.add(10.0, 40.0)
    assert pace.of(60.0) == pytest.approx(60 * 12 / 42)
    pace.add(200.0, 20.0)
    assert pace.of(1.0) > 3

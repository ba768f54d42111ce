"""A day on site, at length with `make torture`, some of it always: nothing acknowledged is lost or wrongly rejected."""

from __future__ import annotations

import os
import time
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import pytest

from station.capture.events import EventKind
from tests.torture import day_campaigns as campaigns
from tests.torture.ledger import record

LONG = bool(os.environ.get("DAYLIT_TORTURE"))
SEED = 20230519
SOAK = 1000 if LONG else 3
SOME_LATE = (("theta_z1", campaigns.PICTURE, 2, 66.0), ("canon_5d2", campaigns.PICTURE, 2, 75.0))
SOME_STEPS = ((2, -20.0), (3, 86_400.0))
SOME_EVENTS = ((24,),)
N_EVENTS = 45
"""Of a capture without faults."""

pytestmark = [pytest.mark.torture, pytest.mark.timeout(7200 if LONG else 180)]


def sweep(name: str, run: Callable[..., list[str]], cases: Sequence[tuple[Any, ...]], into: Path, notes: str) -> None:
    began_s, wrong = time.perf_counter(), []
    for number, case in enumerate(cases):
        folder = into / str(number)
        folder.mkdir()
        if found := run(*case, folder):
            wrong.append(f"{case}: {found}")
    seconds = time.perf_counter() - began_s
    figures = {"injected": len(cases), "observed": len(cases) - len(wrong), "lost": len(wrong)}
    record(name, **figures, seconds=seconds, seed=0, notes=notes)
    assert not wrong, "\n".join(wrong)


def test_late_partners(tmp_path: Path) -> None:
    cases: Sequence[tuple[Any, ...]] = SOME_LATE
    if LONG:
        (tmp_path / "first").mkdir()
        cases = list(campaigns.late_cases(campaigns.bracket_operations(tmp_path / "first"), campaigns.DELAYS_S))
    notes = (
        "either camera, 10 to 120 s, at each operation of a bracket or with its picture; 0 lost: complete or resumed"
    )
    sweep("late partners", campaigns.late_partner, cases, tmp_path, notes)


def test_clock_steps(tmp_path: Path) -> None:
    every = [(pair, step_s) for step_s in campaigns.STEPS_S for pair in range(1, 5)]
    notes = "the computer's clock is set by -1 day to +1 day at each pair; no frame rejected, times undisturbed"
    sweep("clock steps", campaigns.clock_step, every if LONG else SOME_STEPS, tmp_path, notes)


def test_closed_terminals(tmp_path: Path) -> None:
    every = [(number,) for number in range(1, N_EVENTS + 1)]
    notes = "SIGHUP twice and no output from then on, at each event; cameras free, resumed to the end"
    sweep("closed terminal", campaigns.closed_terminal, every if LONG else SOME_EVENTS, tmp_path, notes)


def test_soak(tmp_path: Path) -> None:
    began_s = time.perf_counter()
    found = campaigns.soak(SOAK, tmp_path, fault_frac=0.01 if LONG else 0.1, seed=SEED)
    record(
        "soak in one process",
        injected=found.faults,
        observed=found.faults,
        lost=found.lost,
        seconds=time.perf_counter() - began_s,
        seed=SEED,
        notes=f"{found.captures} captures, {found.resumes} resumes; memory {found.growth_pct:+.1f} % from the first "
        "tenth on; files and threads constant",
    )
    assert found.lost == 0, found.wrong
    assert not found.wrong
    assert found.captures == SOAK
    assert found.faults > 0
    assert found.growth_pct < 5 or not LONG, "of three captures it means nothing"


def test_a_day(tmp_path: Path) -> None:
    began_s, brackets = time.perf_counter(), 9 if LONG else 3
    wrong, kinds = campaigns.day(tmp_path, brackets)
    notes = f"{brackets} brackets: a camera unplugged, a battery changed, the clock set between"
    seconds = time.perf_counter() - began_s
    record(
        "a day",
        injected=3 if LONG else 1,
        observed=3 if LONG else 1,
        lost=len(wrong),
        seconds=seconds,
        seed=0,
        notes=notes,
    )
    assert not wrong
    assert kinds[EventKind.FINISHED] >= brackets + 1
    assert kinds[EventKind.WAITING] >= 2


def test_the_judges_see_what_they_look_for(tmp_path: Path) -> None:
    """A station by the wall clock, and one that takes a closed terminal for nothing, are found out."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("drivers.clock.SteadyClock.utc_now", lambda self: self._base.utc_now())
        patch.setattr("drivers.clock.SteadyClock.new_step_s", lambda _self: None)
        (tmp_path / "clock").mkdir()
        found = campaigns.clock_step(2, -20.0, tmp_path / "clock")
    assert any("rejected" in text or "times by" in text for text in found), found
    assert any("not noticed" in text for text in found)

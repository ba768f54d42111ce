"""Whole captures under fault, resumed until complete: nothing acknowledged lost, nothing misfiled, nothing left behind.

Real drivers on simulated cameras and meter, real frame checks in their own processes, a clock that runs `RATE` times
faster than life. One to three faults a capture, drawn by seed; three in ten are abandoned at some event as well.
"""

from __future__ import annotations

import os
import random
import time
from functools import cache
from pathlib import Path

import pytest

from mocks.instruments.faults import Fault, FaultKind, FaultSchedule
from tests.torture.faulty_capture import SILENCE_LIMIT_S, FaultyCapture, Outcome, Trouble, draw_trouble
from tests.torture.ledger import record
from tests.torture.ptp.faults import single_faults
from tests.torture.ptp.flavours import FLAVOURS

LONG = bool(os.environ.get("DAYLIT_TORTURE"))
CAPTURES, PARTS = (240, 2) if LONG else (1, 1)
SEED = 20230519

pytestmark = [pytest.mark.torture, pytest.mark.timeout(3600 if LONG else 120)]


@cache
def pools() -> dict[str, list[Fault]]:
    """Return the faults of the driver sweep by camera kind; Canon's to its card, as the station uses it."""
    names = {"Theta, F x 100", "Canon, card"}
    return {flavour.kind: single_faults(flavour) for flavour in FLAVOURS if flavour.name in names}


class Campaign:
    """Adds up captures."""

    def __init__(self, name: str) -> None:
        self.name = name
        self.captures = self.fired = self.acknowledged = self.resumes = self.ended_by_error = 0
        self.longest_silence_s = 0.0
        self.wrong: list[str] = []
        self._began_s = time.perf_counter()

    def add(self, trouble: Trouble, outcome: Outcome) -> None:
        """Take one capture in."""
        self.captures += outcome.fired > 0
        self.fired += outcome.fired
        self.acknowledged += len(outcome.acknowledged)
        self.resumes += outcome.resumes
        self.ended_by_error += len(outcome.errors)
        self.longest_silence_s = max(self.longest_silence_s, outcome.longest_silence_s)
        if outcome.wrong:
            self.wrong.append(f"{outcome.wrong} after {trouble.words()}")

    def end(self, seed: int) -> None:
        """Write the figures down and fail if anything was wrong."""
        notes = (
            f"{self.captures} captures, {self.acknowledged} frames acknowledged, {self.ended_by_error} runs ended by "
            f"an error, {self.resumes} resumes; longest silence {self.longest_silence_s:.0f}/{SILENCE_LIMIT_S:.0f} s"
        )
        record(
            f"captures under fault: {self.name}",
            injected=self.fired,
            observed=self.fired - len(self.wrong),
            lost=len(self.wrong),
            seconds=time.perf_counter() - self._began_s,
            seed=seed,
            notes=notes,
        )
        assert not self.wrong, "\n".join([f"{len(self.wrong)} wrong:", *self.wrong[:10]])


@pytest.mark.parametrize("part", range(PARTS))
def test_drawn_faults(part: int, tmp_path: Path) -> None:
    campaign = Campaign(f"drawn, part {part + 1} of {PARTS}")
    wanted = CAPTURES // PARTS
    for seed in range(SEED + part, SEED + 3 * CAPTURES, PARTS):
        if campaign.captures == wanted:
            break
        trouble = draw_trouble(random.Random(seed), pools())
        folder = tmp_path / str(seed)
        folder.mkdir()
        campaign.add(trouble, FaultyCapture(trouble, folder).run())
    campaign.end(SEED + part)
    assert campaign.captures == wanted, "too few captures in which a fault came about"


@pytest.mark.parametrize("first", range(2))
def test_abandoned_at_every_event(first: int, tmp_path: Path) -> None:
    """A capture without faults reports some 45 events."""
    campaign = Campaign(f"abandoned at event {first + 1}, {first + 3}, ...")
    for number in range(first + 1 if LONG else 17 + first, 45, 2 if LONG else 32):
        trouble = Trouble({}, (), number)
        folder = tmp_path / str(number)
        folder.mkdir()
        campaign.add(trouble, FaultyCapture(trouble, folder).run())
    campaign.end(0)


def test_the_judge_sees_what_it_looks_for(tmp_path: Path) -> None:
    """A frame changed after it was acknowledged, and one that no camera made, are found out."""
    sound = FaultyCapture(
        Trouble({"theta_z1": FaultSchedule.of(Fault(FaultKind.BLACK_FRAME, nth=2))}, (), None), tmp_path
    )
    outcome = sound.run()
    assert (outcome.wrong, outcome.fired) == ([], 1)
    file = sorted(outcome.acknowledged)[0]
    (path,) = tmp_path.iterdir()
    (path / file).chmod(0o644)
    data = bytearray((path / file).read_bytes())
    data[len(data) // 2] ^= 1
    (path / file).write_bytes(data)
    sound._judge()
    assert any("acknowledged frame lost" in text for text in outcome.wrong)
    assert any("never made" in text for text in outcome.wrong)
    assert any("verify" in text for text in outcome.wrong)

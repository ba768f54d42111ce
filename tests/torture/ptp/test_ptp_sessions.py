"""Thousands of sittings with a simulated camera, each with one fault or two: none lost, none misfiled, none too slow.

One fault: swept over kind, operation, occurrence, phase and byte (`tests.torture.ptp.faults`). Two: pairs of them drawn
by seed. A sitting whose fault never came about does not count.
"""

from __future__ import annotations

import os
import random
import time
from collections import Counter
from collections.abc import Iterable

import pytest

from mocks.instruments.faults import Fault, FaultKind
from tests.mocks.instruments.fault_dicts import dict_of
from tests.torture.ledger import record
from tests.torture.ptp.faults import evenly, single_faults
from tests.torture.ptp.flavours import FLAVOURS, Flavour
from tests.torture.ptp.session import LIMITS_S, SLACK_S, Sitting, Verdict

LONG = bool(os.environ.get("DAYLIT_TORTURE"))
SINGLE, PAIRS = (1500, 600) if LONG else (6, 3)
"""Sittings of each flavour."""
SEED = 20230519
Schedule = tuple[Fault, ...]

pytestmark = [pytest.mark.torture, pytest.mark.timeout(3600 if LONG else 120)]
flavours = pytest.mark.parametrize("flavour", FLAVOURS, ids=lambda f: f.name)


class Campaign:
    """Adds up what the sittings of a flavour showed."""

    def __init__(self, name: str, flavour: Flavour) -> None:
        self.name, self.flavour = name, flavour
        self.fired = self.silent = self.recoveries = self.resumes = 0
        self.wrong: list[str] = []
        self.errors: Counter[str] = Counter()
        self.waits_s: Counter[str] = Counter()
        self._began_s = time.perf_counter()

    def sit(self, schedules: Iterable[Schedule]) -> None:
        """Run a sitting for each schedule."""
        for faults in schedules:
            self._add(faults, Sitting(self.flavour, faults, SEED).run())

    def _add(self, faults: Schedule, verdict: Verdict) -> None:
        if not verdict.fired:
            self.silent += 1
            assert not verdict.wrong, (verdict.wrong, "without any fault")
            return
        self.fired += 1
        self.recoveries += verdict.recoveries
        self.resumes += verdict.resumes
        self.errors += verdict.errors
        for name, seconds in verdict.waits_s.items():
            self.waits_s[name] = max(self.waits_s[name], seconds)  # type: ignore[assignment]
        if verdict.wrong:
            self.wrong.append(f"{verdict.wrong} after {[dict_of(f) for f in faults]}")

    def end(self) -> None:
        """Write the figures down and fail if anything was wrong."""
        limits_s = LIMITS_S[self.flavour.kind]
        waits = ", ".join(f"{name} {s:.2f}/{limits_s[name] + SLACK_S:.2f}" for name, s in self.waits_s.most_common(4))
        notes = f"{self.recoveries} recoveries, {self.resumes} resumes, {self.silent} that did not fire not counted; "
        record(
            f"PTP {self.name}: {self.flavour.name}",
            injected=self.fired,
            observed=self.fired - len(self.wrong),
            lost=len(self.wrong),
            seconds=time.perf_counter() - self._began_s,
            seed=SEED,
            notes=f"{notes}longest wait/limit, s: {waits}",
        )
        assert not self.wrong, "\n".join([f"{len(self.wrong)} wrong:", *self.wrong[:10]])


@flavours
def test_one_fault(flavour: Flavour) -> None:
    campaign = Campaign("one fault", flavour)
    faults = list(evenly(single_faults(flavour), SINGLE))
    campaign.sit((fault,) for fault in faults)
    campaign.end()
    assert campaign.fired >= 0.7 * SINGLE, f"only {campaign.fired} fired"
    assert campaign.errors, "no fault was ever noticed"


@flavours
def test_two_faults(flavour: Flavour) -> None:
    campaign = Campaign("two faults", flavour)
    rng = random.Random(SEED)
    faults = single_faults(flavour)
    campaign.sit(tuple(rng.sample(faults, 2)) for _ in range(PAIRS))
    campaign.end()
    assert campaign.fired >= 0.7 * PAIRS, f"only {campaign.fired} fired"


@flavours
def test_the_sweep_has_every_fault_of_the_link(flavour: Flavour) -> None:
    shots = {FaultKind.WRONG_EXPOSURE, FaultKind.BLACK_FRAME, FaultKind.REPEATED_FRAME, FaultKind.TRUNCATED_JPEG}
    shots |= {FaultKind.LATE_PICTURE, FaultKind.HELD_UP}  # longer than a sitting waits: swept in whole captures
    swept = {fault.kind for fault in single_faults(flavour)}
    assert set(FaultKind) - swept - shots <= ({FaultKind.AUTOFOCUS} if flavour.kind == "theta_z1" else set())


@flavours
def test_the_judge_sees_what_it_looks_for(flavour: Flavour) -> None:
    """A camera that gives a picture of another exposure, and a call that takes too long, are found out."""
    repeated = Sitting(flavour, (Fault(FaultKind.REPEATED_FRAME, nth=2),)).run()
    assert any("misfiled" in text for text in repeated.wrong)
    wrong_time = Sitting(flavour, (Fault(FaultKind.WRONG_EXPOSURE, nth=2),)).run()
    assert any("misfiled" in text for text in wrong_time.wrong)
    cut = Sitting(flavour, (Fault(FaultKind.TRUNCATED_JPEG, nth=1),)).run()
    assert any("never made" in text for text in cut.wrong)
    slow = Sitting(flavour, ())
    release = slow.camera.release
    slow.camera.release = lambda: (slow.clock.sleep(60.0), release())[1]  # type: ignore[method-assign]
    assert any("release took" in text for text in slow.run().wrong)

"""A day's troubles on simulated instruments: late partners, set clocks, and captures by the hundred in one process.

The cases are those of `tests/torture` (real drivers through pyusb and pyserial, simulated time 20 times life): either
camera late by 10 to 120 s at each operation of a bracket, or with its picture; the computer's clock set by -1 day to
+1 day at each pair; captures on one rig, with faults in 1 % of their frames. ``--quick`` takes a few. A case is lost
where a session could not be completed, or an acknowledged frame is missing, wrong, or rejected for the clock.
"""

from __future__ import annotations

import itertools
import random
import tempfile
from collections.abc import Callable, Iterable
from pathlib import Path
from typing import Any

QUICK_LATE, QUICK_CLOCK, QUICK_SOAK = 2, 2, 6
QUICK_DELAYS_S = (10.0, 58.0)
FULL_SOAK = 1000
UNITS = {"soak_lost": "frames", "late_partner_lost": "cases", "clock_lost": "cases"}


def run(*, quick: bool, seed: int) -> dict[str, Any]:
    """Return the metrics; see the module's docstring."""
    from tests.torture import day_campaigns as campaigns

    with tempfile.TemporaryDirectory() as folder:
        into = _Folders(Path(folder))
        operations = campaigns.bracket_operations(into.new())
        late = list(campaigns.late_cases(operations, QUICK_DELAYS_S if quick else campaigns.DELAYS_S))
        steps = [(pair, step_s) for step_s in campaigns.STEPS_S for pair in range(1, len(campaigns.STOPS_S) + 1)]
        if quick:
            rng = random.Random(seed)
            late, steps = rng.sample(late, QUICK_LATE), rng.sample(steps, QUICK_CLOCK)
        late_wrong = _wrong(lambda case: campaigns.late_partner(*case, into.new()), late)
        clock_wrong = _wrong(lambda case: campaigns.clock_step(*case, into.new()), steps)
        soak = campaigns.soak(QUICK_SOAK if quick else FULL_SOAK, into.new())
    metrics = {
        "soak_captures": soak.captures,
        "soak_lost": soak.lost,
        "soak_growth_pct": round(soak.growth_pct, 2),
        "soak_faults": soak.faults,
        "soak_resumes": soak.resumes,
        "soak_handles_changed": len([text for text in soak.wrong if "threads" in text]),
        "late_partner_cases": len(late),
        "late_partner_lost": len(late_wrong),
        "clock_cases": len(steps),
        "clock_lost": len(clock_wrong),
        **_recorded(),
    }
    return {"metrics": metrics, "notes": [*late_wrong, *clock_wrong, *soak.wrong][:20], "units": UNITS}


class _Folders:
    """New folders, one a case."""

    def __init__(self, root: Path) -> None:
        self._root, self._n = root, 0

    def new(self) -> Path:
        """Return another."""
        self._n += 1
        path = self._root / str(self._n)
        path.mkdir()
        return path


def _wrong(run_case: Callable[[Any], list[str]], cases: Iterable[Any]) -> list[str]:
    return [f"{case}: {'; '.join(found)}" for case in cases if (found := run_case(case))]


def _recorded() -> dict[str, int]:
    """Count the recorded bodies, and the drivers' operations, properties and events that are found in one of them."""
    from drivers.canon_5d2 import codes as canon
    from drivers.theta_z1 import codes as ricoh
    from mocks.instruments import recorded

    drivers: dict[str, tuple[Iterable[int], ...]] = {
        "canon": (canon.CanonOperation, canon.CanonProp, canon.CanonEvent),
        "theta": (ricoh.RicohOperation, ricoh.RicohProp),
    }
    bodies = found = 0
    for kind, constants in drivers.items():
        names = recorded.recorded_bodies(kind)
        said: set[int] = set()
        for body in map(recorded.recording, names):
            said.update(*(body.codes(of) for of in ("operations", "properties", "events")))
            said.update(code for event in body.stream() for code in (event.code, event.prop))
        bodies += len(names)
        found += sum(int(code) in said for code in itertools.chain(*constants))
    return {"recorded_bodies": bodies, "constants_checked": found}

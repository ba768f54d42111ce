"""Counts what happens on a simulated camera and says which faults of its schedule are due."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Literal

from mocks.faults import CONDITION_KINDS, EVENT_KINDS, OPEN_KINDS, PICTURE_KINDS, Fault, FaultKind, Phase

Domain = Literal["transaction", "event", "picture", "open"]


def domain_of(kind: FaultKind) -> Domain:
    """Return what a kind of fault counts."""
    if kind in EVENT_KINDS:
        return "event"
    if kind in PICTURE_KINDS:
        return "picture"
    return "open" if kind in OPEN_KINDS else "transaction"


class DueFaults:
    """The faults due in one transaction, event, picture or opening; whoever acts on one takes it."""

    def __init__(self, faults: list[Fault], fired: list[Fault]) -> None:
        self._faults = faults
        self._fired = fired

    def take(self, kind: FaultKind, phase: Phase | None = None) -> Fault | None:
        """Return the fault of this kind (and phase, if given) and note that it fired; None if there is none."""
        for item in self._faults:
            if item.kind == kind and phase in (None, item.trigger.phase):
                self._faults.remove(item)
                self._fired.append(item)
                return item
        return None

    def take_conditions(self) -> list[Fault]:
        """Return all faults that change the camera's state, and note that they fired."""
        found = [item for item in self._faults if item.kind in CONDITION_KINDS]
        for item in found:
            self._faults.remove(item)
            self._fired.append(item)
        return found


class FaultInjector:
    """The schedule of one camera; ``fired`` lists, in order, the faults that have really struck."""

    def __init__(self, faults: Iterable[Fault] | None = None) -> None:
        self._faults = list(faults or ())
        self._seen = [0] * len(self._faults)
        self.fired: list[Fault] = []

    def add(self, fault: Fault) -> None:
        """Add a fault; its occurrences count from now."""
        self._faults.append(fault)
        self._seen.append(0)

    def begin(self, domain: Domain, code: int | None = None) -> DueFaults:
        """Count one occurrence and return the faults due in it."""
        due = []
        for place, item in enumerate(self._faults):
            trigger = item.trigger
            if domain_of(item.kind) != domain or trigger.operation not in (None, code):
                continue
            self._seen[place] += 1
            if trigger.nth <= self._seen[place] < trigger.nth + trigger.times:
                due.append(item)
        return DueFaults(due, self.fired)

"""Where events leave a simulated camera, and get lost, doubled, misdirected or reordered if the faults say so."""

from __future__ import annotations

import heapq
import itertools
from collections.abc import Callable
from typing import Protocol, Self, TypeVar

from drivers.clock import Clock
from mocks.instruments.faults import Fault, FaultKind, FaultRunner, Moment

# What a simulated device has still to do, and when: no threads, the device catches up whenever it is looked at.


Action = Callable[[float], None]
"""Called with the moment it was due (clock seconds), not the moment it was run."""


class Agenda:
    """Actions in order of time; equal times run in the order they were planned."""

    def __init__(self) -> None:
        self._heap: list[tuple[float, int, Action]] = []
        self._sequence = itertools.count()

    def at(self, due_s: float, action: Action) -> None:
        """Plan ``action`` for clock time ``due_s``."""
        heapq.heappush(self._heap, (due_s, next(self._sequence), action))

    def run_until(self, now_s: float) -> None:
        """Run everything due by ``now_s``, also what those actions plan themselves."""
        while self._heap and self._heap[0][0] <= now_s:
            due_s, _, action = heapq.heappop(self._heap)
            action(due_s)

    def next_due_s(self) -> float | None:
        """Return when the next action is due, or None."""
        return self._heap[0][0] if self._heap else None

    def clear(self) -> None:
        """Forget everything planned."""
        self._heap.clear()


class FaultableEvent(Protocol):
    """An event that can be made wrong."""

    def elsewhere(self, offset: int) -> Self:
        """Return the event for another object or property."""
        ...

    def breaking(self, fault: Fault) -> Self:
        """Return the event with a fault of the link in it."""
        ...


EventT = TypeVar("EventT", bound=FaultableEvent)


class EventGate:
    """Lets events through one at a time."""

    def __init__(self, faults: FaultRunner, agenda: Agenda, clock: Clock) -> None:
        self._faults = faults
        self._agenda = agenda
        self._clock = clock
        self._held: list[Callable[[], None]] = []

    def deliver(self, code: int, event: EventT, put: Callable[[EventT], None]) -> None:
        """Hand ``event`` to ``put``, through whatever faults it triggers; then any event held back before it."""
        copies, hold_s = [event], 0.0
        for fault in self._faults.at(Moment.EVENT, code):
            if fault.kind not in (FaultKind.UNPLUG, FaultKind.STALL):
                self._faults.note(fault)
            if fault.kind is FaultKind.LOST_EVENT:
                copies = []
            elif fault.kind is FaultKind.DUPLICATE_EVENT:
                copies = copies * 2
            elif fault.kind is FaultKind.OTHER_OBJECT_EVENT:
                copies = [c.elsewhere(int(fault.number("offset"))) for c in copies]
            elif fault.kind is FaultKind.REORDERED_EVENT:
                hold_s = fault.number("hold_s")
            else:
                copies = [c.breaking(fault) for c in copies]
        if hold_s:
            self._hold(lambda: self._put_all(copies, put), hold_s)
        else:
            self._put_all(copies, put)
            self._release_held()

    @staticmethod
    def _put_all(events: list[EventT], put: Callable[[EventT], None]) -> None:
        for event in events:
            put(event)

    def _hold(self, send: Callable[[], None], hold_s: float) -> None:
        self._held.append(send)
        self._agenda.at(self._clock.monotonic_s() + hold_s, lambda _due_s: self._release_held())

    def _release_held(self) -> None:
        held, self._held = self._held, []
        for send in held:
            send()

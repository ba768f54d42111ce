"""What a simulated device has still to do, and when: no threads, the device catches up whenever it is looked at."""

from __future__ import annotations

import heapq
import itertools
from collections.abc import Callable

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

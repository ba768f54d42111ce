"""A clock for simulations that costs no time."""

from __future__ import annotations

import threading
from datetime import datetime, timedelta

from mocks.instruments.clock import NOMINAL_START


class VirtualClock:
    """Time that passes only in `sleep`: deterministic, for one thread.

    Several threads may read it safely, but their sleeps add up; use `ScaledClock` for them.
    """

    def __init__(self, start_utc: datetime = NOMINAL_START) -> None:
        self._start_utc = start_utc
        self._elapsed_s = 0.0
        self._lock = threading.Lock()

    def monotonic_s(self) -> float:
        """Return simulated seconds since the clock was made."""
        return self._elapsed_s

    def utc_now(self) -> datetime:
        """Return the simulated wall clock."""
        return self._start_utc + timedelta(seconds=self._elapsed_s)

    def sleep(self, duration_s: float) -> None:
        """Let ``duration_s`` seconds pass at once (nothing for zero or less)."""
        if duration_s > 0:
            with self._lock:
                self._elapsed_s += duration_s

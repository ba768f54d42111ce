"""Clocks for simulations: one that costs no time, one that runs faster than life."""

from __future__ import annotations

import threading
import time
from datetime import UTC, datetime, timedelta

NOMINAL_START = datetime(2023, 5, 19, 15, 54, 0, tzinfo=UTC)
"""When simulated time begins unless asked otherwise (the day of the paper's first session)."""


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


class ScaledClock:
    """Real time, ``rate`` times faster: for simulations with several threads.

    ``rate`` = 1 is life; above about 50 the computer's own scheduling (about 0.1 ms) becomes visible.
    """

    def __init__(self, rate: float = 1.0, start_utc: datetime = NOMINAL_START) -> None:
        if not rate > 0:
            raise ValueError(f"rate must be above 0, not {rate}")
        self.rate = rate
        self._start_utc = start_utc
        self._origin_s = time.monotonic()

    def monotonic_s(self) -> float:
        """Return simulated seconds since the clock was made."""
        return (time.monotonic() - self._origin_s) * self.rate

    def utc_now(self) -> datetime:
        """Return the simulated wall clock."""
        return self._start_utc + timedelta(seconds=self.monotonic_s())

    def sleep(self, duration_s: float) -> None:
        """Sleep for ``duration_s`` simulated seconds; other threads run meanwhile."""
        if duration_s > 0:
            time.sleep(duration_s / self.rate)

"""The clock of simulations: it runs faster than life."""

import time
from datetime import UTC, datetime, timedelta

NOMINAL_START = datetime(2023, 5, 19, 15, 54, 0, tzinfo=UTC)
"""When simulated time begins unless asked otherwise (the day of the paper's first session)."""


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

"""Time as the drivers see it: injected, so that tests can run a day of faults in a second."""

import time
from dataclasses import dataclass
from datetime import UTC, datetime, timedelta
from typing import Protocol, Self

from drivers.errors import DeviceTimeoutError


class Clock(Protocol):
    """Durations come from ``monotonic_s``; ``utc_now`` is for records only and may jump."""

    def monotonic_s(self) -> float:
        """Return seconds from an arbitrary origin; never goes backwards."""

    def utc_now(self) -> datetime:
        """Return the wall clock as an aware UTC datetime."""

    def sleep(self, duration_s: float) -> None:
        """Block for ``duration_s`` seconds (nothing for zero or less)."""


class SystemClock:
    """The computer's own clocks."""

    def monotonic_s(self) -> float:
        """Return seconds since some start, a sleep of the computer included where the system counts it (Linux)."""
        return time.clock_gettime(time.CLOCK_BOOTTIME) if hasattr(time, "CLOCK_BOOTTIME") else time.monotonic()

    def utc_now(self) -> datetime:
        """Return the current UTC time."""
        return datetime.now(UTC)

    def sleep(self, duration_s: float) -> None:
        """Sleep for ``duration_s`` seconds."""
        if duration_s > 0:
            time.sleep(duration_s)


STEP_S = 1.0
"""Chosen: the wall clock was set if it parts by more from the monotonic one (NTP slews half an hour for as much)."""


class SteadyClock:
    """Another clock with a UTC that runs with its monotonic time: a step of the wall clock is noticed, not shown."""

    def __init__(self, base: Clock) -> None:
        self._base = base
        self.rebase()

    def rebase(self) -> None:
        """Take the wall clock as it is now."""
        self._start_s, self._start_utc = self._base.monotonic_s(), self._base.utc_now()
        self._step_s = 0.0

    def monotonic_s(self) -> float:
        """Return the other clock's monotonic seconds."""
        return self._base.monotonic_s()

    def utc_now(self) -> datetime:
        """Return the UTC at the last `rebase` and what has passed since."""
        return self._start_utc + timedelta(seconds=self.monotonic_s() - self._start_s)

    def sleep(self, duration_s: float) -> None:
        """Sleep as the other clock does."""
        self._base.sleep(duration_s)

    def new_step_s(self) -> float | None:
        """Return by how much the wall clock was set since this was last asked; None: it was not."""
        apart_s = (self._base.utc_now() - self.utc_now()).total_seconds()
        step_s = apart_s - self._step_s
        if abs(step_s) <= STEP_S:
            return None
        self._step_s = apart_s
        return step_s


@dataclass(frozen=True)
class Deadline:
    """The moment by which a call must be over; every wait in the drivers holds one."""

    clock: Clock
    end_s: float
    limit_s: float

    @classmethod
    def after(cls, clock: Clock, limit_s: float) -> Self:
        """Return the deadline ``limit_s`` seconds from now."""
        return cls(clock, clock.monotonic_s() + limit_s, limit_s)

    @property
    def remaining_s(self) -> float:
        """Seconds left, never below zero."""
        return max(0.0, self.end_s - self.clock.monotonic_s())

    @property
    def expired(self) -> bool:
        """Whether the moment has come."""
        return self.clock.monotonic_s() >= self.end_s

    def check(self, what: str, where: str = "") -> None:
        """Raise `DeviceTimeoutError` naming ``what`` was waited for, once expired."""
        if self.expired:
            text = f"no {what} within {self.limit_s:g} s"
            likely = "the instrument is asleep, busy, or its cable is loose"
            advice = "wake it, check the cable, then resume"
            raise DeviceTimeoutError(text, where=where, likely=likely, advice=advice, limit_s=self.limit_s)

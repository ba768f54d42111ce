"""Meter readings of a session: taken, typed, recorded, and the drift between two of them."""

from __future__ import annotations

from concurrent.futures import Future, ThreadPoolExecutor
from typing import Literal

from drivers.clock import Clock
from drivers.meter.interface import MeterReading, ReadingStatus
from station.capture.rig import Rig
from station.errors import UsageError
from station.session.session import ReadingRecord

When = Literal["before", "after", "extra"]
TYPED_RANGE_CD_M2 = (1e-3, 1e7)
"""What a luminance meter of this family can show (LS-150/160 data sheets, rounded outwards)."""


def record_reading(when: When, reading: MeterReading) -> ReadingRecord:
    """Return the record of a reading, whatever its status."""
    return ReadingRecord(
        when=when,
        status=str(reading.status),
        luminance_cd_m2=reading.luminance_cd_m2,
        taken_utc=reading.taken_utc,
        taken_monotonic_s=reading.taken_monotonic_s,
        raw=reading.raw[:500],
        dialect=reading.dialect,
        dialect_verified=reading.dialect_verified,
        n_samples=reading.n_samples,
        spread_frac=reading.spread_frac,
        detail=reading.detail[:500],
    )


def check_typed(luminance_cd_m2: float) -> None:
    """Accept a number that a meter of the family can show.

    Raises `UsageError`: outside 0.001 .. 1e7 cd/m2.
    """
    low, high = TYPED_RANGE_CD_M2
    if not low <= luminance_cd_m2 <= high:
        raise UsageError(
            f"{luminance_cd_m2} cd/m2 is not a reading such a meter can show",
            where="--reading",
            advice=f"type the number on the display, in cd/m2, between {low:g} and {high:g}",
        )


def typed_record(when: When, luminance_cd_m2: float, clock: Clock) -> ReadingRecord:
    """Return the record of a number that a person read from the display.

    Raises `UsageError`: outside 0.001 .. 1e7 cd/m2, which no meter of the family shows.
    """
    check_typed(luminance_cd_m2)
    return ReadingRecord(
        when=when,
        status=str(ReadingStatus.TYPED),
        luminance_cd_m2=luminance_cd_m2,
        taken_utc=clock.utc_now(),
        taken_monotonic_s=clock.monotonic_s(),
        raw=f"{luminance_cd_m2:g}",
        dialect="typed",
        dialect_verified=True,
        detail="typed from the display",
    )


def drift_frac(readings: tuple[ReadingRecord, ...]) -> float | None:
    """Return the change from the last "before" to the last "after", relative to before; None without both."""
    found = {r.when: r.luminance_cd_m2 for r in readings if r.luminance_cd_m2 is not None}
    before, after = found.get("before"), found.get("after")
    if not before or after is None:
        return None
    return (after - before) / before


class ReadingTaker:
    """Takes the readings of one capture from the meter, or from what a person typed (first before, last after)."""

    def __init__(self, rig: Rig, typed_cd_m2: tuple[float, ...]) -> None:
        if len(typed_cd_m2) > 2:
            raise UsageError("at most two readings can be typed", where="--reading", advice="before, and after")
        self._rig = rig
        self._typed = tuple(typed_cd_m2)
        self._pool = ThreadPoolExecutor(max_workers=1, thread_name_prefix="meter")
        self._running: Future[ReadingRecord] | None = None

    @property
    def planned(self) -> Literal[0, 1, 2]:
        """How many readings a new session is to have: 2 with a meter, else as many as were typed."""
        if not self._typed:
            return 0 if self._rig.meter is None else 2
        return 1 if len(self._typed) == 1 else 2

    def can_take(self, when: When) -> bool:
        """Whether there is anything to take the reading from."""
        return self._rig.meter is not None if not self._typed else when != "extra"

    def start(self, when: When) -> None:
        """Begin a reading in the background, behind one that runs; that is dropped as stale, errors and all."""
        if self._running is not None:
            self._running.cancel()
        self._running = self._pool.submit(self._take, when)

    def collect(self) -> ReadingRecord | None:
        """Wait for the reading begun last and return it; None if none was begun."""
        running, self._running = self._running, None
        return running.result() if running is not None else None

    def close(self, *, wait: bool = True) -> None:
        """End the background thread; a running reading ends by its own time limit, waited for or not."""
        self._pool.shutdown(wait=wait, cancel_futures=True)

    def _take(self, when: When) -> ReadingRecord:
        if self._typed:
            return typed_record(when, self._typed[0 if when == "before" else -1], self._rig.clock)
        meter, table = self._rig.meter, self._rig.file.meter
        if meter is None or table is None:
            raise UsageError("the rig has no meter", where="meter", advice="add [meter] to the rig file")
        return record_reading(when, meter.measure(n_samples=table.samples, timeout_s=table.timeout_s))

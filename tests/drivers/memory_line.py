"""A simulated meter on a line in memory: a `drivers.serial_link.ByteLine` without a port, for millions of lines."""

from __future__ import annotations

from collections.abc import Callable

from drivers.clock import Clock
from drivers.errors import DeviceLostError, DeviceTimeoutError
from mocks.instruments.serial_port import Instrument


class MemoryLine:
    """A `drivers.serial_link.ByteLine` without a port, for millions of lines; time passes on the clock given."""

    def __init__(self, instrument: Instrument, clock: Clock, name: str = "memory") -> None:
        self.name = name
        self._instrument = instrument
        self._clock = clock
        self._coming: list[tuple[float, bytes | None]] = []
        self._buffer = bytearray()
        self._heard = b""

    def write(self, data: bytes, timeout_s: float) -> None:
        """Give the instrument whole lines."""
        now_s = self._clock.monotonic_s()
        *lines, self._heard = (self._heard + data).split(self._instrument.line_end)
        for line in lines:
            pieces = self._instrument.hear(line, now_s)
            self._coming += [(now_s + p.after_s, p.data) for p in pieces]
        self._coming.sort(key=lambda timed: timed[0])

    def read_line(self, delimiter: bytes, max_bytes: int, timeout_s: float) -> bytes:
        """Return the next line, as `drivers.serial_link.SerialLink.read_line` does."""
        end_s = self._clock.monotonic_s() + timeout_s
        while True:
            self._take(lambda at_s: at_s <= self._clock.monotonic_s())
            found = self._buffer.find(delimiter)
            if 0 <= found <= max_bytes:
                line = bytes(self._buffer[:found])
                del self._buffer[: found + len(delimiter)]
                return line
            if len(self._buffer) >= max_bytes + len(delimiter):
                line = bytes(self._buffer[: max_bytes + 1])
                self._buffer.clear()
                return line
            next_s = self._coming[0][0] if self._coming else float("inf")
            if next_s > end_s:
                self._clock.sleep(end_s - self._clock.monotonic_s())
                partial = bytes(self._buffer)
                self._buffer.clear()
                raise DeviceTimeoutError(
                    f"no complete line within {timeout_s:g} s",
                    where=self.name,
                    partial=partial.hex(),
                    limit_s=timeout_s,
                )
            self._clock.sleep(next_s - self._clock.monotonic_s())

    def drain(self, quiet_s: float, limit_s: float) -> int:
        """Throw away what comes until the line was quiet for ``quiet_s``."""
        end_s, dropped = self._clock.monotonic_s() + limit_s, 0
        while True:
            self._clock.sleep(quiet_s)
            self._take(lambda at_s: at_s <= self._clock.monotonic_s())
            came = len(self._buffer)
            dropped += came
            self._buffer.clear()
            if not came or self._clock.monotonic_s() >= end_s:
                return dropped

    def close(self) -> None:
        """Nothing to give back."""

    def _take(self, is_due: Callable[[float], bool]) -> None:
        while self._coming and is_due(self._coming[0][0]):
            data = self._coming.pop(0)[1]
            if data is None:
                raise DeviceLostError("the line is gone", where=self.name)
            self._buffer += data

"""What a stage cost: seconds, CPU seconds and the peak of the memory."""

from __future__ import annotations

import os
import resource
import sys
import time
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path

_CLEAR_PEAK = Path("/proc/self/clear_refs")
_STATUS = Path("/proc/self/status")


@dataclass(frozen=True)
class Cost:
    """Of one piece of work, threads and finished child processes included."""

    seconds: float
    cpu_seconds: float
    peak_bytes: int
    """Highest resident memory of this process during the work, or ever, where the system cannot tell (not Linux)."""


class Meter:
    """Started when made; `read` tells what the work has cost since."""

    def __init__(self) -> None:
        with suppress(OSError):
            _CLEAR_PEAK.write_text("5")  # Linux: the peak starts anew
        self._start_s = time.monotonic()
        self._start_cpu_s = _cpu_s()

    @property
    def elapsed_s(self) -> float:
        """Return seconds since the start."""
        return time.monotonic() - self._start_s

    def read(self) -> Cost:
        """Return the cost so far."""
        return Cost(self.elapsed_s, _cpu_s() - self._start_cpu_s, _peak_bytes())


def _cpu_s() -> float:
    times = os.times()
    return times.user + times.system + times.children_user + times.children_system


def _peak_bytes() -> int:
    with suppress(OSError, ValueError):
        line = next(line for line in _STATUS.read_text().splitlines() if line.startswith("VmHWM:"))
        return int(line.split()[1]) * 1024
    unit = 1 if sys.platform == "darwin" else 1024
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * unit

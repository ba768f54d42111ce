"""How long the rest will take, from what the same stages took before on this computer.

The seconds and megapixels of each stage's last runs are kept in the user's state folder (`DAYLIT_STATE` names
another); losing them costs the estimate of one run. Part of what a stage costs grows with the picture and part does
not: how much is learnt from runs of several sizes; until there are some, half way between is assumed.
"""

import json
import math
import os
import resource
import statistics
import sys
import time
from collections.abc import Iterable
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path

from pydantic import NonNegativeFloat, TypeAdapter

from drivers.errors import DaylitError
from station.session import strict_json
from station.session.folder import Folder, make_folders, write_file

# What a stage cost: seconds, CPU seconds and the peak of the memory.

_CLEAR_PEAK = Path("/proc/self/clear_refs")
_STATUS = Path("/proc/self/status")


@dataclass(frozen=True)
class Cost:
    """Of one piece of work, threads and finished child processes included."""

    seconds: float
    cpu_seconds: float
    peak_bytes: int
    """Highest resident memory of this process during the work, or ever, where the system does not say (not Linux)."""


class Meter:
    """Started when made; `read` returns what the work has cost since."""

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
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * (1 if sys.platform == "darwin" else 1024)


Run = tuple[float, float]  # seconds and megapixels
_RUNS = TypeAdapter(dict[str, list[tuple[NonNegativeFloat, NonNegativeFloat]]])

FILE_NAME = "stage-seconds.json"
KEPT_RUNS = 7  # chosen: an odd number, for their median
_MAX_BYTES = 1 << 20
_SMALLEST_MPX = 0.1  # below this, what a stage costs does not depend on the size
_SAME_SIZE = 1.3  # ratio of sizes up to which runs are of one size
_USUAL_GROWTH = 0.5
"""Power of the size with which costs grow, where one size only is known: between not at all and in proportion."""
_TRUSTED_FRACTION = 0.05  # of a stage's work, before which its own progress alone gives no estimate (chosen)
_PACE_WEIGHT_S = 2.0
"""Of stages as expected, that a run begins with: a stage of a tenth of a second says little of the rest."""


def state_folder() -> Path:
    """Return where the seconds are kept."""
    named = os.environ.get("DAYLIT_STATE")
    if named:
        return Path(named)
    from platformdirs import user_state_path

    return user_state_path("daylit")


class PastSeconds:
    """Seconds and megapixels of the last runs of each stage and quality."""

    def __init__(self, folder: Path) -> None:
        self._folder = folder
        self._runs = _load(folder)

    def expected_s(self, key: str, megapixels: float) -> float | None:
        """Return what the past makes expect for this size; None for a stage that never ran."""
        runs = self._runs.get(key)
        return expected_from(runs, megapixels) if runs else None

    def add(self, key: str, seconds: float, megapixels: float) -> None:
        """Note a run."""
        self._runs[key] = [*self._runs.get(key, []), (round(seconds, 3), round(megapixels, 3))][-KEPT_RUNS:]

    def save(self) -> None:
        """Keep the notes; failing to do so is no harm."""
        with suppress(DaylitError, OSError):
            make_folders(self._folder)
            with Folder.open(self._folder) as folder:
                write_file(folder, FILE_NAME, json.dumps(self._runs, sort_keys=True).encode())


class Pace:
    """How this run goes beside what the past made expect: the past may have been a busier computer's."""

    def __init__(self) -> None:
        self._spent_s = self._foreseen_s = _PACE_WEIGHT_S

    def add(self, seconds: float, expected_s: float | None) -> None:
        """Note a stage that is done; one of which nothing was expected does not count."""
        if expected_s is not None:
            self._spent_s += seconds
            self._foreseen_s += expected_s

    def of(self, expected_s: float | None) -> float | None:
        """Return what is to be expected in this run."""
        return None if expected_s is None else expected_s * self._spent_s / self._foreseen_s


def expected_from(runs: list[Run], megapixels: float) -> float:
    """Return the seconds to expect: the median of the runs of the nearest size, grown to this one."""
    sizes = [max(size, _SMALLEST_MPX) for _, size in runs]
    wanted = max(megapixels, _SMALLEST_MPX)
    nearest = min(sizes, key=lambda size: abs(math.log(size / wanted)))
    seconds = _median_at(runs, nearest)
    others = [size for size in sizes if _ratio(size, nearest) > _SAME_SIZE]
    growth = _USUAL_GROWTH
    if others:
        other = min(others, key=lambda size: abs(math.log(size / wanted)))
        slope = math.log(max(_median_at(runs, other), 1e-3) / max(seconds, 1e-3)) / math.log(other / nearest)
        growth = min(max(slope, 0.0), 1.0)
    power = 1.0 if _ratio(wanted, nearest) <= _SAME_SIZE else growth
    return seconds * math.exp(power * math.log(wanted / nearest))


def _median_at(runs: list[Run], megapixels: float) -> float:
    return statistics.median(s for s, size in runs if _ratio(max(size, _SMALLEST_MPX), megapixels) <= _SAME_SIZE)


def _ratio(one: float, other: float) -> float:
    return max(one / other, other / one)


def left_s(expected: Iterable[float | None], running_s: float | None, elapsed_s: float, share: float) -> float | None:
    """Return the seconds left: of the running stage and of the ``expected`` ones after it; None if not known.

    The running stage counts by what it was expected to take until it says how far it is; then by both, the more by
    its own word the further it is. A stage that never ran gives no estimate in its first twentieth.
    """
    rest = list(expected)
    least = _TRUSTED_FRACTION if running_s is None else 0.0
    own = elapsed_s * (1 - share) / share if share > least else None
    past = max(running_s - elapsed_s, 0.0) if running_s is not None else None
    if own is None or past is None:
        current = past if own is None else own
    else:
        current = share * own + (1 - share) * past
    known = [seconds for seconds in rest if seconds is not None]
    return None if current is None or len(known) < len(rest) else current + sum(known)


def _load(folder: Path) -> dict[str, list[Run]]:
    try:
        with Folder.open(folder) as opened:
            data = strict_json.loads(opened.read_file(FILE_NAME, _MAX_BYTES) or b"{}")
        return {key: runs[-KEPT_RUNS:] for key, runs in _RUNS.validate_python(data).items()}
    except (DaylitError, OSError, ValueError):
        return {}

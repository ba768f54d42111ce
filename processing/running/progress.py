"""How long the rest will take, from what the same stages took before on this computer.

The seconds per megapixel of each stage's last runs are kept in the user's state folder (`DAYLIT_STATE` names another);
losing them costs the estimate of one run.
"""

from __future__ import annotations

import json
import os
import statistics
from collections.abc import Iterable
from contextlib import suppress
from pathlib import Path

from drivers.errors import DaylitError
from station import strict_json
from station.folder import Folder, make_folders, write_file

FILE_NAME = "stage-seconds.json"
KEPT_RUNS = 7
_MAX_BYTES = 1 << 20
_SMALLEST_MPX = 0.1
"""Below this, what a stage costs does not depend on the size."""


def state_folder() -> Path:
    """Return where the seconds are kept."""
    named = os.environ.get("DAYLIT_STATE")
    if named:
        return Path(named)
    from platformdirs import user_state_path

    return user_state_path("daylit")


class PastSeconds:
    """Seconds per megapixel of the last runs of each stage and quality."""

    def __init__(self, folder: Path) -> None:
        self._folder = folder
        self._runs = _load(folder)

    def expected_s(self, key: str, megapixels: float) -> float | None:
        """Return the median of the past, scaled to the size; None for a stage that never ran."""
        runs = self._runs.get(key)
        return statistics.median(runs) * max(megapixels, _SMALLEST_MPX) if runs else None

    def add(self, key: str, seconds: float, megapixels: float) -> None:
        """Note a run."""
        runs = [*self._runs.get(key, []), seconds / max(megapixels, _SMALLEST_MPX)]
        self._runs[key] = runs[-KEPT_RUNS:]

    def save(self) -> None:
        """Keep the notes; failing to do so is no harm."""
        with suppress(DaylitError, OSError):
            make_folders(self._folder)
            folder = Folder.open(self._folder)
            try:
                write_file(folder, FILE_NAME, json.dumps(self._runs, sort_keys=True).encode())
            finally:
                folder.close()


def left_s(
    expected: Iterable[float | None], running_s: float | None, elapsed_s: float, fraction: float
) -> float | None:
    """Return the seconds left: of the running stage and of the ``expected`` ones after it; None if not known.

    The running stage counts by what it was expected to take until it says how far it is; then by both, the more by
    its own word the further it is.
    """
    rest = list(expected)
    own = elapsed_s * (1 - fraction) / fraction if fraction > 0 else None
    past = max(running_s - elapsed_s, 0.0) if running_s is not None else None
    if own is None or past is None:
        current = past if own is None else own
    else:
        current = fraction * own + (1 - fraction) * past
    known = [seconds for seconds in rest if seconds is not None]
    if current is None or len(known) < len(rest):
        return None
    return current + sum(known)


def _load(folder: Path) -> dict[str, list[float]]:
    try:
        opened = Folder.open(folder)
    except OSError:
        return {}
    try:
        data = strict_json.loads(opened.read_file(FILE_NAME, _MAX_BYTES) or b"{}")
        return {str(key): [abs(float(run)) for run in runs][-KEPT_RUNS:] for key, runs in data.items()}
    except (DaylitError, ValueError, TypeError, AttributeError):
        return {}
    finally:
        opened.close()

"""Rows of a long benchmark that are kept: what was measured with the same code is read again.

DAYLIT_BENCH_CPU_S ends a run after so much CPU time, children's included; run again to go on. DAYLIT_BENCH_ROWS names
rows that are kept though the code has changed since.
"""

from __future__ import annotations

import hashlib
import json
import os
import time
from collections.abc import Callable, Iterable
from pathlib import Path
from typing import Any

import numpy as np

from mocks.optics.picture_cache import default_folder

ROOT = Path(__file__).resolve().parents[1]


Row = Callable[[str, Callable[[], Any]], Any]
"""Gives a row under its key, known or made: `Rows.row`, or `fresh`."""


def fresh(_key: str, make: Callable[[], Any]) -> Any:
    """Return a row of which nothing is kept."""
    return make()


class EnoughError(TimeoutError):
    """The CPU time of this piece is spent."""


class Rows:
    """Figures by key. ``code``: for each kind of row, such as ours, patterns of the files whose change makes it anew.

    ``keep`` False (quick runs): nothing is read, written or ended.
    """

    def __init__(self, name: str, seed: int, code: dict[str, Iterable[str]], *, keep: bool) -> None:
        self._path = default_folder().parent / f"{name}-rows-{seed}.jsonl"
        self._keep = keep
        self._known: dict[str, Any] = {}
        if keep and self._path.is_file():
            rows = map(json.loads, self._path.read_text("utf-8").splitlines())
            self._known = {row["key"]: row["row"] for row in rows}
        self._limit_s, self._start_s = float(os.environ.get("DAYLIT_BENCH_CPU_S", "inf")), _spent_s()
        self._code = {kind: _digest(patterns) for kind, patterns in code.items()}

    @property
    def late(self) -> bool:
        """Whether the CPU time of this piece is spent."""
        return self._keep and _spent_s() - self._start_s > self._limit_s

    def knows(self, key: str, kind: str = "ours") -> bool:
        """Return whether a row is there already."""
        return self._full(key, kind) in self._known

    def row(self, key: str, make: Callable[[], Any], kind: str = "ours", *, even_late: bool = False) -> Any:
        """Return what `make` gives as it will be read again: JSON values, kept under a key and its kind's code.

        Raises
        ------
        EnoughError
            It is not known, and the time is spent.
        """
        full = self._full(key, kind)
        if full not in self._known:
            if self.late and not even_late:
                raise EnoughError(f"{len(self._known)} rows are kept; run again to go on with {key}")
            self._known[full] = json.loads(json.dumps(make(), default=_plain))
            if self._keep:
                self._path.parent.mkdir(parents=True, exist_ok=True)
                with self._path.open("a", encoding="utf-8") as file:
                    file.write(json.dumps({"key": full, "row": self._known[full]}) + "\n")
        return self._known[full]

    def _full(self, key: str, kind: str) -> str:
        return f"{key} {self._code[kind]}".rstrip()


def _plain(value: Any) -> Any:
    return value.item() if isinstance(value, np.generic) else str(value)


def _spent_s() -> float:
    times = os.times()
    return time.process_time() + times.children_user + times.children_system


def _digest(patterns: Iterable[str]) -> str:
    """Return a digest of files, empty for none: such rows outlast every change."""
    found = {pattern: [path for path in ROOT.glob(pattern) if path.is_file()] for pattern in patterns}
    if gone := [pattern for pattern, paths in found.items() if not paths]:
        # Rows would outlast changes of code that has moved.
        raise FileNotFoundError(f"no file of the checkout matches {gone}: say where that code is now")
    digest = hashlib.sha256()
    for path in sorted(path for paths in found.values() for path in paths):
        digest.update(path.name.encode() + path.read_bytes())
    return os.environ.get("DAYLIT_BENCH_ROWS", digest.hexdigest()[:12]) if found else ""

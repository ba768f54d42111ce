"""Rows of a long benchmark that are kept: what was measured with the same code is read again.

DAYLIT_BENCH_CPU_S ends a run after so much CPU time, children's included; run again to go on.
"""

from __future__ import annotations

import hashlib
import json
import os
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

from mocks.picture_cache import default_folder

ROOT = Path(__file__).resolve().parents[1]
FILLING = (
    *("fill", "plane_fill", "near_periodic*", "plain", "skirting", "sources", "kept_sunlight", "mixed_pixels"),
    *("illumination", "membrane", "blurs", "tone", "regions"),
)
"""Of processing/removal: how masks are found does not matter here."""
OURS = (*(f"processing/removal/{name}.py" for name in FILLING), "processing/surfaces/*.py")
THEIRS = ("benchmarks/_remove_rivals.py",)
SHARED = ("benchmarks/_remove_scores.py",)


class EnoughError(TimeoutError):
    """The CPU time of this piece is spent."""


class Rows:
    """Rows by key; those of rivals outlast changes of ours."""

    def __init__(self, seed: int, *, keep: bool) -> None:
        self._path = default_folder().parent / f"remove-rows-{seed}.jsonl"
        self._keep = keep
        self._known: dict[str, Any] = {}
        if keep and self._path.is_file():
            rows = map(json.loads, self._path.read_text("utf-8").splitlines())
            self._known = {row["key"]: row["row"] for row in rows}
        self._limit_s, self._start_s = float(os.environ.get("DAYLIT_BENCH_CPU_S", "inf")), _spent_s()
        self._code = {name: _digest(paths) for name, paths in (("ours", OURS), ("theirs", THEIRS))}

    def row(self, key: str, whose: str, make: Callable[[], Any]) -> Any:
        """Return what `make` gives, JSON values, kept under a key and the code of ``ours`` or ``theirs``.

        Raises
        ------
        EnoughError
            It is not known, and the time is spent.
        """
        full = f"{key} {self._code[whose]}"
        if full not in self._known:
            if _spent_s() - self._start_s > self._limit_s:
                raise EnoughError(f"{len(self._known)} rows are kept; run again to go on with {key}")
            self._known[full] = make()
            if self._keep:
                self._path.parent.mkdir(parents=True, exist_ok=True)
                with self._path.open("a", encoding="utf-8") as file:
                    file.write(json.dumps({"key": full, "row": self._known[full]}) + "\n")
        return self._known[full]


def _spent_s() -> float:
    times = os.times()
    return time.process_time() + times.children_user + times.children_system


def _digest(paths: tuple[str, ...]) -> str:
    told = hashlib.sha256()
    for name in (*paths, *SHARED):
        for path in sorted(ROOT.glob(name)):
            told.update(path.name.encode() + path.read_bytes())
    return os.environ.get("DAYLIT_BENCH_ROWS", told.hexdigest()[:12])

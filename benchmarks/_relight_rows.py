"""Rows of the relighting benchmark, kept so that a long run can be done in pieces.

DAYLIT_BENCH_CPU_S ends a run after so much CPU time; DAYLIT_BENCH_ROWS names rows that are kept though the code has
changed.
"""

from __future__ import annotations

import hashlib
import json
import os
import sys
import time
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

from mocks.picture_cache import default_folder

ROOT = Path(__file__).resolve().parents[1]
CODE = ("processing/rendering", "processing/relighting", "mocks/rooms")


class Rows:
    """The rows of a run; ``keep`` False neither reads nor writes any."""

    def __init__(self, seed: int, *, keep: bool) -> None:
        self.path = default_folder().parent / f"relight-rows-{seed}-{_digest()}.jsonl"
        self.keep, self.left = keep, 0
        self.known: dict[str, dict[str, Any]] = {}
        if keep and self.path.is_file():
            self.known = {row["key"]: row for row in map(json.loads, self.path.read_text("utf-8").splitlines())}
        self._limit_s = float(os.environ.get("DAYLIT_BENCH_CPU_S", "inf"))
        self._start_s = time.process_time()

    def of(self, tasks: Sequence[tuple[str, str, Callable[[], dict[str, Any]]]]) -> dict[str, list[dict[str, Any]]]:
        """Return rows by kind: what each task (kind, name, work) makes or has made; fewer once time is up."""
        found: dict[str, list[dict[str, Any]]] = {kind: [] for kind, _, _ in tasks}
        for kind, name, work in tasks:
            key = f"{kind}-{name}"
            if key not in self.known:
                if found[kind] and time.process_time() - self._start_s > self._limit_s:
                    self.left += 1
                    continue
                self.known[key] = {"key": key, **work()}
                self._write(self.known[key])
            found[kind].append(self.known[key])
        if self.left:
            print(f"{self.left} rows are left; run again to go on", file=sys.stderr)
        return found

    def _write(self, row: dict[str, Any]) -> None:
        if self.keep:
            self.path.parent.mkdir(parents=True, exist_ok=True)
            with self.path.open("a", encoding="utf-8") as file:
                file.write(json.dumps(row) + "\n")


def _digest() -> str:
    told = hashlib.sha256()
    files = [path for folder in CODE for path in sorted((ROOT / folder).rglob("*.py"))]
    for path in [*files, *sorted((ROOT / "benchmarks").glob("*relight*.py"))]:
        told.update(path.name.encode() + path.read_bytes())
    return os.environ.get("DAYLIT_BENCH_ROWS", told.hexdigest()[:12])

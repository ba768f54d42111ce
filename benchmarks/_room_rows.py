"""Rows of the benchmarks room and detect: each part's figures are kept, so that a long run can be resumed."""

from __future__ import annotations

import hashlib
import json
import os
import time
from collections.abc import Callable, Iterable
from pathlib import Path
from typing import Any

import numpy as np

ROOT = Path(__file__).resolve().parents[1]
ROOM_CODE = ("processing/room/*.py", "processing/segmentation/*", "benchmarks/_room*.py", "benchmarks/room.py")
DETECT_CODE = (
    *ROOM_CODE[:2],
    *(f"processing/removal/{name}.py" for name in ("masks", "furniture", "edges", "outliers", "tripod", "nadir")),
    *(f"processing/removal/{name}.py" for name in ("sunlight", "sun_geometry", "shadows", "round_masks")),
    *("benchmarks/_detect*.py", "benchmarks/detect.py"),
)


class Rows:
    """Figures by key, read again in a later run of the same code.

    DAYLIT_BENCH_CPU_S ends the process after so much CPU time, once ``keep`` is set; what is done by then is kept.
    """

    def __init__(self, name: str, seed: int, code: Iterable[str], *, keep: bool) -> None:
        folder = Path(os.environ.get("DAYLIT_CACHE", "/tmp"))
        self._path = folder / f"{name}-rows-{seed}-{_digest(code)}.jsonl" if keep else None
        self._known: dict[str, Any] = {}
        if self._path is not None and self._path.exists():
            lines = self._path.read_text("utf-8").splitlines()
            self._known = {line["key"]: line["row"] for line in map(json.loads, lines)}
        self._limit_s, self._start_s = float(os.environ.get("DAYLIT_BENCH_CPU_S", "inf")), time.process_time()

    def of(self, key: str, make: Callable[[], Any]) -> Any:
        """Return the row of a key, made now where it is not known; raises `TimeoutError` where time is up."""
        if key not in self._known:
            if self._path is not None and time.process_time() - self._start_s > self._limit_s:
                raise TimeoutError(f"{len(self._known)} rows are done; run again to go on")
            # As it will be read: no difference between a first and a resumed run.
            row = json.loads(json.dumps(make(), default=_plain))
            self._known[key] = row
            if self._path is not None:
                self._path.parent.mkdir(parents=True, exist_ok=True)
                with self._path.open("a", encoding="utf-8") as file:
                    file.write(json.dumps({"key": key, "row": row}) + "\n")
        return self._known[key]


def _plain(value: Any) -> Any:
    return value.item() if isinstance(value, np.generic) else str(value)


def _digest(code: Iterable[str]) -> str:
    """Return a digest of the files that rows depend on."""
    told = hashlib.sha256()
    for path in sorted(path for pattern in code for path in ROOT.glob(pattern) if path.is_file()):
        told.update(path.name.encode() + path.read_bytes())
    return told.hexdigest()[:12]

"""Run time against error of the whole pipeline: draft, standard and reference at four sizes of one validation room.

The room of `end_to_end`'s kind (both cameras, nine stops, a calibrated rig, one alternative, no styling) is
photographed once a size and processed by each quality from the same frames; each result is compared with the truth at
its own size. ``{quality}_cpu_s`` and ``{quality}_*_err_pct`` are of the largest size of that quality: luminance of the
panorama, the room's shape (100 x (1 - IoU)), the emptied picture where it was filled, the staged one where furniture
changes it. `reference` runs at the sizes `REFERENCE` only, to spare time. Rows are kept, so that a run can go on
(DAYLIT_BENCH_CPU_S; `benchmarks.kept_rows`). A process makes its first run twice and takes the second one, as the
first one loads libraries and kernels.
"""

from __future__ import annotations

import shutil
import sys
import tempfile
from collections.abc import Callable, Sequence
from functools import lru_cache
from pathlib import Path
from typing import Any

from benchmarks.kept_rows import EnoughError, Rows
from benchmarks.plots import Point, times_against_errors
from benchmarks.sessions import write_session
from benchmarks.truth_rooms import LIGHT_QUALITY, truth_list, truth_of
from benchmarks.whole.end_to_end import rig_profile
from benchmarks.whole.end_to_end_run import PANORAMA_PX, processed, taken_of
from mocks.rooms.model import Use
from processing.errors import ProcessingError

QUALITIES = ("draft", "standard", "reference")
FULL_DIVISORS, QUICK_DIVISORS = (24, 16, 8, 4), (24,)
QUICK_UNTIL = "render"
"""Last stage of a quick run: no figure is of a later one but the CPU time."""
REFERENCE = (24, 16)
"""Divisors at which `reference` runs."""
CODE = {"ours": ("processing/**/*.py", "processing/*.toml", "mocks/**/*.py", "benchmarks/whole/end_to_end_r*.py")}
ERRORS = {
    "luminance_median_err_pct": "luminance of the panorama",
    "room_err_pct": "room, 1 - IoU",
    "empty_median_err_pct": "emptied picture, where filled",
    "staged_median_err_pct": "staged picture, where changed",
}
PLOT = Path("pipeline-time.png")


def run(*, quick: bool, seed: int) -> dict[str, Any]:
    """Return metrics; see the module's docstring."""
    rows = rows_of(quick=quick, seed=seed)
    metrics = metrics_of(rows)
    if not quick:
        draw(rows, PLOT)
    return {"metrics": metrics, "notes": table_lines(rows)}


def rows_of(*, quick: bool, seed: int) -> list[dict[str, Any]]:
    """Return a row a size and quality, of which those that are kept are read again."""
    ((number, use),) = truth_list("validation", 1, seed)
    profile, kept = rig_profile(seed), Rows("qualities", seed, CODE, keep=not quick)
    found: list[dict[str, Any]] = []
    with tempfile.TemporaryDirectory() as place:
        photographed = _photographer(Path(place), number, use)
        try:
            for divisor in QUICK_DIVISORS if quick else FULL_DIVISORS:
                for quality in QUALITIES if quick or divisor in REFERENCE else QUALITIES[:2]:
                    make = _maker(photographed, profile, divisor, quality, full=not quick)
                    row = kept.row(f"{use}-{number}-{divisor}-{quality}", make)
                    found.append({"divisor": divisor, "quality": quality, **row})
                    print(table_lines(found[-1:])[0], file=sys.stderr, flush=True)
        except EnoughError as end:
            print(end, file=sys.stderr)
    return found


def _photographer(place: Path, number: int, use: Use) -> Callable[[int], tuple[Any, Any, Path]]:
    """Return what gives the room, its truth and its session of a size, made once and without stages."""

    @lru_cache(maxsize=1)
    def photographed(divisor: int) -> tuple[Any, Any, Path]:
        rows = PANORAMA_PX // divisor // 2 * 2 // 2
        room, truth = truth_of(number, use, rows=rows, quality=LIGHT_QUALITY)
        return room, truth, write_session(place / f"{divisor}" / room.name, taken_of(room, divisor))

    return photographed


_warm: list[int] = []
"""Divisors of the runs that this process has made."""


def _maker(
    photographed: Callable[[int], tuple[Any, Any, Path]], profile: Path, divisor: int, quality: str, *, full: bool
) -> Callable[[], dict[str, Any]]:
    """Return what measures a quality on a copy of a session, and takes the second run where it is the first."""

    def once() -> dict[str, Any]:
        room, truth, session = photographed(divisor)
        with tempfile.TemporaryDirectory() as place:
            copy = Path(place) / session.name
            shutil.copytree(session, copy)
            try:
                row = processed(copy, room, truth, profile, quality, {}, until=None if full else QUICK_UNTIL)
            except ProcessingError as error:
                return {"room": room.name, "refused": f"{error.code}: {error.message}"}
        if "iou3d" in row:
            row["room_err_pct"] = round(100 * (1 - row["iou3d"]), 3)
        return row

    def make() -> dict[str, Any]:
        if full and not _warm and "refused" not in once():
            _warm.append(divisor)
        return once()

    return make


def metrics_of(rows: Sequence[dict[str, Any]]) -> dict[str, float]:
    """Return CPU seconds and errors of each quality at its largest size, and how many runs were refused."""
    found: dict[str, float] = {"runs": len(rows), "refused": sum("refused" in row for row in rows)}
    for row in sorted(rows, key=lambda one: -one["divisor"]):
        found |= {f"{row['quality']}_{key}": row[key] for key in ("cpu_s", *ERRORS) if key in row}
    return found


def table_lines(rows: Sequence[dict[str, Any]]) -> list[str]:
    """Return a line a run."""
    lines = []
    for row in rows:
        figures = [f"{name} {row[key]:.3g} %" for key, name in ERRORS.items() if key in row]
        spent = [f"{row['cpu_s']:.3g} CPU s, {row['peak_mb']} MB"] if "cpu_s" in row else [row["refused"]]
        lines.append(f"{row['quality']} 1/{row['divisor']}: " + "; ".join([*spent, *figures]))
    return lines


def draw(rows: Sequence[dict[str, Any]], path: Path) -> Path:
    """Draw a panel an error, a line a quality, a label a size, and write it; ``path``: see `benchmarks.plots`."""
    panels = [
        (name, [Point(r["quality"], r["cpu_s"], r[key], f"1/{r['divisor']}") for r in rows if r.get(key)])
        for key, name in ERRORS.items()
    ]
    return times_against_errors(panels, path, error_label="error, %", columns=2)

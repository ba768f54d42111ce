"""End to end: simulated rooms of test seeds through the whole pipeline, each stage's answer against the truth.

A rig is calibrated from its own sessions; each room is photographed by both cameras (nine stops, noise, response, 8
bits, lens), measured by the meter, and handed to the pipeline as a session with place, time and heading. Nothing else
is given: no room, no masks. ``luminance_*``: the calibrated panorama, valid pixels. ``iou3d``: the room's shape.
``furniture_iou``, ``target_recall``, ``sunlight_iou``: masks. ``empty_*``: the emptied panorama where it was filled,
against the truly emptied room under the same light (what furniture takes from the whole room's light counts as error).
``albedo_*``: of surfaces as the camera sees them. ``staged_*``: the first arrangement, against the same furniture truly
placed in the simulated room, where that changes the picture by 2 % or more. Errors are relative, by solid angle; the
figures are medians over rooms (``q25_*``, ``q75_*``: quartiles; ``worst_*``: the worst room's). Rows are kept, so that
a long run can be resumed (DAYLIT_BENCH_CPU_S ends it after so much CPU time; DAYLIT_BENCH_ROWS names rows that are kept
though the code has changed).
"""

from __future__ import annotations

import hashlib
import json
import os
import sys
import tempfile
import time
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.photometry.rig import calibrated_rig
from benchmarks.seeds import seeds
from benchmarks.truth_rooms import truth_list
from benchmarks.whole.end_to_end_plot import spread_lines, table_lines, worst_of, write_plot
from benchmarks.whole.end_to_end_run import measured
from mocks.optics.picture_cache import default_folder
from processing.calibration.profile import save_profile
from processing.errors import ProcessingError

QUICK_ROOMS, FULL_ROOMS = 3, 24
QUICK_DIVISOR, FULL_DIVISOR = 16, 8
RIG_DIVISOR = 4
NOT_MEDIANS = ("room", "key", "refused", "left_out", "stage_cpu_s", "cpu_s", "peak_mb")
ROOT = Path(__file__).resolve().parents[2]


def run(*, quick: bool, seed: int) -> dict[str, Any]:
    """Return metrics; see the module's docstring."""
    profile = rig_profile(seed)
    rows = rows_of(profile, seed, quick=quick)
    notes = [f"pictures at 1/{QUICK_DIVISOR if quick else FULL_DIVISOR} of full size", *table_lines(rows)]
    notes += spread_lines(rows, figures_of(rows))
    if not quick:
        write_plot(rows)
    return {"metrics": metrics_of(rows), "units": {"iou3d_median": "1 is right"}, "notes": notes}


def metrics_of(rows: Sequence[dict[str, Any]]) -> dict[str, float]:
    """Return medians over the rooms of whatever they have, and what the pipeline takes."""
    found: dict[str, float] = {"rooms": len(rows), "refused": sum("refused" in row for row in rows)}
    for key in figures_of(rows):
        values = [row[key] for row in rows if key in row]
        name = key if key.endswith(("_err_pct", "_err")) else f"{key}_median"
        low, middle, high = (round(float(v), 4) for v in np.quantile(values, (0.25, 0.5, 0.75)))
        found |= {name: middle, f"q25_{key}": low, f"q75_{key}": high, f"worst_{key}": worst_of(rows, key)[key]}
        if len(values) < len(rows):
            found[f"{key}_rooms"] = len(values)
    done = [row for row in rows if "cpu_s" in row]
    if done:
        found["seconds"] = round(float(np.median([row["cpu_s"] for row in done])), 2)
        found["peak_mb"] = max(row["peak_mb"] for row in done)
    for stage in {stage for row in done for stage in row["stage_cpu_s"]}:
        spent = [row["stage_cpu_s"][stage] for row in done if stage in row["stage_cpu_s"]]
        found[f"{stage}_cpu_s"] = round(float(np.median(spent)), 2)
    return found


def figures_of(rows: Sequence[dict[str, Any]]) -> list[str]:
    """Return the names of the figures that any of the rows has."""
    return sorted({key for row in rows for key in row} - set(NOT_MEDIANS))


def rig_profile(seed: int) -> Path:
    """Return the profile of a simulated rig, calibrated from its own sessions once and kept."""
    (number,) = seeds("test", 1, seed)
    path = (
        default_folder().parent / f"end-to-end-rig-{number}-{_digest('processing/calibration', 'processing/rig')}.json"
    )
    if not path.is_file():
        path.parent.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryDirectory() as folder:
            save_profile(path, calibrated_rig(Path(folder), RIG_DIVISOR, number).result.profile)
    return path


def rows_of(
    profile: Path, seed: int, *, quick: bool, rooms: int | None = None, options: Mapping[str, object] | None = None
) -> list[dict[str, Any]]:
    """Return a row a room; rows of an earlier run of the same code are read again, but not in a quick run.

    ``rooms``: fewer than usual; ``options``: of `daylit process`, besides the benchmark's own.
    """
    count, divisor = (QUICK_ROOMS, QUICK_DIVISOR) if quick else (FULL_ROOMS, FULL_DIVISOR)
    count, asked = rooms or count, dict(options or {})
    named = "".join(f"-{flag.strip('-')}-{value}" for flag, value in asked.items())
    path = _rows_path(seed, named)
    known: dict[str, dict[str, Any]] = {} if quick else {row["key"]: row for row in _kept(path)}
    limit_s, start_s = float(os.environ.get("DAYLIT_BENCH_CPU_S", "inf")), time.process_time()
    rows = []
    for number, use in truth_list("test", count, seed):
        key = f"{use}-{number}-{divisor}"
        if key not in known:
            if time.process_time() - start_s > limit_s:
                print(f"{len(known)} of {count} rooms are done; run again to go on", file=sys.stderr)
                break
            try:
                row = measured(number, use, profile, divisor, "draft" if quick else "standard", asked)
            except ProcessingError as error:
                row = {"room": f"{use}-{number}", "refused": f"{error.code}: {error.message}"}
            known[key] = {"key": key, **row}
            if not quick:
                with path.open("a", encoding="utf-8") as file:
                    file.write(json.dumps(known[key]) + "\n")
        rows.append(known[key])
    return rows


def kept_rows(seed: int) -> list[dict[str, Any]]:
    """Return the rows that full runs of today's code have left; none where there was no such run."""
    return _kept(_rows_path(seed))


def _rows_path(seed: int, named: str = "") -> Path:
    return default_folder().parent / f"end-to-end-rows-{seed}{named}-{_digest('processing', 'mocks')}.jsonl"


def _kept(path: Path) -> list[dict[str, Any]]:
    return [json.loads(line) for line in path.read_text("utf-8").splitlines()] if path.is_file() else []


def _digest(*folders: str) -> str:
    """Return a digest of the code that rows depend on."""
    digest = hashlib.sha256()
    files = [path for folder in folders for path in sorted((ROOT / folder).rglob("*.py"))]
    for path in [*files, *sorted((ROOT / "benchmarks" / "whole").glob("end_to_end_r*.py"))]:
        digest.update(path.name.encode() + path.read_bytes())
    return os.environ.get("DAYLIT_BENCH_ROWS", digest.hexdigest()[:12])

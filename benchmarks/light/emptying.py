"""Emptied rooms in their own light: what the stages light and remove make, against the truly emptied room.

Rows are those of `end_to_end`: simulated rooms of test seeds through the whole pipeline, nothing given. ``filled_*``:
where removal filled in; ``all_*``: all valid pixels; ``near_holes_*``: seen pixels within 4 degrees of what was filled,
where ghosts would be; ``staged_*``: the first staged picture where furniture changes it; ``pane_worst_pct``: the worst
pane's mean radiance towards the camera against what the camera sees on it; ``depth_err_pct``: distance of the old
furniture's stand-ins. Medians over rooms, but for the worst pane. Rival: ``keep``, the same rooms with the shade kept
(what every other tool does), in a quick run only on the first room.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from benchmarks.whole.end_to_end import rig_profile, rows_of

KEYS = {
    "filled_median_err_pct": "empty_median_err_pct",
    "filled_bias_pct": "empty_bias_pct",
    "all_median_err_pct": "empty_all_median_err_pct",
    "near_holes_p95_err_pct": "empty_near_p95_err_pct",
    "staged_median_err_pct": "staged_median_err_pct",
    "staged_bias_pct": "staged_bias_pct",
    "depth_err_pct": "depth_err_pct",
}
"""Key of this benchmark: key of an end-to-end row."""
STAGES = ("light", "remove")


def run(*, quick: bool, seed: int) -> dict[str, Any]:
    """Return metrics; see the module's docstring."""
    profile = rig_profile(seed)
    rows = rows_of(profile, seed, quick=quick)
    kept = rows_of(profile, seed, quick=quick, rooms=1 if quick else None, options={"--shade": "keep"})
    return {"metrics": _metrics(rows), "rivals": {"keep": _metrics(kept)}, "notes": [_line(row) for row in rows]}


def _metrics(rows: Sequence[dict[str, Any]]) -> dict[str, float]:
    found = {name: _median(rows, key) for name, key in KEYS.items() if any(key in row for row in rows)}
    panes = [row["pane_worst_pct"] for row in rows if "pane_worst_pct" in row]
    spent = [sum(row["stage_cpu_s"].get(stage, 0.0) for stage in STAGES) for row in rows if "stage_cpu_s" in row]
    return found | {"pane_worst_pct": max(panes, default=0.0), "cpu_s": round(float(np.median(spent)), 2)}


def _median(rows: Sequence[dict[str, Any]], key: str) -> float:
    return round(float(np.median([row[key] for row in rows if key in row])), 3)


def _line(row: dict[str, Any]) -> str:
    return f"{row['room']}: " + ", ".join(f"{name} {row[key]:.3g}" for name, key in KEYS.items() if key in row)

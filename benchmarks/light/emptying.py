"""Emptied rooms in their own light: what the stages light and remove make, against the truly emptied room.

Rows are those of `end_to_end`: simulated rooms of test seeds through the whole pipeline, nothing given. ``filled_*``:
where removal filled in; ``all_*``: all valid pixels; ``near_holes_*``: seen pixels within 4 degrees of what was filled,
where ghosts would be; ``staged_*``: the first staged picture where furniture changes it; ``pane_worst_pct``: the worst
pane's mean radiance towards the camera against what the camera sees on it; ``depth_err_pct``: distance of the old
furniture's stand-ins. Medians over rooms, but for the worst pane. Rival: ``keep``, the same rooms with the shade kept
(what every other tool does), in a quick run only on the first room.

``infinigen_*``: rooms of another generator and another renderer (Infinigen Indoors, Cycles), furnished and emptied
under the same daylight, as single panoramas in relative units without a picture of the sky; left out where they are not
beside the checkout.
"""

from __future__ import annotations

import tempfile
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.shared_data import DATA
from benchmarks.whole.end_to_end import rig_profile, rows_of
from benchmarks.whole.end_to_end_run import bias_pct, errors_of
from processing.pictures.exr import read_exr, read_exr_rgb
from processing.pictures.images import luminance_cd_m2
from processing.pictures.preview import read_mask
from processing.running.panorama_session import panorama_session
from processing.running.requests import RunRequest
from processing.running.runner import process
from processing.stages.contract import Quality

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
    lifted, others = _metrics(rows), _metrics(kept)
    independent, notes = _independent()
    lifted |= independent.get("lift", {})
    others |= independent.get("keep", {})
    return {"metrics": lifted, "rivals": {"keep": others}, "notes": [*(_line(row) for row in rows), *notes]}


def _independent() -> tuple[dict[str, dict[str, float]], list[str]]:
    """Return metrics by ``--shade``, medians over the rooms of Infinigen, and notes."""
    pairs = sorted(path.parent for path in (DATA / "infinigen").glob("*/furnished.exr"))
    if not pairs:
        return {}, [f"infinigen: left out, no pairs of pictures in {DATA / 'infinigen'}"]
    rows = {shade: [infinigen_row(pair, shade) for pair in pairs] for shade in ("lift", "keep")}
    names = ("filled_median_err_pct", "filled_bias_pct", "all_median_err_pct", "all_bias_pct")
    found = {
        shade: {f"infinigen_{name}": _median(mine, name) for name in names if any(name in row for row in mine)}
        for shade, mine in rows.items()
    }
    return found, [f"infinigen {row['room']}, {shade}: {row}" for shade, mine in rows.items() for row in mine]


def infinigen_row(pair: Path, shade: str) -> dict[str, Any]:
    """Return the errors of one room, ``furnished.exr`` emptied and compared with ``empty.exr`` of the same folder."""
    before, true = (read_exr_rgb(pair / f"{name}.exr")[0] for name in ("furnished", "empty"))
    with tempfile.TemporaryDirectory() as folder:
        session = panorama_session(pair / "furnished.exr", Path(folder) / pair.name)
        asked: dict[str, object] = {"--shade": shade, "--doubtful-room": True}
        done = process(session, RunRequest(quality=Quality.STANDARD, until="remove", options=asked))
        row: dict[str, Any] = {
            "room": pair.name,
            "left_out": [s.stage for s in done.stages if s.summary.get("skipped")],
        }
        made = session / "stages" / "remove"
        if not (made / "empty.exr").is_file():
            return row
        given = luminance_cd_m2(read_exr(session / "stages" / "calibrate" / "indoor.exr").rgb)
        scale = np.float32(np.median(luminance_cd_m2(before)) / np.median(given))
        rgb, filled = scale * read_exr(made / "empty.exr").rgb, read_mask(made / "filled.png")
    ours, whole = luminance_cd_m2(rgb).astype(np.float64), np.ones(filled.shape, bool)
    for name, where in (("filled", filled), ("all", whole)):
        row |= errors_of(name, rgb, true, where)
        row[f"{name}_bias_pct"] = bias_pct(ours, luminance_cd_m2(true).astype(np.float64), where)
    return row


def _metrics(rows: Sequence[dict[str, Any]]) -> dict[str, float]:
    found = {name: _median(rows, key) for name, key in KEYS.items() if any(key in row for row in rows)}
    panes = [row["pane_worst_pct"] for row in rows if "pane_worst_pct" in row]
    spent = [sum(row["stage_cpu_s"].get(stage, 0.0) for stage in STAGES) for row in rows if "stage_cpu_s" in row]
    return found | {"pane_worst_pct": max(panes, default=0.0), "cpu_s": round(float(np.median(spent)), 2)}


def _median(rows: Sequence[dict[str, Any]], key: str) -> float:
    return round(float(np.median([row[key] for row in rows if key in row])), 3)


def _line(row: dict[str, Any]) -> str:
    return f"{row['room']}: " + ", ".join(f"{name} {row[key]:.3g}" for name, key in KEYS.items() if key in row)

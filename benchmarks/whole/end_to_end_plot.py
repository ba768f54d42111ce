"""The end-to-end benchmark for people: lines a room and a figure, and a plot of each stage's errors and times."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

COLUMNS = {
    "luminance_median_err_pct": "luminance %",
    "iou3d": "room IoU",
    "furniture_iou": "furniture IoU",
    "empty_median_err_pct": "emptied %",
    "albedo_median_err": "albedo",
    "staged_median_err_pct": "staged %",
    "cpu_s": "CPU s",
}
PLOT = Path(__file__).resolve().parents[2] / "docs" / "images" / "end-to-end.png"
BETTER_HIGH = ("iou", "recall")
"""Parts of the names of figures of which the least is the worst."""
SIGNED = "bias"
"""Part of the names of figures of which the one farthest from 0 is the worst."""


def table_lines(rows: Sequence[dict[str, Any]]) -> list[str]:
    """Return a line a room."""
    lines = []
    for row in rows:
        if "refused" in row:
            lines.append(f"{row['room']}: {row['refused']}")
            continue
        text = ", ".join(f"{name} {row[key]:.3g}" for key, name in COLUMNS.items() if key in row)
        missing = "".join(f"; {stage}: {why}" for stage, why in row.get("left_out", {}).items())
        lines.append(f"{row['room']}: {text}{missing}")
    return lines


def worst_of(rows: Sequence[dict[str, Any]], key: str) -> dict[str, Any]:
    """Return the row with the worst value of a figure that at least one row has."""
    having = [row for row in rows if key in row]
    if SIGNED in key:
        return max(having, key=lambda row: abs(row[key]))
    return (min if any(part in key for part in BETTER_HIGH) else max)(having, key=lambda row: row[key])


def spread_lines(rows: Sequence[dict[str, Any]], keys: Sequence[str]) -> list[str]:
    """Return a line a figure: median, quartiles, the worst value and its room, and how many rooms have it."""
    lines = []
    for key in keys:
        values = [row[key] for row in rows if key in row]
        low, middle, high = np.quantile(values, (0.25, 0.5, 0.75))
        worst = worst_of(rows, key)
        text = f"median {middle:.4g}, quartiles {low:.4g} and {high:.4g}, worst {worst[key]:.4g} ({worst['room']})"
        lines.append(f"{key}: {text}, {len(values)} rooms")
    return lines


def write_plot(rows: Sequence[dict[str, Any]], path: Path = PLOT) -> None:
    """Draw the rooms' errors, a strip a figure with median and quartiles, and the stages' median CPU time."""
    from matplotlib.figure import Figure

    shown = [(key, name) for key, name in COLUMNS.items() if key != "cpu_s" and any(key in row for row in rows)]
    if not shown:
        return
    figure = Figure(figsize=(9, 4.2), layout="constrained")
    above, below = figure.subfigures(2, 1, squeeze=False, height_ratios=(3, 2))[:, 0]
    for axes, (key, name) in zip(above.subplots(1, len(shown), squeeze=False)[0], shown, strict=True):
        _strip(axes, name, [row[key] for row in rows if key in row])
    above.suptitle(f"End to end, {len(rows)} simulated test rooms: a dot a room, median and quartiles", fontsize=10)
    _times(below.subplots(), rows)
    path.parent.mkdir(parents=True, exist_ok=True)
    figure.savefig(path, dpi=110)


def _strip(axes: Any, name: str, values: Sequence[float]) -> None:
    """Draw one figure's values, beside one another where they are alike."""
    ordered = np.sort(np.asarray(values, np.float64))
    low, middle, high = np.quantile(ordered, (0.25, 0.5, 0.75))
    axes.axhspan(low, high, color="#c0504d", alpha=0.15, linewidth=0)
    axes.axhline(middle, color="#c0504d", linewidth=1.5)
    axes.plot(np.arange(len(ordered)) * 0.618 % 1, ordered, "o", color="#3a6ea5", alpha=0.6, markersize=4)
    axes.set_title(f"{name}\n{middle:.3g}", fontsize=9)
    axes.set_xticks([])
    axes.set_xlim(-0.3, 1.3)
    axes.set_ylim(0, 1.03 if "IoU" in name else max(ordered[-1] * 1.1, 1e-9))
    axes.tick_params(labelsize=8)


def _times(axes: Any, rows: Sequence[dict[str, Any]]) -> None:
    """Draw the median CPU time of each stage, in the order in which they run."""
    spent: dict[str, list[float]] = {}
    for row in rows:
        for stage, seconds in row.get("stage_cpu_s", {}).items():
            spent.setdefault(stage, []).append(seconds)
    medians = [float(np.median(values)) for values in spent.values()]
    bars = axes.bar(list(spent), medians, color="#3a6ea5", alpha=0.7)
    axes.bar_label(bars, [f"{value:.1f}" for value in medians], fontsize=8)
    axes.set_ylabel("CPU s a room", fontsize=8)
    axes.set_ylim(0, max(medians, default=1.0) * 1.2 + 1e-9)
    axes.tick_params(labelsize=8)

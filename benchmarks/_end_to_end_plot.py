"""The end-to-end benchmark for people: a table of all rooms, and a plot of each stage's errors."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

COLUMNS = {
    "luminance_median_err_pct": "luminance %",
    "iou3d": "room IoU",
    "furniture_iou": "furniture IoU",
    "empty_median_err_pct": "emptied %",
    "albedo_median_err": "albedo",
    "staged_median_err_pct": "staged %",
    "cpu_s": "CPU s",
}
PLOT = Path(__file__).resolve().parents[1] / "docs" / "images" / "end-to-end.png"


def table_lines(rows: Sequence[dict[str, Any]]) -> list[str]:
    """Return a line a room."""
    lines = []
    for row in rows:
        if "refused" in row:
            lines.append(f"{row['room']}: {row['refused']}")
            continue
        told = ", ".join(f"{name} {row[key]:.3g}" for key, name in COLUMNS.items() if key in row)
        missing = "".join(f"; {stage}: {why}" for stage, why in row.get("left_out", {}).items())
        lines.append(f"{row['room']}: {told}{missing}")
    return lines


def write_plot(rows: Sequence[dict[str, Any]]) -> None:
    """Draw the rooms' errors, a strip a stage, into docs/images."""
    from matplotlib.figure import Figure

    shown = [(key, name) for key, name in COLUMNS.items() if key != "cpu_s" and any(key in row for row in rows)]
    if not shown:
        return
    figure = Figure(figsize=(9, 2.6), layout="constrained")
    for axes, (key, name) in zip(figure.subplots(1, len(shown), squeeze=False)[0], shown, strict=True):
        values = sorted(row[key] for row in rows if key in row)
        middle = values[len(values) // 2]
        axes.plot([0.5] * len(values), values, "o", color="#3a6ea5", alpha=0.5, markersize=5)
        axes.axhline(middle, color="#c0504d", linewidth=1.5)
        axes.set_title(f"{name}\nmedian {middle:.3g}", fontsize=9)
        axes.set_xticks([])
        axes.set_ylim(0, 1 if "IoU" in name else max(values) * 1.1 + 1e-9)
        axes.tick_params(labelsize=8)
    figure.suptitle(f"End to end, {len(rows)} simulated test rooms, a dot a room", fontsize=10)
    PLOT.parent.mkdir(parents=True, exist_ok=True)
    figure.savefig(PLOT, dpi=110)

"""Plot of the arrangement benchmark: how long one arrangement takes, ours against rivals, in the same rooms."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks._plots import IMAGES

STYLES = ("-", "--", "-.", ":")


def time_plot(large: Sequence[dict[str, Any]], path: Path) -> Path:
    """Draw the share of rooms of 12 m2 and more over the CPU time within which each method has answered."""
    import matplotlib as mpl

    mpl.use("Agg")
    from matplotlib import pyplot as plt

    figure, axes = plt.subplots(figsize=(6.4, 4.0), layout="constrained")
    done = [row for row in large if "refused" not in row]
    lines = {
        "one arrangement": [row["one_ms"][0] for row in done],
        "seven different ones": [row["seven_ms"][0] for row in done],
        "trial with shapely alone": [row["trial"][0] for row in done if "trial" in row],
        "CP-SAT, paths not looked at": [row["cp_sat_ms"] for row in done if row.get("cp_sat_ms") is not None],
    }
    for style, (name, times) in zip(STYLES, lines.items(), strict=True):
        share = 100 * (np.arange(len(times)) + 1) / max(1, len(times))
        axes.step(np.sort(times), share, style, where="post", lw=1.8, label=f"{name} ({len(times)} rooms)")
    axes.axhline(95, color="0.8", lw=1, zorder=0)
    axes.set(xscale="log", xlabel="CPU time, ms", ylabel="% of rooms answered", ylim=(0, 101))
    axes.grid(visible=True, axis="x", color="0.92")
    axes.legend(fontsize=8, loc="lower right", frameon=False)
    target = path if path.is_absolute() else IMAGES / path
    target.parent.mkdir(parents=True, exist_ok=True)
    figure.savefig(target, dpi=110)
    plt.close(figure)
    return target

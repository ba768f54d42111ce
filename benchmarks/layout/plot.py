"""Plot of the arrangement benchmark: how long one arrangement takes, ours against rivals, in the same rooms."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.plots import IMAGES

STYLES = ("-", "--", "-.", ":")


def time_plot(large: Sequence[dict[str, Any]], path: Path) -> Path:
    """Draw the share of rooms of 12 m2 and more over the CPU time in which each method furnishes them."""
    import matplotlib as mpl

    mpl.use("Agg")
    from matplotlib import pyplot as plt

    figure, axes = plt.subplots(figsize=(6.4, 4.0), layout="constrained")
    done = [row for row in large if "refused" not in row]
    tried = [row for row in done if "trial" in row]
    lines = {
        "one arrangement": ([row["one_ms"][0] for row in done if row["complete"]], len(done)),
        "seven different ones": ([row["seven_ms"][0] for row in done if row["found_complete"]], len(done)),
        "trial with shapely alone": ([row["trial"][0] for row in tried if row["trial"][1]], len(tried)),
        "CP-SAT, where it has a solution; paths not looked at": _both([row["cp_sat_ms"] for row in tried]),
    }
    for style, (name, (times, count)) in zip(STYLES, lines.items(), strict=True):
        share = 100 * (np.arange(len(times)) + 1) / max(1, count)
        axes.step(np.sort(times), share, style, where="post", lw=1.8, label=f"{name} ({count} rooms)")
    axes.axhline(95, color="0.8", lw=1, zorder=0)
    axes.set(xscale="log", xlabel="CPU time, ms", ylabel="% of rooms fully furnished", ylim=(0, 101))
    axes.grid(visible=True, axis="x", color="0.92")
    figure.legend(fontsize=8, loc="outside lower center", ncols=2, frameon=False)
    target = path if path.is_absolute() else IMAGES / path
    target.parent.mkdir(parents=True, exist_ok=True)
    figure.savefig(target, dpi=110)
    plt.close(figure)
    return target


def _both(times: Sequence[float | None]) -> tuple[list[float], int]:
    known = [t for t in times if t is not None]
    return known, len(known)

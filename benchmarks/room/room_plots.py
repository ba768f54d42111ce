"""Plots of the room benchmark: is a stated confidence kept?"""

from __future__ import annotations

from pathlib import Path

import numpy as np

from benchmarks.plots import IMAGES


def reliability_plot(confidence: np.ndarray, right: np.ndarray, path: Path, title: str, groups: int = 4) -> Path:
    """Draw the share of right rooms over stated confidence, in groups of equal number, with binomial errors."""
    import matplotlib as mpl

    mpl.use("Agg")
    from matplotlib import pyplot as plt

    figure, axes = plt.subplots(figsize=(4.6, 4.2), layout="constrained")
    axes.plot([0, 1], [0, 1], color="0.7", lw=1)
    for group in np.array_split(np.argsort(confidence), min(groups, len(confidence))):
        share = float(right[group].mean())
        error = float(np.sqrt(max(share * (1 - share), 0.05) / len(group)))
        axes.errorbar(float(confidence[group].mean()), share, yerr=error, marker="o", color="#1864ab", capsize=3)
    axes.set(xlabel="stated confidence", ylabel="share with 3D IoU of 0.85 or more", xlim=(0, 1), ylim=(0, 1.05))
    axes.set_title(title, fontsize=10)
    target = path if path.is_absolute() else IMAGES / path
    target.parent.mkdir(parents=True, exist_ok=True)
    figure.savefig(target, dpi=110)
    plt.close(figure)
    return target

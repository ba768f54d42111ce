"""The plot of response errors over codes."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

import numpy as np
import numpy.typing as npt

from benchmarks.plots import IMAGES


def error_over_codes(errors: Mapping[str, npt.NDArray[np.float64]], first_code: int, path: Path) -> Path:
    """Draw the error (stops, mean of the channels) over codes: ours thick; above all methods, below the best ones."""
    import matplotlib as mpl

    mpl.use("Agg")
    from matplotlib import pyplot as plt

    figure, (wide, near) = plt.subplots(2, 1, figsize=(6.4, 5.6), sharex=True, layout="constrained")
    styles = ["-", "--", "-.", ":", (0, (5, 1)), (0, (1, 1)), (0, (3, 1, 1, 1))]
    for axes in (wide, near):
        for number, (name, error) in enumerate(errors.items()):
            codes = first_code + np.arange(len(error))
            width, colour = (2.2, "black") if name == "ours" else (1.0, f"C{number}")
            axes.plot(
                codes,
                error,
                linestyle=styles[number % len(styles)],
                color=colour,
                lw=width,
                label=name.replace("_", " "),
            )
        axes.grid(visible=True, color="0.9")
        axes.spines[["top", "right"]].set_visible(False)
        axes.axhspan(-0.006, 0.006, color="0.85", zorder=0)
    wide.set(ylim=(-0.15, 0.15), ylabel="stops", title="Error of the recovered response (grey: 0.006 stop)")
    near.set(ylim=(-0.02, 0.02), ylabel="stops", xlabel="code")
    wide.legend(frameon=False, fontsize=7, ncol=2, loc="lower right")
    target = path if path.is_absolute() else IMAGES / path
    target.parent.mkdir(parents=True, exist_ok=True)
    figure.savefig(target, dpi=110)
    plt.close(figure)
    return target

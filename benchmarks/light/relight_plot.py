"""Error against cost of relighting, as a picture: ``python -m benchmarks.light.relight_plot FILE.png``.

Figures of one room with sun and furniture at three heights, as `benchmarks.light.relight` and its kin measured them.
"""

from __future__ import annotations

import sys
from pathlib import Path

POINTS = {
    "stored rays": ((128, 0.057, 4.11), (256, 0.17, 2.48), (512, 0.26, 2.36)),
    "fresh render": ((128, 1.06, 5.08), (256, 4.74, 2.28), (512, 10.4, 2.29)),
}
"""Rows, CPU seconds, relative rms error in per cent."""


def plot(path: Path) -> None:
    """Write the plot."""
    import matplotlib

    matplotlib.use("Agg")
    from matplotlib import pyplot

    figure, axes = pyplot.subplots(figsize=(6.4, 3.4), layout="constrained")
    for (name, points), marker in zip(POINTS.items(), "os", strict=True):
        axes.plot([p[1] for p in points], [p[2] for p in points], marker=marker, label=name)
        for rows, cpu_s, error in points:
            axes.annotate(f"{rows}", (cpu_s, error), textcoords="offset points", xytext=(5, 5), fontsize=8)
    axes.set(xscale="log", ylim=(0, 6), xlabel="CPU seconds for one more light", ylabel="relative rms error, %")
    axes.grid(alpha=0.3)
    axes.legend(title="rows of the picture beside the points")
    figure.savefig(path, dpi=110)
    pyplot.close(figure)


if __name__ == "__main__":
    plot(Path(sys.argv[1]))

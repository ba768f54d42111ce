"""The plot of round trips: error against the faces' size."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from benchmarks.plots import IMAGES, MARKERS, Point


def error_against_size(points: Sequence[Point], path: Path, *, panorama_px: int) -> Path:
    """Draw each method's round-trip error (``Point.error``) against face size (``Point.seconds`` holds pixels)."""
    import matplotlib as mpl

    mpl.use("Agg")
    from matplotlib import pyplot as plt
    from matplotlib.ticker import NullFormatter, StrMethodFormatter

    figure, axes = plt.subplots(figsize=(6.4, 4.0), layout="constrained")
    for number, method in enumerate(dict.fromkeys(p.method for p in points)):
        mine = [p for p in points if p.method == method]
        axes.plot([p.seconds for p in mine], [p.error for p in mine], marker=MARKERS[number], lw=1, label=method)
    axes.set(
        xscale="log",
        yscale="log",
        xlabel="pixels across a cube face",
        ylabel="rms error / rms of the truth",
        title=f"Panorama of {panorama_px} px to six faces and back",
    )
    sizes = sorted({p.seconds for p in points})
    axes.set_xticks(sizes)
    axes.xaxis.set_major_formatter(StrMethodFormatter("{x:g}"))
    axes.xaxis.set_minor_formatter(NullFormatter())
    axes.grid(visible=True, which="major", color="0.9")
    axes.spines[["top", "right"]].set_visible(False)
    axes.legend(frameon=False, fontsize=8)
    target = path if path.is_absolute() else IMAGES / path
    figure.savefig(target, dpi=110)
    plt.close(figure)
    return target

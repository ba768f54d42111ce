"""Plots for the documentation: small, readable without colour, the same look everywhere."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

IMAGES = Path(__file__).resolve().parents[1] / "docs" / "images"
MARKERS = "osD^vP*X"


@dataclass(frozen=True)
class Point:
    """One measurement: what it cost, how far off it was, and which method made it."""

    method: str
    seconds: float
    error: float
    label: str = ""
    """Beside the point, such as the number of samples."""


def time_against_error(
    points: Sequence[Point], path: Path, *, title: str, error_label: str, seconds_label: str = "CPU seconds"
) -> Path:
    """Draw run time against error, both logarithmic, a line a method, and write it (PNG or SVG by the name).

    Below and to the left is better. ``path`` relative: in docs/images.
    """
    return times_against_errors([(title, points)], path, error_label=error_label, seconds_label=seconds_label)


def times_against_errors(
    panels: Sequence[tuple[str, Sequence[Point]]],
    path: Path,
    *,
    error_label: str,
    seconds_label: str = "CPU seconds",
    columns: int = 1,
) -> Path:
    """Draw panels of run time against error, a title and its points each, and write them as one picture.

    Both axes are logarithmic, a line is a method; ``path`` relative: in docs/images.
    """
    import matplotlib as mpl

    mpl.use("Agg")
    from matplotlib import pyplot as plt

    rows = -(-len(panels) // columns)
    shape = (6.4, 4.0) if columns == 1 else (4.7 * columns, 3.5 * rows)
    figure, grid = plt.subplots(rows, columns, figsize=shape, layout="constrained", squeeze=False)
    for axes, (title, points) in zip(grid.flat, panels, strict=False):
        _draw(axes, points)
        axes.set(xscale="log", yscale="log", xlabel=seconds_label, ylabel=error_label, title=title)
        _finish(axes)
    for axes in grid.flat[len(panels) :]:
        axes.set_axis_off()
    return save_figure(figure, path)


def _draw(axes: Axes, points: Sequence[Point]) -> None:
    for number, method in enumerate(dict.fromkeys(p.method for p in points)):
        mine = sorted((p for p in points if p.method == method), key=lambda p: p.seconds)
        marker = MARKERS[number % len(MARKERS)]
        axes.plot([p.seconds for p in mine], [p.error for p in mine], marker=marker, markersize=6, lw=1, label=method)
        for p in mine:
            place = (p.seconds, p.error)
            axes.annotate(p.label, place, textcoords="offset points", xytext=(6, 5), fontsize=8, color="0.3")


def _finish(axes: Axes) -> None:
    """Set plain numbers at 1, 2 and 5, a light grid and the legend."""
    from matplotlib.ticker import LogLocator, NullFormatter, StrMethodFormatter

    for axis in (axes.xaxis, axes.yaxis):
        axis.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0)))
        axis.set_major_formatter(StrMethodFormatter("{x:g}"))
        axis.set_minor_formatter(NullFormatter())
    axes.grid(visible=True, which="major", color="0.9")
    axes.margins(0.12)
    axes.spines[["top", "right"]].set_visible(False)
    axes.legend(frameon=False, fontsize=9)


def save_figure(figure: Figure, path: Path) -> Path:
    """Write and close a figure (PNG or SVG by the name); a relative ``path`` is within docs/images."""
    import matplotlib as mpl
    from matplotlib import pyplot as plt

    target = path if path.is_absolute() else IMAGES / path
    target.parent.mkdir(parents=True, exist_ok=True)
    # Without dates and random ids, so that equal figures give equal files.
    mpl.rcParams["svg.hashsalt"] = "daylit"
    figure.savefig(target, dpi=110, metadata={"Date": None} if target.suffix == ".svg" else None)
    plt.close(figure)
    return target

"""The merge's charts: error against noise, against the number of stops, and against run time."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.paired import cost_of
from benchmarks.photometry import merge_rivals as rivals
from benchmarks.photometry.merge_truth import summary, true_curve, true_noise, well_exposed
from benchmarks.photometry.synthetic_bracket import PAPER_TIMES_S, REFERENCE_SENSOR, SyntheticBracket, synthetic_bracket
from benchmarks.plots import Point, save_figure, time_against_error
from benchmarks.seeds import seeds
from processing.calibration.merge.merge import Merged, MergeOptions, merge
from processing.calibration.response.response import recover_response
from processing.calibration.response.samples import Bracket8
from processing.pictures.frames import array_frame
from processing.sphere import Equirectangular

SIZE = (1680, 840)
NOISE_TIMES = (1.0, 2.0, 3.0, 5.0, 10.0)
STOPS = (2, 3, 4, 5, 7, 9)
RANGE_OF_STOPS = (1.0, 1 / 1000)
"""Times of the chart over the number of stops: all brackets span these, so that they see the same pixels."""


def draw_all(seed: int) -> None:
    """Draw the three charts into docs/images."""
    number = seeds("test", 1, seed + 3)[0]
    against_noise(number)
    against_stops(number)
    pareto(number)


def ours(shot: SyntheticBracket, **options: Any) -> Merged:
    """Merge with true curve and noise."""
    frames = [array_frame(f, f"frame {i}") for i, f in enumerate(shot.frames)]
    place = Equirectangular(shot.radiance.shape[1], shot.radiance.shape[0])
    return merge(
        frames, shot.true_s, true_curve(shot), true_noise(shot), geometry=place, options=MergeOptions(**options)
    )


def self_calibrated(shot: SyntheticBracket) -> Merged:
    """Recover the curve first."""
    fit = recover_response([Bracket8(shot.frames, shot.nominal_s)])
    frames = [array_frame(f, f"frame {i}") for i, f in enumerate(shot.frames)]
    place = Equirectangular(shot.radiance.shape[1], shot.radiance.shape[0])
    return merge(frames, fit.times_s, fit.curve, fit.noise, geometry=place)


METHODS: dict[str, Callable[[SyntheticBracket], Any]] = {
    "daylit": lambda shot: self_calibrated(shot).image.rgb,
    "OpenCV Robertson": lambda shot: rivals.robertson(shot.frames, shot.true_s),
    "OpenCV Debevec": lambda shot: rivals.debevec(shot.frames, shot.true_s),
}


def noisy(seed: int, times: float) -> SyntheticBracket:
    """Return a bracket of a sensor with ``times`` the noise."""
    wells = REFERENCE_SENSOR.full_well_e / times**2
    read = REFERENCE_SENSOR.read_noise_e / REFERENCE_SENSOR.full_well_e * times * wells
    return synthetic_bracket(SIZE, seed, sensor=replace(REFERENCE_SENSOR, full_well_e=wells, read_noise_e=read))


def against_noise(seed: int) -> Path:
    """Draw median error over noise."""
    lines: dict[str, list[float]] = {name: [] for name in METHODS}
    for times in NOISE_TIMES:
        shot = noisy(seed, times)
        good = well_exposed(shot)
        for name, method in METHODS.items():
            lines[name].append(summary(method(shot), shot, good).median)
    return _lines(NOISE_TIMES, lines, "merge-noise.png", "Error against noise", "noise, times the reference sensor's")


def against_stops(seed: int) -> Path:
    """Draw median error over the number of stops of one range of times, known curve."""
    lines: dict[str, list[float]] = {"daylit, curve known": [], "OpenCV Robertson, curve known": []}
    good = None
    for count in STOPS:
        times = tuple(float(t) for t in np.geomspace(*RANGE_OF_STOPS, count))
        shot = synthetic_bracket(SIZE, seed, nominal_s=times)
        good = (shot.luminance > 1) & (shot.luminance < 2e4) if good is None else good
        lines["daylit, curve known"].append(summary(ours(shot).image.rgb, shot, good).median)
        response = rivals.opencv_response(true_curve(shot))
        theirs = rivals.robertson_merge(shot.frames, shot.true_s, response)
        lines["OpenCV Robertson, curve known"].append(summary(theirs, shot, good).median)
    return _lines(STOPS, lines, "merge-stops.png", "Error against stops, 1 s to 1/1000 s", "number of stops")


def pareto(seed: int) -> Path:
    """Draw error over CPU time: our qualities and numbers of stops, and the rivals."""
    shot = synthetic_bracket(SIZE, seed)
    good, points = well_exposed(shot), []
    for quality in ("draft", "standard", "reference"):
        points.append(
            _point("daylit, curve known", lambda q=quality: ours(shot, quality=q).image.rgb, shot, good, quality)
        )
    for step in (2, 4):
        few = replace(shot, frames=shot.frames[::step], nominal_s=PAPER_TIMES_S[::step], true_s=shot.true_s[::step])
        label = f"{len(few.frames)} stops"
        points.append(_point("daylit, fewer stops", lambda few=few: ours(few).image.rgb, few, good, label))
    for name, method in METHODS.items():
        label = name if name != "daylit" else ""
        named = "daylit, self-calibrated" if name == "daylit" else name
        points.append(_point(named, lambda method=method: method(shot), shot, good, label))
    return time_against_error(
        points,
        Path("merge-pareto.png"),
        title="Nine frames of 1680 x 840: run time against error",
        error_label="median error, stops",
    )


def _point(method: str, work: Callable[[], Any], shot: SyntheticBracket, good: Any, label: str) -> Point:
    found = summary(work(), shot, good)
    runs = 5
    cost = cost_of(lambda: [work() for _ in range(runs)])
    return Point(method, cost.cpu_s / runs, found.median, label)


def _lines(x: Sequence[float], lines: dict[str, list[float]], name: str, title: str, label: str) -> Path:
    import matplotlib as mpl

    mpl.use("Agg")
    from matplotlib import pyplot as plt
    from matplotlib.ticker import LogLocator, NullFormatter

    figure, axes = plt.subplots(figsize=(6.4, 4.0), layout="constrained")
    for (method, values), marker in zip(lines.items(), "osD^", strict=False):
        axes.plot(x, values, marker=marker, lw=1, label=method)
    axes.set(xscale="log", yscale="log", xlabel=label, ylabel="median error, stops", title=title)
    axes.set_xticks(list(x), [f"{v:g}" for v in x])
    axes.xaxis.minorticks_off()
    axes.yaxis.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0)))
    axes.yaxis.set_major_formatter("{x:g}")
    axes.yaxis.set_minor_formatter(NullFormatter())
    axes.grid(visible=True, which="major", color="0.92")
    axes.spines[["top", "right"]].set_visible(False)
    axes.legend(frameon=False, fontsize=9)
    return save_figure(figure, Path(name))

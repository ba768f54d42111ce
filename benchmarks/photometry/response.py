"""Response curves recovered from simulated brackets, against the simulated camera's own tone curves.

Errors are root mean squares in stops over codes 5..250 and the three channels, each channel free of its own mean over
those codes, for us and for the rivals alike. Brackets are the reference's: nine lossless frames of 6720 x 3360 (1680 x
840 in quick runs) of test seeds. ``cpu_s`` is the CPU time of our recovery with all frames in memory.
"""

from __future__ import annotations

import statistics
from collections.abc import Callable, Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from benchmarks.hostile.dorf import dorf_figures
from benchmarks.paired import cost_of
from benchmarks.photometry.response_rivals import colour_hdri, mitsunaga_nayar, opencv_debevec, opencv_robertson
from benchmarks.photometry.synthetic_bracket import REFERENCE_SENSOR, SyntheticBracket, jpeg_coded, synthetic_bracket
from benchmarks.plots import save_figure
from benchmarks.seeds import seeds
from mocks.optics.sensor import TrueShutter
from processing.calibration.response.response import ResponseFit, recover_response
from processing.calibration.response.samples import Bracket8
from processing.ground.arrays import Doubles

FULL_SIZE, QUICK_SIZE = (6720, 3360), (1680, 840)
FULL_BRACKETS, QUICK_BRACKETS = 2, 2
RUNS = 3
FIRST, LAST = 5, 250
JPEG_QUALITY = 95
PLOT = Path("response.png")
COLOUR_HDRI_SAMPLES, QUICK_COLOUR_HDRI_SAMPLES = 150, 75
"""Samples given to colour-hdri; its defaults take more than a minute of CPU."""
WARM_SIZE = (336, 168)


def run(*, quick: bool, seed: int) -> dict[str, Any]:
    """Return metrics; see the module's docstring."""
    size = QUICK_SIZE if quick else FULL_SIZE
    chosen = seeds("test", QUICK_BRACKETS if quick else FULL_BRACKETS, seed)
    truth = true_curves()
    fits: list[ResponseFit] = []
    found: dict[str, list[Doubles]] = {}
    costs: dict[str, list[float]] = {}
    jpeg: list[Doubles] = []
    ways = methods(QUICK_COLOUR_HDRI_SAMPLES if quick else COLOUR_HDRI_SAMPLES)
    for number in chosen:
        bracket = synthetic_bracket(size, number)
        for name, method in ways.items():
            # Once unmeasured: imports are not the method's.
            if number == chosen[0]:
                method(synthetic_bracket(WARM_SIZE, number) if quick else bracket)
            curves: list[Doubles] = []
            runs = RUNS if name == "ours" else 1
            cost = [cost_of(lambda m=method, b=bracket, c=curves: c.append(m(b))).cpu_s for _ in range(runs)]
            found.setdefault(name, []).append(curves[0])
            costs.setdefault(name, []).append(statistics.median(cost))
        fits.append(recover_response([as_bracket(bracket)]))
        coded = replace(bracket, frames=tuple(jpeg_coded(frame, JPEG_QUALITY) for frame in bracket.frames))
        jpeg.append(recover_response([as_bracket(coded)]).curve.log2_exposure)
    errors = {name: [aligned(curve, truth) for curve in curves] for name, curves in found.items()}
    rms = {name: float(np.sqrt(np.mean(np.square(one)))) for name, one in errors.items()}
    rivals = {
        name: {"rms_stops": round(rms[name], 5), "cpu_s": round(statistics.median(costs[name]), 3)}
        for name in rms
        if name != "ours"
    }
    jpeg_rms = float(np.sqrt(np.mean([np.square(aligned(curve, truth)) for curve in jpeg])))
    metrics = {
        "rms_stops": round(rms["ours"], 5),
        "worst_stops": round(float(np.abs(errors["ours"]).max()), 4),
        "cpu_s": round(statistics.median(costs["ours"]), 3),
        "rival_best_rms_stops": min(rival["rms_stops"] for rival in rivals.values()),
        "jpeg_rms_stops": round(jpeg_rms, 5),
        "balance_stops": round(max(np.ptp((f.curve.log2_exposure - truth)[:, 20:236].mean(axis=1)) for f in fits), 4),
        **agreement(fits, truth),
        **unknown_times(QUICK_SIZE, chosen[0], truth),
        **dorf_figures(seed, quick=quick),
    }
    if not quick:
        error_over_codes({name: one[0].mean(axis=0) for name, one in errors.items()}, FIRST, PLOT)
    notes = [f"{len(chosen)} brackets of {size[0]} x {size[1]}, test seeds {chosen}"]
    return {"metrics": metrics, "rivals": rivals, "units": {"cpu_s": "s"}, "notes": notes}


def true_curves() -> Doubles:
    """Return the log2 exposure (3, 256) of each code of the simulated camera."""
    codes = np.clip(np.arange(256), 0.25, 255) / 255
    return np.stack([np.log2(tone.decode(codes)) for tone in REFERENCE_SENSOR.tone])


def aligned(curve: Doubles, truth: Doubles) -> Doubles:
    """Return the error (3, codes) in stops over codes 5..250, each channel free of its mean."""
    error = (curve - truth)[:, FIRST : LAST + 1]
    return np.asarray(error - error.mean(axis=1, keepdims=True))


def as_bracket(bracket: SyntheticBracket) -> Bracket8:
    """Return the frames with their true times."""
    return Bracket8(bracket.frames, bracket.true_s)


def methods(colour_hdri_samples: int) -> dict[str, Callable[[SyntheticBracket], Doubles]]:
    """Return each method: a bracket to log2 exposure (3, 256)."""

    return {
        "ours": lambda bracket: recover_response([as_bracket(bracket)]).curve.log2_exposure,
        "opencv_debevec": opencv_debevec,
        "opencv_robertson_every_8th": opencv_robertson,
        "colour_hdri": lambda bracket: colour_hdri(bracket, colour_hdri_samples),
        "mitsunaga_nayar": mitsunaga_nayar,
    }


def agreement(fits: list[ResponseFit], truth: Doubles) -> dict[str, float]:
    """Return the shares (per cent) of codes where brackets agree, and are right, within 1 and 2 stated sigmas."""
    pairs, right = [], []
    for i, one in enumerate(fits):
        right.append(_z(one.curve.log2_exposure - truth, one.curve.sigma_log2))
        for other in fits[:i]:
            sigma = np.hypot(one.curve.sigma_log2, other.curve.sigma_log2)
            pairs.append(_z(one.curve.log2_exposure - other.curve.log2_exposure, sigma))
    both = {"agree": np.array(pairs), "right": np.array(right)}
    return {f"{name}_{k}sigma_pct": round(100 * float((z < k).mean()), 1) for name, z in both.items() for k in (1, 2)}


def _z(difference: Doubles, sigma: Doubles) -> Doubles:
    centred = difference - difference[:, 128:129]
    return np.asarray(np.abs(centred / np.maximum(sigma, 1e-12))[:, FIRST : LAST + 1])


def unknown_times(size: tuple[int, int], seed: int, truth: Doubles) -> dict[str, float]:
    """Return errors with nominal times given while the shutter opens for powers of two."""
    sensor = replace(REFERENCE_SENSOR, true_shutter=TrueShutter.THIRDS_OF_STOPS)
    bracket = synthetic_bracket(size, seed, sensor=sensor)
    fit = recover_response([Bracket8(bracket.frames, bracket.nominal_s)], estimate_times=True)
    off = np.abs(np.log2(np.array(fit.times_s) / bracket.true_s)).max()
    error = aligned(fit.curve.log2_exposure, truth)
    return {
        "unknown_times_rms_stops": round(float(np.sqrt(np.mean(np.square(error)))), 5),
        "times_worst_stops": round(float(off), 5),
    }


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
    return save_figure(figure, path)

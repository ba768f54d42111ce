"""The merge: cost beside OpenCV's, error against known truth, honest uncertainty, memory.

``cpu_ratio_*``: our CPU seconds over OpenCV's merge, curve known to both, frames in memory (compilation done before;
it is in ``compile_cpu_s``). ``decode_ratio``: wall time of decoding and merging nine JPEGs over decoding them one after
the other (``decode_cpu_ratio``: the same of CPU time). Errors are of self-calibrated merges in stops, one scale fixed
at 50..200 cd/m2, over well exposed pixels of 0.13..2e5 cd/m2
(`benchmarks.photometry.merge_truth`); ``known_*``: curve and
noise given. ``nominal_*``: times as the camera names them are given, true ones are powers of two.
"""

from __future__ import annotations

import tempfile
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import simplejpeg

from benchmarks.memory import peak_mb
from benchmarks.paired import compare, cost_of
from benchmarks.photometry import merge_rivals as rivals
from benchmarks.photometry.merge_plots import draw_all
from benchmarks.photometry.merge_truth import Summary, summary, true_curve, true_noise, well_exposed
from benchmarks.photometry.synthetic_bracket import REFERENCE_SENSOR, SyntheticBracket, jpeg_coded, synthetic_bracket
from benchmarks.seeds import seeds
from mocks.optics.sensor import TrueShutter
from processing.calibration.merge.merge import Merged, MergeOptions, merge
from processing.calibration.response.response import recover_response
from processing.calibration.response.samples import Bracket8
from processing.pictures.frames import FrameSource, array_frame, jpeg_frame
from processing.sphere import Equirectangular

FULL_SIZE, QUICK_SIZE, SMALL_SIZE, TINY_SIZE = (6720, 3360), (1680, 840), (1680, 840), (210, 105)
QUALITY = 95


def run(*, quick: bool, seed: int) -> dict[str, Any]:
    """Return metrics; see the module's docstring."""
    size = QUICK_SIZE if quick else FULL_SIZE
    first, second = seeds("test", 2, seed)
    shot = synthetic_bracket(size, first)
    compile_cost = cost_of(lambda: known(shot))
    good = well_exposed(shot)
    metrics: dict[str, Any] = {"compile_cpu_s": round(compile_cost.cpu_s, 2)}
    metrics |= costs(shot, pairs=1 if quick else 3) | errors(shot, good, second)
    metrics["peak_mb"] = round(memory_mb(shot), 1)
    found = {name: figures(summary(work(shot.frames, shot.true_s), shot, good)) for name, work in rivals.ALL.items()}
    tiny = synthetic_bracket(TINY_SIZE, first)
    for name, work in rivals.SMALL.items():
        found[name] = figures(summary(work(tiny.frames, tiny.true_s), tiny, well_exposed(tiny)))
    if not quick:
        draw_all(seed)
    return {
        "metrics": metrics,
        "rivals": found,
        "units": {"merge_cpu_s": "s", "self_calibrated_cpu_s": "s", "compile_cpu_s": "s, once"},
        "notes": [f"{size[0]} x {size[1]}; colour_hdri at {TINY_SIZE[0]} x {TINY_SIZE[1]}"],
    }


def known(shot: SyntheticBracket, **options: Any) -> Merged:
    """Merge frames in memory with the true curve and noise."""
    frames = [array_frame(frame, f"frame {i}") for i, frame in enumerate(shot.frames)]
    return merge(
        frames,
        shot.true_s,
        true_curve(shot),
        true_noise(shot),
        geometry=geometry(shot),
        options=MergeOptions(**options),
    )


def self_calibrated(
    shot: SyntheticBracket, sources: Sequence[FrameSource] | None = None, *, estimate_times: bool = False
) -> Merged:
    """Recover curve and noise from the frames themselves, then merge; only nominal times are given."""
    fit = recover_response([Bracket8(shot.frames, shot.nominal_s)], estimate_times=estimate_times)
    frames = sources or [array_frame(frame, f"frame {i}") for i, frame in enumerate(shot.frames)]
    return merge(frames, fit.times_s, fit.curve, fit.noise, geometry=geometry(shot), time_sigma=fit.time_sigma)


def geometry(shot: SyntheticBracket) -> Equirectangular:
    """Return the geometry of a bracket's frames."""
    return Equirectangular(shot.radiance.shape[1], shot.radiance.shape[0])


def costs(shot: SyntheticBracket, pairs: int) -> dict[str, float]:
    """Return CPU ratios to OpenCV's merges, CPU of the self-calibrated whole, and the ratio to decoding."""
    response = rivals.opencv_response(true_curve(shot))
    ours = lambda: known(shot)  # noqa: E731
    robertson = compare(ours, lambda: rivals.robertson_merge(shot.frames, shot.true_s, response), pairs=pairs)
    debevec = compare(ours, lambda: rivals.debevec_merge(shot.frames, shot.true_s, response), pairs=pairs)
    table = compare(ours, lambda: rivals.table_merge(shot.frames, shot.true_s, response), pairs=pairs)
    whole = min((cost_of(lambda: self_calibrated(shot)) for _ in range(2)), key=lambda cost: cost.cpu_s)
    return {
        "cpu_ratio_robertson": round(robertson.cpu_ratio, 4),
        "cpu_ratio_debevec": round(debevec.cpu_ratio, 4),
        "cpu_ratio_table": round(table.cpu_ratio, 4),
        "table_cpu_s": round(table.rival.cpu_s, 3),
        "merge_cpu_s": round(robertson.ours.cpu_s, 3),
        "merge_wall_s": round(robertson.ours.wall_s, 3),
        "robertson_cpu_s": round(robertson.rival.cpu_s, 3),
        "debevec_cpu_s": round(debevec.rival.cpu_s, 3),
        "self_calibrated_cpu_s": round(whole.cpu_s, 3),
    } | decoding(shot, pairs)


def decoding(shot: SyntheticBracket, pairs: int) -> dict[str, float]:
    """Return what decoding and merging takes over decoding alone."""
    coded = [cv2.imencode(".jpg", f[..., ::-1], [cv2.IMWRITE_JPEG_QUALITY, QUALITY])[1].tobytes() for f in shot.frames]
    curve, noise = true_curve(shot), true_noise(shot)

    def whole() -> object:
        frames = [jpeg_frame(data, f"frame {i}") for i, data in enumerate(coded)]
        return merge(frames, shot.true_s, curve, noise, geometry=geometry(shot))

    def alone() -> object:
        return [simplejpeg.decode_jpeg(data, "RGB") for data in coded]

    found = compare(whole, alone, pairs=max(pairs, 3))
    return {"decode_ratio": round(found.wall_ratio, 3), "decode_cpu_ratio": round(found.cpu_ratio, 3)}


def errors(shot: SyntheticBracket, good: Any, seed: int) -> dict[str, float]:
    """Return errors and coverage: self-calibrated and with all known; JPEG; true times unknown."""
    found = self_calibrated(shot).image
    plain = summary(found.rgb, shot, good, found.uncertainty)
    best = known(shot).image
    floor = summary(best.rgb, shot, good, best.uncertainty)
    coded = replace(shot, frames=tuple(jpeg_coded(frame, QUALITY) for frame in shot.frames))
    from_jpeg = self_calibrated(coded).image
    jpeg = summary(from_jpeg.rgb, coded, good, from_jpeg.uncertainty)
    sensor = replace(REFERENCE_SENSOR, true_shutter=TrueShutter.THIRDS_OF_STOPS)
    nominal = synthetic_bracket(SMALL_SIZE, seed, sensor=sensor)
    image = self_calibrated(nominal, estimate_times=True).image
    timed = summary(image.rgb, nominal, well_exposed(nominal), image.uncertainty)
    return {
        "median_err_stops": round(plain.median, 4),
        "p95_err_stops": round(plain.p95, 4),
        "decade_bias_stops": round(plain.decade_bias, 4),
        "coverage68_pct": round(100 * plain.coverage68, 2),
        "coverage95_pct": round(100 * plain.coverage95, 2),
        "known_median_err_stops": round(floor.median, 4),
        "known_p95_err_stops": round(floor.p95, 4),
        "known_decade_bias_stops": round(floor.decade_bias, 4),
        "jpeg_median_err_stops": round(jpeg.median, 4),
        "jpeg_p95_err_stops": round(jpeg.p95, 4),
        "jpeg_decade_bias_stops": round(jpeg.decade_bias, 4),
        "jpeg_coverage68_pct": round(100 * jpeg.coverage68, 2),
        "jpeg_coverage95_pct": round(100 * jpeg.coverage95, 2),
        "nominal_median_err_stops": round(timed.median, 4),
        "nominal_p95_err_stops": round(timed.p95, 4),
        "false_ghost_pct": round(100 * float(np.mean(found.ghost > 0)), 4) if found.ghost is not None else 0.0,
        "jpeg_false_ghost_pct": round(100 * float(np.mean(from_jpeg.ghost > 0)), 4)
        if from_jpeg.ghost is not None
        else 0.0,
    }


def figures(found: Summary) -> dict[str, float]:
    """Return a rival's errors."""
    return {
        "median_err_stops": round(found.median, 4),
        "p95_err_stops": round(found.p95, 4),
        "decade_bias_stops": round(found.decade_bias, 4),
    }


def memory_mb(shot: SyntheticBracket) -> float:
    """Return the peak memory of a fresh process that loads the frames and merges them."""
    with tempfile.TemporaryDirectory() as folder:
        np.savez(Path(folder) / "frames.npz", *shot.frames)
        return peak_mb(_load_and_merge, folder, shot.true_s)


def _load_and_merge(folder: str, times_s: Sequence[float]) -> None:
    with np.load(Path(folder) / "frames.npz") as stored:
        frames = tuple(stored[name] for name in stored.files)
    empty = np.broadcast_to(np.float32(0), frames[0].shape)
    known(SyntheticBracket(frames, tuple(times_s), tuple(times_s), empty))

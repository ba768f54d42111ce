"""Full captures on simulated instruments: wall time against the physical limit, start skew, memory, help.

The limit is what the simulated latencies allow at best: each pair as long as its slower camera (release lag + true
exposure + processing), transfers behind exposures, what is left at the end beside the second reading, both readings.
Each capture runs in a process of its own; its memory is the peak of the proportional set size of that process and its
frame-checking children, sampled every 50 ms. Pictures are rendered before (they come from a cache the second time).

Rival: the same drivers, settings and frames, used as two plain scripts side by side would: a thread a camera, longest
exposure first, each frame fetched before the next exposure, no synchronisation, no checks, nothing put on disk.

``--quick`` takes four of the nine stops and one meter sample a reading instead of three (in ours, the rival and the
limit alike).
"""

from __future__ import annotations

import json
import math
import statistics
import subprocess
import sys
import tempfile
import threading
import time
from pathlib import Path
from typing import Any

from benchmarks.memory import MemoryWatch

FULL_RUNS, QUICK_RUNS = 5, 1
FULL_SAMPLES, QUICK_SAMPLES = 3, 1
QUICK_STOPS = ("1", "1/15", "1/250", "1/4000")
"""With a single meter sample; the true latencies of a Theta would make nine stops twice too long."""
HELP_RUNS = 7
UNITS = {"limit_ratio": "wall / limit", "limit_ratio_max": "wall / limit"}


def run(*, quick: bool, seed: int) -> dict[str, Any]:
    """Return metrics and rivals; see the module's docstring."""
    samples = QUICK_SAMPLES if quick else FULL_SAMPLES
    runs, scripts = [], []
    for _ in range(QUICK_RUNS if quick else FULL_RUNS):
        runs.append(_in_own_process("together", seed, samples))
        scripts.append(_in_own_process("scripts", seed, samples))
    skews_ms = sorted(s for r in runs for s in r["skews_ms"])
    wall_s = statistics.median(r["wall_s"] for r in runs)
    rival_s = statistics.median(r["wall_s"] for r in scripts)
    rival_skew_ms = sorted(s for r in scripts for s in r["skews_ms"])
    metrics = {
        "limit_ratio": round(statistics.median(r["wall_s"] / r["limit_s"] for r in runs), 4),
        "limit_ratio_max": round(max(r["wall_s"] / r["limit_s"] for r in runs), 4),
        "wall_s": round(wall_s, 3),
        "limit_s": round(statistics.median(r["limit_s"] for r in runs), 3),
        "skew_p99_ms": round(_percentile(skews_ms, 99), 3),
        "skew_median_ms": round(statistics.median(skews_ms), 3),
        "overlapping_pairs_pct": round(100 * statistics.mean(r["overlap_frac"] for r in runs), 1),
        "peak_mb": round(max(r["peak_mb"] for r in runs), 1),
        "station_peak_mb": round(max(r["station_peak_mb"] for r in runs), 1),
        "frames": runs[0]["frames"],
        "captures": len(runs),
        "help_s": round(_help_s(), 4),
    }
    rivals = {
        "two_scripts": {
            "wall_s": round(rival_s, 3),
            "ratio_ours_over_it": round(
                statistics.median(a["wall_s"] / b["wall_s"] for a, b in zip(runs, scripts, strict=True)), 3
            ),
            "skew_median_ms": round(statistics.median(rival_skew_ms), 1),
        }
    }
    notes = [f"skew: 99th percentile of {len(skews_ms)} pairs, from the simulated shutters themselves"]
    return {"metrics": metrics, "rivals": rivals, "notes": notes, "units": UNITS}


def _in_own_process(how: str, seed: int, samples: int) -> dict[str, Any]:
    command = [sys.executable, "-m", "benchmarks.whole.capture", how, str(seed), str(samples)]
    done = subprocess.run(command, capture_output=True, text=True, timeout=600, check=False)
    if done.returncode != 0:
        raise RuntimeError(f"the capture could not run: {done.stderr[-2000:]}")
    answer: dict[str, Any] = json.loads(done.stdout.splitlines()[-1])
    return answer


def _percentile(ordered: list[float], percent: float) -> float:
    """Nearest rank: the smallest value that at least ``percent`` per cent do not exceed."""
    return ordered[max(0, math.ceil(percent / 100 * len(ordered)) - 1)]


def _help_s() -> float:
    """Median wall time of a warm ``daylit --help`` as a whole process."""
    times = []
    for _ in range(HELP_RUNS + 1):
        start_s = time.perf_counter()
        subprocess.run([Path(sys.executable).with_name("daylit"), "--help"], capture_output=True, check=True)
        times.append(time.perf_counter() - start_s)
    return statistics.median(times[1:])


def _capture_once(how: str, seed: int, samples: int) -> dict[str, Any]:
    from mocks.instruments.bench import BenchOptions, make_bench
    from station.capture.rig import open_simulated_rig, wanted_cameras
    from station.capture.rig_file import PAPER_RIG, BracketTable, MeterTable

    file = PAPER_RIG.model_copy(update={"meter": MeterTable(dialect="ls160", samples=samples)})
    if samples == QUICK_SAMPLES:
        file = file.model_copy(update={"bracket": BracketTable(stops=QUICK_STOPS)})
    bench = make_bench("room", wanted_cameras(file), file.bracket.stops_s(), BenchOptions(seed=seed))
    rig = open_simulated_rig(file, bench)
    with tempfile.TemporaryDirectory() as folder, MemoryWatch() as memory:
        start_s = time.perf_counter()
        frames = _together(rig, Path(folder)) if how == "together" else _as_two_scripts(rig)
        wall_s = time.perf_counter() - start_s
    rig.close()
    sizes = frames.pop("sizes")
    return {
        "wall_s": wall_s,
        "limit_s": _limit_s(bench, file, sizes, samples),
        "peak_mb": memory.peak_mb,
        "station_peak_mb": memory.own_peak_mb,
        **frames,
        **_starts(bench),
    }


def _together(rig: Any, folder: Path) -> dict[str, Any]:
    from station.capture.capture import Capture, CaptureRequest
    from station.session.session import SessionStatus

    job = Capture.new(rig, CaptureRequest(room="benchmark", into=folder))
    for _ in job.events():
        pass
    manifest = job.store.manifest
    job.store.close()
    if manifest.status is not SessionStatus.COMPLETE:
        raise RuntimeError(f"missing: {manifest.missing}")
    sizes = {(str(f.side), f.stop): f.size_bytes for f in manifest.frames}
    return {"frames": len(manifest.frames), "sizes": sizes}


def _as_two_scripts(rig: Any) -> dict[str, Any]:
    """Meter, then both cameras side by side, each frame fetched before the next exposure, meter."""
    sizes: dict[tuple[str, int], int] = {}
    rig.meter.connect()
    rig.meter.measure(n_samples=rig.file.meter.samples)
    threads = [threading.Thread(target=_script, args=(rig, side, sizes)) for side in rig.cameras]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    rig.meter.measure(n_samples=rig.file.meter.samples)
    return {"frames": len(sizes), "sizes": sizes}


def _script(rig: Any, side: Any, sizes: dict[tuple[str, int], int]) -> None:
    camera = rig.cameras[side]
    camera.connect()
    camera.prepare(rig.file.cameras()[side].settings())
    for stop, shutter_s in enumerate(rig.file.bracket.stops_s()):
        camera.set_shutter(shutter_s)
        camera.arm()
        camera.release()
        while not (progress := camera.poll_exposure()).done:
            pass
        (frame,) = progress.frames
        done = 0
        while done < frame.size_bytes:
            done += len(camera.read_chunk(frame, done, 1 << 20))
        camera.finish_frame(frame)
        sizes[str(side), stop] = done


def _limit_s(bench: Any, file: Any, sizes: dict[tuple[str, int], int], samples: int) -> float:
    """Return the least time that the simulated latencies allow."""
    from mocks.instruments.exposures import true_time_s
    from station.capture.bracket import CameraCost, estimate_bracket, plan_bracket
    from station.session.session import Side

    stops_s = file.bracket.stops_s()
    plan = plan_bracket(stops_s, "full", tuple(Side))
    costs, exposure_s = {}, {}
    for side, table in file.cameras().items():
        timing = bench.cameras[table.kind].timing
        mean_bytes = statistics.mean(size for (s, _), size in sizes.items() if s == side)
        overhead_s = timing.release_lag_s + timing.processing_s
        costs[side] = CameraCost(overhead_s, int(mean_bytes), timing.transfer_bytes_per_s)
        for stop, nominal_s in enumerate(stops_s):
            exposure_s[side, stop] = true_time_s(nominal_s, power_of_two=timing.power_of_two_times)
    reading_s = samples * bench.meter.measuring_s
    return estimate_bracket(plan, costs, reading_s=(reading_s, reading_s), exposure_s=exposure_s).total_s


def _starts(bench: Any) -> dict[str, Any]:
    """Return start skews and the share of pairs whose exposures overlap, from the cameras' own logs."""
    logs = [{e.nominal_s: e for e in camera.exposure_log} for camera in bench.cameras.values()]
    pairs = [(a, min(logs[1].values(), key=lambda b: abs(b.nominal_s - a.nominal_s))) for a in logs[0].values()]
    overlaps = [min(a.end_s, b.end_s) > max(a.start_s, b.start_s) for a, b in pairs]
    return {
        "skews_ms": [1000 * abs(a.start_s - b.start_s) for a, b in pairs],
        "overlap_frac": sum(overlaps) / len(overlaps),
    }


if __name__ == "__main__":
    print(json.dumps(_capture_once(sys.argv[1], int(sys.argv[2]), int(sys.argv[3]))))

"""Many sessions through `daylit batch`, a worker killed in the middle: all done or listed, none wrong; throughput.

Sessions are the paper's 137 conditions in small rooms (`batch_sessions`), processed up to `UNTIL`. "Wrong" is a
session that is called done and whose results a second batch does not find whole and up to date, or whose results
differ from those of a run without any batch.
"""

from __future__ import annotations

import contextlib
import json
import os
import shutil
import signal
import statistics
import sys
import tempfile
import time
from pathlib import Path
from typing import Any

import psutil

from benchmarks.shared_data import DATA
from benchmarks.whole.batch_sessions import DIVISOR, ZONE, make_sessions
from processing.batch.dataset import Description, build, check
from processing.batch.run import BatchReport, BatchRequest, run_batch
from processing.batch.work import Outcome, Task, work
from processing.running.requests import RunRequest
from processing.running.results import Action
from processing.running.runner import process
from processing.stages.contract import Quality

UNTIL = os.environ.get("DAYLIT_BATCH_UNTIL", "calibrate")
ARGUMENTS = ("--quality", "draft", "--until", UNTIL)
CONDITIONS = DATA / "paper" / "cali_hdr_summary.csv"
COUNT = {True: 4, False: 137}
TIMED = {True: 2, False: 8}
ALONE = {True: 1, False: 3}
RENDERED, QUARTER = {True: 1, False: 6}, 4
"""Sessions that go through render, and by how much their pictures are smaller than full size each way."""
CHILD = "processing.batch.work"


def run(*, quick: bool, seed: int) -> dict[str, Any]:
    """Return the figures; ``DAYLIT_BATCH_SESSIONS`` names a folder of sessions made before."""
    with tempfile.TemporaryDirectory() as place:
        known = os.environ.get("DAYLIT_BATCH_SESSIONS")
        folder = Path(known) if known else Path(place) / "sessions"
        sessions = make_sessions(folder, COUNT[quick], CONDITIONS, seed)
        for path in sessions:
            shutil.rmtree(path / "stages", ignore_errors=True)
        killer = _Killer(at=len(sessions) // 3)
        report = run_batch(BatchRequest(folder, ARGUMENTS, 2, zone=ZONE), killer.after)
        metrics = _counts(report, folder, killer)
        print(json.dumps(metrics), file=sys.stderr, flush=True)
        metrics["differ_from_alone"] = float(_differ(report, folder, Path(place), ALONE[quick]))
        build(folder, Description("benchmark", "CC0-1.0"), zone=ZONE)
        metrics["dataset_ok"] = float(check(folder).ok)
        metrics |= _throughput(sessions[: TIMED[quick]], Path(place))
        metrics |= _through_render(Path(place) / "rendered", quick=quick, seed=seed)
    notes = [
        f"{UNTIL} is the last stage; pictures of 280 x 140; {os.cpu_count()} cores, which other work may share",
        "codes of those listed: " + json.dumps(_codes(report)),
    ]
    return {"metrics": metrics, "notes": notes, "units": {"per_hour_1": "1/h", "per_hour_2": "1/h"}}


class _Killer:
    """Kills a worker that has a session, once so many outcomes are there."""

    def __init__(self, at: int) -> None:
        self.at, self.killed = at, 0

    def after(self, _outcome: Outcome, over: int, _total: int) -> None:
        if over < self.at or self.killed:
            return
        end_s = time.monotonic() + 60
        while not self.killed and time.monotonic() < end_s:
            self.killed = _kill_a_worker()


def _kill_a_worker() -> int:
    """Kill the parent of a session's process (a worker); return how many were killed."""
    for child in psutil.Process().children(recursive=True):
        with contextlib.suppress(psutil.Error, ProcessLookupError):
            # The warm process of a worker that is forking: its own parent is the worker.
            worker = child.parent()
            if CHILD in child.cmdline() and child.children() and worker and CHILD not in worker.cmdline():
                os.kill(worker.pid, signal.SIGKILL)
                return 1
    return 0


def _counts(report: BatchReport, folder: Path, killer: _Killer) -> dict[str, float]:
    done = [one.session for one in report.outcomes if one.state == "done"]
    return {
        "sessions": len(report.outcomes),
        "done": len(done),
        "listed": len(report.failed),
        "workers_killed": killer.killed,
        "wrong": len([name for name in done if not _whole(folder / name)]),
        "batch_s": round(report.seconds, 1),
        "cpu_s_a_session": round(statistics.median(one.cpu_seconds for one in report.outcomes), 2),
    }


def _whole(session: Path) -> bool:
    """Return whether a second run would find every stage's result up to date and every file, read again, intact."""
    asked = RunRequest(until=UNTIL, quality=Quality.DRAFT, dry_run=True, recheck=True)
    return all(stage.action is Action.SKIPPED for stage in process(session, asked).stages)


def _codes(report: BatchReport) -> dict[str, int]:
    codes = [one.code for one in report.failed]
    return {code: codes.count(code) for code in sorted(set(codes))}


def _throughput(sessions: list[Path], place: Path) -> dict[str, float]:
    """Return sessions an hour with one and two workers, on copies of the same sessions."""
    found: dict[str, float] = {}
    for workers in (1, 2):
        folder = place / f"timed-{workers}"
        for path in sessions:
            shutil.copytree(path, folder / path.name, ignore=shutil.ignore_patterns("stages"))
        report = run_batch(BatchRequest(folder, ARGUMENTS, workers))
        found[f"per_hour_{workers}"] = round(3600 * len(sessions) / report.seconds, 1)
        found[f"busy_{workers}"] = round(sum(one.seconds for one in report.outcomes) / report.seconds / workers, 3)
    found["speedup_2"] = round(found["per_hour_2"] / found["per_hour_1"], 3)
    return found


def _through_render(folder: Path, *, quick: bool, seed: int) -> dict[str, float]:
    """Return the throughput of two workers through all stages at standard quality, pictures of quarter size."""
    sessions = make_sessions(folder, RENDERED[quick], CONDITIONS, seed, DIVISOR if quick else QUARTER)
    report = run_batch(BatchRequest(folder, (), 2))
    return {
        "render_done": float(len(report.outcomes) - len(report.failed)),
        "render_per_hour_2": round(3600 * len(sessions) / report.seconds, 1),
        "render_cpu_s": round(statistics.median(one.cpu_seconds for one in report.outcomes), 1),
        "render_cores_busy": round(report.cores_busy, 3),
    }


def _differ(report: BatchReport, folder: Path, place: Path, count: int) -> int:
    """Return how many of some sessions have other results when they are processed alone."""
    chosen = [one.session for one in report.outcomes if one.state == "done"]
    chosen = chosen[len(chosen) // 3 :][:count]
    wrong = 0
    for name in chosen:
        copy = place / "alone" / name
        shutil.copytree(folder / name, copy, ignore=shutil.ignore_patterns("stages"))
        work(Task(str(copy), name, ARGUMENTS, 3600.0))
        files = [path / "result.json" for path in (folder / name / "stages").iterdir() if path.is_dir()]
        pairs = ((path, copy / path.relative_to(folder / name)) for path in files if path.is_file())
        wrong += any(not b.is_file() or a.read_bytes() != b.read_bytes() for a, b in pairs)
    return wrong

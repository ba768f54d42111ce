"""The pipeline as a user meets it: what a session costs, what a rerun spares, what growth of the picture does.

A simulated session of the default world (bedroom-7, both cameras, nine stops) of each size is captured once and kept;
each run is a process of its own on a copy of its frames, from nothing to the report with three staged alternatives.
``full_*``: of 6720 x 3360, ``quarter_*``: of 1680 x 840. CPU is of the whole process and its children, memory the most
that they held together, disk what the session holds beside its frames. ``rerun_s``: nothing has changed.
``rerun_unneeded_cpu_s``: --repair-sun of a sunless sky. ``draft_moved_m``: furthest that a piece of furniture stands
from where the standard run put it, of pieces that both placed. ``first_use_extra_cpu_s``: with no compiled kernels.
``growth_exponent``: of CPU, from half to full size (quick: from small to quarter) by pixels.
"""

from __future__ import annotations

import json
import math
import os
import shutil
import subprocess
import sys
import tempfile
from pathlib import Path
from typing import Any

from benchmarks.memory import MemoryWatch
from benchmarks.paired import cost_of
from benchmarks.whole.end_to_end import rig_profile
from mocks.optics.picture_cache import default_folder

FULL_SIZES, QUICK_SIZES = ("half", "full"), ("small", "quarter")
STAGES_OF_USE = "calibrate"
"""The stage up to which first and second use are compared in a quick run."""
WORLD = "bedroom-7"
TIMEOUT_S = 3600.0
DEMO = True
"""Whether a full run times `daylit demo` too."""


def run(*, quick: bool, seed: int) -> dict[str, Any]:
    """Return metrics; see the module's docstring."""
    profile = rig_profile(seed)
    smaller, larger = QUICK_SIZES if quick else FULL_SIZES
    found, notes = {}, []
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        costs = {}
        for size in (smaller, larger):
            session = fresh(size, folder / size)
            watched = daylit(["process", str(session), "--calibration", str(profile)])
            costs[size] = watched["cpu_s"]
            found |= {f"{size}_{key}": round(value, 2) for key, value in watched.items()}
            found[f"{size}_disk_mb"] = round(megabytes(session / "stages"), 1)
            notes += [f"{size} {line}" for line in stage_lines(session)]
        found |= reruns(session, profile)
        found |= draft(larger, session, profile, folder / "draft")
        found |= first_use(smaller, profile, folder, quick=quick)
        if DEMO and not quick:
            found["demo_wall_s"] = round(daylit(["demo", "--into", str(folder / "demo")])["wall_s"], 1)
    pixels = 4.0  # small is 840 x 420, half 3360 x 1680
    found["growth_exponent"] = round(math.log(costs[larger] / costs[smaller]) / math.log(pixels), 3)
    return {"metrics": found, "units": {"growth_exponent": "of pixels", "draft_moved_m": "m"}, "notes": notes}


def fresh(size: str, into: Path) -> Path:
    """Return a copy of the kept session of a size, its frames alone; it is captured where it is not there yet."""
    kept = default_folder().parent / "pipeline" / size
    sessions = sorted(kept.glob(f"*{WORLD}/session.json"))
    if not sessions:
        shutil.rmtree(kept, ignore_errors=True)
        daylit(["demo", "--world", WORLD, "--size", size, "--capture-only", "--into", str(kept)])
        sessions = sorted(kept.glob(f"*{WORLD}/session.json"))
    source = sessions[0].parent
    shutil.copytree(source, into / source.name, ignore=shutil.ignore_patterns("stages", "relight", "views"))
    return into / source.name


def daylit(arguments: list[str], **environment: str) -> dict[str, float]:
    """Run the command in a process of its own; return CPU and wall seconds and its peak memory (MB)."""
    child = subprocess.Popen(
        [sys.executable, "-m", "daylit", *arguments, "--json"],
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        env={**os.environ, **environment},
        text=True,
    )
    watch, said = MemoryWatch(0.1, child.pid), ""

    def wait() -> None:
        nonlocal said
        with watch:
            said, _ = child.communicate(timeout=TIMEOUT_S)

    cost = cost_of(wait)
    if child.returncode != 0:
        raise RuntimeError(f"daylit {' '.join(arguments)} ended with {child.returncode}: {said[-2000:]}")
    return {"cpu_s": cost.cpu_s, "wall_s": cost.wall_s, "peak_mb": watch.peak_mb}


def megabytes(folder: Path) -> float:
    """Return what a folder's files hold."""
    return sum(path.stat().st_size for path in folder.rglob("*") if path.is_file()) / 1e6


def stage_lines(session: Path) -> list[str]:
    """Return what each stage cost, by its own record."""
    lines = []
    for path in sorted((session / "stages").glob("*/run.json"), key=lambda one: one.stat().st_mtime):
        one = json.loads(path.read_text("utf-8"))
        cost = f"{one['cpu_seconds']:.1f} CPU s, {one['seconds']:.1f} s wall"
        lines.append(f"{path.parent.name}: {cost}, {one['peak_bytes'] / 1e6:.0f} MB")
    return lines


def reruns(session: Path, profile: Path) -> dict[str, float]:
    """Return what a second run takes that has nothing to do, and one whose change changes nothing."""
    usual = ["process", str(session), "--calibration", str(profile)]
    return {
        "rerun_s": round(daylit(usual)["wall_s"], 2),
        "rerun_unneeded_cpu_s": round(daylit([*usual, "--repair-sun", "clear-sky"])["cpu_s"], 2),
    }


def draft(size: str, standard: Path, profile: Path, folder: Path) -> dict[str, float]:
    """Return what a draft costs and how far its furniture stands from the standard run's."""
    session = fresh(size, folder)
    cost = daylit(["process", str(session), "--calibration", str(profile), "--quality", "draft"])
    return {"draft_cpu_s": round(cost["cpu_s"], 2), "draft_moved_m": round(moved_m(standard, session), 3)}


def moved_m(one: Path, other: Path) -> float:
    """Return the greatest distance between places of pieces that two sessions' alternatives of one rank both have."""
    every = []
    for session in (one, other):
        text = (session / "stages" / "arrange" / "arrangement.json").read_text("utf-8")
        found = {}
        for arrangement in json.loads(text)["arrangements"]:
            for item in arrangement["items"]:
                found[arrangement["rank"], item["id"]] = item["t_m"][:2]
        every.append(found)
    first, second = every
    return max((math.dist(first[key], second[key]) for key in first.keys() & second.keys()), default=0.0)


def first_use(size: str, profile: Path, folder: Path, *, quick: bool) -> dict[str, float]:
    """Return how many CPU seconds the first use takes more than the second, which has compiled kernels."""
    until = ["--until", STAGES_OF_USE] if quick else []
    spent = []
    for number in range(2):
        session = fresh(size, folder / f"use-{number}")
        arguments = ["process", str(session), "--calibration", str(profile), *until]
        spent.append(daylit(arguments, NUMBA_CACHE_DIR=str(folder / "kernels"))["cpu_s"])
    return {"first_use_extra_cpu_s": round(spent[0] - spent[1], 2)}

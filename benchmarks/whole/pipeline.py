"""The pipeline as a user meets it: what a session costs, what a rerun spares, what growth of the picture does.

Each run is a process of its own: from the frames of a simulated session of the default world (both cameras, nine stops)
to the report with three staged alternatives. ``full_*``: of 6720 x 3360, ``quarter_*``: of 1680 x 840. CPU is of the
process and its children, memory the most that they held together, disk what the session holds beside its frames.
``demo_wall_s``: `daylit demo` with no compiled kernels. ``rerun_s``: nothing has changed. ``rerun_unneeded_cpu_s``:
--repair-sun after a run without it (an upper bound: the demo's sky has a sun). ``one_more_cpu_s``: a fourth one.
``draft_moved_m``: furthest that a piece stands from where the standard run put it, of pieces that both placed.
``first_use_extra_cpu_s``: small, with no compiled kernels against with; ``first_use_wheel_extra_cpu_s``: with no more
than a wheel brings. ``growth_exponent``: of CPU, from half to full
size (quick: small to quarter) by pixels. ``zenith_*``: the demo's blue sky against the world's.

A full run takes some ten minutes of two idle cores, most of it `demo_wall_s`, whose session the other figures are of. A
quick run keeps its sessions, and takes the reruns and the draft of the small one.
"""

from __future__ import annotations

import json
import math
import os
import shutil
import subprocess
import sys
import tempfile
import time
from pathlib import Path
from typing import Any

from benchmarks.memory import MemoryWatch
from benchmarks.photometry.zenith import zenith_errors
from mocks.optics.picture_cache import default_folder
from processing.commands.demo import GENERATED
from studio.build import compile_kernels

WORLD = GENERATED
SUNLESS = "bedroom-7"
"""The same room under clouds: `--repair-sun` changes nothing of it."""
TIMEOUT_S = 3600.0
PIXELS = 4.0
"""Of a size over the next smaller one of the pair."""


def run(*, quick: bool, seed: int) -> dict[str, Any]:
    """Return metrics; see the module's docstring. The world is one and the same: ``seed`` changes nothing."""
    kept, found, notes = default_folder().parent / "pipeline", {}, []
    profile = rig_profile(kept)
    smaller, larger = ("small", "quarter") if quick else ("half", "full")
    with tempfile.TemporaryDirectory() as name:
        folder, sessions = Path(name), {}
        kernels = {"DAYLIT_KERNELS": str(folder / "kernels")}  # empty for what is first, compiled for all after it
        if quick:
            found |= first_use(captured(kept, "small"), profile, folder, **kernels)
        else:
            cost = daylit(["demo", "--into", str(folder / "demo")], **kernels)
            found["demo_wall_s"] = round(cost["wall_s"], 1)
            profile = folder / "demo" / "rig" / "calibration.json"  # the kept one is of small pictures
        for size in (smaller, larger):
            source = newest(folder / "demo") if size == "full" else captured(kept, size)
            session = sessions[size] = fresh(source, folder / size)
            spent = daylit(["process", str(session), "--calibration", str(profile)], **kernels)
            found |= {f"{size}_{key}": round(value, 2) for key, value in spent.items()}
            found[f"{size}_disk_mb"] = round(megabytes(session / "stages"), 1)
            notes += [f"{size} {line}" for line in stage_lines(session)]
        found |= {key: round(value, 2) for key, value in zenith_errors(sessions[larger], WORLD).items()}
        judged = sessions[smaller if quick else larger]
        found |= draft(judged, profile, folder / "draft", **kernels)
        found |= reruns(judged, fresh(captured(kept, "small", SUNLESS), folder / "sunless"), profile, **kernels)
        if not quick:
            found |= first_use(captured(kept, "small"), profile, folder, DAYLIT_KERNELS=str(folder / "first"))
    growth = math.log(found[f"{larger}_cpu_s"] / found[f"{smaller}_cpu_s"]) / math.log(PIXELS)
    found["growth_exponent"] = round(growth, 3)
    return {"metrics": found, "units": {"growth_exponent": "of pixels", "draft_moved_m": "m"}, "notes": notes}


def rig_profile(kept: Path) -> Path:
    """Return the kept profile of the simulated rig, made with small pictures where it is not there yet."""
    profile = kept / "small" / "rig" / "calibration.json"
    captured(kept, "small")
    if not profile.is_file():
        daylit(["demo", "--quick", "--size", "small", "--set", "none", "--into", str(kept / "small")])
    return profile


def captured(kept: Path, size: str, world: str = WORLD) -> Path:
    """Return the kept session of a size and world, captured faster than life where it is not there yet."""
    into = kept / (size if world == WORLD else f"{size}-{world}")
    if not list(into.glob(f"*{world}/session.json")):
        shutil.rmtree(into, ignore_errors=True)
        daylit(["demo", "--quick", "--world", world, "--size", size, "--capture-only", "--into", str(into)])
    return newest(into, world)


def newest(folder: Path, world: str = WORLD) -> Path:
    """Return the last session of the world in a folder."""
    return max(folder.glob(f"*{world}/session.json")).parent


def fresh(source: Path, into: Path) -> Path:
    """Return a copy of a session, its frames alone."""
    shutil.copytree(source, into / source.name, ignore=shutil.ignore_patterns("stages", "relight", "views"))
    return into / source.name


def daylit(arguments: list[str], home: Path | None = None, **environment: str) -> dict[str, float]:
    """Run the command (of the program in ``home``) in a process of its own; return CPU and wall seconds and its peak
    memory (MB).
    """
    child = subprocess.Popen(
        [sys.executable, "-m", "daylit", *arguments, "--json"],
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        env={**os.environ, **environment},
        cwd=home,
        text=True,
    )
    watch, said = MemoryWatch(0.1, child.pid), ""

    def wait() -> None:
        nonlocal said
        with watch:
            said, _ = child.communicate(timeout=TIMEOUT_S)

    # Of the program alone: to read its memory ten times a second takes a tenth of a core of this process.
    before, start_s = os.times(), time.perf_counter()
    wait()
    after, wall_s = os.times(), time.perf_counter() - start_s
    cpu_s = after.children_user + after.children_system - before.children_user - before.children_system
    if child.returncode != 0:
        raise RuntimeError(f"daylit {' '.join(arguments)} ended with {child.returncode}: {said[-2000:]}")
    return {"cpu_s": cpu_s, "wall_s": wall_s, "peak_mb": watch.peak_mb}


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


def reruns(session: Path, sunless: Path, profile: Path, **kernels: str) -> dict[str, float]:
    """Return what a second run takes: with nothing to do, with one alternative, and of a new session with a change that
    changes nothing.
    """
    usual, other = (["process", str(one), "--calibration", str(profile)] for one in (session, sunless))
    daylit(other, **kernels)
    return {
        "rerun_s": round(daylit(usual, **kernels)["wall_s"], 2),
        "rerun_unneeded_cpu_s": round(daylit([*other, "--repair-sun", "clear-sky"], **kernels)["cpu_s"], 2),
        "one_more_cpu_s": round(daylit([*usual, "--alternatives", "4"], **kernels)["cpu_s"], 2),
    }


def draft(standard: Path, profile: Path, folder: Path, **kernels: str) -> dict[str, float]:
    """Return what a draft costs and how far its furniture stands from the standard run's."""
    session = fresh(standard, folder)
    cost = daylit(["process", str(session), "--calibration", str(profile), "--quality", "draft"], **kernels)
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


def first_use(source: Path, profile: Path, folder: Path, **kernels: str) -> dict[str, float]:
    """Return how many CPU seconds the first use takes more than the second: of a checkout, and of a wheel."""

    def cpu_s(name: str, home: Path | None, **kernels: str) -> float:
        session = fresh(source, folder / name)
        return daylit(["process", str(session), "--calibration", str(profile)], home, **kernels)["cpu_s"]

    first, second = (cpu_s(f"use-{number}", None, **kernels) for number in range(2))
    wheel = as_installed(folder / "installed")
    shipped = cpu_s("use-wheel", wheel, DAYLIT_KERNELS=str(folder / "unused"))
    return {
        "first_use_extra_cpu_s": round(first - second, 2),
        "first_use_wheel_extra_cpu_s": round(shipped - second, 2),
    }


def as_installed(folder: Path) -> Path:
    """Return the folder with this program as a wheel installs it, with the kernels that its building compiles."""
    root, leave = Path(__file__).parents[2], shutil.ignore_patterns("__pycache__", "web")
    for package in ("drivers", "mocks", "processing", "station", "studio"):
        shutil.copytree(root / package, folder / package, ignore=leave)
    shutil.copy(root / "daylit.py", folder)
    compile_kernels(folder / "processing")
    return folder

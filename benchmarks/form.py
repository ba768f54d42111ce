"""The one form of a benchmark's result, and what runs a module so that its answer has that form."""

from __future__ import annotations

import importlib
import math
import os
import platform
import time
from collections.abc import Callable
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import Any, TypedDict

import benchmarks

PACKAGES = (
    "daylit",
    "numpy",
    "scipy",
    "opencv-contrib-python-headless",
    "pillow",
    "openexr",
    "mitsuba",
    "drjit",
    "embreex",
    "pyoidn",
    "pvlib",
    "shapely",
    "pyusb",
    "pyserial",
    "pydantic",
)
UNITS = {
    "_err_pct": "%",
    "_pct": "%",
    "_db": "dB",
    "_stops": "stops",
    "_mb": "MB",
    "_ms": "ms",
    "_s": "s",
    "seconds": "s",
    "_lux": "lx",
    "_lx": "lx",
}
"""A key's unit by how it ends; a module names others."""


class Result(TypedDict):
    """What a benchmark gives back, and what it depends on."""

    name: str
    metrics: dict[str, float]
    rivals: dict[str, dict[str, float]]
    units: dict[str, str]
    notes: list[str]
    seconds: float
    machine: dict[str, Any]
    versions: dict[str, str]
    seed: int
    quick: bool


def names() -> list[str]:
    """Return the benchmarks there are: the modules of the folders of this package whose text defines ``run(*, quick``.

    They are not imported, so that one which cannot be does not keep the others from running.
    """
    return sorted(modules())


def modules() -> dict[str, str]:
    """Return the module of each benchmark by its name."""
    folder = Path(benchmarks.__path__[0])
    files = (path for path in folder.glob("*/*.py") if "\ndef run(*, quick" in path.read_text("utf-8"))
    return {path.stem: f"benchmarks.{path.parent.name}.{path.stem}" for path in files}


def run_one(name: str, *, quick: bool, seed: int) -> Result:
    """Run one benchmark and return the whole result; raise where it could not run or answered out of form."""
    start_s = time.perf_counter()
    run: Callable[..., dict[str, Any]] = importlib.import_module(modules()[name]).run
    measured = run(quick=quick, seed=seed)
    metrics, rivals = measured["metrics"], measured.get("rivals", {})
    for key, value in [*metrics.items(), *((k, v) for figures in rivals.values() for k, v in figures.items())]:
        if isinstance(value, bool) or not isinstance(value, int | float) or not math.isfinite(value):
            raise ValueError(f"{key} is not a finite number: {value!r}")
    return {
        "name": name,
        "metrics": metrics,
        "rivals": rivals,
        "units": units_of(metrics) | measured.get("units", {}),
        "notes": measured.get("notes", []),
        "seconds": round(time.perf_counter() - start_s, 2),
        "machine": machine(),
        "versions": versions(),
        "seed": seed,
        "quick": quick,
    }


def units_of(metrics: dict[str, float]) -> dict[str, str]:
    """Return the units that the ends of keys state."""
    found = {key: next((unit for end, unit in UNITS.items() if key.endswith(end)), "") for key in metrics}
    return {key: unit for key, unit in found.items() if unit}


def machine() -> dict[str, Any]:
    """Return what the figures depend on, without names."""
    cpu = "unknown"
    info = Path("/proc/cpuinfo")
    if info.exists():
        models = [
            line.split(":", 1)[1].strip() for line in info.read_text().splitlines() if line.startswith("model name")
        ]
        cpu = models[0] if models else cpu
    return {"cpu": cpu, "cores": os.cpu_count(), "system": platform.system(), "python": platform.python_version()}


def versions() -> dict[str, str]:
    """Return the versions of what was measured."""
    found = {}
    for name in PACKAGES:
        try:
            found[name] = version(name)
        except PackageNotFoundError:
            continue
    return found

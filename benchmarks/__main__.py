"""``python -m benchmarks NAME [--quick] [--json] [--seed N]``; NAME may be ``all``.

With ``--json`` the last line of standard output is one JSON object a benchmark: name, metrics, rivals, seconds,
machine, versions, seed, quick. Exit status 0 whatever the figures; another only where a benchmark could not run.
"""

from __future__ import annotations

import importlib
import json
import os
import pkgutil
import platform
import sys
import time
from collections.abc import Callable
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path

import click

import benchmarks

Result = dict[str, object]


def names() -> list[str]:
    """Return the benchmarks there are: the public modules of this package that have ``run``."""
    found = [m.name for m in pkgutil.iter_modules(benchmarks.__path__)]
    return [n for n in found if not n.startswith("_") and hasattr(importlib.import_module(f"benchmarks.{n}"), "run")]


def machine() -> Result:
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
    for name in ("daylit", "numpy", "opencv-python-headless", "pillow", "pyusb", "pyserial", "pydantic"):
        try:
            found[name] = version(name)
        except PackageNotFoundError:
            continue
    return found


def run_one(name: str, *, quick: bool, seed: int) -> Result:
    """Run one benchmark and return the whole result."""
    run: Callable[..., Result] = importlib.import_module(f"benchmarks.{name}").run
    start_s = time.perf_counter()
    measured = run(quick=quick, seed=seed)
    return {
        "name": name,
        "metrics": measured["metrics"],
        "rivals": measured.get("rivals", {}),
        "notes": measured.get("notes", []),
        "seconds": round(time.perf_counter() - start_s, 2),
        "machine": machine(),
        "versions": versions(),
        "seed": seed,
        "quick": quick,
    }


@click.command()
@click.argument("name")
@click.option("--quick", is_flag=True, help="Within 50 s on 2 cores, the same keys.")
@click.option("--json", "as_json", is_flag=True, help="One JSON object on the last line.")
@click.option("--seed", type=int, default=0, show_default=True)
def main(name: str, *, quick: bool, as_json: bool, seed: int) -> None:
    """Run benchmark NAME, or all."""
    chosen = names() if name == "all" else [name]
    unknown = set(chosen) - set(names())
    if unknown:
        raise click.UsageError(f"no benchmark {', '.join(unknown)}; there are: {', '.join(names())}")
    for one in chosen:
        result = run_one(one, quick=quick, seed=seed)
        if as_json:
            click.echo(json.dumps(result))
        else:
            _print(result)
    sys.stdout.flush()


def _print(result: Result) -> None:
    click.echo(f"{result['name']} ({result['seconds']} s, seed {result['seed']}{', quick' if result['quick'] else ''})")
    for title in ("metrics", "rivals"):
        table = result[title]
        assert isinstance(table, dict)
        for key, value in table.items():
            click.echo(f"  {title[:-1]:<7} {key:<32} {value}")
    notes = result["notes"]
    assert isinstance(notes, list)
    for note in notes:
        click.echo(f"  note    {note}")


if __name__ == "__main__":
    main()

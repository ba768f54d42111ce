"""Physics of the simulated truth against calculation: what every later figure stands on.

Errors are the largest of all cases, in per cent: white furnaces, integrating cube and sphere, form factors, daylight
through unglazed openings, outdoor illuminance against pvlib's clear sky, the meter's spot against dense quadrature.
``rooms_ok`` counts the rooms of ``rooms_drawn`` test seeds that are made without failure and are valid; ``room_*`` are
run time and error of the light baked in furnished rooms with sun in them.
"""

from __future__ import annotations

import importlib
import math
from collections.abc import Callable
from pathlib import Path
from typing import Any

from benchmarks.light import physics as _physics
from benchmarks.light.room_light import OURS, Outcome, room_light
from benchmarks.paired import cost_of
from benchmarks.photometry.sky_anchor import DAYS, QUICK_DAYS, outdoor_errors
from benchmarks.photometry.spot import spot_errors
from benchmarks.plots import Point, time_against_error
from benchmarks.seeds import seeds
from mocks.rooms.light.engine import engine

FULL_SPP = {"furnace": 2**20, "sphere": 2**18, "form_factor": 2**20, "daylight": 2**20}
QUICK_SPP = {"furnace": 2**16, "sphere": 2**14, "form_factor": 2**18, "daylight": 2**15}
PLOT, PLOT_SPP = Path("truth-convergence.png"), (2**14, 2**16, 2**18)
FULL_ROOMS, QUICK_ROOMS = 200, 8
FULL_LIGHT_ROOMS, QUICK_LIGHT_ROOMS = 2, 1
LIGHT_PLOT = Path("room-light.png")

SCENES: dict[str, Callable[[int, int], _physics.Errors]] = {
    "furnace": _physics.furnace,
    "sphere": _physics.integrating,
    "form_factor": _physics.form_factors,
    "daylight": _physics.daylight,
}


def run(*, quick: bool, seed: int) -> dict[str, Any]:
    """Return metrics; see the module's docstring."""
    spp = QUICK_SPP if quick else FULL_SPP
    errors = {name: scene(spp[name], seed + 1) for name, scene in SCENES.items()}
    errors |= outdoor_errors(QUICK_DAYS if quick else DAYS)
    errors["spot"] = spot_errors(seed)
    asked = seeds("test", QUICK_ROOMS if quick else FULL_ROOMS, seed)
    faults = {number: found for number in asked if (found := faults_of_seed(number))}
    worst = {name: max(cases, key=lambda case: abs(cases[case])) for name, cases in errors.items()}
    metrics: dict[str, Any] = {f"{name}_err_pct": round(abs(errors[name][case]), 4) for name, case in worst.items()}
    metrics |= {"rooms_ok": len(asked) - len(faults), "rooms_drawn": len(asked)}
    light = _light(quick=quick, seed=seed)
    notes = [f"rendered with {engine().variant}"]
    notes += [
        f"{name}: worst of {len(errors[name])} at {case} ({errors[name][case]:+.3f} %)" for name, case in worst.items()
    ]
    notes += [f"room {number}: {'; '.join(found)}" for number, found in faults.items()]
    if not quick:
        time_against_error(
            convergence(seed),
            PLOT,
            title="Scenes of known light: run time against error",
            error_label="root mean square error, %",
            seconds_label=f"CPU seconds for all points ({engine().variant})",
        )
    return {
        "metrics": metrics | light.metrics,
        "rivals": {"plain_path": light.rival},
        "units": {"rooms_ok": f"of {len(asked)}"},
        "notes": notes + light.notes,
    }


def _light(*, quick: bool, seed: int) -> Outcome:
    """Measure the rooms' light; a full run also at more work, which it plots."""
    if quick:
        return room_light(QUICK_LIGHT_ROOMS, seed, samples=(4,))
    found = room_light(FULL_LIGHT_ROOMS, seed, ("sketch", *OURS, "standard"), (16, 4, 64))
    time_against_error(
        [Point(one.method, one.cpu_s, one.median_err_pct, one.label) for one in found.summaries],
        LIGHT_PLOT,
        title="Light in furnished rooms with sun: run time against error",
        error_label="median error of illuminance, %",
        seconds_label=f"CPU seconds a room ({engine().variant})",
    )
    return found


def convergence(seed: int) -> list[Point]:
    """Return what error how much time buys; a bias would show as a line that stops falling."""
    points = []
    for name, scene in SCENES.items():
        for spp in PLOT_SPP:
            # The first run compiles, so that only its errors count.
            errors = list(scene(spp, seed + 1007).values())
            cost = cost_of(lambda spp=spp, scene=scene, errors=errors: errors.extend(scene(spp, seed + 7).values()))
            rms = math.sqrt(sum(error**2 for error in errors) / len(errors))
            points.append(Point(name.replace("_", " "), cost.cpu_s, rms, f"{spp:,}"))
    return points


def room_faults(room: Any) -> list[str]:
    """Return what a room's own checks find wrong with its plan and its furniture."""
    check_plan = importlib.import_module("mocks.rooms.plan.openings").check_plan
    check_items = importlib.import_module("mocks.rooms.furnish.check").check_items
    return [*check_plan(room.plan), *check_items(room.plan, room.items)]


def faults_of_seed(seed: int) -> list[str]:
    """Return what is wrong with the room of a seed: a failure to make it, or what its own checks find."""
    try:
        return room_faults(importlib.import_module("mocks.rooms.room").make_room(seed))
    except Exception as error:  # noqa: BLE001 (any failure is what is counted here)
        return [f"{type(error).__name__}: {error}"]

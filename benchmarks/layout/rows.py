"""One room of the arrangement benchmark as a row of figures; rows are kept, so that a long run can be resumed."""

from __future__ import annotations

import hashlib
import json
import os
import sys
import time
from collections.abc import Iterator, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.layout.oracle import first_solution_s
from benchmarks.layout.raster import Raster
from benchmarks.layout.rivals import paper_faults, place_by_trial
from benchmarks.layout.scene import scene_eval
from processing.errors import LayoutError
from processing.layout.arrange import arrange
from processing.layout.arrangement import Arrangement, Arrangements
from processing.layout.items import KINDS, set_items
from processing.layout.plan import FloorPlan
from processing.layout.rules import RuleSet, built_in_rules
from processing.layout.verify import Judge, Piece

MIN_AREA_M2 = 12.0
RIVALS_EVERY = 8
"""The slow rivals (trial with shapely, CP-SAT) run in every eighth room of 12 m2 and more."""
ROOT = Path(__file__).resolve().parents[2]


def measured(number: int, plan: FloorPlan, use: str, seed: int) -> dict[str, Any]:
    """Return the figures of one room; times are CPU and wall times in ms."""
    items, rules, standard = set_items(use), built_in_rules().named("tight"), built_in_rules().named("standard")
    row: dict[str, Any] = {"room": plan.name, "area_m2": round(plan.area_m2, 2), "corners": len(plan.corners)}
    row["paper"] = [bool(v) for v in paper_faults(plan)]
    try:
        one, row["one_ms"] = _timed(plan, use, rules, 1, seed)
        seven, row["seven_ms"] = _timed(plan, use, rules, 7, seed)
    except LayoutError as error:
        return row | {"refused": error.message}
    row |= _checked(plan, [one, seven], rules)
    first = one.arrangements[0] if one.arrangements else None
    row |= {"complete": bool(first and first.complete), "found": len(seven.arrangements)}
    row["found_complete"] = sum(a.complete for a in seven.arrangements)
    row["scores"] = [a.score for a in seven.arrangements]
    if plan.area_m2 < MIN_AREA_M2:
        return row
    if not row["complete"]:
        left_out = first.not_placed if first else ()
        row["reasons"] = [f"{n.id}: {n.rule}: {n.reason}" for n in left_out]
    if number % RIVALS_EVERY == 0:
        start = time.process_time()
        count, _ = place_by_trial(plan, items, rules, seed)
        row["trial"] = [1e3 * (time.process_time() - start), count == len(items)]
        solved_s = first_solution_s(plan, items, rules)
        row["cp_sat_ms"] = None if solved_s is None else 1e3 * solved_s
    more = _checked(plan, [arrange(plan, items, standard, n=7, seed=seed)], standard)
    return row | {key: row[key] + more[key] for key in more}


def _timed(plan: FloorPlan, use: str, rules: RuleSet, n: int, seed: int) -> tuple[Arrangements, list[float]]:
    start, wall = time.process_time(), time.perf_counter()
    result = arrange(plan, set_items(use), rules, n=n, seed=seed)
    return result, [1e3 * (time.process_time() - start), 1e3 * (time.perf_counter() - wall)]


def _checked(plan: FloorPlan, results: Sequence[Arrangements], rules: RuleSet) -> dict[str, Any]:
    """Return what judge and raster find in all arrangements, and SceneEval's figures."""
    judge, raster = Judge(plan, rules), Raster(plan, rules)
    handless = all(door.hinge == "unknown" and door.swing == "unknown" for door in plan.doors)
    row: dict[str, Any] = {"layouts": 0, "judge": [], "raster": [], "scene": []}
    for one in (a for result in results for a in result.arrangements):
        row["layouts"] += 1
        row["judge"] += [f"{rules.name}: {v}" for v in judge.judge(pieces_of(one))]
        row["raster"] += [f"{rules.name}: {v}" for v in raster.faults(one)]
        if handless:
            row["scene"].append([round(v, 6) for v in scene_eval(plan, one)])
    return row


def pieces_of(one: Arrangement) -> list[Piece]:
    """Return an arrangement as the judge takes it."""
    return [
        Piece(i.id, replace(KINDS[i.category], size_m=i.size_m, base_m=i.base_m), *i.t_m[:2], i.theta_rad, i.group)
        for i in one.items
    ]


def rows_of(rooms: Sequence[tuple[FloorPlan, str, int]], seed: int, *, keep: bool) -> Iterator[dict[str, Any]]:
    """Yield the rows of all rooms; with `keep`, those of an earlier, interrupted run of the same code are read again.

    DAYLIT_BENCH_CPU_S ends the process after so much CPU time (the rows so far are kept).
    """
    path = Path(os.environ.get("DAYLIT_CACHE", "/tmp")) / f"arrange-rows-{seed}-{_digest()}.jsonl"
    known: dict[str, dict[str, Any]] = {}
    if keep and path.exists():
        known = {row["key"]: row for row in map(json.loads, path.read_text("utf-8").splitlines())}
    limit_s, start = float(os.environ.get("DAYLIT_BENCH_CPU_S", "inf")), time.process_time()
    for number, (plan, use, group) in enumerate(rooms):
        key = f"{number}-{plan.name}"
        if key not in known:
            if time.process_time() - start > limit_s:
                raise TimeoutError(f"{len(known)} of {len(rooms)} rooms are done; run again to go on")
            row = {"key": key, "use": use, "group": group, **measured(number, plan, use, seed)}
            known[key] = row
            if keep:
                path.parent.mkdir(parents=True, exist_ok=True)
                with path.open("a", encoding="utf-8") as file:
                    file.write(json.dumps(row, default=_plain) + "\n")
        yield known[key]


def _plain(value: Any) -> Any:
    return value.item() if isinstance(value, np.generic) else str(value)


def _digest() -> str:
    """Return a digest of the code that rows depend on: the modules of the solver and of this benchmark in use."""
    used = [m for m in sys.modules if m.startswith(("processing.layout.", "benchmarks.layout"))]
    names = [ROOT / "processing/layout/rules.toml", *(Path(str(sys.modules[m].__file__)) for m in sorted(used))]
    digest = hashlib.sha256()
    for path in names:
        digest.update(path.name.encode() + path.read_bytes())
    return digest.hexdigest()[:12]

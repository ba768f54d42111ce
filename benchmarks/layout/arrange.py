"""Furniture arrangements: hard rules broken, rooms fully furnished, time, side by side with the paper's fixed ratios.

Rooms: the shared floor plans (even-numbered ones served for tuning: `placed_all_pct` is of the odd ones) and generated
ones with slanted walls, bays, columns and 24 corners. Items: the built-in sets of eight, `living` where the label says
so, else `bedroom`; rule set `tight` (paths of 0.6 m), and rooms >= 12 m2 by `standard` too. Every arrangement is judged
anew by `verify` and by a 1 cm raster. For rooms >= 12 m2 that are not fully furnished, a full run tries every place of
what was left out and asks an oracle (CP-SAT) whether any arrangement holds everything (`benchmarks.layout.reasons`).
Times are of one thread after warm-up (the search uses one): CPU time, which a busy machine changes less, and wall time.
SceneEval's figures: out of bounds, collision, opening clearance (a door keeps one leaf's depth, at most 0.9 m, and its
own width, in rooms whose doors have no known hand; a window 0.5 m against what is taller than its sill), navigability
with its own walker (0.2 m). A full run keeps its rows and can be resumed (`benchmarks.layout.rows`).
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from benchmarks.layout.reasons import add_answers
from benchmarks.layout.rooms import KINDS, generated, plan_of, shared_rooms, use_of
from benchmarks.layout.rows import MIN_AREA_M2, rows_of
from benchmarks.plots import save_figure
from processing.layout.arrange import arrange
from processing.layout.items import set_items
from processing.layout.plan import FloorPlan

QUICK_ROOMS, QUICK_GENERATED = 16, 1
FULL_GENERATED = 75
UNITS = {"placed_all_pct": "% of odd-numbered rooms >= 12 m2", "navigability": "share of free floor"}
Row = dict[str, Any]


def run(*, quick: bool, seed: int) -> dict[str, Any]:
    """Return metrics and rivals; see the module's docstring."""
    rooms, notes = _rooms(quick=quick, seed=seed)
    for plan, use, _ in rooms[:2]:  # warm-up: compiled code from the cache
        for n in (1, 7):
            arrange(plan, set_items(use), "tight", n=n)
    rows = list(rows_of(rooms, seed, keep=not quick))
    if not quick:
        add_answers(rooms, rows, seed)
    large = [row for (plan, _, _), row in zip(rooms, rows, strict=True) if plan.area_m2 >= MIN_AREA_M2]
    if not quick:
        time_plot(large, Path("arrange-time.png"))
    return {
        "metrics": _metrics(rows, large),
        "rivals": _rivals(rows, large),
        "units": UNITS,
        "notes": notes + _notes(large),
    }


def _rooms(*, quick: bool, seed: int) -> tuple[list[tuple[FloorPlan, str, int]], list[str]]:
    """Return (plan, use, group), the large ones first, and notes; group: 0 tuning, 1 report, 2 generated."""
    numbered = list(enumerate(shared_rooms()))
    listed = [(n, room) for n, room in numbered if any(o["kind"] == "door" for o in room["openings"])]
    step = max(1, len(listed) // QUICK_ROOMS) if quick else 1
    notes = [] if numbered else ["the shared floor plans are missing (DAYLIT_SHARED): only generated rooms"]
    notes += [f"{len(numbered) - len(listed)} of {len(numbered)} shared rooms have no door and are left out"]
    rooms = [(plan_of(r), use_of(r["label"]), n % 2) for n, r in listed[step // 2 :: step]]
    for kind in KINDS:
        for k in range(QUICK_GENERATED if quick else FULL_GENERATED):
            rooms.append((generated(kind, 900_000 + seed * 1000 + k), "bedroom" if k % 2 else "living", 2))
    return sorted(rooms, key=lambda room: room[0].area_m2 < MIN_AREA_M2), notes


def _metrics(rows: Sequence[Row], large: Sequence[Row]) -> dict[str, float]:
    done = [row for row in rows if "refused" not in row]
    roomy = [row for row in large if "refused" not in row]
    answers = Counter(row["oracle"]["answer"] for row in roomy if row.get("oracle"))
    unplaced = [row for row in roomy if not row["complete"]]
    scores = [score for row in roomy for score in row["scores"]]
    return {
        "hard_violations": sum(bool(row["judge"]) + bool(row["raster"]) for row in done),
        "raster_violations": sum(bool(row["raster"]) for row in done),
        "layouts": sum(row["layouts"] for row in done),
        "rooms": len(rows),
        "refused_rooms": len(rows) - len(done),
        **_placed(large),
        "rooms_12m2": len(large),
        "named_reason_pct": _pct([bool(row["reasons"]) for row in unplaced]),
        "reasons_confirmed": sum(bool(row.get("confirmed")) for row in unplaced),
        "rooms_not_all_placed": len(unplaced),
        "oracle_none_exists": answers["proved"] + answers["by custom"],
        "oracle_found_one": answers["found"],
        "oracle_open": answers["open"] + answers["not rectilinear"],
        "p95_ms": _p95([row["one_ms"][0] for row in roomy]),
        "median_ms": _median([row["one_ms"][0] for row in roomy]),
        "wall_p95_ms": _p95([row["one_ms"][1] for row in roomy]),
        "seven_p95_ms": _p95([row["seven_ms"][0] for row in roomy]),
        "seven_median_ms": _median([row["seven_ms"][0] for row in roomy]),
        "seven_wall_p95_ms": _p95([row["seven_ms"][1] for row in roomy]),
        "seven_found_pct": _pct([row["found"] == 7 for row in roomy]),
        "seven_found_mean": round(float(np.mean([row["found"] for row in roomy])), 2),
        "score_best_mean": round(float(np.mean([row["scores"][0] for row in roomy if row["scores"]])), 3),
        "score_mean": round(float(np.mean(scores)), 3),
        "paper_faulty_pct": _pct([faulty for row in rows for faulty in row["paper"]]),
        **_scene_eval(np.array([s for row in done for s in row["scene"]])),
    }


def _scene_eval(scene: NDArray[np.float64]) -> dict[str, float]:
    """Return SceneEval's means; none without a room whose doors have no known hand (the shared plans' rooms)."""
    if not scene.size:
        return {}
    out, collide, blocked, navigable = scene.mean(axis=0)
    return {
        "sceneeval_out_of_bounds_pct": round(100 * float(out), 3),
        "sceneeval_collision_pct": round(100 * float(collide), 3),
        "sceneeval_opening_blocked_pct": round(100 * float(blocked), 3),
        "navigability": round(float(navigable), 4),
    }


def _rivals(rows: Sequence[Row], large: Sequence[Row]) -> dict[str, dict[str, float]]:
    """Return the rivals' figures; the ratios are of their medians to ours in the same rooms."""
    tried = [row for row in large if "trial" in row]
    solved = [row for row in tried if row["cp_sat_ms"] is not None]
    found = {"paper_ratios": {"faulty_pct": _pct([faulty for row in rows for faulty in row["paper"]])}}
    if tried:
        found["shapely_trial"] = {
            "median_ms": _median([row["trial"][0] for row in tried]),
            "p95_ms": _p95([row["trial"][0] for row in tried]),
            "placed_all_pct": _pct([row["trial"][1] for row in tried]),
            "median_ratio": _ratio([row["trial"][0] for row in tried], tried),
        }
    if solved:
        found["cp_sat_without_paths"] = {
            "median_ms": _median([row["cp_sat_ms"] for row in solved]),
            "p95_ms": _p95([row["cp_sat_ms"] for row in solved]),
            "median_ratio": _ratio([row["cp_sat_ms"] for row in solved], solved),
        }
    return found


def _notes(large: Sequence[Row]) -> list[str]:
    notes = [
        f"{row['room']}: {(row['judge'] + row['raster'])[:2]}" for row in large if row.get("judge") or row.get("raster")
    ]
    for row in large:
        if row.get("reasons"):
            answer = row["oracle"]["answer"] if row.get("oracle") else "not asked"
            sure = "confirmed" if row.get("confirmed") else "not confirmed" if row.get("oracle") else "not looked at"
            room = f"{row['room']} ({row['area_m2']} m2, {row['use']})"
            notes.append(f"{room}, oracle: {answer}; {sure}: {'; '.join(row['reasons'])}")
    return notes


def _ratio(theirs: list[float], rows: Sequence[Row]) -> float:
    return round(float(np.median(theirs) / np.median([row["one_ms"][0] for row in rows])), 2)


def _placed(large: Sequence[Row]) -> dict[str, float]:
    """Return the shares of rooms that hold everything, by group; of a group without rooms none."""
    groups = {"placed_all_tuning_pct": 0, "placed_all_pct": 1, "placed_all_generated_pct": 2}
    found = {
        key: [bool(row.get("complete")) for row in large if row["group"] == group] for key, group in groups.items()
    }
    return {key: _pct(values) for key, values in found.items() if values}


def _pct(values: list[bool]) -> float:
    return round(100 * float(np.mean(values)), 2) if values else 100.0


def _p95(values: list[float]) -> float:
    return round(float(np.percentile(values, 95)), 1)


def _median(values: list[float]) -> float:
    return round(float(np.median(values)), 1)


STYLES = ("-", "--", "-.", ":")


def time_plot(large: Sequence[dict[str, Any]], path: Path) -> Path:
    """Draw the share of rooms of 12 m2 and more over the CPU time in which each method furnishes them."""
    import matplotlib as mpl

    mpl.use("Agg")
    from matplotlib import pyplot as plt

    figure, axes = plt.subplots(figsize=(6.4, 4.0), layout="constrained")
    done = [row for row in large if "refused" not in row]
    tried = [row for row in done if "trial" in row]
    lines = {
        "one arrangement": ([row["one_ms"][0] for row in done if row["complete"]], len(done)),
        "seven different ones": ([row["seven_ms"][0] for row in done if row["found_complete"]], len(done)),
        "trial with shapely alone": ([row["trial"][0] for row in tried if row["trial"][1]], len(tried)),
        "CP-SAT, where it has a solution; paths not looked at": _both([row["cp_sat_ms"] for row in tried]),
    }
    for style, (name, (times, count)) in zip(STYLES, lines.items(), strict=True):
        share = 100 * (np.arange(len(times)) + 1) / max(1, count)
        axes.step(np.sort(times), share, style, where="post", lw=1.8, label=f"{name} ({count} rooms)")
    axes.axhline(95, color="0.8", lw=1, zorder=0)
    axes.set(xscale="log", xlabel="CPU time, ms", ylabel="% of rooms fully furnished", ylim=(0, 101))
    axes.grid(visible=True, axis="x", color="0.92")
    figure.legend(fontsize=8, loc="outside lower center", ncols=2, frameon=False)
    return save_figure(figure, path)


def _both(times: Sequence[float | None]) -> tuple[list[float], int]:
    known = [t for t in times if t is not None]
    return known, len(known)

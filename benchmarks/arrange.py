"""Furniture arrangements: hard rules broken, rooms fully furnished, time, side by side with the paper's fixed ratios.

Rooms: the shared floor plans (even-numbered ones served for tuning: `placed_all_pct` is of the odd ones) and generated
ones with slanted walls, bays, columns and 24 corners. Items: the built-in sets of eight, `living` where the label says
so, else `bedroom`; rule set `tight` (paths of 0.6 m), and rooms >= 12 m2 by `standard`
too. Every arrangement is judged anew by `verify` and by a 1 cm raster.
Times are CPU times of one thread after warm-up (the search uses one), so that a busy machine does not change them.
SceneEval's figures: out of bounds, collision, opening clearance (a door keeps one leaf's depth, at most 0.9 m, and its
own width, in rooms whose doors have no known hand; a window 0.5 m against what is taller than its sill), navigability
with its own walker (0.2 m).
"""

from __future__ import annotations

import sys
import time
from dataclasses import replace
from typing import Any

import numpy as np
import shapely
from shapely.geometry import Polygon

from benchmarks._arrange_raster import Raster
from benchmarks._arrange_rivals import paper_faults, place_by_trial
from benchmarks._arrange_rooms import KINDS, generated, plan_of, shared_rooms, use_of
from processing.errors import LayoutError
from processing.layout.arrange import arrange
from processing.layout.arrangement import Arrangement, Arrangements
from processing.layout.item_list import set_items
from processing.layout.item_table import KINDS as ITEMS
from processing.layout.plan import FloorPlan
from processing.layout.rules import RuleSet, built_in_rules
from processing.layout.verify import Judge, Piece

QUICK_ROOMS, QUICK_GENERATED = 16, 1
FULL_GENERATED = 120
MIN_AREA_M2 = 12.0
UNITS = {"placed_all_pct": "% of odd-numbered rooms >= 12 m2", "navigability": "share of free floor"}


def run(*, quick: bool, seed: int) -> dict[str, Any]:
    """Return metrics and rivals; see the module's docstring."""
    rules = built_in_rules().named("tight")
    numbered = list(enumerate(shared_rooms()))
    listed = [(n, room) for n, room in numbered if any(o["kind"] == "door" for o in room["openings"])]
    step = max(1, len(listed) // QUICK_ROOMS) if quick else 1
    if len(listed) < len(numbered):
        print(f"rooms without a door, refused: {len(numbered) - len(listed)}", file=sys.stderr)
    shared: list[Any] = [(plan_of(r), use_of(r["label"]), n % 2) for n, r in listed[step // 2 :: step]]
    made = QUICK_GENERATED if quick else FULL_GENERATED
    generated_rooms = [
        (generated(kind, 900_000 + seed * 1000 + k), "bedroom" if k % 2 else "living", 2)
        for kind in KINDS
        for k in range(made)
    ]
    for plan, use, _ in (shared or generated_rooms)[:2]:  # warm-up: compiled code from the cache
        arrange(plan, set_items(use), rules, n=2)
    tally = _Tally(rules)
    for plan, use, group in [*shared, *generated_rooms]:
        tally.room(plan, use, group, seed)
    return {"metrics": tally.metrics(), "rivals": tally.rivals(), "units": UNITS, "notes": tally.notes}


class _Tally:
    """What is counted over all rooms."""

    def __init__(self, rules: RuleSet) -> None:
        self.rules = rules
        self.one_ms: list[float] = []
        self.seven_ms: list[float] = []
        self.large_one_ms: list[float] = []
        self.large_seven_ms: list[float] = []
        self.placed: dict[int, list[bool]] = {0: [], 1: [], 2: []}
        self.named: list[bool] = []
        self.layouts = self.judge_faults = self.raster_faults = self.rooms = self.refused = 0
        self.sevens: list[int] = []
        self.paper: list[bool] = []
        self.trial: list[tuple[float, bool]] = []
        self.scene: list[tuple[float, float, float, float]] = []
        self.notes: list[str] = []

    def room(self, plan: FloorPlan, use: str, group: int, seed: int) -> None:
        """Arrange one room; group: 0 tuning, 1 report, 2 generated."""
        items = set_items(use)
        self.rooms += 1
        self.paper += paper_faults(plan)
        try:
            start = time.process_time()
            one = arrange(plan, items, self.rules, n=1, seed=seed)
            one_ms = 1e3 * (time.process_time() - start)
            start = time.process_time()
            seven = arrange(plan, items, self.rules, n=7, seed=seed)
            seven_ms = 1e3 * (time.process_time() - start)
        except LayoutError as error:
            self.refused += 1
            if len(self.notes) < 8:
                self.notes.append(f"refused {plan.name}: {error.message}")
            return
        self.one_ms.append(one_ms)
        self.seven_ms.append(seven_ms)
        self._judge(plan, one, self.rules)
        self._judge(plan, seven, self.rules)
        if plan.area_m2 >= MIN_AREA_M2:
            self.large_one_ms.append(one_ms)
            self.large_seven_ms.append(seven_ms)
            complete = bool(one.arrangements) and one.arrangements[0].complete
            self.placed[group].append(complete)
            self.sevens.append(len(seven.arrangements))
            if not complete:
                told = one.arrangements[0].not_placed if one.arrangements else ()
                self.named.append(bool(told) and all(n.rule and n.reason for n in told))
            start = time.process_time()
            count, _ = place_by_trial(plan, items, self.rules, seed)
            self.trial.append((1e3 * (time.process_time() - start), count == len(items)))
            standard = built_in_rules().named("standard")
            self._judge(plan, arrange(plan, items, standard, n=7, seed=seed), standard)

    def _judge(self, plan: FloorPlan, result: Arrangements, rules: RuleSet) -> None:
        judge, raster = Judge(plan, rules), Raster(plan, rules)
        handless = all(door.hinge == "unknown" and door.swing == "unknown" for door in plan.doors)
        for one in result.arrangements:
            self.layouts += 1
            faults = judge.judge(_pieces(one)).violations
            self.judge_faults += bool(faults)
            seen = raster.faults(one)
            self.raster_faults += bool(seen)
            if (faults or seen) and len(self.notes) < 8:
                self.notes.append(f"{plan.name}: {[str(f) for f in faults][:2]} {seen[:2]}")
            if handless:
                self.scene.append(_scene_eval(plan, one))

    def metrics(self) -> dict[str, float]:
        scene = np.array(self.scene)
        return {
            "hard_violations": self.judge_faults + self.raster_faults,
            "raster_violations": self.raster_faults,
            "layouts": self.layouts,
            "rooms": self.rooms,
            "refused_rooms": self.refused,
            "placed_all_pct": _pct(self.placed[1]),
            "placed_all_tuning_pct": _pct(self.placed[0]),
            "placed_all_generated_pct": _pct(self.placed[2]),
            "rooms_12m2": sum(len(p) for p in self.placed.values()),
            "named_reason_pct": _pct(self.named),
            "p95_ms": _p95(self.large_one_ms),
            "median_ms": round(float(np.median(self.large_one_ms)), 1),
            "seven_p95_ms": _p95(self.large_seven_ms),
            "all_rooms_p95_ms": _p95(self.one_ms),
            "all_rooms_seven_p95_ms": _p95(self.seven_ms),
            "seven_found_mean": round(float(np.mean(self.sevens)), 2),
            "paper_faulty_pct": _pct(self.paper),
            "sceneeval_out_of_bounds_pct": round(100 * float(scene[:, 0].mean()), 3),
            "sceneeval_collision_pct": round(100 * float(scene[:, 1].mean()), 3),
            "sceneeval_opening_blocked_pct": round(100 * float(scene[:, 2].mean()), 3),
            "navigability": round(float(scene[:, 3].mean()), 4),
        }

    def rivals(self) -> dict[str, dict[str, float]]:
        times = [ms for ms, _ in self.trial]
        return {
            "paper_ratios": {"faulty_pct": _pct(self.paper)},
            "shapely_trial": {
                "p95_ms": _p95(times),
                "median_ms": round(float(np.median(times)), 1),
                "placed_all_pct": _pct([ok for _, ok in self.trial]),
                "median_ratio": round(float(np.median(times) / np.median(self.large_one_ms)), 2),
            },
        }


def _pct(values: list[bool]) -> float:
    return round(100 * float(np.mean(values)), 2) if values else 100.0


def _p95(values: list[float]) -> float:
    return round(float(np.percentile(values, 95)), 1)


def _pieces(one: Arrangement) -> list[Piece]:
    return [
        Piece(
            i.id,
            replace(ITEMS[i.category], size_m=i.size_m, base_m=i.base_m),
            *i.t_m[:2],
            i.theta_rad,
            i.group,
        )
        for i in one.items
    ]


def _scene_eval(plan: FloorPlan, one: Arrangement) -> tuple[float, float, float, float]:
    """Return the shares out of bounds, colliding, and of blocked openings, and the navigable share of the floor."""
    room = Polygon(plan.corners, list(plan.holes))
    loose = room.buffer(1e-4)
    shapes = []
    for i in one.items:
        c, s = np.cos(i.theta_rad), np.sin(i.theta_rad)
        w, d = i.size_m[0] / 2, i.size_m[1] / 2
        shapes.append(
            Polygon(
                [(i.t_m[0] + x * c - y * s, i.t_m[1] + x * s + y * c) for x, y in ((-w, -d), (w, -d), (w, d), (-w, d))]
            )
        )
    solid = [(i, s) for i, s in zip(one.items, shapes, strict=True) if i.category != "rug"]
    out = [not loose.covers(s) for s in shapes]
    hits = [
        any(
            o is not i
            and s.intersection(t).area > 1e-4
            and min(i.base_m + i.size_m[2], o.base_m + o.size_m[2]) > max(i.base_m, o.base_m) + 1e-4
            for o, t in solid
        )
        for i, s in solid
    ]
    blocked = []
    for door in plan.doors:
        corner, u, _ = plan.edge(door.edge)
        wide = door.end_m - door.start_m
        leaf = (
            0.6
            if wide > 2 or door.swing in ("sliding", "out")
            else wide / 2
            if wide > 1 and door.swing != "in"
            else min(wide, 0.9)
        )
        blocked.append(any(_box(corner, u, door.start_m, door.end_m, leaf).intersection(s).area > 1e-4 for s in shapes))
    for window in plan.windows:
        corner, u, _ = plan.edge(window.edge)
        box = _box(corner, u, window.start_m, window.end_m, 0.5)
        tall = [s for i, s in solid if i.base_m + i.size_m[2] > window.sill_m and i.base_m < window.head_m]
        blocked.append(any(box.intersection(s).area > 1e-4 for s in tall))
    free = room.difference(shapely.union_all([s for _, s in solid]))
    walk = free.buffer(-0.2)
    parts = [p.area for p in getattr(walk, "geoms", [walk])]
    share = max(parts, default=0.0) / sum(parts) if sum(parts) else 0.0
    return float(np.mean(out or [0])), float(np.mean(hits or [0])), float(np.mean(blocked or [0])), share


def _box(corner: Any, u: Any, t0: float, t1: float, deep: float) -> Polygon:
    n = np.array([-u[1], u[0]])
    return Polygon([corner + u * t0, corner + u * t1, corner + u * t1 + n * deep, corner + u * t0 + n * deep])

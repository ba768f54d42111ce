"""Are the reasons true? For rooms not fully furnished: every place of what was left out is tried, the oracle is asked.

*Confirmed*: beside the pieces that stand, none of those left out has a legal place: all poses on a 5 cm grid are tried
(at walls: every 5 cm along each, back or, by the solver's custom, a side to it; what stands free: every 5 cm of the
floor, along the walls' directions), by the judge, not by the solver. A piece whose host is left out has none by rule.
This is of the arrangement returned; whether any other holds everything is the oracle's question (`oracle`).
"""

from __future__ import annotations

import hashlib
import json
import math
import os
import time
from collections.abc import Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np
import shapely

from benchmarks.layout.oracle import FOLLOWS, SIDEWAYS_M2, ask
from benchmarks.layout.rows import pieces_of
from processing.layout.arrange import arrange
from processing.layout.items import Item, set_items
from processing.layout.plan import FloorPlan
from processing.layout.rules import RuleSet, built_in_rules
from processing.layout.verify import Judge, Piece

STEP_M = 0.05
SKIN_M = 1e-4
MOST_JUDGED = 1500
ORACLE_S = 10.0
Poses = np.ndarray
"""(n, 3): x, y, theta."""


def add_answers(rooms: Sequence[tuple[FloorPlan, str, int]], rows: Sequence[dict[str, Any]], seed: int) -> None:
    """Write `oracle` and `confirmed` into the rows that have reasons; answers are kept as rows are."""
    path = Path(os.environ.get("DAYLIT_CACHE", "/tmp")) / f"arrange-reasons-{seed}.jsonl"
    known = {}
    if path.exists():
        known = {row["key"]: row for row in map(json.loads, path.read_text("utf-8").splitlines())}
    limit_s, start = float(os.environ.get("DAYLIT_BENCH_CPU_S", "inf")), time.process_time()
    for (plan, use, _), row in zip(rooms, rows, strict=True):
        if not row.get("reasons"):
            continue
        key = hashlib.sha256(json.dumps([row["key"], row["reasons"], _source()]).encode()).hexdigest()[:16]
        if key not in known:
            if time.process_time() - start > limit_s:
                raise TimeoutError("all rooms are done, not all reasons looked at; run again to go on")
            known[key] = {"key": key, "room": row["room"], **_answers(plan, use, seed)}
            path.parent.mkdir(parents=True, exist_ok=True)
            with path.open("a", encoding="utf-8") as file:
                file.write(json.dumps(known[key]) + "\n")
        row |= {"oracle": known[key]["oracle"], "confirmed": known[key]["confirmed"]}


def _source() -> str:
    return hashlib.sha256(Path(__file__).read_bytes()).hexdigest()


def _answers(plan: FloorPlan, use: str, seed: int) -> dict[str, Any]:
    items, rules = set_items(use), built_in_rules().named("tight")
    one = arrange(plan, items, rules, n=1, seed=seed).arrangements[0]
    missing = {piece.id for piece in one.not_placed}
    left = [item for item in items if item.id in missing]
    return {
        "oracle": asdict(ask(plan, items, rules, ORACLE_S)),
        "confirmed": all(place_of(item, pieces_of(one), plan, rules) is None for item in left),
    }


def place_of(item: Item, placed: Sequence[Piece], plan: FloorPlan, rules: RuleSet) -> tuple[float, ...] | None:
    """Return a legal pose (x, y, theta) of a piece beside those placed; None where there is none on the grid."""
    spec = item.spec
    hosts = [p for p in placed if spec.bound and p.spec.category.endswith(spec.group_with)]
    if spec.category in FOLLOWS or (spec.bound and not hosts):
        return None
    judge = Judge(plan, rules)
    poses = _free_poses(plan) if spec.placement == "free" else _wall_poses(item, plan)
    if spec.category == "armchair":
        poses = np.concatenate([poses, _free_poses(plan)])
    poses = poses[_possible(item, poses, placed, plan, judge, rules)]
    if hosts:
        near = shapely.union_all([_boxes(np.array([[p.x_m, p.y_m, p.theta_rad]]), p.spec.size_m)[0] for p in hosts])
        poses = poses[shapely.distance(_boxes(poses, spec.size_m), near) <= rules.together + 1e-3]
    step = max(1, math.ceil(len(poses) / MOST_JUDGED))
    for x, y, theta in poses[::step].tolist():
        if judge.passes([*placed, Piece(item.id, spec, x, y, theta, item.id)]):
            return x, y, theta
    return None


def _edges(plan: FloorPlan) -> list[tuple[np.ndarray, np.ndarray, float]]:
    """Return (first corner, direction, length) of all walls, columns' too."""
    found = []
    for ring in (plan.corners, *plan.holes):
        for a, b in zip(ring, np.roll(ring, -1, axis=0), strict=True):
            length = float(np.hypot(*(b - a)))
            found.append((a, (b - a) / length, length))
    return found


def _wall_poses(item: Item, plan: FloorPlan) -> Poses:
    w, d, _ = item.spec.size_m
    sides = (0, 1, 3) if item.spec.footprint_m2 >= SIDEWAYS_M2 and item.spec.category != "tv stand" else (0,)
    rows = []
    for corner, u, length in _edges(plan):
        inward, angle = np.array([-u[1], u[0]]), math.atan2(u[1], u[0])
        for quarter in sides:
            along, deep = (w, d) if quarter == 0 else (d, w)
            if length < along:
                continue
            for s in np.unique([*np.arange(0, length - along, STEP_M), length - along]):
                x, y = corner + u * (s + along / 2) + inward * (deep / 2 + SKIN_M / 2)
                rows.append((x, y, angle + quarter * math.pi / 2))
    return np.array(rows).reshape(-1, 3)


def _free_poses(plan: FloorPlan) -> Poses:
    low, high = plan.corners.min(axis=0), plan.corners.max(axis=0)
    angles = sorted({round(math.atan2(u[1], u[0]) % (math.pi / 2), 6) for _, u, length in _edges(plan) if length > 0.5})
    x, y, a = np.meshgrid(
        np.arange(low[0], high[0], STEP_M),
        np.arange(low[1], high[1], STEP_M),
        [angle + k * math.pi / 2 for angle in angles for k in range(4)],
    )
    return np.stack([x.ravel(), y.ravel(), a.ravel()], axis=1)


def _boxes(poses: Poses, size_m: Sequence[float], rect: tuple[float, ...] | None = None) -> np.ndarray:
    """Return polygons of rectangles of the piece's frame (its footprint) at poses, a skin smaller."""
    x0, x1, y0, y1 = rect or (-size_m[0] / 2, size_m[0] / 2, -size_m[1] / 2, size_m[1] / 2)
    local = np.array(
        [[x0 + SKIN_M, y0 + SKIN_M], [x1 - SKIN_M, y0 + SKIN_M], [x1 - SKIN_M, y1 - SKIN_M], [x0 + SKIN_M, y1 - SKIN_M]]
    )
    c, s = np.cos(poses[:, 2])[:, None], np.sin(poses[:, 2])[:, None]
    corners = np.stack([local[:, 0] * c - local[:, 1] * s, local[:, 0] * s + local[:, 1] * c], axis=2)
    return np.asarray(shapely.polygons(corners + poses[:, None, :2]))


def _possible(
    item: Item, poses: Poses, placed: Sequence[Piece], plan: FloorPlan, judge: Judge, rules: RuleSet
) -> np.ndarray:
    """Return which poses are worth judging: in the room, on no other piece, the use zones before and behind free."""
    shapes = _boxes(poses, item.spec.size_m)
    good = shapely.covers(judge.room, shapes)
    solid = [p for p in placed if not p.spec.is_rug and p.spec.base_m < item.spec.top_m and not item.spec.is_rug]
    bodies = shapely.union_all([_boxes(np.array([[p.x_m, p.y_m, p.theta_rad]]), p.spec.size_m)[0] for p in solid])
    good &= ~shapely.intersects(shapes, bodies)
    w, d, _ = (v / 2 for v in item.spec.size_m)
    for zone in item.spec.zones:
        deep = zone.depth_m(rules)
        if zone.side in ("front", "back") and deep > 0:
            rect = (-w, w, d, d + deep) if zone.side == "front" else (-w, w, -d - deep, -d)
            zones = _boxes(poses, item.spec.size_m, rect)
            good &= shapely.covers(judge.room, zones) & ~shapely.intersects(zones, bodies)
    return np.asarray(good)

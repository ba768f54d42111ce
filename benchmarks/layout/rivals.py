"""Rivals in the arrangement benchmark: the paper's fixed ratios, and placing by trial with shapely alone.

The paper's ratios are not published with a licence: the seven sets here are ours, in the paper's form (an item along
the window's side and along the wall beside it), spread over the room as its figure shows.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

import numpy as np
import shapely
from shapely.geometry import Polygon

from processing.layout.items import Item
from processing.layout.plan import FloorPlan
from processing.layout.rules import RuleSet

SIZES = {"couch": (1.6, 0.8), "bed": (1.5, 2.0), "table": (1.2, 0.6), "chair": (0.6, 0.6)}
SETS = (
    {"couch": (0.0, 0.5, 0), "bed": (1.0, 1.0, 1), "table": (0.5, 0.5, 0), "chair": (0.6, 0.2, 1)},
    {"couch": (0.5, 1.0, 1), "bed": (0.0, 0.0, 0), "table": (1.0, 0.0, 0), "chair": (1.0, 0.3, 1)},
    {"couch": (1.0, 0.5, 0), "bed": (0.0, 1.0, 1), "table": (0.4, 0.1, 0), "chair": (0.5, 0.4, 1)},
    {"couch": (0.2, 0.0, 0), "bed": (1.0, 0.3, 0), "table": (0.2, 0.5, 1), "chair": (0.3, 0.9, 1)},
    {"couch": (0.5, 0.6, 1), "bed": (0.5, 0.0, 0), "table": (0.0, 1.0, 1), "chair": (1.0, 1.0, 1)},
    {"couch": (0.0, 1.0, 1), "bed": (1.0, 0.0, 0), "table": (0.0, 0.2, 0), "chair": (0.1, 0.5, 0)},
    {"couch": (1.0, 1.0, 1), "bed": (0.2, 0.2, 0), "table": (1.0, 0.4, 0), "chair": (0.8, 0.5, 1)},
)


def paper_faults(plan: FloorPlan) -> list[bool]:
    """Return for each of the seven sets whether anything is wrong: outside, overlapping, a door blocked, no path.

    The frame is the smallest rectangle around the floor, the window's side the one along the widest window. A door
    keeps its width free, at most 0.9 m deep; a path is 0.6 m wide.
    """
    room = Polygon(plan.corners, list(plan.holes))
    origin, along, away, length, depth = _frame(plan, room)
    doors = [_strip(plan, d.edge, d.start_m, d.end_m, min(0.9, d.end_m - d.start_m)) for d in plan.doors]
    ways = [_strip(plan, d.edge, d.start_m, d.end_m, 0.6) for d in plan.doors]
    return [_faulty(room, doors, ways, _shapes(ratios, origin, along, away, length, depth)) for ratios in SETS]


def _frame(plan: FloorPlan, room: Polygon) -> tuple[Any, Any, Any, float, float]:
    box = np.array(room.minimum_rotated_rectangle.exterior.coords)[:4]
    box = box if shapely.is_ccw(shapely.linearrings(box)) else box[::-1]
    side = 0
    if plan.windows:
        window = max(plan.windows, key=lambda w: w.width_m)
        u = plan.edge(window.edge)[1]
        side = max(range(4), key=lambda k: float((box[(k + 1) % 4] - box[k]) @ u / math.dist(box[k], box[(k + 1) % 4])))
    a, b, c = box[side], box[(side + 1) % 4], box[(side + 2) % 4]
    return a, (b - a) / math.dist(a, b), (c - b) / math.dist(b, c), math.dist(a, b), math.dist(b, c)


def _shapes(ratios: dict[str, Any], origin: Any, along: Any, away: Any, length: float, depth: float) -> list[Polygon]:
    shapes = []
    for name, (r1, r2, _) in ratios.items():
        w, d = SIZES[name]
        corner = origin + along * r1 * (length - w) + away * r2 * (depth - d)
        shapes.append(Polygon([corner, corner + along * w, corner + along * w + away * d, corner + away * d]))
    return shapes


def _strip(plan: FloorPlan, edge: int, t0: float, t1: float, deep: float) -> Polygon:
    corner, u, _ = plan.edge(edge)
    n = np.array([-u[1], u[0]])
    return Polygon([corner + u * t0, corner + u * t1, corner + u * t1 + n * deep, corner + u * t0 + n * deep])


def _faulty(room: Polygon, doors: Sequence[Polygon], ways: Sequence[Polygon], shapes: Sequence[Polygon]) -> bool:
    if any(not room.buffer(1e-6).covers(s) for s in shapes):
        return True
    if any(a.intersection(b).area > 1e-4 for k, a in enumerate(shapes) for b in shapes[:k]):
        return True
    if any(s.intersection(d).area > 1e-4 for s in shapes for d in doors):
        return True
    walk = room.difference(shapely.union_all(list(shapes))).buffer(-0.299)
    parts = list(getattr(walk, "geoms", [walk]))
    return not any(all(not p.is_empty and p.distance(w) < 1e-6 for w in ways) for p in parts)


def place_by_trial(
    plan: FloorPlan, items: Sequence[Item], rules: RuleSet, seed: int, restarts: int = 6, tries: int = 60
) -> tuple[int, int]:
    """Place each item alone at random along walls, tested with shapely until it fits; return (most placed, tests).

    Overlaps, walls, doors, windows and front zones are looked at, paths are not: an easier task than ours.
    """
    rng = np.random.default_rng(seed)
    room = Polygon(plan.corners, list(plan.holes)).buffer(1e-9)
    shapely.prepare(room)
    doors = [
        _strip(plan, d.edge, d.start_m, d.end_m, max(rules.door_approach, min(1.0, d.width_m))) for d in plan.doors
    ]
    bands = [(w, _strip(plan, w.edge, w.start_m, w.end_m, rules.window_band)) for w in plan.windows]
    best = tests = 0
    order = sorted(items, key=lambda i: -i.spec.footprint_m2)
    for _ in range(restarts):
        solid: list[Polygon] = []
        zones: list[Polygon] = []
        for item in order:
            w, d, _h = item.spec.size_m
            front = max((z.depth_m(rules) for z in item.spec.zones if z.side == "front"), default=0.0)
            for _ in range(tries):
                edge = int(rng.integers(len(plan.corners)))
                length = plan.edge(edge)[2]
                if length < w:
                    continue
                t = rng.uniform(0, length - w)
                tests += 1
                body = _strip(plan, edge, t, t + w, d)
                zone = _strip(plan, edge, t, t + w, d + front)
                if not room.covers(zone) or any(body.intersection(s).area > 1e-9 for s in (*doors, *zones)):
                    continue
                if any(zone.intersection(s).area > 1e-9 for s in solid):
                    continue
                if any(item.spec.top_m > win.sill_m - 0.05 and body.intersection(b).area > 1e-9 for win, b in bands):
                    continue
                solid.append(body)
                zones.append(zone)
                break
        best = max(best, len(solid))
        if best == len(items):
            break
    return best, tests

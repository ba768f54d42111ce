"""SceneEval's figures of an arrangement: out of bounds, collision, opening clearance, navigability."""

from __future__ import annotations

from typing import Any

import numpy as np
import shapely
from shapely.geometry import Polygon

from processing.layout.arrangement import Arrangement
from processing.layout.plan import FloorPlan


def scene_eval(plan: FloorPlan, one: Arrangement) -> tuple[float, float, float, float]:
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
    return float(np.mean(out or [False])), float(np.mean(hits or [False])), float(np.mean(blocked or [False])), share


def _box(corner: Any, u: Any, t0: float, t1: float, deep: float) -> Polygon:
    n = np.array([-u[1], u[0]])
    return Polygon([corner + u * t0, corner + u * t1, corner + u * t1 + n * deep, corner + u * t0 + n * deep])

"""Rooms for the arrangement benchmark: the shared floor plans, and generated ones with slants, bays and columns."""

from __future__ import annotations

import json
import math
from typing import Any

import numpy as np

from benchmarks.shared_data import DATA
from processing.errors import PlanError
from processing.layout.plan import Door, FloorPlan, Window, make_plan
from processing.layout.plan_files import plan_from_mapping

SHARED = DATA / "floorplans"
KINDS = ("slanted", "bay", "column", "corners24")


def shared_rooms() -> list[dict[str, Any]]:
    """Return the rooms of the shared floor plans as they are listed, all files after each other; [] where absent."""
    if not SHARED.is_dir():
        return []
    return [
        json.loads(line)
        for name in ("r2v", "ifc", "zind")
        for line in (SHARED / f"{name}.jsonl").read_text("utf-8").splitlines()
    ]


def plan_of(room: dict[str, Any]) -> FloorPlan:
    return plan_from_mapping(room, where=room["id"])


def use_of(label: str) -> str:
    """Return the set of items for a room's label."""
    return "living" if "living" in label else "bedroom"


def generated(kind: str, seed: int) -> FloorPlan:
    """Return a room of 14 to 32 m2 of a kind; openings lie on walls that are long enough."""
    rng = np.random.default_rng([seed, KINDS.index(kind)])
    for _ in range(50):
        w, d = rng.uniform(4.0, 6.4), rng.uniform(3.6, 5.2)
        ring = {"slanted": _slanted, "bay": _bay, "column": _plain, "corners24": _steps}[kind](w, d, rng)
        turn = rng.uniform(-math.pi, math.pi)
        c, s = math.cos(turn), math.sin(turn)
        ring = ring @ np.array([[c, s], [-s, c]])
        holes = []
        if kind == "column":
            at, half = np.array([w, d]) * rng.uniform(0.35, 0.65, 2), rng.uniform(0.15, 0.25)
            box = np.array([[-half, -half], [half, -half], [half, half], [-half, half]]) + at
            holes = [(box @ np.array([[c, s], [-s, c]])).tolist()]
        try:
            bare = make_plan(ring, holes=holes, name=f"{kind}-{seed}")
            return _with_openings(bare, holes, rng)
        except (PlanError, IndexError):
            continue
    raise RuntimeError(f"no room of kind {kind} with seed {seed}")


def _plain(w: float, d: float, rng: np.random.Generator) -> Any:
    return np.array([[0, 0], [w, 0], [w, d], [0, d]])


def _slanted(w: float, d: float, rng: np.random.Generator) -> Any:
    a, b = rng.uniform(0.3, 1.4, 2)
    e, f = rng.uniform(-0.5, 0.5, 2)
    return np.array([[a, 0], [w, e], [w, d - b], [w - b, d], [f, d], [0, a]])


def _bay(w: float, d: float, rng: np.random.Generator) -> Any:
    m, half, out = rng.uniform(0.4, 0.6) * w, rng.uniform(0.7, 1.1), rng.uniform(0.4, 0.8)
    inner = half - rng.uniform(0.2, 0.5)
    bay = [[m + half, d], [m + inner, d + out], [m - inner, d + out], [m - half, d]]
    return np.array([[0, 0], [w, 0], [w, d], *bay, [0, d]])


def _steps(w: float, d: float, rng: np.random.Generator) -> Any:
    """Return 24 corners: five niches and piers of 0.15 to 0.5 m along the walls."""
    ring: list[list[float]] = []
    for (ax, ay), (bx, by), count in (
        ((0, 0), (w, 0), 2),
        ((w, 0), (w, d), 1),
        ((w, d), (0, d), 1),
        ((0, d), (0, 0), 1),
    ):
        ring.append([ax, ay])
        length = math.hypot(bx - ax, by - ay)
        ux, uy = (bx - ax) / length, (by - ay) / length
        for k in range(count):
            middle = length * (k + 1) / (count + 1) + rng.uniform(-0.3, 0.3)
            half, deep = rng.uniform(0.2, 0.6), rng.choice([-1, 1]) * rng.uniform(0.15, 0.5)
            for t, y in ((middle - half, 0.0), (middle - half, deep), (middle + half, deep), (middle + half, 0.0)):
                ring.append([ax + t * ux - y * uy, ay + t * uy + y * ux])
    return np.array(ring)


def _with_openings(plan: FloorPlan, holes: Any, rng: np.random.Generator) -> FloorPlan:
    lengths = [plan.edge(i)[2] for i in range(len(plan.corners))]
    long_walls = [i for i, length in enumerate(lengths) if length > 1.3]
    rng.shuffle(long_walls)
    doors, windows = [], []
    for number in range(int(rng.integers(1, 3))):
        edge = long_walls.pop()
        wide = rng.uniform(0.75, 0.95)
        start = rng.uniform(0.0, lengths[edge] - wide)
        hinge, swing = str(rng.choice(["left", "right", "unknown"])), str(rng.choice(["in", "in", "unknown", "out"]))
        doors.append(Door(edge, start, start + wide, hinge, swing, f"d{number}"))  # type: ignore[arg-type]
    for _ in range(min(2, len(long_walls))):
        edge = long_walls.pop()
        wide = min(lengths[edge] - 0.2, rng.uniform(0.8, 2.0))
        start = rng.uniform(0.0, lengths[edge] - wide)
        windows.append(Window(edge, start, start + wide, float(rng.choice([0.0, 0.5, 0.9])), 2.1))
    return make_plan(plan.corners, holes=holes, doors=doors, windows=windows, ceiling_height_m=2.5, name=plan.name)

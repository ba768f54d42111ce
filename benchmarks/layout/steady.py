"""How far furniture moves where a room is measured anew: corners and ends of openings off by up to 1 cm.

Rooms: simulated ones (test seeds) and generated boxes and L-shapes, by the rules `standard`, three alternatives, the
camera's place kept free. Each is arranged as it is and with three draws of noise, uniform within 1 cm in every
coordinate of a corner and at both ends of each opening. Pieces are matched by category, alternatives by rank; in a room
that is refused once it is measured anew, all have moved.
"""

from __future__ import annotations

import time
from collections.abc import Iterator
from dataclasses import replace
from typing import Any, TypeVar

import numpy as np
from scipy.optimize import linear_sum_assignment

from benchmarks.truth_rooms import room_model_of, truth_list
from mocks.rooms.room import make_room
from processing.errors import LayoutError
from processing.layout.arrange import arrange
from processing.layout.arrangement import Arrangement, Arrangements
from processing.layout.assumed import with_door
from processing.layout.items import set_items
from processing.layout.plan import Door, FloorPlan, Window, from_room_model, make_plan

NOISE_M, STEADY_M = 0.01, 0.1
QUICK_ROOMS, FULL_ROOMS = 8, 48
"""Simulated rooms; as many boxes and L-shapes each by half."""
DRAWS = 3
ALTERNATIVES = 3
UNITS = {"moved_p50_m": "m, of an alternative's worst piece", "moved_p90_m": "m", "score_mean": "0 to 1"}
OpeningT = TypeVar("OpeningT", Door, Window)


def run(*, quick: bool, seed: int) -> dict[str, Any]:
    """Return the share of alternatives in which every piece stays where it is, and how far the worst piece moves."""
    arrange(*boxed(0), "standard", n=ALTERNATIVES)  # warm-up: compiled code from the cache
    every = [_measured(plan, items, number) for number, (plan, items) in enumerate(rooms("test", quick, seed))]
    rows = [row for row in every if row is not None]
    moved = np.concatenate([row["moved"] for row in rows])
    scores = [score for row in rows for score in row["scores"]]
    metrics = {
        "rooms": float(len(rows)),
        "refused_rooms": float(len(every) - len(rows)),
        "steady_pct": round(100 * float(np.mean(moved < STEADY_M)), 1),
        "steady_first_pct": round(100 * float(np.mean(np.concatenate([r["first"] for r in rows]) < STEADY_M)), 1),
        "moved_p50_m": round(float(np.median(moved)), 3),
        "moved_p90_m": round(float(np.percentile(moved, 90)), 2),
        "placed_all_pct": round(100 * float(np.mean([row["complete"] for row in rows])), 1),
        "score_best_mean": round(float(np.mean([row["scores"][0] for row in rows if row["scores"]])), 4),
        "score_mean": round(float(np.mean(scores)), 4),
        "found_mean": round(float(np.mean([len(row["scores"]) for row in rows])), 2),
        "median_ms": round(float(np.median([row["ms"] for row in rows])), 1),
        "p95_ms": round(float(np.percentile([row["ms"] for row in rows], 95)), 1),
    }
    return {"metrics": metrics, "rivals": {}, "units": UNITS, "notes": []}


def rooms(split: Any, quick: bool, seed: int) -> Iterator[tuple[FloorPlan, list[Any]]]:
    """Yield plans and items: simulated rooms, boxes, L-shapes."""
    count = QUICK_ROOMS if quick else FULL_ROOMS
    for number, use in truth_list(split, count, seed):
        room, _ = with_door(room_model_of(make_room(number, use)))
        yield from_room_model(room, keep_camera_free=True, name=f"{use.value}-{number}"), set_items(use.value)
    for k in range(count):
        yield boxed(900_000 + 1000 * seed + k)


def noisy(plan: FloorPlan, seed: int, noise_m: float = NOISE_M) -> FloorPlan:
    """Return the plan measured anew: each coordinate of a corner and each end of an opening off by up to `noise_m`."""
    rng = np.random.default_rng(seed)

    def moved(openings: tuple[OpeningT, ...], corners: Any) -> Iterator[OpeningT]:
        for one in openings:
            ends = corners[[one.edge, (one.edge + 1) % len(corners)]]
            long_m = float(np.hypot(*(ends[1] - ends[0])))
            low, high = np.array([one.start_m, one.end_m]) + rng.uniform(-noise_m, noise_m, 2)
            yield replace(one, start_m=max(0.0, float(low)), end_m=min(long_m, float(high)))

    corners = plan.corners + rng.uniform(-noise_m, noise_m, plan.corners.shape)
    doors, windows = moved(plan.doors, corners), moved(plan.windows, corners)
    return make_plan(
        corners,
        ceiling_height_m=plan.ceiling_height_m,
        doors=list(doors),
        windows=list(windows),
        keep_free=plan.keep_free,
        name=plan.name,
    )


def moved_m(before: Arrangement, after: Arrangement) -> float:
    """Return how far the piece that moved most did, matched by category; infinite where one is missing."""
    worst = 0.0
    for category in {item.category for item in (*before.items, *after.items)}:
        old, new = (np.array([i.t_m[:2] for i in one.items if i.category == category]) for one in (before, after))
        if len(old) != len(new):
            return float("inf")
        gaps = np.hypot(*(old[:, None] - new[None]).transpose(2, 0, 1))
        pairs = linear_sum_assignment(gaps**2)
        worst = max(worst, float(gaps[pairs].max()))
    return worst


def _measured(plan: FloorPlan, items: list[Any], number: int) -> dict[str, Any] | None:
    try:
        start = time.process_time()
        first = arrange(plan, items, "standard", n=ALTERNATIVES)
        ms = 1e3 * (time.process_time() - start)
    except LayoutError:
        return None
    moved = [moves(first, _anew(plan, items, DRAWS * number + k)) for k in range(DRAWS)]
    return {
        "moved": np.concatenate(moved),
        "first": [one[0] for one in moved if one],
        "complete": bool(first.arrangements and first.arrangements[0].complete),
        "scores": [one.score for one in first.arrangements],
        "ms": ms,
    }


def _anew(plan: FloorPlan, items: list[Any], seed: int) -> Arrangements | None:
    """Return the arrangements of a room measured anew; None where it is refused then."""
    try:
        return arrange(noisy(plan, seed), items, "standard", n=ALTERNATIVES)
    except LayoutError:
        return None


def moves(first: Arrangements, other: Arrangements | None) -> list[float]:
    """Return how far each alternative's worst piece moved; one that is missing moved infinitely far."""
    theirs = dict(enumerate(other.arrangements)) if other else {}
    return [moved_m(a, theirs[k]) if k in theirs else float("inf") for k, a in enumerate(first.arrangements)]


def boxed(seed: int) -> tuple[FloorPlan, list[Any]]:
    """Return a box or (odd seeds) an L-shape of 12 to 33 m2, turned, with a door, one or two windows and a camera."""
    rng = np.random.default_rng([seed, 5])
    w, d = rng.uniform(3.6, 6.2), rng.uniform(3.4, 5.4)
    ring = np.array([[0, 0], [w, 0], [w, d], [0, d]])
    if seed % 2:
        a, b = rng.uniform(0.3, 0.5) * w, rng.uniform(0.25, 0.45) * d
        w, d = w + 0.5, d + 0.5
        ring = np.array([[0, 0], [w, 0], [w, d - b], [w - a, d - b], [w - a, d], [0, d]])
    turn = rng.uniform(-np.pi, np.pi)
    c, s = np.cos(turn), np.sin(turn)
    camera = np.array([w, d]) * rng.uniform(0.35, 0.6, 2)
    ring = (ring - camera) @ np.array([[c, s], [-s, c]])
    lengths = np.hypot(*(np.roll(ring, -1, axis=0) - ring).T)
    walls = [int(i) for i in rng.permutation(len(ring)) if lengths[i] > 1.6]
    at = rng.uniform(0.05, lengths[walls[0]] - 1.0)
    windows = []
    for wall in walls[1 : 2 + int(rng.integers(0, 2))]:
        wide = rng.uniform(0.9, min(2.4, lengths[wall] - 0.4))
        start = rng.uniform(0.2, lengths[wall] - wide - 0.1)
        windows.append(Window(wall, start, start + wide, float(rng.choice([0.0, 0.5, 0.9])), 2.1))
    plan = make_plan(
        ring, doors=[Door(walls[0], at, at + 0.85)], windows=windows, keep_free=[(0.0, 0.0)], name=f"box-{seed}"
    )
    return plan, set_items(("bedroom", "living", "office", "dining")[seed // 2 % 4])

"""Soft scores of a whole arrangement: each 0 to 1, None where it does not apply; `rules.toml` has the weights."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import TypeAlias

import numpy as np
from shapely import Polygon, union_all

from processing.layout.grouping import ROLES
from processing.layout.plan import FloorPlan
from processing.layout.polygons import Array
from processing.layout.poses import Stand

Pair: TypeAlias = tuple[float, float]
Samples: TypeAlias = tuple[Array, Array]
"""Points (n, 2) on the floor and their distances (n,) to the walls."""
SEATS = ("sofa", "armchair")
SAMPLES = 18


def soft_scores(plan: FloorPlan, placed: Sequence[Stand], samples: Samples | None = None) -> dict[str, float]:
    """Return the scores that apply to what is placed; `samples` (of the same plan) spare time where there are many."""
    samples = samples or floor_samples(plan)
    found: dict[str, float | None] = {
        "conversation": _conversation(placed),
        "viewing": _viewing(placed),
        "bed_view": _bed_view(plan, placed),
        "bed_wall": _bed_wall(plan, placed),
        "desk_light": _desk_light(plan, placed),
        "wall_use": _wall_use(placed),
        "alignment": _alignment(placed),
        "balance": _balance(plan, placed),
        "openness": _openness(plan, placed, samples),
        "daylight": _daylight(plan, placed),
        "walk": _walk(plan, placed),
        "together": _together(placed),
    }
    return {name: round(min(1.0, max(0.0, value)), 4) for name, value in found.items() if value is not None}


def weighted(scores: Mapping[str, float], weights: Mapping[str, float]) -> float:
    """Return the weighted mean of the scores that apply."""
    total = sum(weights.get(name, 0.0) for name in scores)
    return round(sum(weights.get(name, 0.0) * value for name, value in scores.items()) / total, 4) if total else 0.0


def _ramp(value: float, zero: float, one: float) -> float:
    return min(1.0, max(0.0, (value - zero) / (one - zero)))


def _of(placed: Sequence[Stand], *names: str) -> list[Stand]:
    return [s for s in placed if s.item.spec.category in names or ROLES.get(s.item.spec.category) in names]


def _looks(a: Stand, b: Stand) -> tuple[float, float]:
    """Return the distance, and the cosine between a's front and the way to b."""
    dx, dy = b.x_m - a.x_m, b.y_m - a.y_m
    d = math.hypot(dx, dy) + 1e-9
    fx, fy = a.facing()
    return d, (dx * fx + dy * fy) / d


def _conversation(placed: Sequence[Stand]) -> float | None:
    seats = _of(placed, *SEATS)
    if len(seats) < 2:
        return None
    values = []
    for i, a in enumerate(seats):
        for b in seats[i + 1 :]:
            d, to = _looks(a, b)
            back = _looks(b, a)[1]
            near = _ramp(d, 4.0, 2.6) * _ramp(d, 0.6, 1.3)
            values.append(near * (0.5 * _ramp(to, -0.2, 0.6) + 0.5 * _ramp(back, -0.2, 0.6)))
    return float(np.mean(values))


def _viewing(placed: Sequence[Stand]) -> float | None:
    screens = _of(placed, "tv") or _of(placed, "tv stand")
    viewers = _of(placed, "sofa") or _of(placed, "armchair") or _of(placed, "bed")
    if not screens or not viewers:
        return None
    tv, best = screens[0], 0.0
    width_m, _, height_m = tv.item.spec.size_m
    diagonal_m = max(0.8, math.hypot(width_m, height_m if tv.item.spec.category == "tv" else 0.6))
    for seat in viewers:
        d, to = _looks(tv, seat)
        back = _looks(seat, tv)[1]
        far = _ramp(d, 0.8 * diagonal_m, 1.2 * diagonal_m) * _ramp(d, 4.0 * diagonal_m, 2.6 * diagonal_m)
        best = max(best, _ramp(to, 0.5, 0.94) * _ramp(back, 0.3, 0.94) * (0.4 + 0.6 * far))
    return best


def _openings(plan: FloorPlan, kind: str) -> list[tuple[Pair, Pair, float]]:
    """Return (middle, inward direction, width) of doors or windows."""
    found = []
    for o in plan.doors if kind == "door" else plan.windows:
        corner, along, _ = plan.edge(o.edge)
        middle = corner + along * (o.start_m + o.end_m) / 2
        found.append(((float(middle[0]), float(middle[1])), (float(-along[1]), float(along[0])), o.width_m))
    return found


def _bed_view(plan: FloorPlan, placed: Sequence[Stand]) -> float | None:
    beds, doors = _of(placed, "bed"), _openings(plan, "door")
    if not beds or not doors:
        return None
    values = []
    for bed in beds:
        fx, fy = bed.facing()
        for (x, y), _, _ in doors:
            dx, dy = x - bed.x_m, y - bed.y_m
            d = math.hypot(dx, dy) + 1e-9
            in_line = (dx * fx + dy * fy) > 0 and abs(dx * fy - dy * fx) < 0.5
            values.append(_ramp((dx * fx + dy * fy) / d, -0.4, 0.3) * (0.6 if in_line else 1.0))
    return float(np.mean(values))


def _bed_wall(plan: FloorPlan, placed: Sequence[Stand]) -> float | None:
    beds = _of(placed, "bed")
    if not beds:
        return None
    values = []
    for bed in beds:
        sides = sum(1 for x0, x1, _, _ in bed.zones if x1 <= 0 or x0 >= 0)
        behind = _behind(plan, bed)
        values.append((0.5 if bed.edge is not None else 0.0) * (1 - behind) + 0.25 * min(2, sides))
    return float(np.mean(values))


def _behind(plan: FloorPlan, stand: Stand) -> float:
    """Return the share of a piece's width that has a window behind it."""
    if stand.edge is None or stand.edge >= len(plan.corners):
        return 0.0
    corner, along, _ = plan.edge(stand.edge)
    at = float((np.array([stand.x_m, stand.y_m]) - corner) @ along)
    half = stand.item.spec.size_m[0] / 2
    over = sum(
        max(0.0, min(at + half, w.end_m) - max(at - half, w.start_m)) for w in plan.windows if w.edge == stand.edge
    )
    return min(1.0, over / (2 * half))


def _desk_light(plan: FloorPlan, placed: Sequence[Stand]) -> float | None:
    desks, windows = _of(placed, "desk"), _openings(plan, "window")
    if not desks or not windows:
        return None
    values = []
    for desk in desks:
        fx, fy = desk.facing()
        best = 0.0
        for (x, y), _, _ in windows:
            dx, dy = x - desk.x_m, y - desk.y_m
            d = math.hypot(dx, dy) + 1e-9
            best = max(best, abs((dx * fy - dy * fx) / d) * _ramp(d, 5.0, 1.5))
        values.append(best)
    return float(np.mean(values))


def _wall_use(placed: Sequence[Stand]) -> float | None:
    large = [s for s in placed if s.item.spec.placement == "wall" and s.item.spec.footprint_m2 >= 0.15]
    if not large:
        return None
    return sum(s.item.spec.footprint_m2 for s in large if s.edge is not None) / sum(
        s.item.spec.footprint_m2 for s in large
    )


def _alignment(placed: Sequence[Stand]) -> float | None:
    if len(placed) < 2:
        return None
    weights = np.array([s.item.spec.footprint_m2 for s in placed])
    phases = np.array([s.theta_rad * 4 for s in placed])
    return float(np.hypot((weights * np.cos(phases)).sum(), (weights * np.sin(phases)).sum()) / weights.sum())


def _balance(plan: FloorPlan, placed: Sequence[Stand]) -> float | None:
    solid = [s for s in placed if not s.item.spec.is_rug]
    if not solid:
        return None
    weights = np.array([math.prod(s.item.spec.size_m) for s in solid])
    at = (np.array([[s.x_m, s.y_m] for s in solid]) * weights[:, None]).sum(axis=0) / weights.sum()
    ring = plan.corners
    cross = ring[:, 0] * np.roll(ring[:, 1], -1) - np.roll(ring[:, 0], -1) * ring[:, 1]
    middle = ((ring + np.roll(ring, -1, axis=0)) * cross[:, None]).sum(axis=0) / (3 * cross.sum())
    return 1 - float(np.hypot(*(at - middle))) / (0.5 * math.sqrt(plan.area_m2))


def floor_samples(plan: FloorPlan) -> Samples:
    """Return points over the floor and their distance to the nearest wall."""
    low, high = plan.corners.min(axis=0), plan.corners.max(axis=0)
    xs, ys = np.meshgrid(np.linspace(low[0], high[0], SAMPLES), np.linspace(low[1], high[1], SAMPLES))
    points = np.stack([xs.ravel(), ys.ravel()], axis=1)
    clear = _wall_distance(plan, points)
    return points[clear > 0.1], clear[clear > 0.1]


def _openness(plan: FloorPlan, placed: Sequence[Stand], samples: Samples) -> float:
    """Return how large a free circle is left, against the largest that furniture of this area could leave."""
    solid = [s for s in placed if not s.item.spec.is_rug]
    points, clear = samples
    if solid and len(points):
        at = np.array([(s.x_m, s.y_m, math.cos(s.theta_rad), math.sin(s.theta_rad)) for s in solid])
        half = np.array([s.item.spec.size_m[:2] for s in solid]) / 2
        dx, dy = points[:, :1] - at[:, 0], points[:, 1:] - at[:, 1]
        u = np.abs(dx * at[:, 2] + dy * at[:, 3]) - half[:, 0]
        v = np.abs(dy * at[:, 2] - dx * at[:, 3]) - half[:, 1]
        gap = np.sqrt(np.maximum(u, 0) ** 2 + np.maximum(v, 0) ** 2) + np.minimum(0, np.maximum(u, v))
        clear = np.minimum(clear, gap.min(axis=1))
    covered = sum(s.item.spec.footprint_m2 for s in solid)
    best = 0.5 * math.sqrt(max(0.5, plan.area_m2 - covered))
    return float(max(0.0, clear.max(initial=0.0)) / (0.8 * best))


def _wall_distance(plan: FloorPlan, points: Array) -> Array:
    """Return the distance to the nearest wall, negative outside."""
    best = np.full(len(points), np.inf)
    odd = np.zeros(len(points), dtype=bool)
    for ring in (plan.corners, *plan.holes):
        for a, b in zip(ring, np.roll(ring, -1, axis=0), strict=True):
            d = b - a
            t = np.clip((points - a) @ d / float(d @ d), 0, 1)
            gap = points - a - t[:, None] * d
            best = np.minimum(best, np.hypot(gap[:, 0], gap[:, 1]))
            if a[1] != b[1]:
                spans = (a[1] > points[:, 1]) != (b[1] > points[:, 1])
                odd ^= spans & (points[:, 0] < a[0] + (points[:, 1] - a[1]) * d[0] / d[1])
    return np.where(odd, best, -best)


def _daylight(plan: FloorPlan, placed: Sequence[Stand]) -> float | None:
    """Return how much of the windows' light is kept: tall pieces near a window take from it."""
    windows = _openings(plan, "window")
    if not windows:
        return None
    lost, total = 0.0, 0.0
    for (x, y), (nx, ny), width_m in windows:
        total += width_m
        worst = 0.0
        for s in placed:
            if s.item.spec.top_m < 1.1:
                continue
            dx, dy = s.x_m - x, s.y_m - y
            ahead, aside = dx * nx + dy * ny, abs(dx * ny - dy * nx)
            near = _ramp(ahead, 2.5, 0.8) if ahead > 0 else 0.0
            worst += near * _ramp(aside, width_m / 2 + 0.9, width_m / 2) * min(1.0, s.item.spec.size_m[0])
        lost += width_m * min(1.0, worst)
    return 1 - lost / total


def _walk(plan: FloorPlan, placed: Sequence[Stand]) -> float:
    """Return how much of the floor that a slim walker (0.4 m) can stand on is in one piece: 0 at 90 %, 1 at all."""
    solid = [Polygon(s.corners()) for s in placed if not s.item.spec.is_rug and s.item.spec.base_m < 2.0]
    floor = Polygon(plan.corners, list(plan.holes)).difference(union_all(solid)).buffer(-0.2, quad_segs=2)
    areas = [part.area for part in getattr(floor, "geoms", [floor])]
    return _ramp(max(areas) / sum(areas), 0.9, 1.0) if sum(areas) > 0 else 0.0


def _together(placed: Sequence[Stand]) -> float | None:
    present = {s.item.spec.category for s in placed} | {ROLES.get(s.item.spec.category, "") for s in placed}
    present.discard("")
    rugs = {"sofa", "dining"} & present
    bound = [s for s in placed if s.item.spec.group_with in present or (rugs and s.item.spec.is_rug)]
    if not bound:
        return None
    return sum(1.0 for s in bound if s.group != s.item.id) / len(bound)

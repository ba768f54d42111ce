"""The lines that units are placed on: the walls, and lines through the room for what stands free."""

from __future__ import annotations

import numpy as np

from processing.layout.plan import FloorPlan
from processing.layout.polygons import Array

LEAST_WALL_M = 0.2
MOST_DIRECTIONS = 3
MOST_OFFSETS = 20
NO_EDGE = -1.0


def wall_lines(plan: FloorPlan) -> Array:
    """Return (n, 6): first corner, direction, length, edge; columns' faces have edges past the outline's."""
    rows, number = [], 0
    for ring in (plan.corners, *plan.holes):
        for corner, end in zip(ring, np.roll(ring, -1, axis=0), strict=True):
            along = end - corner
            length_m = float(np.hypot(*along))
            if length_m >= LEAST_WALL_M:
                rows.append([*corner, *(along / length_m), length_m, float(number)])
            number += 1
    return np.array(rows).reshape(-1, 6)


def wall_directions(plan: FloorPlan) -> list[float]:
    """Return the room's main directions in radians, 0 to pi/2, the one with the longest walls first."""
    totals: dict[int, tuple[float, float]] = {}
    for _, _, ux, uy, length_m in ((*row[:2], *row[2:5]) for row in wall_lines(plan)):
        angle = float(np.arctan2(uy, ux)) % (np.pi / 2)
        key = round(np.degrees(angle) * 2) % 180
        total, first = totals.get(key, (0.0, angle))
        totals[key] = (total + length_m, first)
    ranked = sorted(totals.values(), key=lambda pair: -pair[0])
    return [angle for _, angle in ranked[:MOST_DIRECTIONS]]


def free_lines(plan: FloorPlan, depth_m: float, step_m: float = 0.25) -> Array:
    """Return (n, 6) lines for a unit `depth_m` deep: along each wall direction, both ways and across, at offsets where
    it touches a corner's level with its near or far side, and every `step_m` between."""
    rows: list[list[float]] = []
    for angle in wall_directions(plan):
        for quarter in range(4):
            turn = angle + quarter * np.pi / 2
            u = np.array([np.cos(turn), np.sin(turn)])
            v = np.array([-u[1], u[0]])
            points = np.concatenate([plan.corners, *plan.holes]) if plan.holes else plan.corners
            along, away = points @ u, points @ v
            low, high = float(away.min()), float(away.max())
            for offset in _offsets(away, low, high - depth_m, depth_m, step_m):
                origin = u * float(along.min()) + v * offset
                rows.append([*origin, *u, float(along.max() - along.min()), NO_EDGE])
    return np.array(rows).reshape(-1, 6)


def _offsets(levels: Array, low: float, high: float, depth_m: float, step_m: float) -> list[float]:
    if high < low - 1e-7:
        return []
    steps = np.arange(low, high + 1e-9, step_m)
    wanted = np.concatenate([levels, levels - depth_m, [0.5 * (low + high), high], steps])
    wanted = np.sort(wanted[(wanted >= low - 1e-9) & (wanted <= high + 1e-9)])
    kept = [float(wanted[0])]
    for offset in wanted[1:]:
        if offset - kept[-1] > 0.02:
            kept.append(float(offset))
    if len(kept) > MOST_OFFSETS:
        kept = [kept[i] for i in np.unique(np.linspace(0, len(kept) - 1, MOST_OFFSETS).round().astype(int))]
    return kept

"""The lines that units are placed on: the walls, and lines through the room for what stands free."""

from __future__ import annotations

import numpy as np

from processing.ground.arrays import Doubles
from processing.layout.plan import FloorPlan

LEAST_WALL_M = 0.2
MOST_DIRECTIONS = 3
MOST_OFFSETS = 20
NO_EDGE = -1.0


def wall_lines(plan: FloorPlan) -> Doubles:
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


class FreeLines:
    """Lines for what stands free: along each wall direction, both ways and across."""

    def __init__(self, plan: FloorPlan) -> None:
        points = np.concatenate([plan.corners, *plan.holes])
        self._frames = []
        for angle in wall_directions(plan):
            for quarter in range(4):
                turn = angle + quarter * np.pi / 2
                u = np.array([np.cos(turn), np.sin(turn)])
                along, away = points @ u, np.sort(points @ np.array([-u[1], u[0]]))
                self._frames.append((u, float(along.min()), float(along.max() - along.min()), away))

    def lines(self, depth_m: float, step_m: float = 0.25) -> Doubles:
        """Return (n, 6) lines for a unit `depth_m` deep, at offsets where its near or far side is level with a corner,
        and every `step_m` between."""
        found = []
        for u, start_m, length_m, away in self._frames:
            offsets = _offsets(away, depth_m, step_m)
            rows = np.empty((len(offsets), 6))
            rows[:, 0] = u[0] * start_m - u[1] * offsets
            rows[:, 1] = u[1] * start_m + u[0] * offsets
            rows[:, 2:] = (u[0], u[1], length_m, NO_EDGE)
            found.append(rows)
        return np.concatenate(found)


def _offsets(levels: Doubles, depth_m: float, step_m: float) -> Doubles:
    low, high = levels[0], levels[-1] - depth_m
    if high < low - 1e-7:
        return np.empty(0)
    steps = np.arange(low, high + 1e-9, step_m)
    wanted = np.sort(np.concatenate([levels, levels - depth_m, [0.5 * (low + high), high], steps]))
    wanted = wanted[(wanted >= low - 1e-9) & (wanted <= high + 1e-9)]
    wanted = wanted[np.concatenate([[True], np.diff(wanted) > 0.02])]
    if len(wanted) > MOST_OFFSETS:
        wanted = wanted[np.unique(np.linspace(0, len(wanted) - 1, MOST_OFFSETS).round().astype(int))]
    return np.asarray(wanted)

"""A second check of arrangements, on a 1 cm raster: numpy and OpenCV only, no code of the solver or of its judge."""

from __future__ import annotations

import math
from typing import Any

import cv2
import numpy as np

from processing.layout.arrangement import Arrangement, PlacedItem
from processing.layout.plan import FloorPlan
from processing.layout.rules import RuleSet

CELL_M = 0.01
PATH_SKIN_M = 0.0075
"""Half a cell's diagonal: so far may the middle of an exact fit lie from the nearest cell's middle."""
SKIN_M = 0.006
"""Cells whose middles are this near an outline are nobody's."""


class Raster:
    """One room on the raster."""

    def __init__(self, plan: FloorPlan, rules: RuleSet) -> None:
        self.plan, self.rules = plan, rules
        low, high = plan.corners.min(axis=0) - 0.05, plan.corners.max(axis=0) + 0.05
        shape = [int(v) for v in np.ceil((high - low) / CELL_M)]
        self.x, self.y = np.meshgrid(
            low[0] + CELL_M * (np.arange(shape[0]) + 0.5), low[1] + CELL_M * (np.arange(shape[1]) + 0.5)
        )
        self.room = np.zeros(self.x.shape, dtype=bool)
        for ring in (plan.corners, *plan.holes):
            for a, b in zip(ring, np.roll(ring, -1, axis=0), strict=True):
                if a[1] != b[1]:
                    spans = (a[1] > self.y) != (b[1] > self.y)
                    self.room ^= spans & (self.x < a[0] + (self.y - a[1]) * (b[0] - a[0]) / (b[1] - a[1]))
        self.doors = [self._door(door) for door in plan.doors]
        self.ways = [
            self._strip(d.edge, d.start_m, d.end_m, max(rules.door_approach, rules.path / 2 + 0.1)) for d in plan.doors
        ]
        self.windows = [self._strip(w.edge, w.start_m, w.end_m, rules.window_band) for w in plan.windows]
        self.needed = self._needed()

    def _strip(self, edge: int, t0: float, t1: float, deep: float) -> Any:
        corner, u, _ = self.plan.edge(edge)
        dx, dy = self.x - corner[0], self.y - corner[1]
        t, n = dx * u[0] + dy * u[1], dy * u[0] - dx * u[1]
        return (t > t0) & (t < t1) & (n > 0) & (n < deep)

    def _door(self, door: Any) -> Any:
        r = self.rules
        zone = self._strip(door.edge, door.start_m - r.door_side, door.end_m + r.door_side, r.door_approach)
        wide = door.end_m - door.start_m
        if door.swing in ("sliding", "out") or (wide > 2 * r.door_reach and door.swing != "in"):
            return zone
        pair = wide > r.door_reach and door.swing != "in"
        leaf = wide / 2 if pair else wide
        corner, u, _ = self.plan.edge(door.edge)
        dx, dy = self.x - corner[0], self.y - corner[1]
        t, n = dx * u[0] + dy * u[1], dy * u[0] - dx * u[1]
        for hand, at, sign in (("left", door.end_m, -1), ("right", door.start_m, 1)):
            if pair or door.hinge in (hand, "unknown"):
                zone |= (n > 0) & (sign * (t - at) > 0) & (np.hypot(t - at, n) < leaf)
        return zone

    def _inside(self, item: PlacedItem, rect: tuple[float, float, float, float], skin: float = SKIN_M) -> Any:
        c, s = math.cos(item.theta_rad), math.sin(item.theta_rad)
        reach = max(abs(v) for v in rect) * 1.5 + abs(skin) + CELL_M
        i, j = ((item.t_m[1] - self.y[0, 0]) / CELL_M, (item.t_m[0] - self.x[0, 0]) / CELL_M)
        n = int(reach / CELL_M) + 1
        window = (slice(max(0, int(i) - n), max(0, int(i) + n + 1)), slice(max(0, int(j) - n), max(0, int(j) + n + 1)))
        dx, dy = self.x[window] - item.t_m[0], self.y[window] - item.t_m[1]
        u, v = dx * c + dy * s, dy * c - dx * s
        mask = np.zeros(self.x.shape, dtype=bool)
        mask[window] = (u > rect[0] + skin) & (u < rect[1] - skin) & (v > rect[2] + skin) & (v < rect[3] - skin)
        return mask

    def faults(self, arrangement: Arrangement) -> list[str]:
        """Return the hard rules that the raster sees broken."""
        found = []
        items = arrangement.items
        bodies = [
            self._inside(i, (-i.size_m[0] / 2, i.size_m[0] / 2, -i.size_m[1] / 2, i.size_m[1] / 2)) for i in items
        ]
        for k, (item, body) in enumerate(zip(items, bodies, strict=True)):
            rug = item.category == "rug"
            top = item.base_m + item.size_m[2]
            if (body & ~self.room).any():
                found.append(f"{item.id} outside")
            if top > self.plan.ceiling_height_m:
                found.append(f"{item.id} through the ceiling")
            if any((body & door).any() for door in self.doors) and item.base_m < 2.1:
                found.append(f"{item.id} in a door")
            for window, band in zip(self.plan.windows, self.windows, strict=True):
                if (
                    not rug
                    and top > max(0.0, window.sill_m - 0.05) + 1e-6
                    and item.base_m < window.head_m
                    and (body & band).any()
                ):
                    found.append(f"{item.id} before a window")
            for other, theirs in zip(items[:k], bodies[:k], strict=True):
                apart = min(top, other.base_m + other.size_m[2]) <= max(item.base_m, other.base_m) + 1e-6
                if rug == (other.category == "rug") and not apart and (body & theirs).any():
                    found.append(f"{item.id} in {other.id}")
            found += self._use_faults(item, items, bodies)
        return found + self._paths(items)

    def _use_faults(self, item: PlacedItem, items: tuple[PlacedItem, ...], bodies: list[Any]) -> list[str]:
        found = []
        for zone in item.use_zones_m:
            area = self._inside(item, zone)
            if (area & ~self.room).any():
                found.append(f"use of {item.id} in a wall")
            for other, theirs in zip(items, bodies, strict=True):
                solid = other.group != item.group and other.category != "rug" and other.base_m < 2
                if solid and (area & theirs).any():
                    found.append(f"use of {item.id} blocked by {other.id}")
        return found

    def _components(self, free: Any, slack_m: float) -> tuple[int, Any]:
        far = cv2.distanceTransform(np.pad(free, 1).astype(np.uint8), cv2.DIST_L2, cv2.DIST_MASK_PRECISE)[1:-1, 1:-1]
        count, labels = cv2.connectedComponents((far * CELL_M > self.rules.path / 2 - slack_m).astype(np.uint8))
        return count, labels

    def _needed(self) -> set[int]:
        # Passages that the raster cannot tell from too narrow ones are not asked for.
        _, labels = self._components(self.room, -PATH_SKIN_M)
        served = [set(np.unique(labels[way]).tolist()) - {0} for way in self.ways]
        parts = sorted(set().union(*served), key=lambda k: -np.count_nonzero(labels == k))
        return {n for n, s in enumerate(served) if parts and parts[0] in s}

    def _paths(self, items: tuple[PlacedItem, ...]) -> list[str]:
        free = self.room.copy()
        for item in items:
            if item.category != "rug" and item.base_m < 2:
                w, d = item.size_m[0] / 2, item.size_m[1] / 2
                free &= ~self._inside(item, (-w, w, -d, d), 0.0)
        _, labels = self._components(free, PATH_SKIN_M)
        reach = self.rules.path / 2 - 0.05 + 0.01
        goals = [(f"door {n + 1}", self.ways[n]) for n in sorted(self.needed)]
        goals += [(item.id, self._inside(item, zone, -reach)) for item in items for zone in item.use_zones_m]
        served = [set(np.unique(labels[mask]).tolist()) - {0} for _, mask in goals]
        parts = sorted(set().union(*served))
        failed = [
            [f"no path to {name}" for (name, _), s in zip(goals, served, strict=True) if k not in s] for k in parts
        ]
        return min(failed, key=len, default=["nowhere to walk"])

"""A second check of arrangements, on a 1 cm raster: numpy and OpenCV only, no code of the solver or of its judge.

It raises no false alarm. A cell whose middle lies in two shapes shows that they overlap (overlaps thinner than a cell
may be missed). A way that exists passes cells whose middles are at most half a cell's diagonal off it, so that paths
are looked for that much narrower, and doors reached from that far.
"""

from __future__ import annotations

import math
from typing import Any

import cv2
import numpy as np

from processing.layout.arrangement import Arrangement, PlacedItem
from processing.layout.plan import FloorPlan
from processing.layout.rules import RuleSet

CELL_M = 0.01
HALF_M = 0.0085
"""Half a cell's diagonal (7.1 mm), the judge's millimetre of path width, and its arcs."""
SKIN_M = 1e-4
"""Middles this near an outline are nobody's."""
TALL_M = 2.0


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
            self._strip(d.edge, d.start_m, d.end_m, max(rules.door_approach, rules.path / 2 + 0.1), HALF_M)
            for d in plan.doors
        ]
        self.windows = [self._strip(w.edge, w.start_m, w.end_m, rules.window_band) for w in plan.windows]
        self.needed = self._needed()

    def _strip(self, edge: int, t0: float, t1: float, deep: float, more: float = -SKIN_M) -> Any:
        at, t, n = self._along(edge, t0 - 0.1, t1 + 0.1, deep + 0.1)
        zone = np.zeros(self.x.shape, dtype=bool)
        zone[at] = (t > t0 - more) & (t < t1 + more) & (n > -more) & (n < deep + more)
        return zone

    def _along(self, edge: int, t0: float, t1: float, deep: float) -> Any:
        """Return the window of cells around a strip, and their places along and away from the edge."""
        corner, u, _ = self.plan.edge(edge)
        ends = np.array([corner + u * t + np.array([-u[1], u[0]]) * n for t in (t0, t1) for n in (-0.1, deep)])
        first = np.floor((ends.min(axis=0) - (self.x[0, 0], self.y[0, 0])) / CELL_M).astype(int).clip(0)
        last = np.ceil((ends.max(axis=0) - (self.x[0, 0], self.y[0, 0])) / CELL_M).astype(int).clip(0) + 1
        at = slice(first[1], last[1]), slice(first[0], last[0])
        dx, dy = self.x[at] - corner[0], self.y[at] - corner[1]
        return at, dx * u[0] + dy * u[1], dy * u[0] - dx * u[1]

    def _door(self, door: Any) -> Any:
        r = self.rules
        zone = self._strip(door.edge, door.start_m - r.door_side, door.end_m + r.door_side, r.door_approach)
        wide = door.end_m - door.start_m
        if door.swing in ("sliding", "out") or (wide > 2 * r.door_reach and door.swing != "in"):
            return zone
        pair = wide > r.door_reach and door.swing != "in"
        leaf = wide / 2 if pair else wide
        place, t, n = self._along(door.edge, door.start_m - 0.1, door.end_m + 0.1, leaf + 0.1)
        for hand, at, sign in (("left", door.end_m, -1), ("right", door.start_m, 1)):
            if pair or door.hinge in (hand, "unknown"):
                zone[place] |= (n > SKIN_M) & (sign * (t - at) > SKIN_M) & (np.hypot(t - at, n) < leaf - SKIN_M)
        return zone

    def _cells(self, item: PlacedItem, rect: tuple[float, float, float, float], more: float = -SKIN_M) -> Any:
        """Return the rows and columns of the cells in a rectangle of an item's frame, grown by `more`."""
        c, s = math.cos(item.theta_rad), math.sin(item.theta_rad)
        far = max(math.hypot(x, y) for x in rect[:2] for y in rect[2:]) + 1.5 * abs(more) + CELL_M
        (i0, i1), (j0, j1) = (
            (max(0, int((at - far - first) / CELL_M)), max(0, int((at + far - first) / CELL_M) + 1))
            for at, first in ((item.t_m[1], self.y[0, 0]), (item.t_m[0], self.x[0, 0]))
        )
        dx, dy = self.x[0, j0:j1] - item.t_m[0], self.y[i0:i1, :1] - item.t_m[1]
        u, v = dx * c + dy * s, dy * c - dx * s
        mask = (u > rect[0] - more) & (u < rect[1] + more) & (v > rect[2] - more) & (v < rect[3] + more)
        i, j = np.nonzero(mask)
        return i + i0, j + j0

    def faults(self, arrangement: Arrangement) -> list[str]:
        """Return the hard rules that the raster sees broken."""
        found: list[str] = []
        items = arrangement.items
        floors = np.zeros((2, *self.room.shape), dtype=np.int16)
        for k, item in enumerate(items):
            w, d = item.size_m[0] / 2, item.size_m[1] / 2
            cells = self._cells(item, (-w, w, -d, d))
            found += self._room_faults(item, cells)
            floor = floors[int(item.category == "rug")]
            top = item.base_m + item.size_m[2]
            for other in (items[n - 1] for n in np.unique(floor[cells]) if n):
                if min(top, other.base_m + other.size_m[2]) > max(item.base_m, other.base_m) + 1e-6:
                    found.append(f"{item.id} in {other.id}")
            if item.base_m < TALL_M and not floor[cells].all():
                floor[cells] = k + 1
        for item in items:
            found += self._use_faults(item, items, floors[0])
        return found + self._paths(items, floors[0])

    def _room_faults(self, item: PlacedItem, cells: Any) -> list[str]:
        found = []
        top = item.base_m + item.size_m[2]
        if not self.room[cells].all():
            found.append(f"{item.id} outside")
        if top > self.plan.ceiling_height_m:
            found.append(f"{item.id} through the ceiling")
        if item.base_m < 2.1 and any(door[cells].any() for door in self.doors):
            found.append(f"{item.id} in a door")
        for window, band in zip(self.plan.windows, self.windows, strict=True):
            tall = top > max(0.0, window.sill_m - 0.05) + 1e-6 and item.base_m < window.head_m
            if item.category != "rug" and tall and band[cells].any():
                found.append(f"{item.id} before a window")
        return found

    def _use_faults(self, item: PlacedItem, items: tuple[PlacedItem, ...], floor: Any) -> list[str]:
        found = []
        for zone in item.use_zones_m:
            cells = self._cells(item, zone)
            if not self.room[cells].all():
                found.append(f"use of {item.id} in a wall")
            there = [items[n - 1] for n in np.unique(floor[cells]) if n]
            found += [f"use of {item.id} blocked by {o.id}" for o in there if o.group != item.group]
        return found

    def _parts(self, free: Any, radius_m: float) -> Any:
        far = cv2.distanceTransform(np.pad(free, 1).astype(np.uint8), cv2.DIST_L2, cv2.DIST_MASK_PRECISE)[1:-1, 1:-1]
        return cv2.connectedComponents((far * CELL_M > radius_m).astype(np.uint8))[1]

    def _needed(self) -> set[int]:
        # Passages that the raster cannot distinguish from too narrow ones are not asked for.
        labels = self._parts(self.room, self.rules.path / 2 + HALF_M)
        served = [set(np.unique(labels[way]).tolist()) - {0} for way in self.ways]
        parts = sorted(set().union(*served), key=lambda k: -np.count_nonzero(labels == k))
        return {n for n, s in enumerate(served) if parts and parts[0] in s}

    def _paths(self, items: tuple[PlacedItem, ...], floor: Any) -> list[str]:
        labels = self._parts(self.room & (floor == 0), self.rules.path / 2 - HALF_M)
        reach = self.rules.path / 2 - 0.05 + 0.01
        served = {f"door {n + 1}": [self._touched(labels, self.ways[n])] for n in sorted(self.needed)}
        for item in items:
            sides = [z for z in item.use_zones_m if abs(z[0] + z[1]) > item.size_m[0]]
            if "bed" in item.category:  # as many sides as the rules ask for, and the rest
                reached = [self._touched(labels, self._cells(item, zone, reach)) for zone in sides]
                served[f"a side of {item.id}"] = reached
                sides = []
            for number, zone in enumerate(
                z for z in item.use_zones_m if abs(z[0] + z[1]) <= item.size_m[0] or z in sides
            ):
                served[f"{item.id} ({number})"] = [self._touched(labels, self._cells(item, zone, reach))]
        need = {name: self._sides(name, items) if name.startswith("a side of") else 1 for name in served}
        parts = sorted(set().union(*(part for reached in served.values() for part in reached)))
        failed = [
            [f"no path to {name}" for name, reached in served.items() if sum(k in r for r in reached) < need[name]]
            for k in parts
        ]
        return min(failed, key=len, default=["nowhere to walk"])

    def _sides(self, name: str, items: tuple[PlacedItem, ...]) -> int:
        """Return how many of a bed's sides must be reached."""
        bed = next(item for item in items if name.endswith(f" {item.id}"))
        return int(self.rules.bed_single_sides if bed.category == "single bed" else self.rules.bed_sides)

    @staticmethod
    def _touched(labels: Any, cells: Any) -> set[int]:
        return set(np.unique(labels[cells]).tolist()) - {0}

"""Routes for the floor plan: a short way from the first door to every other door and use zone, at the path's width."""

from __future__ import annotations

import heapq
import math
from collections.abc import Sequence

import numpy as np
import shapely
from shapely.geometry import LineString, MultiPolygon, Point, Polygon

from processing.layout.plan import FloorPlan

CELL_M = 0.08


def routes(
    plan: FloorPlan, solid: Sequence[Polygon], doors: Sequence[Polygon], goals: Sequence[Polygon], width_m: float
) -> list[list[tuple[float, float]]]:
    """Return polylines from the first door's floor to each other door and goal that can be reached."""
    floor = Polygon(plan.corners, list(plan.holes)).difference(shapely.union_all(list(solid)))
    walk = floor.buffer(-(width_m - 0.001) / 2)
    parts = list(walk.geoms) if isinstance(walk, MultiPolygon) else [walk]
    part = max(parts, key=lambda p: (any(p.intersects(d) for d in doors), p.area))
    doors = [door for door in doors if part.intersects(door)]
    if not doors:
        return []
    nodes, tree = _nodes(part)
    starts = [n for n, p in enumerate(tree) if p.intersects(doors[0])]
    if not starts:
        return []
    middle = doors[0].centroid
    start = min(starts, key=lambda n: tree[n].distance(middle))
    costs, before = _shortest(nodes, start)
    found = []
    for goal in (*doors[1:], *goals):
        gaps = shapely.distance(np.array(tree), goal)
        reached = [n for n in range(len(tree)) if gaps[n] <= width_m / 2 and costs[n] < math.inf]
        if reached:
            end = min(reached, key=lambda n: costs[n] + 3 * gaps[n])
            found.append(_straightened(part, _chain(before, end, tree)))
    return found


def _nodes(part: Polygon) -> tuple[dict[tuple[int, int], int], list[Point]]:
    x0, y0, x1, y1 = part.bounds
    columns, rows = int((x1 - x0) / CELL_M) + 1, int((y1 - y0) / CELL_M) + 1
    xs, ys = np.meshgrid(x0 + CELL_M * (np.arange(columns) + 0.5), y0 + CELL_M * (np.arange(rows) + 0.5))
    inside = shapely.contains_xy(part, xs, ys)
    cells = [(int(i), int(j)) for i, j in np.argwhere(inside)]
    return {cell: n for n, cell in enumerate(cells)}, [Point(xs[c], ys[c]) for c in cells]


def _shortest(nodes: dict[tuple[int, int], int], start: int) -> tuple[list[float], list[int]]:
    """Return the length to each node over eight neighbours, and the node before it (Dijkstra)."""
    cells = list(nodes)
    costs, before = [math.inf] * len(cells), [-1] * len(cells)
    costs[start] = 0.0
    queue = [(0.0, start)]
    while queue:
        cost, node = heapq.heappop(queue)
        if cost > costs[node]:
            continue
        i, j = cells[node]
        for di, dj in ((0, 1), (1, 0), (0, -1), (-1, 0), (1, 1), (1, -1), (-1, 1), (-1, -1)):
            other = nodes.get((i + di, j + dj))
            if other is not None and cost + math.hypot(di, dj) < costs[other] - 1e-12:
                costs[other] = cost + math.hypot(di, dj)
                before[other] = node
                heapq.heappush(queue, (costs[other], other))
    return costs, before


def _chain(before: Sequence[int], end: int, points: Sequence[Point]) -> list[tuple[float, float]]:
    chain = [end]
    while before[chain[-1]] >= 0:
        chain.append(before[chain[-1]])
    return [(points[n].x, points[n].y) for n in reversed(chain)]


def _straightened(part: Polygon, chain: list[tuple[float, float]]) -> list[tuple[float, float]]:
    """Return the chain with what can be walked straight made straight."""
    loose = part.buffer(CELL_M / 2)
    kept, at = [chain[0]], 0
    while at < len(chain) - 1:
        ahead = len(chain) - 1
        while ahead > at + 1 and not loose.covers(LineString([chain[at], chain[ahead]])):
            ahead = at + (ahead - at) // 2 if ahead - at > 8 else ahead - 1
        kept.append(chain[ahead])
        at = ahead
    return kept

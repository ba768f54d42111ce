"""Surfaces and panes as triangles."""

from __future__ import annotations

from itertools import pairwise

import numpy as np

from processing.errors import SceneError
from processing.ground.arrays import Doubles
from processing.light.scene.scene import Pane, Surface

EPSILON = 1e-12


def surface_triangles(surface: Surface) -> Doubles:
    """Return (m, 3, 3) corners of a surface's triangles, turned so that they face where its normal does."""
    flat = _with_holes(surface) if surface.holes_m else ears(surface.outline_m)
    corners = surface.at(flat[..., 0], flat[..., 1])
    flips = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]) @ surface.normal < 0
    corners[flips] = corners[flips][:, ::-1]
    return corners


def pane_triangles(pane: Pane) -> Doubles:
    """Return (2, 3, 3)."""
    a, b = pane.corner_m, pane.corner_m + pane.across_m
    c, d = b + pane.up_m, a + pane.up_m
    return np.array([[a, b, c], [a, c, d]])


def _with_holes(surface: Surface) -> Doubles:
    """Cut a rectangle along all edges of its holes: cells share whole edges, so that no ray slips through."""
    us = np.unique([0.0, surface.width_m, *(h[0] for h in surface.holes_m), *(h[2] for h in surface.holes_m)])
    vs = np.unique([0.0, surface.height_m, *(h[1] for h in surface.holes_m), *(h[3] for h in surface.holes_m)])
    found = []
    for u0, u1 in pairwise(us):
        for v0, v1 in pairwise(vs):
            u, v = (u0 + u1) / 2, (v0 + v1) / 2
            if not any(h[0] < u < h[2] and h[1] < v < h[3] for h in surface.holes_m):
                found += [[(u0, v0), (u1, v0), (u1, v1)], [(u0, v0), (u1, v1), (u0, v1)]]
    # A wall that is all window has nothing left.
    return np.array(found, dtype=np.float64).reshape(-1, 3, 2)


def ears(outline: Doubles) -> Doubles:
    """Return the triangles (n - 2, 3, 2) of a simple polygon (n, 2), by cutting off ears."""
    points = outline if _twice_area(outline) > 0 else outline[::-1]
    left = list(range(len(points)))
    found = []
    while len(left) > 3:
        # With margin first: a corner on an ear's edge would be cut off with it. Degenerate outlines need it without.
        tries = ((k, margin) for margin in (-EPSILON, EPSILON) for k in range(len(left)))
        ear = next((k for k, margin in tries if _is_ear(points, left, k, margin)), None)
        if ear is None:
            raise SceneError("an outline that crosses itself", where="floor polygon", advice="correct the corners")
        found.append([points[left[ear - 1]], points[left[ear]], points[left[(ear + 1) % len(left)]]])
        left.pop(ear)
    found.append([points[k] for k in left])
    return np.array(found, dtype=np.float64)


def _is_ear(points: Doubles, left: list[int], k: int, margin: float) -> bool:
    a, b, c = points[left[k - 1]], points[left[k]], points[left[(k + 1) % len(left)]]
    if _turn(a, b, c) < -EPSILON:
        return False
    others = (points[i] for i in left if i not in (left[k - 1], left[k], left[(k + 1) % len(left)]))
    corners = (tuple(a), tuple(b), tuple(c))
    return not any(tuple(p) not in corners and _within(p, a, b, c, margin) for p in others)


def _within(p: Doubles, a: Doubles, b: Doubles, c: Doubles, margin: float) -> bool:
    return _turn(a, b, p) > margin and _turn(b, c, p) > margin and _turn(c, a, p) > margin


def _turn(a: Doubles, b: Doubles, c: Doubles) -> float:
    return float((b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0]))


def _twice_area(outline: Doubles) -> float:
    x, y = outline[:, 0], outline[:, 1]
    return float(x @ np.roll(y, -1) - y @ np.roll(x, -1))


def inside(outline: Doubles, points: Doubles) -> np.ndarray:
    """Return which points (n, 2) lie in a polygon (even-odd rule)."""
    x, y = points[:, 0], points[:, 1]
    odd = np.zeros(len(points), bool)
    for (x0, y0), (x1, y1) in zip(outline, np.roll(outline, -1, axis=0), strict=True):
        if y0 != y1:
            crosses = (y0 > y) != (y1 > y)
            odd ^= crosses & (x < x0 + (y - y0) / (y1 - y0) * (x1 - x0))
    return odd

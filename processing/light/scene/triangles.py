"""Surfaces and panes as triangles."""

from __future__ import annotations

from itertools import pairwise

import numpy as np

from processing.ground.arrays import Doubles
from processing.ground.polygons import triangles
from processing.light.scene.scene import Pane, Surface


def surface_triangles(surface: Surface) -> Doubles:
    """Return (m, 3, 3) corners of a surface's triangles, turned so that they face where its normal does."""
    flat = _with_holes(surface) if surface.holes_m else triangles(surface.outline_m)
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

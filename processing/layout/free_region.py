"""Exact regions for what stands free: all positions of rectangles at one angle that walls and obstacles allow.

The region is the floor's inner fit (every position at which the rectangle lies on the floor) without the Minkowski sums
of the obstacles with the turned rectangle. All outlines are convex pieces, whose sums are hulls of corner sums.
"""

from __future__ import annotations

from processing.ground.arrays import Doubles

import math
from collections.abc import Sequence
from typing import Any

import numpy as np
import shapely
import shapely.affinity
from shapely.geometry import Polygon

from processing.layout.field import Field
from processing.layout.free_sets import MEETS, SKIN_M

Rows = Sequence[tuple[tuple[float, float, float, float, float, float], int]]
"""(x0, x1, y0, y1, low, high) in the piece's frame and class (`free_sets`) of each rectangle that moves together."""


def free_region(field: Field, rows: Rows, theta_rad: float, extra: Sequence[tuple[Any, ...]] = ()) -> Any:
    """Return where the frame's origin may be, as a closed (multi)polygon.

    `extra` are further obstacles: (corners, low, high, class, name). Places that exist only as a point or a line
    (exact fits) are left out of the region; `free_sets` finds those along walls.
    """
    plan = field.plan
    room = Polygon(plan.corners, list(plan.holes))
    region = room.buffer(0)
    c, s = math.cos(theta_rad), math.sin(theta_rad)
    turn = np.array([[c, s], [-s, c]])
    fixed = field.fixed
    known = [(fixed.corners[i], *fixed.heights_m[i], int(fixed.classes[i]), "") for i in range(len(fixed.classes))]
    blocked = []
    for (x0, x1, y0, y1, low, high), kind in rows:
        corners = np.array([(x0, y0), (x1, y0), (x1, y1), (x0, y1)]) @ turn
        blocked += [_sum(segment.reshape(2, 2), corners) for segment in field.walls]
        middle = corners.mean(axis=0)
        region = region.intersection(shapely.affinity.translate(room, -middle[0], -middle[1]))
        for outline, bottom, top, other, _ in (*known, *extra):
            if MEETS[kind, other] and bottom < high - SKIN_M and top > low + SKIN_M:
                blocked.append(_sum(np.asarray(outline), corners))
    return region.difference(shapely.union_all([b for b in blocked if b.area > 0]))


def _sum(outline: Doubles, corners: Doubles) -> Polygon:
    """Return the positions at which a rectangle at `corners` from the origin meets a convex outline."""
    sums = (outline[:, None, :] - corners[None, :, :]).reshape(-1, 2)
    return shapely.convex_hull(shapely.multipoints(sums))

"""Which doors can be reached in the empty room: where none of the rule's width leads, furniture cannot be blamed."""

from __future__ import annotations

from shapely.geometry import MultiPolygon, Polygon

from processing.layout.solver.field import Field

PATH_SLACK_M = 1e-3
"""Paths are measured to a millimetre."""


def reachable_doors(field: Field) -> list[int]:
    """Return the doors of the largest part of the empty floor that a walker can reach through any."""
    room = Polygon(field.plan.corners, list(field.plan.holes))
    walk = room.buffer(-(field.rules.path - PATH_SLACK_M) / 2, quad_segs=32)
    parts = list(walk.geoms) if isinstance(walk, MultiPolygon) else [walk]
    ways = [Polygon(way.corners) for way in field.doorways]
    for part in sorted(parts, key=lambda p: -p.area):
        served = [n for n, way in enumerate(ways) if not part.is_empty and part.intersects(way)]
        if served:
            return served
    return []

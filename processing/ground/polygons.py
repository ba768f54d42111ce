"""Polygons in a plane: which points lie inside, and triangles that fill them (by shapely)."""

import numpy as np
import shapely

from processing.errors import SceneError
from processing.ground.arrays import Doubles, Flags


def signed_area(ring: Doubles) -> float:
    """Return the area in m2 of a ring (N, 2) in metres, positive where it runs counter-clockwise."""
    x, y = ring[:, 0], ring[:, 1]
    return float(0.5 * np.sum(x * np.roll(y, -1) - np.roll(x, -1) * y))


def inside(outline: Doubles, points: Doubles) -> Flags:
    """Return which ``points`` (N, 2) lie inside a simple polygon (K, 2), either way round; its border is outside."""
    return np.asarray(shapely.contains_xy(shapely.Polygon(outline), points[:, 0], points[:, 1]), bool)


def triangles(outline: Doubles) -> Doubles:
    """Return triangles (K - 2, 3, 2) that fill a simple polygon (K, 2), either way round, and add no corners.

    Constrained Delaunay (Chew 1989), as GEOS does it. Raises `SceneError` for an outline that crosses itself or has no
    area, to rounding.
    """
    polygon = shapely.Polygon(outline)
    try:
        parts = shapely.get_parts(shapely.constrained_delaunay_triangles(polygon)) if polygon.is_valid else ()
    except shapely.GEOSException:
        parts = ()
    if not len(parts):
        advice = "correct the corners"
        raise SceneError("an outline that crosses itself or has no area", where="floor polygon", advice=advice)
    return np.stack([shapely.get_coordinates(part)[:3] for part in parts])

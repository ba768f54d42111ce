"""Pictures of the sphere: what each pixel sees, in four geometries that share one convention.

Pixel coordinates are continuous: the first pixel reaches from 0 to 1 and its centre is 0.5; x grows to the right,
y downwards. World axes: x right, y ahead, z up (right-handed). Longitude is 0 ahead (+y) and grows to the right (+x),
in (-pi, pi); latitude grows upwards, in (-pi/2, pi/2). docs/reference/coordinates.md states all of this,
docs/reference/sphere.md the rest.

This is the front of `geometry` (types and lenses), `maps` (pixels and directions) and `area` (solid angles).
"""

import math

from processing.errors import ParameterError
from processing.sphere.area import projected_solid_angles, solid_angles
from processing.sphere.geometry import Equirectangular, Fisheye, Geometry, LensMapping, Perspective, in_pixels
from processing.sphere.maps import directions, pixels, point_directions, view_axes

__all__ = [
    "CUBE_FACES",
    "Equirectangular",
    "Fisheye",
    "Geometry",
    "LensMapping",
    "Perspective",
    "cube_views",
    "directions",
    "in_pixels",
    "pixels",
    "point_directions",
    "projected_solid_angles",
    "solid_angles",
    "view_axes",
]

CUBE_FACES = ("front", "right", "back", "left", "up", "down")


def cube_views(size_px: int) -> tuple[Perspective, ...]:
    """Return six square views of 90 degrees in the order of `CUBE_FACES`; together they see everything once.

    The picture of ``up`` continues ``front`` upwards (its lower edge is the upper edge of ``front``),
    ``down`` downwards.
    """
    if size_px < 1:
        raise ParameterError(f"cube faces of {size_px} px", advice="give at least 1")
    quarter = math.pi / 2
    level = [Perspective(size_px, size_px, quarter, yaw_rad=yaw) for yaw in (0.0, quarter, math.pi, -quarter)]
    return (*level, *(Perspective(size_px, size_px, quarter, pitch_rad=pitch) for pitch in (quarter, -quarter)))

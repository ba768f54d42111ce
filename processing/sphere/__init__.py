"""Pictures of the sphere: what each pixel sees, in four geometries that share one convention.

Pixel coordinates are continuous: the first pixel reaches from 0 to 1 and its centre is 0.5; x grows to the right,
y downwards. World axes: x right, y ahead, z up (right-handed). Longitude is 0 ahead (+y) and grows to the right (+x),
in (-pi, pi); latitude grows upwards, in (-pi/2, pi/2). docs/reference/coordinates.md states all of this,
docs/reference/sphere.md the rest.

This is the front of `geometry` (types and lenses), `maps` (pixels and directions) and `area` (solid angles).
"""

from processing.sphere.area import projected_solid_angles, solid_angles
from processing.sphere.geometry import Equirectangular, Fisheye, Geometry, LensMapping, Perspective, in_pixels
from processing.sphere.maps import directions, pixels, point_directions, view_axes

__all__ = [
    "Equirectangular",
    "Fisheye",
    "Geometry",
    "LensMapping",
    "Perspective",
    "directions",
    "in_pixels",
    "pixels",
    "point_directions",
    "projected_solid_angles",
    "solid_angles",
    "view_axes",
]

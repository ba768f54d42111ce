"""Pictures of the sphere: what each pixel sees, in four geometries that share one convention.

Pixel coordinates are continuous: the first pixel reaches from 0 to 1 and its centre is 0.5; x grows to the right,
y downwards. World axes: x right, y ahead, z up (right-handed). Longitude is 0 ahead (+y) and grows to the right (+x),
in (-pi, pi); latitude grows upwards, in (-pi/2, pi/2). docs/coordinates.md states all of this.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from enum import StrEnum


class LensMapping(StrEnum):
    """How the angle theta from a fisheye's axis becomes the distance r from its centre (r = 1 at the edge)."""

    EQUIDISTANT = "equidistant"
    EQUISOLID = "equisolid"
    STEREOGRAPHIC = "stereographic"
    ORTHOGRAPHIC = "orthographic"
    POLYNOMIAL = "polynomial"
    """theta / half_field = c1 r + c2 r2 + ... (monotone in 0..1); coefficients as calibrated, sum 1."""


@dataclass(frozen=True)
class Equirectangular:
    """The whole sphere: longitude across, latitude down; its middle column sees longitude ``yaw_rad``."""

    width_px: int
    height_px: int
    yaw_rad: float = 0.0


@dataclass(frozen=True)
class Perspective:
    """A pinhole view: horizontal field ``fov_x_rad``, square pixels, looking at (yaw, pitch), then rolled clockwise."""

    width_px: int
    height_px: int
    fov_x_rad: float
    yaw_rad: float = 0.0
    pitch_rad: float = 0.0
    roll_rad: float = 0.0


@dataclass(frozen=True)
class Fisheye:
    """A circular picture that looks straight up.

    The picture's up is the compass-like angle ``top_azimuth_rad`` (from +y towards +x), and, as in any photograph of
    the sky from below with north at the top, east is on the left. ``radius_px`` is where ``half_field_rad`` falls.
    """

    width_px: int
    height_px: int
    mapping: LensMapping
    radius_px: float
    half_field_rad: float = math.pi / 2
    centre_px: tuple[float, float] | None = None
    """Column and row of the axis; None: the middle of the picture."""
    top_azimuth_rad: float = 0.0
    polynomial: tuple[float, ...] = ()


Geometry = Equirectangular | Perspective | Fisheye

"""Radial mappings of fisheyes: the polar angle of a radius and back, both ways to rounding error.

Radii are relative (1 at ``half_field_rad``). Angles are handed on as sine and cosine, because an orthographic lens's
angle near 90 degrees is known far worse than its sine.
"""

from __future__ import annotations

from processing.ground.arrays import Doubles, Flags

import math

import numpy as np
import numpy.typing as npt

from processing.sphere_geometry import Fisheye, LensMapping


FIELD_TOLERANCE_RAD = 1e-9
"""A direction computed to lie on the field's edge is inside it."""
TABLE_SIZE = 257
NEWTON_STEPS = 4
"""From a table of 257 points each step squares the error: three reach rounding, one is spare."""


def polar_of_radius(lens: Fisheye, radius: Doubles) -> tuple[Doubles, Doubles]:
    """Return sine and cosine of the angle from the axis at relative radii 0..1."""
    half = lens.half_field_rad
    if lens.mapping is LensMapping.ORTHOGRAPHIC:
        sine = radius * math.sin(half)
        return sine, np.sqrt((1 - sine) * (1 + sine))
    if lens.mapping is LensMapping.EQUISOLID:
        s = radius * math.sin(half / 2)
        return 2 * s * np.sqrt((1 - s) * (1 + s)), 1 - 2 * s * s
    if lens.mapping is LensMapping.STEREOGRAPHIC:
        t = radius * math.tan(half / 2)
        return 2 * t / (1 + t * t), (1 - t) * (1 + t) / (1 + t * t)
    theta = half * (radius if lens.mapping is LensMapping.EQUIDISTANT else polynomial(lens, radius))
    return np.sin(theta), np.cos(theta)


def radius_of_polar(lens: Fisheye, flat: Doubles, height: Doubles) -> tuple[Doubles, Flags]:
    """Return relative radii, at most 1, of directions (``flat`` across, ``height`` along the axis), and who is seen."""
    half = lens.half_field_rad
    theta = np.arctan2(flat, height)
    seen = theta <= half + FIELD_TOLERANCE_RAD
    if lens.mapping is LensMapping.ORTHOGRAPHIC:
        radius = flat / np.maximum(np.hypot(flat, height), np.finfo(float).tiny) / math.sin(half)
        radius = np.where(seen, radius, 1.0)
    elif lens.mapping is LensMapping.EQUISOLID:
        radius = np.sin(theta / 2) / math.sin(half / 2)
    elif lens.mapping is LensMapping.STEREOGRAPHIC:
        radius = np.tan(np.minimum(theta, half) / 2) / math.tan(half / 2)
    elif lens.mapping is LensMapping.EQUIDISTANT:
        radius = theta / half
    else:
        radius = inverse_polynomial(lens, np.minimum(theta / half, 1.0))
    return np.minimum(radius, 1.0), seen


def radial_density(lens: Fisheye, radius: Doubles) -> Doubles:
    """Return the solid angle of a unit of relative area, sin(theta) theta'(r) / r, at relative radii 0..1 (steradians).

    At the edge of an orthographic hemisphere it has no bound; there a very large number is returned.
    """
    half = lens.half_field_rad
    sine, cosine = polar_of_radius(lens, radius)
    if lens.mapping is LensMapping.ORTHOGRAPHIC:
        return math.sin(half) ** 2 / np.maximum(cosine, 1e-9)
    if lens.mapping is LensMapping.EQUISOLID:
        return np.full_like(radius, 4 * math.sin(half / 2) ** 2)
    if lens.mapping is LensMapping.STEREOGRAPHIC:
        return math.tan(half / 2) ** 2 * (1 + cosine) ** 2
    slope = np.ones_like(radius) if lens.mapping is LensMapping.EQUIDISTANT else polynomial_slope(lens, radius)
    steepness = half * slope
    return np.where(radius > 1e-9, sine / np.maximum(radius, 1e-9), steepness) * steepness


def polynomial(lens: Fisheye, radius: Doubles) -> Doubles:
    """Return theta / half_field of relative radii (Horner)."""
    total = np.zeros_like(radius)
    for coefficient in reversed(lens.polynomial):
        total = (total + coefficient) * radius
    return total


def polynomial_slope(lens: Fisheye, radius: Doubles) -> Doubles:
    """Return the derivative of `polynomial`."""
    total = np.zeros_like(radius)
    for power in range(len(lens.polynomial), 0, -1):
        total = total * radius + power * lens.polynomial[power - 1]
    return total


def inverse_polynomial(lens: Fisheye, share: Doubles) -> Doubles:
    """Return the radii 0..1 at which `polynomial` is ``share`` 0..1: a table's guess, then Newton."""
    knots = np.linspace(0, 1, TABLE_SIZE)
    radius = np.interp(share, polynomial(lens, knots), knots)
    for _ in range(NEWTON_STEPS):
        slope = np.maximum(polynomial_slope(lens, radius), 1e-6)
        radius = np.clip(radius - (polynomial(lens, radius) - share) / slope, 0.0, 1.0)
    return np.asarray(radius)

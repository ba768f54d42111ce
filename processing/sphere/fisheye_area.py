"""Solid angles of fisheye pixels, cut exactly by the image circle.

By Green's theorem the integral over a cell is one along its edges, of F(theta) dphi, where F is the integral from the
axis: 1 - cos(theta) for the solid angle. Edges end at the circle, whose own arcs add F(half field) times their angle.
Neighbours share their edges, so that nothing is counted twice or lost. Far from the edge of a large picture the cells
are so small that Gauss's rule inside each is as exact and much cheaper.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import numpy.typing as npt

from processing.ground.arrays import Doubles, Indices
from processing.sphere.geometry import Fisheye, LensMapping, polar_of_radius, radial_density

Integral = Callable[[Doubles, Doubles, Doubles, Doubles], Doubles]
"""From sine and cosine of theta, and cosine and sine of the azimuth in the picture, to F."""

LARGE_RADIUS_PX, VERY_LARGE_RADIUS_PX = 256, 1024
RIM_PX = 32
CELLS_AT_ONCE = 1 << 18


def fisheye_solid_angles(lens: Fisheye) -> Doubles:
    """Return the solid angle of each cell's part inside the circle (H, W), in steradians."""
    found = _cells(lens, lambda sine, cosine, _c, _s: _cap(sine, cosine), _rim_solid(lens), None)
    # A cell that the circle only touches may come out as minus a rounding error.
    return np.asarray(np.maximum(found, 0.0))


def fisheye_areas(lens: Fisheye) -> Doubles:
    """Return the area of each cell's part inside the circle (H, W), in square pixels."""
    whole = replace(lens, mapping=LensMapping.EQUISOLID, half_field_rad=math.pi, polynomial=())
    return np.asarray(fisheye_solid_angles(whole) * (lens.radius_px**2 / 4))


def fisheye_projected(lens: Fisheye, normal: Doubles) -> Doubles:
    """Return the signed integral of ``normal . direction`` over each cell's part inside the circle (H, W)."""
    sin_top, cos_top = math.sin(lens.top_azimuth_rad), math.cos(lens.top_azimuth_rad)
    right, up = -normal[0] * cos_top + normal[1] * sin_top, normal[0] * sin_top + normal[1] * cos_top
    axial = float(normal[2])

    def integral(sine: Doubles, cosine: Doubles, cos_phi: Doubles, sin_phi: Doubles) -> Doubles:
        return np.asarray((right * cos_phi + up * sin_phi) * _level(sine, cosine) + axial * sine * sine / 2)

    sine, cosine = (np.asarray(v) for v in polar_of_radius(lens, np.array(1.0)))
    level, cap = float(_level(sine, cosine)), float(sine * sine / 2)

    def rim(phi: Doubles) -> Doubles:
        return np.asarray(level * (right * np.sin(phi) - up * np.cos(phi)) + axial * cap * phi)

    return _cells(lens, integral, rim, (right, up, axial))


def _cap(sine: Doubles, cosine: Doubles) -> Doubles:
    """Return 1 - cos(theta) without cancellation."""
    return np.where(cosine > 0, sine * sine / (1 + np.abs(cosine)), 1 - cosine)


def _level(sine: Doubles, cosine: Doubles) -> Doubles:
    """Return the integral of sin2 from 0 to theta, without cancellation."""
    theta = np.arctan2(sine, cosine)
    t2 = theta * theta
    series = theta * t2 * (1 / 3 - t2 * (1 / 15 - t2 * (2 / 315 - t2 / 2835)))
    return np.where(theta < 0.1, series, (theta - sine * cosine) / 2)


def _rim_solid(lens: Fisheye) -> Callable[[Doubles], Doubles]:
    sine, cosine = polar_of_radius(lens, np.array(1.0))
    cap = float(_cap(sine, cosine))
    return lambda phi: cap * phi


def _cells(
    lens: Fisheye,
    integral: Integral,
    rim: Callable[[Doubles], Doubles],
    normal: tuple[float, float, float] | None,
) -> Doubles:
    """Return all cells' integrals: inside by Gauss's rule where the picture is large, else and at the rim by edges."""
    out = np.zeros((lens.height_px, lens.width_px))
    column, row = lens.axis_px
    u = _relative(np.arange(lens.width_px) + 0.5 - column, lens)
    for y in range(0, lens.height_px, band := max(1, CELLS_AT_ONCE // lens.width_px)):
        v = _relative(row - (np.arange(y, min(y + band, lens.height_px)) + 0.5), lens)
        radius = np.hypot(u[None, :], v[:, None])
        inner = radius < 1 - RIM_PX / lens.radius_px
        if lens.radius_px < LARGE_RADIUS_PX:
            inner[:] = False
        part = out[y : y + band]
        at_y, at_x = np.nonzero(inner)
        part[at_y, at_x] = _by_gauss(lens, u[at_x], v[at_y], normal)
        at_y, at_x = np.nonzero(~inner & (radius < 1 + 1 / lens.radius_px))
        part[at_y, at_x] = _by_edges(lens, at_y + y, at_x, integral)
    _add_arcs(lens, out, rim)
    return out


def _by_gauss(lens: Fisheye, u: Doubles, v: Doubles, normal: tuple[float, float, float] | None) -> Doubles:
    shift = 0.5 / math.sqrt(3) / lens.radius_px
    # An orthographic density bends most, and costs least.
    once = lens.radius_px >= VERY_LARGE_RADIUS_PX and lens.mapping is not LensMapping.ORTHOGRAPHIC
    shifts = (0.0,) if once else (-shift, shift)
    total = np.zeros_like(u)
    for du in shifts:
        for dv in shifts:
            radius = np.hypot(u + du, v + dv)
            value = radial_density(lens, radius)
            if normal is not None:
                sine, cosine = polar_of_radius(lens, radius)
                flat = sine / np.where(radius > 0, radius, 1.0)
                value = value * (flat * ((u + du) * normal[0] + (v + dv) * normal[1]) + cosine * normal[2])
            total += value
    return total / (len(shifts) ** 2 * lens.radius_px**2)


def _by_edges(lens: Fisheye, row: Indices, column: Indices, integral: Integral) -> Doubles:
    """Return the integrals along the four edges of cells, as far as they lie inside the circle, anticlockwise."""
    centre_x, centre_y = lens.axis_px
    left, right = _relative(column - centre_x, lens), _relative(column + 1 - centre_x, lens)
    upper, lower = _relative(centre_y - row, lens), _relative(centre_y - row - 1, lens)

    def across(v: Doubles) -> Doubles:
        return -_line(lens, v, left, right, integral)

    def along(u: Doubles) -> Doubles:
        return _line(lens, u, lower, upper, lambda s, c, up, fixed: integral(s, c, fixed, up))

    return across(lower) + along(right) - across(upper) - along(left)


def _line(lens: Fisheye, fixed: Doubles, start: Doubles, end: Doubles, integral: Integral) -> Doubles:
    """Return the integral of fixed F / r2 over the part of a grid line inside the circle.

    With along = c sin(a), c the half chord, the root that F has at an orthographic circle's edge is smooth in a.
    """
    chord = np.sqrt(np.maximum(1 - fixed * fixed, 0.0))
    safe = np.where(chord > 0, chord, 1.0)
    a0, a1 = (np.where(chord > 0, np.arcsin(np.clip(t / safe, -1.0, 1.0)), 0.0) for t in (start, end))
    nodes, weights = np.polynomial.legendre.leggauss(_order(lens.radius_px))
    total = np.zeros_like(a0)
    for node, weight in zip(nodes, weights, strict=True):
        a = (a0 + a1) / 2 + (a1 - a0) / 2 * node
        place = chord * np.sin(a)
        radius = np.sqrt(place * place + fixed * fixed)
        sine, cosine = polar_of_radius(lens, np.minimum(radius, 1.0))
        r = np.maximum(radius, 1e-150)
        total += weight * integral(sine, cosine, place / r, fixed / r) / (r * r) * chord * np.cos(a)
    return np.asarray(fixed * total * (a1 - a0) / 2)


def _relative(distance_px: npt.NDArray[Any], lens: Fisheye) -> Doubles:
    return np.asarray(distance_px / lens.radius_px, dtype=np.float64)


def _order(radius_px: float) -> int:
    return 48 if radius_px < 4 else 16 if radius_px < 64 else 6


def _add_arcs(lens: Fisheye, out: Doubles, rim: Callable[[Doubles], Doubles]) -> None:
    """Add the circle's own part, cut into arcs where it crosses the lines between pixels."""
    centre_x, centre_y = lens.axis_px
    u = (np.arange(lens.width_px + 1) - centre_x) / lens.radius_px
    v = (centre_y - np.arange(lens.height_px + 1)) / lens.radius_px
    u, v = np.arccos(u[np.abs(u) <= 1]), np.arcsin(v[np.abs(v) <= 1])
    cuts = np.concatenate([u, -u, v, math.pi - v, [0.0, 2 * math.pi]])
    cuts = np.sort(np.where(cuts < 0, cuts + 2 * math.pi, cuts))
    middle = (cuts[1:] + cuts[:-1]) / 2
    x = np.floor(centre_x + lens.radius_px * np.cos(middle)).astype(np.intp)
    y = np.floor(centre_y - lens.radius_px * np.sin(middle)).astype(np.intp)
    inside = (x >= 0) & (x < lens.width_px) & (y >= 0) & (y < lens.height_px)
    np.add.at(out, (y[inside], x[inside]), np.diff(rim(cuts))[inside])

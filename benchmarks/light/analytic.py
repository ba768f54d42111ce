"""What light does where mathematics says it: closed forms and quadrature, sharing no code with the renderer.

Form factors: J. R. Howell, "A Catalog of Radiation Heat Transfer Configuration Factors" (C-11, C-14). Overcast sky: CIE
S 011 type 16 (Moon and Spencer), ``L = Lz (1 + 2 sin elevation) / 3``, 7 pi / 9 Lz on open flat ground.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import TypeAlias

import numpy as np

from processing.ground.arrays import Doubles

Triple: TypeAlias = tuple[float, float, float]
SkyLuminance: TypeAlias = Callable[[Doubles], Doubles]
"""Sine of the elevation -> luminance (cd/m2)."""


def overcast(sine: Doubles) -> Doubles:
    """Return the luminance of the CIE overcast sky with 1 cd/m2 at the zenith."""
    return np.asarray((1 + 2 * sine) / 3)


def uniform(sine: Doubles) -> Doubles:
    """Return the luminance of a uniform sky of 1 cd/m2."""
    return np.ones_like(sine)


def open_ground_lux(sky: SkyLuminance) -> float:
    """Return the illuminance of open flat ground."""
    nodes, weights = np.polynomial.legendre.leggauss(64)
    sine = (nodes + 1) / 2
    return float(math.pi * (sky(sine) * sine * weights).sum())


def furnace_radiance(emission: float, albedo: float) -> float:
    """Return the radiance inside a closed room whose walls all emit and reflect alike."""
    return emission / (1 - albedo)


def indirect_lux(flux_lm: float, area_m2: float, albedo: float) -> float:
    """Return the mean illuminance by reflected light on the walls of a closed room."""
    return flux_lm / area_m2 * albedo / (1 - albedo)


def parallel_form_factor(a_m: float, b_m: float, apart_m: float) -> float:
    """Return the form factor between two equal rectangles facing each other (C-11)."""
    x, y = a_m / apart_m, b_m / apart_m
    kx, ky = math.sqrt(1 + x * x), math.sqrt(1 + y * y)
    return (2 / (math.pi * x * y)) * (
        math.log(kx * ky / math.sqrt(1 + x * x + y * y))
        + x * ky * math.atan(x / ky)
        + y * kx * math.atan(y / kx)
        - x * math.atan(x)
        - y * math.atan(y)
    )


def perpendicular_form_factor(width_m: float, depth_m: float, common_m: float) -> float:
    """Return the form factor from a rectangle ``width_m`` x ``common_m`` to one ``depth_m`` x ``common_m`` (C-14).

    They stand at a right angle and share the edge ``common_m``.
    """
    w, h = width_m / common_m, depth_m / common_m
    w2, h2 = w * w, h * h
    s = math.sqrt(w2 + h2)
    log = (
        math.log((1 + w2) * (1 + h2) / (1 + w2 + h2))
        + w2 * math.log(w2 * (1 + w2 + h2) / ((1 + w2) * (w2 + h2)))
        + h2 * math.log(h2 * (1 + h2 + w2) / ((1 + h2) * (h2 + w2)))
    )
    angle = w * math.atan(1 / w) + h * math.atan(1 / h) - s * math.atan(1 / s)
    return (angle + log / 4) / (math.pi * w)


def through_opening_lux(
    point: Triple,
    normal: Triple,
    opening: tuple[Triple, Triple, Triple],
    light: SkyLuminance,
    glass: Callable[[Doubles], Doubles] = np.ones_like,
) -> float:
    """Return the illuminance at a point from what is seen through a rectangle: a corner, a level side, another side.

    ``light`` also gets negative sines: the ground. Gauss and Legendre's rule with 96 x 96 nodes on either side of the
    horizon, where the light may jump. ``glass`` gives the opening's transmittance by the cosine of incidence.
    """
    corner, u, v = (np.array(side, dtype=np.float64) for side in opening)
    horizon = min(max((point[2] - corner[2]) / v[2], 0.0), 1.0) if v[2] else 0.0
    halves = (corner, u, v * horizon), (corner + v * horizon, u, v * (1 - horizon))
    return sum(_seen_lux(point, normal, half, light, glass) for half in halves)


def _seen_lux(
    point: Triple,
    normal: Triple,
    opening: tuple[Doubles, Doubles, Doubles],
    light: SkyLuminance,
    glass: Callable[[Doubles], Doubles],
) -> float:
    nodes, weights = np.polynomial.legendre.leggauss(96)
    t, weight = (nodes + 1) / 2, weights / 2
    corner, u, v = opening
    to = corner + t[:, None, None] * u + t[None, :, None] * v - np.array(point)
    far2 = (to**2).sum(axis=-1)
    far = np.sqrt(far2)
    here = np.maximum(to @ np.array(normal), 0) / far
    across = np.cross(u, v)
    there = np.abs(to @ across) / far
    through = glass(there / max(float(np.linalg.norm(across)), 1e-300))
    return float((light(to[..., 2] / far) * through * here * there / far2 * weight[:, None] * weight[None, :]).sum())


def overcast_behind_facade_lux(distance_m: float, width_m: float, height_m: float) -> float:
    """Return a floor point's illuminance under the overcast sky (1 cd/m2 at the zenith) through an opening in a wall.

    The opening stands on the point's level and begins beside it: other ones are sums and differences of such. This is
    the integral over azimuth and elevation in closed form (Walsh).
    """
    d, h = distance_m, height_m
    a = math.hypot(d, h)
    azimuth = math.atan2(width_m, d)
    t = math.sin(azimuth)
    squares = azimuth - d / a * math.atan(d / a * math.tan(azimuth))
    cubes = math.asin(h * t / a) - h * d * d * t / (a * a * math.sqrt(a * a - h * h * t * t))
    return (squares / 2 + 2 * cubes / 3) / 3

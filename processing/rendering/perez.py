"""The all-weather model of the sky's luminance (Perez, Seals, Michalsky 1993, Solar Energy 50, 235; erratum 51, 423).

Five coefficients, by how clear and how bright the sky is, tell the luminance of every direction relative to the
others; the absolute level comes from the diffuse illuminance.
"""

from __future__ import annotations

from processing.ground.arrays import Doubles

import math

import numpy as np

from processing.rendering.scene import Vector

EDGES = (1.065, 1.23, 1.5, 1.95, 2.8, 4.5, 6.2)
"""Of the eight bins of clearness."""
_TABLE = np.array(
    [
        *(1.3525, -0.2576, -0.2690, -1.4366, -0.7670, 0.0007, 1.2734, -0.1233, 2.8000, 0.6004),
        *(1.2375, 1.0000, 1.8734, 0.6297, 0.9738, 0.2809, 0.0356, -0.1246, -0.5718, 0.9938),
        *(-1.2219, -0.7730, 1.4148, 1.1016, -0.2054, 0.0367, -3.9128, 0.9156, 6.9750, 0.1774),
        *(6.4477, -0.1239, -1.5798, -0.5081, -1.7812, 0.1080, 0.2624, 0.0672, -0.2190, -0.4285),
        *(-1.1000, -0.2515, 0.8952, 0.0156, 0.2782, -0.1812, -4.5000, 1.1766, 24.7219, -13.0812),
        *(-37.7000, 34.8438, -5.0000, 1.5218, 3.9229, -2.6204, -0.0156, 0.1597, 0.4199, -0.5562),
        *(-0.5484, -0.6654, -0.2672, 0.7117, 0.7234, -0.6219, -5.6812, 2.6297, 33.3389, -18.3000),
        *(-62.2500, 52.0781, -3.5000, 0.0016, 1.1477, 0.1062, 0.4659, -0.3296, -0.0876, -0.0329),
        *(-0.6000, -0.3566, -2.5000, 2.3250, 0.2937, 0.0496, -5.6812, 1.8415, 21.0000, -4.7656),
        *(-21.5906, 7.2492, -3.5000, -0.1554, 1.4062, 0.3988, 0.0032, 0.0766, -0.0656, -0.1294),
        *(-1.0156, -0.3670, 1.0078, 1.4051, 0.2875, -0.5328, -3.8500, 3.3750, 14.0000, -0.9999),
        *(-7.1406, 7.5469, -3.4000, -0.1078, -1.0750, 1.5702, -0.0672, 0.4016, 0.3017, -0.4844),
        *(-1.0000, 0.0211, 0.5025, -0.5119, -0.3000, 0.1922, 0.7023, -1.6317, 19.0000, -5.0000),
        *(1.2438, -1.9094, -4.0000, 0.0250, 0.3844, 0.2656, 1.0468, -0.3788, -2.4517, 1.4656),
        *(-1.0500, 0.0289, 0.4260, 0.3590, -0.3250, 0.1156, 0.7781, 0.0025, 31.0625, -14.5000),
        *(-46.1148, 55.3750, -7.2312, 0.4050, 13.3500, 0.6234, 1.5000, -0.6426, 1.8564, 0.5636),
    ]
).reshape(8, 5, 4)
"""By bin, coefficient (a to e) and term."""
LOWEST = math.sin(math.radians(1.0))
"""Sine of the elevation under which the sky is taken as there, where the model's horizon has no end."""


def clearness(diffuse_w_m2: float, normal_w_m2: float, zenith_rad: float) -> float:
    """Return Perez's epsilon of a sky: 1 overcast, above 6.2 clear."""
    twist = 1.041 * zenith_rad**3
    return (1 + normal_w_m2 / max(diffuse_w_m2, 1e-9) + twist) / (1 + twist)


def coefficients(epsilon: float, brightness: float, zenith_rad: float) -> Doubles:
    """Return a, b, c, d, e; ``brightness`` is Perez's Delta, ``zenith_rad`` the sun's distance from the zenith."""
    number = sum(epsilon >= edge for edge in EDGES)
    delta = brightness
    if EDGES[0] < epsilon < EDGES[4]:
        # As in Radiance's gendaylit: below, the model was not fitted and tells no sky.
        delta = max(delta, 0.2)
    t = _TABLE[number]
    found = t[:, 0] + t[:, 1] * zenith_rad + delta * (t[:, 2] + t[:, 3] * zenith_rad)
    if number == 0:
        c, d = t[2], t[3]
        found[2] = math.exp(max(delta * (c[0] + c[1] * zenith_rad), 0.0) ** c[2]) - c[3]
        found[3] = -math.exp(delta * (d[0] + d[1] * zenith_rad)) + d[2] + delta * d[3]
    return np.asarray(found)


def relative_luminance(rays: Doubles, sun: Vector, five: Doubles) -> Doubles:
    """Return the relative luminance (...,) of unit directions (..., 3) above the horizon, never below 0."""
    a, b, c, d, e = (float(v) for v in five)
    away = np.arccos(np.clip(rays @ np.asarray(sun), -1.0, 1.0))
    gradation = 1 + a * np.exp(b / np.maximum(rays[..., 2], LOWEST))
    scattering = 1 + c * np.exp(d * away) + e * np.cos(away) ** 2
    return np.asarray(np.maximum(gradation * scattering, 0.0))

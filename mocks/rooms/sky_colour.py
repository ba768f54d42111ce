"""Colours of sky, sun and clouds as linear RGB (Rec. 709 primaries, white D65) at luminance 1."""

from __future__ import annotations

from processing.ground.arrays import Floats

import math

import numpy as np

from mocks.light import LUMINANCE_WEIGHTS, Reals, Vector, luminance_cd_m2
from mocks.rooms.sky_light import OZONE_DEPTH, aerosol_depth, air_mass

XYZ_TO_RGB = np.array(
    [[3.2404542, -1.5371385, -0.4985314], [-0.9692660, 1.8760108, 0.0415560], [0.0556434, -0.2040259, 1.0572252]]
)

# Where the three primaries lie in the spectrum (micrometres), and the sun's own colour above the air.
WAVELENGTHS_UM = (0.610, 0.550, 0.465)
SUN_ABOVE_AIR_XY = (0.3225, 0.3325)


def at_luminance_1(rgb: Vector | Floats) -> Floats:
    """Return the colour(s) scaled to luminance 1 (last axis RGB)."""
    colour = np.asarray(rgb, dtype=np.float32)
    return np.asarray(colour / luminance_cd_m2(colour)[..., None], dtype=np.float32)


def daylight(temperature_k: Reals | float) -> Floats:
    """Return the colour of the CIE daylight locus (CIE 15) at 4000..25000 K, luminance 1."""
    t = np.clip(np.asarray(temperature_k, dtype=np.float64), 4000, 25000)
    k = 1e3 / t
    low = -4.6070 * k**3 + 2.9678 * k**2 + 0.09911 * k + 0.244063
    high = -2.0064 * k**3 + 1.9018 * k**2 + 0.24748 * k + 0.237040
    x = np.where(t <= 7000, low, high)
    return _from_xy(x, -3.0 * x**2 + 2.870 * x - 0.275)


def clear_sky(luminance: Floats) -> Floats:
    """Return the colour of a clear sky's element by its luminance in cd/m2, at luminance 1.

    Measured by Chain, Dumortier and Fontoynont (2001): 1e6 / T = 59.77 log10(L) - 132.1.
    """
    mired = 59.77 * np.log10(np.maximum(luminance, 1.0)) - 132.1
    return daylight(1e6 / np.clip(mired, 40, 250))


def sun(sun_elevation_rad: float, turbidity: float) -> Floats:
    """Return the colour of the sun through clear air, at luminance 1: air, ozone and aerosol by wavelength."""
    mass = air_mass(max(sun_elevation_rad, 0.0))
    above = _from_xy(np.array(SUN_ABOVE_AIR_XY[0]), np.array(SUN_ABOVE_AIR_XY[1]))
    ozone = (1.15, 0.85, 0.12)
    depths = [
        0.008735 * um**-4.08 + OZONE_DEPTH * share + aerosol_depth(turbidity) * (um / 0.55) ** -1.3
        for um, share in zip(WAVELENGTHS_UM, ozone, strict=True)
    ]
    passed = np.array([math.exp(-depth * mass) for depth in depths], dtype=np.float32)
    return at_luminance_1(above * passed)


def _from_xy(x: Reals, y: Reals) -> Floats:
    xyz = np.stack([x / y, np.ones_like(x), (1 - x - y) / y], axis=-1)
    rgb = np.maximum(xyz @ XYZ_TO_RGB.T, 0.0)
    return np.asarray(rgb / (rgb @ LUMINANCE_WEIGHTS.astype(np.float64))[..., None], dtype=np.float32)


def low_sun(sun_elevation_rad: float) -> float:
    """Return how much a low sun colours the air near the horizon: 0 for a high sun, about 1 at sunset."""
    return math.exp(-max(sun_elevation_rad, 0.0) / math.radians(9))

"""Outdoor illuminance as pvlib's clear-sky model has it: the measure for the simulated sky."""

from __future__ import annotations

import math

from mocks.rooms.sky.daylight import Moment

WATER_CM = 1.5
"""Precipitable water: the usual mid-latitude value, that of the ASTM G173 atmosphere."""

CLEARNESS_EDGES = (1.065, 1.23, 1.5, 1.95, 2.8, 4.5, 6.2)
# Perez et al. 1990, Solar Energy 44, table 4, global luminous efficacy: a, b, c, d by bin of clearness.
GLOBAL_LM_W = (
    (96.63, -0.47, 11.50, -9.16),
    (107.54, 0.79, 1.79, -1.19),
    (98.73, 0.70, 4.40, -6.95),
    (92.72, 0.56, 8.36, -8.31),
    (86.73, 0.98, 7.10, -10.94),
    (88.34, 1.39, 6.06, -7.60),
    (78.63, 1.47, 4.93, -11.37),
    (99.65, 1.86, -4.46, -3.15),
)


def linke_of(luminous_turbidity: float) -> float:
    """Return the Linke turbidity (Ineichen 2008, Solar Energy 82, at sea level) that goes with a luminous one.

    Luminous turbidity counts air (1), ozone (0.27) and aerosol (10 per optical thickness at 550 nm).
    """
    aerosol = max((luminous_turbidity - 1.27) / 10, 0.0)
    return 3.91 * math.exp(0.689) * aerosol + 0.376 * math.log(WATER_CM) + 2.0 + 0.54 - 0.5 + 0.16


def pvlib_clear_sky_lx(moment: Moment, linke_turbidity: float, *, enhanced: bool = True) -> float:
    """Return the horizontal illuminance under a clear sky, sun and sky together, at sea level.

    Ineichen and Perez's irradiance from pvlib times Perez's efficacy. The enhancement term of the published model is
    on, which is not pvlib's default: without it, below 20 degrees of sun, the model falls 10 to 25 % under pvlib's own
    Bird and Solis models.
    """
    import pandas as pd
    import pvlib

    times = pd.DatetimeIndex([moment.utc])
    sun = pvlib.solarposition.get_solarposition(times, moment.latitude_deg, moment.longitude_deg)
    zenith_deg = float(sun["apparent_zenith"].iloc[0])
    mass = float(pvlib.atmosphere.get_relative_airmass(zenith_deg))
    top = float(pvlib.irradiance.get_extra_radiation(moment.utc.timetuple().tm_yday))
    found = pvlib.clearsky.ineichen(zenith_deg, mass, linke_turbidity, 0, top, perez_enhancement=enhanced)
    ghi, dni, dhi = (float(found[name]) for name in ("ghi", "dni", "dhi"))
    zenith = math.radians(zenith_deg)
    twist = 1.041 * zenith**3
    clearness = ((dhi + dni) / dhi + twist) / (1 + twist)
    a, b, c, d = GLOBAL_LM_W[sum(clearness >= edge for edge in CLEARNESS_EDGES)]
    return ghi * (a + b * WATER_CM + c * math.cos(zenith) + d * math.log(dhi * mass / top))

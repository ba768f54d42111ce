"""Outdoor illuminance as pvlib and Perez's efficacies have it: the measure for the simulated sky."""

from __future__ import annotations

import math

from mocks.rooms.moment import Moment

SKY_CLEARNESS = (1.065, 1.23, 1.5, 1.95, 2.8, 4.5, 6.2)
# Perez et al. 1990, Solar Energy 44, table 4: a, b, c, d for each bin of clearness.
DIFFUSE_LM_W = (
    (97.24, -0.46, 12.00, -8.91),
    (107.22, 1.15, 0.59, -3.95),
    (104.97, 2.96, -5.53, -8.77),
    (102.39, 5.59, -13.95, -13.90),
    (100.71, 5.94, -22.75, -23.74),
    (106.42, 3.83, -36.15, -28.83),
    (141.88, 1.90, -53.24, -14.03),
    (152.23, 0.35, -45.27, -7.98),
)
DIRECT_LM_W = (
    (57.20, -4.55, -2.98, 117.12),
    (98.99, -3.46, -1.21, 12.38),
    (109.83, -4.90, -1.71, -8.81),
    (110.34, -5.84, -1.99, -4.56),
    (106.36, -3.97, -1.75, -6.16),
    (107.19, -1.25, -1.51, -26.73),
    (105.75, 0.77, -1.26, -34.44),
    (101.18, 1.58, -1.10, -8.29),
)


def linke_turbidity(luminous_turbidity: float, precipitable_water_cm: float = 2.0) -> float:
    """Return the Linke turbidity (Ineichen 2008, Solar Energy 82, at sea level) that goes with a luminous one.

    Luminous turbidity counts air (1), ozone (0.27) and aerosol (10 per optical thickness at 550 nm).
    """
    aerosol = max(luminous_turbidity / 10 - 0.127, 0.0)
    return 3.91 * math.exp(0.689) * aerosol + 0.376 * math.log(precipitable_water_cm) + 2.0 + 0.54 - 0.5 + 0.16


def pvlib_clear_sky_lx(
    moment: Moment, linke_turbidity: float, precipitable_water_cm: float = 2.0
) -> tuple[float, float]:
    """Return the horizontal illuminance of a clear sky, from the sky and from the sun: Ineichen's irradiance."""
    import pandas as pd
    import pvlib

    times = pd.DatetimeIndex([moment.utc])
    site = pvlib.location.Location(moment.latitude_deg, moment.longitude_deg)
    zenith_deg = float(site.get_solarposition(times)["apparent_zenith"].iloc[0])
    sky = site.get_clearsky(times, model="ineichen", linke_turbidity=linke_turbidity).iloc[0]
    top = float(pvlib.irradiance.get_extra_radiation(times).iloc[0])
    return _perez_lx(float(sky["dhi"]), float(sky["dni"]), top, zenith_deg, precipitable_water_cm)


def _perez_lx(dhi: float, dni: float, top: float, zenith_deg: float, water_cm: float) -> tuple[float, float]:
    import pvlib

    zenith = math.radians(zenith_deg)
    twist = 1.041 * zenith**3
    clearness = ((dhi + dni) / dhi + twist) / (1 + twist)
    brightness = dhi * float(pvlib.atmosphere.get_relative_airmass(zenith_deg)) / top
    row = sum(clearness >= edge for edge in SKY_CLEARNESS)
    a, b, c, d = DIFFUSE_LM_W[row]
    diffuse = dhi * (a + b * water_cm + c * math.cos(zenith) + d * math.log(brightness))
    a, b, c, d = DIRECT_LM_W[row]
    direct = dni * max(a + b * water_cm + c * math.exp(5.73 * zenith - 5) + d * brightness, 0.0)
    return diffuse, direct * math.cos(zenith)

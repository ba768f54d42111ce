"""Place and time, the sun then, and how bright sun and sky are: luminance and colour of daylight."""

import math
from dataclasses import dataclass
from datetime import UTC, datetime, timedelta
from functools import lru_cache

import numpy as np

from mocks.worlds.light import LUMINANCE_WEIGHTS, Vector, luminance_cd_m2
from processing.ground.arrays import Floats, Reals
from processing.ground.tables import table_of

LOWEST_SUN_RAD = math.radians(8)

_TABLES = table_of(__package__, "outdoors")
SITES: list[list[float]] = _TABLES["sites"]  # latitude, longitude, weight


@dataclass(frozen=True)
class Moment:
    """A site, an instant and a heading. ``heading_rad`` is the compass azimuth (clockwise from north) of +y."""

    latitude_deg: float
    longitude_deg: float
    utc: datetime
    heading_rad: float

    def __post_init__(self) -> None:
        if self.utc.tzinfo is None:
            raise ValueError("a moment needs a time with its zone")


@lru_cache(maxsize=256)
def sun_of(moment: Moment) -> tuple[float, float]:
    """Return the sun's azimuth (from +y towards +x, in -pi..pi) and apparent elevation in radians.

    By NREL's solar position algorithm as pvlib has it, with refraction at standard pressure.
    """
    import pandas as pd
    from pvlib.solarposition import spa_python

    found = spa_python(pd.DatetimeIndex([moment.utc]), moment.latitude_deg, moment.longitude_deg)
    compass_rad = math.radians(float(found["azimuth"].iloc[0]))
    elevation_rad = math.radians(float(found["apparent_elevation"].iloc[0]))
    return math.remainder(compass_rad - moment.heading_rad, 2 * math.pi), elevation_rad


def sun_distance_au(moment: Moment) -> float:
    """Return the distance to the sun in astronomical units (Spencer 1971; right to 0.05 %)."""
    day_angle = 2 * math.pi * (moment.utc.astimezone(UTC).timetuple().tm_yday - 1) / 365.25
    closeness = 1.000110 + 0.034221 * math.cos(day_angle) + 0.001280 * math.sin(day_angle)
    closeness += 0.000719 * math.cos(2 * day_angle) + 0.000077 * math.sin(2 * day_angle)
    return 1 / math.sqrt(closeness)


def draw_moment(rng: np.random.Generator, lowest_sun_rad: float = LOWEST_SUN_RAD) -> Moment:
    """Return a moment of any date, any heading, in working daylight: the sun at least ``lowest_sun_rad`` high."""
    weights = np.array([weight for _, _, weight in SITES])
    while True:
        latitude_deg, longitude_deg, _ = SITES[int(rng.choice(len(SITES), p=weights / weights.sum()))]
        solar_noon = datetime(2025, 1, 1, 12, tzinfo=UTC) - timedelta(hours=longitude_deg / 15)
        minutes = int(rng.integers(365)) * 1440 + int(rng.integers(-420, 421))
        moment = Moment(
            latitude_deg + round(float(rng.uniform(-0.2, 0.2)), 3),
            longitude_deg + round(float(rng.uniform(-0.2, 0.2)), 3),
            (solar_noon + timedelta(minutes=minutes)).replace(second=0, microsecond=0),
            round(float(rng.uniform(0, 2 * math.pi)), 4),
        )
        if sun_of(moment)[1] >= lowest_sun_rad:
            return moment


LUMINOUS_SOLAR_CONSTANT_LX = 133_100.0
"""Darula, Kittler and Gueymard 2005, Reference luminous solar constant, Solar Energy 79."""

TRADITIONAL_OVERCAST = 16  # CIE S 011's sixteenth sky: Moon and Spencer's overcast sky, (1 + 2 sin elevation) / 3

PARAMETERS = {int(number): tuple(row) for number, row in _TABLES["cie"].items()}
"""Of the CIE's standard skies, by number: gradation a, b; indicatrix c, d, e."""

RAYLEIGH_DEPTH = 0.1
"""Optical thickness of clean dry air for light as the eye weighs it: the unit of luminous turbidity."""
OZONE_DEPTH = 0.027  # of 300 DU in the Chappuis band, weighed the same way

CLOUD_ENHANCEMENT = 1.15
"""The most that clouds beside the sun add to a clear sky's global illuminance: rarely more in minutes' means
(Gueymard 2017, Cloud and albedo enhancement impacts on solar irradiance, Solar Energy 153)."""


def relative_luminance(cie_type: int, sin_elevation: Floats, cos_to_sun: Floats, sun_elevation_rad: float) -> Floats:
    """Return luminance relative to the zenith's for directions above the horizon.

    ``sin_elevation`` is the sine of each direction's elevation, ``cos_to_sun`` the cosine of its angle to the sun; both
    and the result have one shape.
    """
    z = np.maximum(sin_elevation, np.float32(1e-3))
    if cie_type == TRADITIONAL_OVERCAST:
        return np.asarray((1 + 2 * z) / 3, dtype=np.float32)
    a, b, c, d, e = PARAMETERS[cie_type]
    sun_zenith_rad = math.pi / 2 - sun_elevation_rad
    angle = np.arccos(np.clip(cos_to_sun, -1, 1))
    gradation = (1 + a * np.exp(b / z)) / (1 + a * math.exp(b))
    floor = math.exp(d * math.pi / 2)
    indicatrix = 1 + c * (np.exp(d * angle) - floor) + e * np.square(cos_to_sun)
    at_zenith = 1 + c * (math.exp(d * sun_zenith_rad) - floor) + e * math.cos(sun_zenith_rad) ** 2
    return np.asarray(gradation * indicatrix / at_zenith, dtype=np.float32)


def air_mass(sun_elevation_rad: float) -> float:
    """Return the relative optical air mass (Kasten and Young 1989, Applied Optics 28)."""
    elevation_deg = max(math.degrees(sun_elevation_rad), -3.0)
    return 1 / (math.sin(math.radians(elevation_deg)) + 0.50572 * math.pow(elevation_deg + 6.07995, -1.6364))


def normal_illuminance_lx(sun_elevation_rad: float, turbidity: float, sun_distance_au: float = 1.0) -> float:
    """Return the sun's illuminance on a plane that faces it, below clear air of a luminous ``turbidity``.

    Extinction 1 / (9.9 + 0.043 m) per unit of air mass and turbidity (Clear 1982; Navvab et al. 1984; Kittler and
    Darula's form).
    """
    if sun_elevation_rad <= 0:
        return 0.0
    mass = air_mass(sun_elevation_rad)
    extinction = mass * turbidity / (9.9 + 0.043 * mass)
    return LUMINOUS_SOLAR_CONSTANT_LX / sun_distance_au**2 * math.exp(-extinction)


def clear_diffuse_lx(sun_elevation_rad: float, turbidity: float, sun_distance_au: float = 1.0) -> float:
    """Return the horizontal illuminance from a clear sky without its sun.

    The form is Bird and Hulstrom's (1981, SERI/TR-642-761): half of what air scatters and 84 % of what aerosol
    scatters comes down, 10 % of the aerosol's extinction is absorption, and light goes back and forth between ground
    (albedo 0.2) and sky; the transmittances are those of the luminous band.
    """
    if sun_elevation_rad <= 0:
        return 0.0
    mass = air_mass(sun_elevation_rad)
    sine = math.sin(sun_elevation_rad)
    rayleigh, ozone = math.exp(-RAYLEIGH_DEPTH * mass), math.exp(-OZONE_DEPTH * mass)
    aerosol = math.exp(-aerosol_depth(turbidity) * mass)
    absorbing = 1 - 0.1 * (1 - mass + math.pow(mass, 1.06)) * (1 - aerosol)
    scattering = aerosol / absorbing
    scattered = 0.5 * (1 - rayleigh) + 0.84 * (1 - scattering)
    top = LUMINOUS_SOLAR_CONSTANT_LX / sun_distance_au**2 * sine
    down = 0.79 * top * ozone * absorbing * scattered / (1 - mass + math.pow(mass, 1.02))
    direct = normal_illuminance_lx(sun_elevation_rad, turbidity, sun_distance_au) * sine
    sky_albedo = 0.0685 + (1 - 0.84) * (1 - scattering)
    return (direct + down) / (1 - 0.2 * sky_albedo) - direct


def aerosol_depth(turbidity: float) -> float:
    """Return the aerosol optical thickness near 550 nm that a luminous turbidity stands for."""
    return max(turbidity * RAYLEIGH_DEPTH - RAYLEIGH_DEPTH - OZONE_DEPTH, 0.0)


def partly_cloudy_diffuse_lx(sun_elevation_rad: float) -> float:
    """Return the horizontal illuminance from a partly cloudy sky (IES RP-21: 0.3 + 45 sin(elevation) klx)."""
    return 300.0 + 45_000.0 * max(math.sin(sun_elevation_rad), 0.0)


def overcast_lx(sun_elevation_rad: float) -> float:
    """Return the horizontal illuminance from an overcast sky (Krochmann, Seidl 1974: 0.3 + 21 sin(elevation) klx)."""
    return 300.0 + 21_000.0 * max(math.sin(sun_elevation_rad), 0.0)


# Colours of sky, sun and clouds as linear RGB (Rec. 709 primaries, white D65) at luminance 1.

XYZ_TO_RGB = np.array(
    [[3.2404542, -1.5371385, -0.4985314], [-0.9692660, 1.8760108, 0.0415560], [0.0556434, -0.2040259, 1.0572252]]
)
"""Linear RGB of CIE XYZ (Lindbloom, sRGB, D65). Its digits stay: kept light was made with them."""

# Where the three primaries lie in the spectrum (micrometres), and the sun's own colour above the air.
WAVELENGTHS_UM = (0.610, 0.550, 0.465)
SUN_ABOVE_AIR_XY = (0.3225, 0.3325)


def at_luminance_1(rgb: Vector | Floats) -> Floats:
    """Return colours, shape (..., 3), linear RGB, scaled to luminance 1."""
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
    """Return the colour, shape (3,), of the sun through clear air at luminance 1: air, ozone, aerosol by wavelength."""
    mass = air_mass(max(sun_elevation_rad, 0.0))
    above = _from_xy(np.array(SUN_ABOVE_AIR_XY[0]), np.array(SUN_ABOVE_AIR_XY[1]))
    ozone = (1.15, 0.85, 0.12)
    depths = [
        0.008735 * um**-4.08 + OZONE_DEPTH * share + aerosol_depth(turbidity) * (um / 0.55) ** -1.3
        for um, share in zip(WAVELENGTHS_UM, ozone, strict=True)
    ]
    return at_luminance_1(above * np.array([math.exp(-depth * mass) for depth in depths], dtype=np.float32))


def _from_xy(x: Reals, y: Reals) -> Floats:
    xyz = np.stack([x / y, np.ones_like(x), (1 - x - y) / y], axis=-1)
    rgb = np.maximum(xyz @ XYZ_TO_RGB.T, 0.0)
    return np.asarray(rgb / (rgb @ LUMINANCE_WEIGHTS.astype(np.float64))[..., None], dtype=np.float32)


def low_sun(sun_elevation_rad: float) -> float:
    """Return how much a low sun colours the air near the horizon: 0 for a high sun, about 1 at sunset."""
    return math.exp(-max(sun_elevation_rad, 0.0) / math.radians(9))

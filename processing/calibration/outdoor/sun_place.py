"""Where the sun stands at a time and a place, how much light it gives from a clear sky, and where north is by it.

Positions: NREL's solar position algorithm (Reda, Andreas 2004, 0.0003 degrees) as pvlib has it, with refraction. Light:
Ineichen and Perez's clear-sky model (2002) for the beam in W/m2, times Perez et al.'s efficacy (1990, Solar Energy 44,
271-289, table 4, direct) in lm/W. North comes from the sun's place in the outdoor picture, or from a recorded heading.
"""

import math
from dataclasses import dataclass, replace
from datetime import UTC, datetime, timedelta, timezone, tzinfo
from typing import Literal, Self
from zoneinfo import ZoneInfo

from processing.calibration.outdoor.sun_disc import Sun, find_sun
from processing.errors import ParameterError, SunError
from processing.ground.tables import table_of
from processing.pictures.images import LuminanceImage, RelativeImage
from processing.sphere import Equirectangular, Fisheye
from station.session.session import SessionManifest, Side, Site

WATER_CM = 1.5  # precipitable water, the usual mid-latitude value, where none is given
_CLEARNESS_EDGES: list[float] = table_of(__package__, "efficacy")["clearness_edges"]
_LM_W: dict[str, list[list[float]]] = table_of(__package__, "efficacy")["lm_w"]
RAYLEIGH = (0.06, 0.10, 0.20)  # optical depth of clean air for red, green and blue light
BEAM_UNCERTAINTY = 0.12  # relative, standard: the clear-sky model by its turbidity (10 %) and the efficacy (5 %)


@dataclass(frozen=True)
class Place:
    """Where on Earth: degrees north and east, metres over the sea."""

    latitude_deg: float
    longitude_deg: float
    altitude_m: float = 0.0

    def __post_init__(self) -> None:
        if not (abs(self.latitude_deg) <= 90 and abs(self.longitude_deg) <= 180 and -500 <= self.altitude_m <= 9000):
            raise ParameterError(
                f"not on Earth: latitude {self.latitude_deg}, longitude {self.longitude_deg}, {self.altitude_m} m",
                advice="degrees, north and east positive",
            )

    @classmethod
    def of(cls, site: Site) -> Self | None:
        """Return where a session was taken; None where that is not recorded."""
        if site.latitude_deg is None or site.longitude_deg is None:
            return None
        return cls(site.latitude_deg, site.longitude_deg, site.altitude_m or 0.0)


def shortest_taken(session: SessionManifest, side: Side) -> datetime | None:
    """Return when the shortest frame of a side was taken, which shows the sun and sunlit places best."""
    frames = sorted((f for f in session.frames if f.side is side and f.taken_utc), key=lambda f: f.camera_s)
    return frames[0].taken_utc if frames else None


@dataclass(frozen=True)
class SunPlace:
    """Where the sun stands: compass azimuth (clockwise from north) and apparent elevation, radians."""

    azimuth_rad: float
    elevation_rad: float


def sun_place(time_utc: datetime, place: Place) -> SunPlace:
    """Return where the sun's centre appears at a time with its zone. Raises `ParameterError` for one without."""
    found = _solar_position(time_utc, place)
    return SunPlace(math.radians(found["azimuth"]), math.radians(found["apparent_elevation"]))


@dataclass(frozen=True)
class Beam:
    """The sun's light on a plane that faces it, from a clear sky."""

    normal_lx: float
    relative_uncertainty: float
    normal_w_m2: float
    linke_turbidity: float
    diffuse_w_m2: float = 0.0
    """Of the clear sky around it, on level ground."""
    diffuse_lx: float = 0.0
    top_w_m2: float = 0.0
    """Above the atmosphere, facing the sun."""
    air_mass: float = 0.0
    """Relative: 1 with the sun at the zenith."""


def clear_beam(
    time_utc: datetime, place: Place, linke_turbidity: float | None = None, *, elevation_rad: float | None = None
) -> Beam:
    """Return the beam of a clear sky; a Linke turbidity of None is the place's and month's mean (SoDa's map).

    ``elevation_rad``: where the sun is seen, if that is known better than by time and place. 0 lx with the sun below
    the horizon.
    """
    import pandas as pd
    import pvlib

    times = pd.DatetimeIndex([_checked(time_utc)])
    if linke_turbidity is None:
        means = pvlib.clearsky.lookup_linke_turbidity(
            times, place.latitude_deg, place.longitude_deg, interp_turbidity=False
        )
        linke_turbidity = float(means.iloc[0])
    if not 1 <= linke_turbidity <= 15:
        raise ParameterError(f"a Linke turbidity of {linke_turbidity}", advice="1 (clean) to 8 (hazy)")
    zenith_deg = _solar_position(time_utc, place)["apparent_zenith"]
    if elevation_rad is not None:
        zenith_deg = 90 - math.degrees(elevation_rad)
    if zenith_deg >= 90:
        return Beam(0.0, 1.0, 0.0, linke_turbidity)
    mass = float(pvlib.atmosphere.get_relative_airmass(zenith_deg))
    absolute = float(pvlib.atmosphere.get_absolute_airmass(mass, pvlib.atmosphere.alt2pres(place.altitude_m)))
    top = float(pvlib.irradiance.get_extra_radiation(_checked(time_utc).timetuple().tm_yday))
    light = pvlib.clearsky.ineichen(zenith_deg, absolute, linke_turbidity, place.altitude_m, top)
    normal, diffuse = float(light["dni"]), float(light["dhi"])
    direct_lm_w, around_lm_w = efficacies_lm_w(math.radians(zenith_deg), normal, diffuse, diffuse * mass / top)
    lit = normal * direct_lm_w, diffuse * around_lm_w
    return Beam(lit[0], BEAM_UNCERTAINTY, normal, linke_turbidity, diffuse, lit[1], top, mass)


def efficacies_lm_w(
    zenith_rad: float, normal_w_m2: float, diffuse_w_m2: float, brightness: float
) -> tuple[float, float]:
    """Return the luminous efficacies of the beam, and of the sky's own light on level ground.

    Perez et al. 1990, table 4, direct and diffuse; ``brightness`` is their Delta.
    """
    twist = 1.041 * zenith_rad**3
    clearness = ((diffuse_w_m2 + normal_w_m2) / max(diffuse_w_m2, 1e-9) + twist) / (1 + twist)
    number = sum(clearness >= edge for edge in _CLEARNESS_EDGES)
    (a, b, c, d), (e, f, g, h) = _LM_W["direct"][number], _LM_W["diffuse"][number]
    direct = a + b * WATER_CM + c * math.exp(5.73 * zenith_rad - 5) + d * brightness
    around = e + f * WATER_CM + g * math.cos(zenith_rad) + h * math.log(max(brightness, 1e-3))
    return max(0.0, direct), max(0.0, around)


def _solar_position(time_utc: datetime, place: Place) -> dict[str, float]:
    import pandas as pd
    from pvlib.solarposition import spa_python

    times = pd.DatetimeIndex([_checked(time_utc)])
    found = spa_python(times, place.latitude_deg, place.longitude_deg, place.altitude_m)
    return {str(name): float(found[name].iloc[0]) for name in found.columns}


def _checked(time_utc: datetime) -> datetime:
    if time_utc.tzinfo is None:
        raise ParameterError("a time without a time zone", advice="give UTC, such as 2023-05-19T15:54Z")
    return time_utc.astimezone(UTC)


WARN_RAD = math.radians(1.0)
"""Disagreement in elevation that is worth a warning: a camera off level, or a clock that is wrong."""
REFUSE_RAD = math.radians(8.0)  # what was found is not the sun, or not at that time and place
TIME_SIGMA_S, LEVEL_SIGMA_RAD = 2.0, math.radians(0.05)  # of the camera's clock, and of its levelling; chosen
COMPASS_SIGMA_RAD = math.radians(5.0)  # of a heading read from a compass


@dataclass(frozen=True)
class North:
    """Which way the picture's top (a panorama's middle column) faces: compass azimuth, clockwise from north."""

    top_azimuth_rad: float
    """In 0..2 pi."""
    sigma_rad: float
    source: Literal["sun", "heading"]
    elevation_off_rad: float | None = None
    """The sun's elevation in the picture less that of time and site."""
    warnings: tuple[str, ...] = ()


def north_from_sun(
    image: RelativeImage | LuminanceImage, time_utc: datetime, place: Place, *, sun: Sun | None = None
) -> North:
    """Return where the picture's top faces. ``sun``: as `find_sun` gave it for this picture (None: it is found).

    The uncertainty has parts from the picture, the clock (`TIME_SIGMA_S`) and the levelling of the camera; an error e
    along the horizon is e / cos(elevation) of azimuth. Raises `SunError` where there is no sun, where its elevation
    disagrees with time and site by more than 8 degrees, or where it stands at the zenith, which has no azimuth.
    """
    sun = sun or find_sun(image)
    expected = sun_place(time_utc, place)
    off = sun.elevation_rad - expected.elevation_rad
    _agree(sun, expected.elevation_rad, off)
    in_picture = sun.azimuth_rad - _top_of(image.geometry)
    later = sun_place(time_utc + timedelta(minutes=1), place)
    rate = math.remainder(later.azimuth_rad - expected.azimuth_rad, 2 * math.pi) / 60
    across = math.hypot(sun.sigma_rad, LEVEL_SIGMA_RAD * math.sin(abs(sun.elevation_rad))) / math.cos(sun.elevation_rad)
    sigma = math.hypot(across, rate * TIME_SIGMA_S)
    if sigma > math.pi / 8:
        raise SunError("the sun is at the zenith and has no azimuth", advice="use the recorded heading for north")
    return North((expected.azimuth_rad - in_picture) % (2 * math.pi), sigma, "sun", off, _warnings(off, sun))


def north_from_heading(heading_rad: float, sigma_rad: float = COMPASS_SIGMA_RAD) -> North:
    """Return a recorded heading (compass azimuth of the picture's top) as a north."""
    return North(heading_rad % (2 * math.pi), sigma_rad, "heading")


def oriented(geometry: Fisheye, north: North, heading_rad: float = 0.0) -> Fisheye:
    """Return the geometry with its top where it faces, in a world whose +y has the compass azimuth ``heading_rad``."""
    return replace(geometry, top_azimuth_rad=math.remainder(north.top_azimuth_rad - heading_rad, 2 * math.pi))


def _top_of(geometry: object) -> float:
    """Return the azimuth (from +y) that a picture's top, or a panorama's middle, is taken to have."""
    if isinstance(geometry, Fisheye):
        return geometry.top_azimuth_rad
    if isinstance(geometry, Equirectangular):
        return geometry.yaw_rad
    raise SunError("north is found in fisheye pictures and panoramas, not in perspective views")


def _agree(sun: Sun, expected_rad: float, off_rad: float) -> None:
    if abs(off_rad) > REFUSE_RAD:
        raise SunError(
            f"the sun stands {math.degrees(sun.elevation_rad):.1f} degrees high in the picture, "
            f"and {math.degrees(expected_rad):.1f} by time and site",
            likely="a wrong clock, zone or site, a tilted camera, or a lamp mistaken for the sun",
            advice="check the session's time and site, or use the recorded heading for north",
            found_deg=math.degrees(sun.elevation_rad),
            expected_deg=math.degrees(expected_rad),
        )


def _warnings(off_rad: float, sun: Sun) -> tuple[str, ...]:
    found = []
    if abs(off_rad) > WARN_RAD + 3 * sun.sigma_rad:
        way = "higher" if off_rad > 0 else "lower"
        found.append(
            f"the sun is {abs(math.degrees(off_rad)):.1f} degrees {way} in the picture than time and site predict: "
            "a tilted camera, or a clock minutes off"
        )
    if sun.cut:
        found.append("part of the sun is outside the field of view; its centre is from a disc fitted to the rest")
    return tuple(found)


def zone_named(text: str) -> tzinfo:
    """Return a time zone by its name, or by ``+HH:MM`` ahead of UTC; `ParameterError` where there is none."""
    try:
        if text[:1] in ("+", "-"):
            ahead = datetime.fromisoformat(f"2000-01-01T00:00{text}").utcoffset()
            return timezone(ahead or timedelta())
        return ZoneInfo(text)
    except (KeyError, ValueError, OSError):
        advice = "such as America/New_York, or -04:00"
        raise ParameterError(f"--zone {text[:60]}: no such time zone", advice=advice) from None


def zone_at(latitude_deg: float | None, longitude_deg: float | None, named: str | None = None) -> tzinfo:
    """Return the zone of the clocks at a place: the one that is named, else the place's own, else UTC."""
    if named is not None:
        return zone_named(named)
    if latitude_deg is None or longitude_deg is None:
        return UTC
    from tzfpy import get_tz

    return ZoneInfo(get_tz(longitude_deg, latitude_deg) or "UTC")


def with_zone(moment: datetime, zone: tzinfo) -> str:
    """Return a moment as clocks of the zone show it: ``2023-06-21 16:00 EDT``."""
    local = moment.astimezone(zone)
    return f"{local:%Y-%m-%d %H:%M} {local:%Z}"

"""The sun and the sky at another time, in the weather of the captured picture or in a weather of one's own.

The captured picture of the sky shows how much of a clear sky's beam arrives and how bright the rest of the sky is
beside a clear one. The same shares of the clear sky at another time give its sun and its diffuse light, and the
all-weather model (`rendering.perez`) spreads that over the sky; the colour is the captured sky's.
"""

import math
from dataclasses import dataclass
from datetime import UTC, datetime, timedelta, tzinfo
from typing import Any, Literal

import numpy as np

from processing.calibration.outdoor.sun_place import RAYLEIGH, Beam, Place, SunPlace, clear_beam, sun_place
from processing.errors import DaylightError, ParameterError
from processing.ground.arrays import Doubles, Vector
from processing.ground.tables import table_of
from processing.light.picture.relight_photo import with_captured_land
from processing.light.scene.scene import Outdoors, Sun
from processing.pictures.images import LUMINANCE_WEIGHTS
from processing.sphere import Equirectangular, directions, solid_angles

# The all-weather model of the sky's luminance (Perez, Seals, Michalsky 1993, Solar Energy 50, 235; erratum 51, 423).
#
# Five coefficients, by how clear and how bright the sky is, give the luminance of every direction relative to the
# others; the absolute level comes from the diffuse illuminance.


EDGES = (1.065, 1.23, 1.5, 1.95, 2.8, 4.5, 6.2)  # of the eight bins of clearness
_TABLE = np.array(table_of(__package__, "perez")["table"]).reshape(8, 5, 4)  # by bin, coefficient (a to e) and term
LOWEST = math.sin(math.radians(1.0))
"""Sine of the elevation under which the sky is taken as there, where the model's horizon has no end."""


def clearness(diffuse_w_m2: float, normal_w_m2: float, zenith_rad: float) -> float:
    """Return Perez's epsilon of a sky: 1 overcast, above 6.2 clear."""
    twist = 1.041 * zenith_rad**3
    return (1 + normal_w_m2 / max(diffuse_w_m2, 1e-9) + twist) / (1 + twist)


def coefficients(epsilon: float, brightness: float, zenith_rad: float) -> Doubles:
    """Return Perez's a to e, shape (5,), for his Delta ``brightness`` and the sun's distance from the zenith."""
    number = sum(epsilon >= edge for edge in EDGES)
    # As in Radiance's gendaylit: below, the model was not fitted and describes no sky.
    delta = max(brightness, 0.2) if EDGES[0] < epsilon < EDGES[4] else brightness
    t = _TABLE[number]
    found = t[:, 0] + t[:, 1] * zenith_rad + delta * (t[:, 2] + t[:, 3] * zenith_rad)
    if number == 0:
        c, d = t[2], t[3]
        found[2] = math.exp(max(delta * (c[0] + c[1] * zenith_rad), 0.0) ** c[2]) - c[3]
        found[3] = -math.exp(delta * (d[0] + d[1] * zenith_rad)) + d[2] + delta * d[3]
    return np.asarray(found)


def relative_luminance(rays: Doubles, sun: Vector, five: Doubles) -> Doubles:
    """Return the relative luminance, shape (...,), of unit directions (..., 3) above the horizon, never below 0."""
    a, b, c, d, e = (float(v) for v in five)
    away = np.arccos(np.clip(rays @ np.asarray(sun), -1.0, 1.0))
    gradation = 1 + a * np.exp(b / np.maximum(rays[..., 2], LOWEST))
    scattering = 1 + c * np.exp(d * away) + e * np.cos(away) ** 2
    return np.asarray(np.maximum(gradation * scattering, 0.0))


Sky = Literal["captured", "clear", "overcast"]
MOST_BEAM, LEAST_DIFFUSE, MOST_DIFFUSE = 1.3, 0.03, 6.0  # of a clear sky's: between them the picture is believed
OVERCAST_GLOBAL = 0.25  # of the clear sky's light on level ground, under clouds (Kasten, Czeplak 1980: 1 - 0.75)
USUAL_SUN, USUAL_SKY = (1.04, 1.0, 0.88), (0.92, 1.0, 1.22)  # colours where none were captured
_WEIGHTS = np.asarray(LUMINANCE_WEIGHTS)


@dataclass(frozen=True)
class Weather:
    """What of a clear sky's light there is, and its colours."""

    kind: Sky
    beam: float
    """Of a clear sky's sun."""
    diffuse: float
    """The sky's light on level ground, of what `_clear_share` says that there is."""
    sun_colour: Vector
    """Of luminance 1, at `sun_air_mass`."""
    sun_air_mass: float
    sky_colour: Vector
    notes: tuple[str, ...] = ()


@dataclass(frozen=True)
class Daylight:
    """The light outdoors at a time."""

    outdoors: Outdoors
    place: SunPlace
    diffuse_lx: float
    """Of the sky on level ground."""
    normal_lx: float
    """Of the sun on a plane that faces it."""
    clearness: float
    """Perez's epsilon."""

    @property
    def global_lx(self) -> float:
        """Return the light of sun and sky on level ground."""
        return self.diffuse_lx + self.normal_lx * max(math.sin(self.place.elevation_rad), 0.0)


def level_illuminance(outdoors: Outdoors) -> tuple[Doubles, Doubles]:
    """Return the illuminance, shape (3,), lx, on level ground by the sky alone, and by the sun alone."""
    rays, area = _grid(outdoors.rgb.shape[0])
    sky = np.tensordot(np.maximum(rays[..., 2], 0) * area, outdoors.rgb.astype(np.float64), axes=2)
    sun = outdoors.sun
    direct = np.zeros(3) if sun is None else np.asarray(sun.normal_illuminance_lx) * max(sun.direction[2], 0.0)
    return np.asarray(sky), direct


def captured_weather(outdoors: Outdoors, time_utc: datetime, place: Place) -> Weather:
    """Return the weather that a captured sky shows.

    The sun's height is that of the picture where the sun is in it, else that of time and place.
    """
    sun, sky_rgb = outdoors.sun, level_illuminance(outdoors)[0]
    elevation = math.asin(sun.direction[2]) if sun else sun_place(time_utc, place).elevation_rad
    clear = clear_beam(time_utc, place, elevation_rad=max(elevation, math.radians(3.0)))
    shown_lx = float(np.asarray(sun.normal_illuminance_lx) @ _WEIGHTS) if sun else 0.0
    beam = shown_lx / max(clear.normal_lx, 1.0)
    height = max(elevation, math.radians(3.0))
    diffuse = float(sky_rgb @ _WEIGHTS) / max(_clear_share(clear, min(beam, 1.0), height), 1.0)
    held = min(beam, MOST_BEAM), min(max(diffuse, LEAST_DIFFUSE), MOST_DIFFUSE)
    of = "a clear sky's light and beam together" if beam < 0.5 else "its diffuse light"
    notes = [f"captured: {beam:.2f} of a clear sky's beam; the sky gives {diffuse:.2f} of {of}"]
    if held != (beam, diffuse):
        notes.append(f"limited to {held[0]:.2f} and {held[1]:.2f}: values beyond are implausible")
    if sun:
        off = math.degrees(elevation - sun_place(time_utc, place).elevation_rad)
        if abs(off) > 8:
            notes.append(f"the captured sun stands {off:+.1f} degrees off its computed position: one is wrong")
    colour = _unit(np.asarray(sun.normal_illuminance_lx)) if sun else _unit(np.asarray(USUAL_SUN))
    return Weather("captured", *held, colour, clear.air_mass if sun else 1.5, _unit(sky_rgb), tuple(notes))


def usual_weather(kind: Sky, glass: Vector = (1.0, 1.0, 1.0)) -> Weather:
    """Return a clear or an overcast weather.

    ``glass``: the windows' transmittance as it was measured. Its colour is mostly what two cameras differ by, and
    goes with the captured sky; a sky of known colour is given the other way round, so that it looks so indoors.
    """
    clear = kind == "clear"
    back = 1 / np.maximum(np.asarray(glass), 1e-3)
    sun, sky = (np.asarray(USUAL_SUN), np.asarray(USUAL_SKY)) if clear else (np.ones(3), np.ones(3))
    beam, diffuse = (1.0, 1.0) if clear else (0.0, OVERCAST_GLOBAL)
    return Weather(kind, beam, diffuse, _unit(sun * back), 1.5, _unit(sky * back))


def sun_direction(sun: SunPlace, heading_rad: float) -> Vector:
    """Return the sun's direction in a room whose +y has the compass azimuth ``heading_rad``."""
    azimuth, level = sun.azimuth_rad - heading_rad, math.cos(sun.elevation_rad)
    return (math.sin(azimuth) * level, math.cos(azimuth) * level, math.sin(sun.elevation_rad))


def daylight_at(
    time_utc: datetime, place: Place, heading_rad: float, weather: Weather, captured: Outdoors, *, rows: int = 128
) -> Daylight:
    """Return the light outdoors at a time; ground, trees and houses are the captured ones under the new light.

    Raises `DaylightError`: the sun is below the horizon: twilight is not modelled.
    """
    sun = sun_place(time_utc, place)
    if sun.elevation_rad <= 0:
        text = f"the sun is {math.degrees(-sun.elevation_rad):.1f} degrees below the horizon"
        advice = "give a time in daylight; twilight and night are not modelled"
        raise DaylightError(text, where=time_utc.isoformat(timespec="minutes"), advice=advice)
    clear = clear_beam(time_utc, place)
    measured_by_lx = _clear_share(clear, min(weather.beam, 1.0), sun.elevation_rad)
    share = weather.diffuse * measured_by_lx / max(clear.diffuse_lx, 1e-9)
    normal_lx, diffuse_lx = weather.beam * clear.normal_lx, share * clear.diffuse_lx
    direction = sun_direction(sun, heading_rad)
    zenith = math.pi / 2 - sun.elevation_rad
    epsilon = clearness(share * clear.diffuse_w_m2, weather.beam * clear.normal_w_m2, zenith)
    brightness = share * clear.diffuse_w_m2 * clear.air_mass / max(clear.top_w_m2, 1e-9)
    rays, area = _grid(rows)
    above = rays[..., 2] > 0
    level = np.where(above, relative_luminance(rays, direction, coefficients(epsilon, brightness, zenith)), 0.0)
    whole = float((level * np.maximum(rays[..., 2], 0) * area).sum())
    sky = (level * diffuse_lx / max(whole, 1e-12))[..., None] * np.asarray(weather.sky_colour)
    disc = Sun(direction, _sunlight(normal_lx, weather, clear)) if normal_lx > 0 else None
    found = Outdoors(sky.astype(np.float32), disc)
    return Daylight(with_captured_land(found, captured), sun, diffuse_lx, normal_lx, epsilon)


def _clear_share(clear: Beam, beam: float, elevation_rad: float) -> float:
    """Return the light (lx) on level ground that a sky's is measured by: the clear sky's, and what clouds scatter.

    The less of the sun's ``beam`` arrives, the more of it comes as the light of clouds: an overcast sky gives a share
    of sun and sky together (Kasten and Czeplak 1980)."""
    return clear.diffuse_lx + (1 - beam) * clear.normal_lx * max(math.sin(elevation_rad), 0.0)


def _sunlight(normal_lx: float, weather: Weather, clear: Beam) -> Vector:
    """Return the sun's RGB illuminance: the captured colour, reddened or not by the air it comes through."""
    more = np.exp(-np.asarray(RAYLEIGH) * (clear.air_mass - weather.sun_air_mass))
    red, green, blue = (normal_lx * v for v in _unit(np.asarray(weather.sun_colour) * more))
    return (red, green, blue)


def _unit(rgb: Doubles) -> Vector:
    level = float(rgb @ _WEIGHTS)
    red, green, blue = (float(v) / level if level > 0 else 1.0 for v in rgb)
    return (red, green, blue)


def _grid(rows: int) -> tuple[Doubles, Doubles]:
    geometry = Equirectangular(2 * rows, rows)
    return directions(geometry)[0], solid_angles(geometry)


def daylight_facts(found: Daylight, time_utc: datetime) -> dict[str, Any]:
    """Return a moment's light as plain values."""
    return {
        "time_utc": time_utc.isoformat(timespec="minutes"),
        "sun_azimuth_deg": round(math.degrees(found.place.azimuth_rad) % 360, 3),
        "sun_elevation_deg": round(math.degrees(found.place.elevation_rad), 3),
        "sun_normal_lx": round(found.normal_lx, 1),
        "sky_horizontal_lx": round(found.diffuse_lx, 1),
        "global_horizontal_lx": round(found.global_lx, 1),
        "clearness": round(found.clearness, 3),
    }


def sky_facts(outdoors: Outdoors) -> dict[str, Any]:
    """Return the light of a given sky as plain values."""
    sky, sun = (float(v @ _WEIGHTS) for v in level_illuminance(outdoors))
    found: dict[str, Any] = {"sky_horizontal_lx": round(sky, 1), "global_horizontal_lx": round(sky + sun, 1)}
    if outdoors.sun is not None:
        x, y, z = outdoors.sun.direction
        found["sun_from_middle_deg"] = round(math.degrees(math.atan2(x, y)), 3)
        found["sun_elevation_deg"] = round(math.degrees(math.asin(z)), 3)
    return found


def parse_time(text: str, zone: tzinfo) -> datetime:
    """Return a time of ISO 8601 in UTC; one without a zone is as clocks in ``zone`` show it."""
    try:
        found = datetime.fromisoformat(text.strip())
    except ValueError as error:
        advice = 'write "2023-06-21 16:00", or with a zone: …T16:00+02:00'
        raise ParameterError(f"not a time: {text!r}", advice=advice) from error
    if not 1 < found.year < 9999:  # in which any zone and any span of a day still have a date
        raise ParameterError(f"{text!r} is too far from today", advice="give a year from 2 to 9998")
    return (found.replace(tzinfo=zone) if found.tzinfo is None else found).astimezone(UTC)


def day_times(day: datetime, place: Place, zone: tzinfo, step: timedelta) -> list[datetime]:
    """Return the times of a local day, whole steps from midnight, at which the sun is at least 1 degree high."""
    if not timedelta(minutes=5) <= step <= timedelta(hours=6):
        raise ParameterError(f"a step of {step}", advice="give 5 minutes to 6 hours, such as 30m or 1h")
    local = day.astimezone(zone)
    midnight = local.replace(hour=0, minute=0, second=0, microsecond=0).astimezone(UTC)
    times = [midnight + k * step for k in range(math.ceil(timedelta(days=1) / step))]
    found = [t for t in times if sun_place(t, place).elevation_rad > math.radians(1.0)]
    if not found:
        raise DaylightError("the sun does not rise that day", where=local.date().isoformat(), advice="try another date")
    return found

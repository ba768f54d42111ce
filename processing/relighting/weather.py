"""The sun and the sky at another time, in the weather of the captured picture or in a weather of one's own.

The captured picture of the sky tells how much of a clear sky's beam arrives and how bright the rest of the sky is
beside a clear one. The same shares of the clear sky at another time give its sun and its diffuse light, and the
all-weather model (`rendering.perez`) spreads that over the sky; the colour is the captured sky's.
"""

from __future__ import annotations

from processing.ground.arrays import Doubles

import math
from dataclasses import dataclass
from datetime import datetime
from typing import Literal

import numpy as np

from processing.calibration.clear_sky import Beam, Place, SunPlace, clear_beam, sun_place
from processing.errors import DaylightError
from processing.images import LUMINANCE_WEIGHTS
from processing.rendering.perez import clearness, coefficients, relative_luminance
from processing.rendering.relight_land import with_captured_land
from processing.rendering.scene import Outdoors, Sun, Vector
from processing.sphere import Equirectangular, directions, solid_angles

Sky = Literal["captured", "clear", "overcast"]
MOST_BEAM, LEAST_DIFFUSE, MOST_DIFFUSE = 1.3, 0.03, 6.0
"""Of a clear sky's: between which the captured picture is believed."""
OVERCAST_GLOBAL = 0.25
"""Of the clear sky's light on level ground, that an overcast sky gives (Kasten, Czeplak 1980: 1 - 0.75)."""
RAYLEIGH = (0.06, 0.10, 0.20)
"""Optical depth of clean air for red, green and blue light."""
USUAL_SUN, USUAL_SKY = (1.04, 1.0, 0.88), (0.92, 1.0, 1.22)
"""Colours where none were captured."""
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
    """Return the illuminance (3,) on level ground by the sky alone, and by the sun alone."""
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
        notes.append(f"held to {held[0]:.2f} and {held[1]:.2f}: more or less is not believed")
    if sun:
        off = math.degrees(elevation - sun_place(time_utc, place).elevation_rad)
        if abs(off) > 8:
            notes.append(f"the captured sun stands {off:+.1f} degrees off where time and site say: one is wrong")
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
    return Weather(
        kind, 1.0 if clear else 0.0, 1.0 if clear else OVERCAST_GLOBAL, _unit(sun * back), 1.5, _unit(sky * back)
    )


def sun_direction(sun: SunPlace, heading_rad: float) -> Vector:
    """Return the sun's direction in a room whose +y has the compass azimuth ``heading_rad``."""
    azimuth, level = sun.azimuth_rad - heading_rad, math.cos(sun.elevation_rad)
    return (math.sin(azimuth) * level, math.cos(azimuth) * level, math.sin(sun.elevation_rad))


def daylight_at(
    time_utc: datetime, place: Place, heading_rad: float, weather: Weather, captured: Outdoors, *, rows: int = 128
) -> Daylight:
    """Return the light outdoors at a time; ground, trees and houses are the captured ones under the new light.

    Raises
    ------
    DaylightError
        The sun is below the horizon: twilight is not modelled.
    """
    sun = sun_place(time_utc, place)
    if sun.elevation_rad <= 0:
        raise DaylightError(
            f"the sun is {math.degrees(-sun.elevation_rad):.1f} degrees below the horizon",
            where=time_utc.isoformat(timespec="minutes"),
            advice="give a time by day; twilight and night are not modelled",
        )
    clear = clear_beam(time_utc, place)
    share = (
        weather.diffuse * _clear_share(clear, min(weather.beam, 1.0), sun.elevation_rad) / max(clear.diffuse_lx, 1e-9)
    )
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
    of sun and sky together (Kasten and Czeplak 1980).
    """
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

"""The sky over a simulated room: CIE general sky in colour, its sun, and the land below, in absolute units."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import lru_cache
from typing import Literal, TypeAlias

import numpy as np

from mocks.light import BrightDisc, Floats, Vector, direction_of
from mocks.rooms import sky_colour, sky_light
from mocks.rooms.moment import Moment, sun_distance_au, sun_of

Kind: TypeAlias = Literal["clear", "intermediate", "overcast"]
Component: TypeAlias = Literal["sky", "sun"]

SUN_RADIUS_RAD = math.radians(0.53 / 2)
GROUND_ALBEDO = (0.19, 0.205, 0.15)
OVERCAST_K = 6400.0


@dataclass(frozen=True)
class Sky:
    """A sky in room axes: azimuth from +y towards +x.

    ``cie_type`` is one of CIE S 011's fifteen or 16, the traditional overcast sky. ``turbidity`` is luminous (1 is
    clean dry air). ``sun_share`` is how much of the sun's light passes the clouds before it. ``cloud_mix`` turns the
    diffuse light from the clear sky's (0) to the partly cloudy sky's (1); an overcast sky has its own.
    """

    kind: Kind = "clear"
    sun_azimuth_rad: float = math.radians(48)
    sun_elevation_rad: float = math.radians(44)
    cie_type: int = 12
    turbidity: float = 2.2
    sun_share: float = 1.0
    cloud_mix: float = 0.0
    sun_distance_au: float = 1.0
    seed: int = 0

    @property
    def key(self) -> str:
        """Return the parameters as text."""
        return repr(self)

    @property
    def sun_direction(self) -> Vector:
        """Unit vector to the sun's centre."""
        return direction_of(self.sun_azimuth_rad, self.sun_elevation_rad)

    @property
    def sun_normal_illuminance_rgb(self) -> Floats:
        """Illuminance (lx, as RGB) on a plane that faces the sun."""
        colour = sky_colour.sun(self.sun_elevation_rad, self.turbidity)
        return np.asarray(colour * np.float32(self._sun_normal_lx), dtype=np.float32)

    @property
    def _sun_normal_lx(self) -> float:
        if self.kind == "overcast":
            return 0.0
        clear = sky_light.normal_illuminance_lx(self.sun_elevation_rad, self.turbidity, self.sun_distance_au)
        return clear * self.sun_share

    def disc(self) -> BrightDisc | None:
        """Return the sun's disc, uniform, 0.53 degrees wide; None where clouds hide it."""
        if self._sun_normal_lx == 0.0:
            return None
        solid_angle_sr = 2 * math.pi * (1 - math.cos(SUN_RADIUS_RAD))
        red, green, blue = (float(v) / solid_angle_sr for v in self.sun_normal_illuminance_rgb)
        return BrightDisc(self.sun_direction, SUN_RADIUS_RAD, (red, green, blue))

    def horizontal_illuminance_lx(self) -> tuple[float, float]:
        """Return the illuminance on open level ground: from the sky, from the sun."""
        elevation_rad = self.sun_elevation_rad
        direct = self._sun_normal_lx * max(math.sin(elevation_rad), 0.0)
        if self.kind == "overcast":
            return sky_light.overcast_lx(elevation_rad), direct
        clear = sky_light.clear_diffuse_lx(elevation_rad, self.turbidity, self.sun_distance_au)
        cloudy = sky_light.partly_cloudy_diffuse_lx(elevation_rad)
        return clear + self.cloud_mix * (cloudy - clear), direct

    def radiance(self, directions: Floats, pixel_rad: float = 0.0, component: Component | None = None) -> Floats:
        """Return the radiance without the sun's disc, from unit directions (..., 3), in room axes.

        ``component`` keeps what came from the sky's dome ("sky") or from the sun by way of ground and skyline
        ("sun"). Detail finer than ``pixel_rad`` is smoothed away.
        """
        ground = _ground_radiance(self, component)
        above = directions[..., 2:] > 0
        if component == "sun":
            return np.where(above, np.float32(0), ground).astype(np.float32)
        return np.where(above, self.dome(directions), ground).astype(np.float32)

    def dome(self, directions: Floats) -> Floats:
        """Return the sky's own radiance, as if the horizon were free; below it, that of the horizon."""
        z = np.maximum(directions[..., 2], np.float32(0))
        cos_sun = np.asarray(directions @ np.array(self.sun_direction, dtype=np.float32), dtype=np.float32)
        relative = sky_light.relative_luminance(self.cie_type, z, cos_sun, self.sun_elevation_rad)
        luminance = relative * np.float32(_zenith_luminance(self))
        return np.asarray(self._tint(luminance) * luminance[..., None], dtype=np.float32)

    def _tint(self, luminance: Floats) -> Floats:
        grey = sky_colour.daylight(OVERCAST_K)
        if self.kind == "overcast":
            return grey
        return sky_colour.clear_sky(luminance)

    def environment(self, rows: int, component: Component | None = None) -> Floats:
        """Return the radiance as an equirectangular map (rows, 2 rows, 3), each pixel the mean over its area.

        Longitude 0 (+y) at the centre, growing to the right (+x); zenith up; pixel centres at half integers.
        """
        fine = 4
        pixel_rad = math.pi / rows
        out = np.empty((rows, 2 * rows, 3), dtype=np.float32)
        for row in range(rows):
            latitude = math.pi / 2 - (np.arange(row * fine, (row + 1) * fine) + 0.5) * (pixel_rad / fine)
            longitude = (np.arange(2 * rows * fine) + 0.5) * (pixel_rad / fine) - math.pi
            directions = _directions(longitude[None, :], latitude[:, None])
            weight = np.cos(latitude)[:, None, None, None]
            light = self.radiance(directions, pixel_rad / fine, component).reshape(fine, 2 * rows, fine, 3)
            out[row] = (light * weight).sum(axis=(0, 2)) / (weight.sum() * fine)
        return out


def _directions(azimuth_rad: np.ndarray, elevation_rad: np.ndarray) -> Floats:
    azimuth, elevation = np.broadcast_arrays(azimuth_rad, elevation_rad)
    flat = np.cos(elevation)
    return np.stack([flat * np.sin(azimuth), flat * np.cos(azimuth), np.sin(elevation)], axis=-1).astype(np.float32)


def cosine_grid(rows: int = 128) -> Floats:
    """Return directions over the upper half (rows, 2 rows, 3), each for the same horizontal illuminance.

    The mean of the luminance over them, times pi, is the horizontal illuminance.
    """
    sine = np.sqrt((np.arange(rows) + 0.5) / rows)
    azimuth = (np.arange(2 * rows) + 0.5) * (math.pi / rows) - math.pi
    return _directions(azimuth[None, :], np.arcsin(sine)[:, None])


@lru_cache(maxsize=64)
def _zenith_luminance(sky: Sky) -> float:
    """Return the zenith luminance (cd/m2) with which the dome gives the diffuse illuminance that it should."""
    grid = cosine_grid()
    cos_sun = np.asarray(grid @ np.array(sky.sun_direction, dtype=np.float32), dtype=np.float32)
    relative = sky_light.relative_luminance(sky.cie_type, grid[..., 2], cos_sun, sky.sun_elevation_rad)
    return sky.horizontal_illuminance_lx()[0] / (math.pi * float(relative.mean(dtype=np.float64)))


@lru_cache(maxsize=64)
def _dome_illuminance_rgb(sky: Sky) -> tuple[float, ...]:
    light = sky.dome(cosine_grid(64)).mean(axis=(0, 1), dtype=np.float64) * math.pi
    return tuple(float(v) for v in light)


def _ground_radiance(sky: Sky, component: Component | None) -> Floats:
    light = np.zeros(3, dtype=np.float32)
    if component != "sun":
        light += np.array(_dome_illuminance_rgb(sky), dtype=np.float32)
    if component != "sky":
        light += sky.sun_normal_illuminance_rgb * np.float32(max(math.sin(sky.sun_elevation_rad), 0.0))
    return np.asarray(light * np.array(GROUND_ALBEDO, dtype=np.float32) / np.float32(math.pi), dtype=np.float32)


def draw_sky(rng: np.random.Generator, moment: Moment, kind: Kind | None = None) -> Sky:
    """Return a sky of the moment; of any kind (45 % clear, 30 % intermediate, 25 % overcast) unless told."""
    kinds: tuple[Kind, ...] = ("clear", "intermediate", "overcast")
    drawn = kinds[int(rng.choice(3, p=(0.45, 0.30, 0.25)))]
    chosen = kind or drawn
    azimuth_rad, elevation_rad = sun_of(moment)
    cie_type = int(rng.choice({"clear": (11, 12, 12, 13), "intermediate": (7, 8, 9, 10), "overcast": (16,)}[chosen]))
    free = rng.random() < 0.6
    return Sky(
        kind=chosen,
        sun_azimuth_rad=azimuth_rad,
        sun_elevation_rad=elevation_rad,
        cie_type=cie_type,
        turbidity=round(float(rng.uniform(1.8, 3.0)), 2),
        sun_share=0.0
        if chosen == "overcast"
        else 1.0
        if free or chosen == "clear"
        else round(float(rng.uniform(0.1, 0.7)), 2),
        cloud_mix=round(float(rng.uniform(0.35, 0.9)), 2) if chosen == "intermediate" else 0.0,
        sun_distance_au=round(sun_distance_au(moment), 5),
        seed=int(rng.integers(2**31)),
    )

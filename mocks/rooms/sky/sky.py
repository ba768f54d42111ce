"""The sky over a simulated room: CIE general sky in colour with clouds, its sun, and the land below, absolute units."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from functools import lru_cache
from typing import Literal, TypeAlias

import numpy as np

from mocks.rooms.sky import daylight as sky_colour
from mocks.rooms.sky import daylight as sky_light
from mocks.rooms.sky import outdoors
from mocks.rooms.sky.clouds import CloudLayer, overcast_relief
from mocks.rooms.sky.moment import Moment, sun_distance_au, sun_of
from mocks.rooms.sky.outdoors import Ambient, Component, Surroundings
from mocks.worlds.light import BrightDisc, Vector, direction_of
from processing.ground.arrays import Floats
from processing.ground.colour import LUMINANCE_WEIGHTS

Kind: TypeAlias = Literal["clear", "intermediate", "overcast"]

SUN_RADIUS_RAD = math.radians(0.53 / 2)
OVERCAST_K = 6400.0
SHARES: dict[Kind, float] = {"clear": 0.45, "intermediate": 0.30, "overcast": 0.25}
CIE_TYPES: dict[Kind, tuple[int, ...]] = {
    "clear": (11, 12, 12, 13),
    "intermediate": (7, 8, 9, 10),
    "overcast": (sky_light.TRADITIONAL_OVERCAST,),
}


@dataclass(frozen=True)
class Sky:
    """A sky in room axes: azimuth from +y towards +x.

    ``cie_type`` is one of CIE S 011's fifteen or 16, the traditional overcast sky. ``turbidity`` is luminous (1 is
    clean dry air). ``sun_share`` is how much of the sun's light passes the clouds before it. ``cloud_cover`` (0..1)
    paints clouds, and turns an intermediate sky's diffuse light from clear (0) to partly cloudy (1); with 0 the dome
    has exactly the CIE distribution. ``skyline`` puts houses and trees around, seen from ``eye_height_m``.
    """

    kind: Kind = "clear"
    sun_azimuth_rad: float = math.radians(48)
    sun_elevation_rad: float = math.radians(44)
    cie_type: int = 12
    turbidity: float = 2.2
    sun_share: float = 1.0
    cloud_cover: float = 0.0
    sun_distance_au: float = 1.0
    eye_height_m: float = 2.1
    skyline: bool = True
    ground_albedo: Vector = (0.162, 0.208, 0.098)
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
        """Return the illuminance on open level ground with a free horizon: from the sky, from the sun."""
        elevation_rad = self.sun_elevation_rad
        if self.kind == "overcast":
            return sky_light.overcast_lx(elevation_rad), 0.0
        direct = self._sun_normal_lx * max(math.sin(elevation_rad), 0.0)
        clear = sky_light.clear_diffuse_lx(elevation_rad, self.turbidity, self.sun_distance_au)
        if self.kind == "clear":
            return clear, direct
        cloudy = clear + self.cloud_cover * (sky_light.partly_cloudy_diffuse_lx(elevation_rad) - clear)
        whole_clear = sum(replace(self, kind="clear", sun_share=1.0).horizontal_illuminance_lx())
        return min(cloudy, sky_light.CLOUD_ENHANCEMENT * whole_clear - direct), direct

    def radiance(self, directions: Floats, pixel_rad: float = 0.0, component: Component | None = None) -> Floats:
        """Return the radiance without the sun's disc, from unit directions (..., 3), in room axes.

        ``component`` keeps what came from the sky's dome ("sky") or from the sun by way of ground and skyline
        ("sun"). Detail finer than ``pixel_rad`` is smoothed away.
        """
        directions = np.asarray(directions, dtype=np.float32)
        surroundings = Surroundings(self.seed, self.eye_height_m, self.ground_albedo, self.skyline)
        behind = np.zeros_like(directions)
        if component != "sun":
            above = directions[..., 2] > 0
            behind[above] = self.dome(directions[above], pixel_rad)
        return outdoors.over(behind, directions, pixel_rad, surroundings, ambient_of(self), component)

    def dome(self, directions: Floats, pixel_rad: float = 0.0) -> Floats:
        """Return the sky's own radiance, as if the horizon were free; below it, that of the horizon."""
        return self._unscaled(directions, pixel_rad) * np.float32(_scale(self))

    def _unscaled(self, directions: Floats, pixel_rad: float) -> Floats:
        """Return the dome as if the CIE distribution gave the whole diffuse light and clouds came on top."""
        cos_sun = np.asarray(directions @ np.array(self.sun_direction, dtype=np.float32), dtype=np.float32)
        luminance = np.float32(_cie_zenith(self)) * sky_light.relative_luminance(
            self.cie_type, directions[..., 2], cos_sun, self.sun_elevation_rad
        )
        if self.kind == "overcast":
            if self.cloud_cover > 0:
                relief = overcast_relief(self.seed, directions, pixel_rad)
                luminance = luminance * (1 + np.float32(0.16 * self.cloud_cover) * relief)
            return sky_colour.daylight(OVERCAST_K) * luminance[..., None]
        air = sky_colour.clear_sky(luminance)
        warm = _warmth(directions[..., 2], cos_sun)[..., None] * sky_colour.low_sun(self.sun_elevation_rad)
        air = sky_colour.at_luminance_1(air + warm * sky_colour.sun(self.sun_elevation_rad, self.turbidity))
        light = np.asarray(air * luminance[..., None], dtype=np.float32)
        return self._with_clouds(light, directions, cos_sun, pixel_rad) if self.cloud_cover > 0 else light

    def _with_clouds(self, light: Floats, directions: Floats, cos_sun: Floats, pixel_rad: float) -> Floats:
        layer = CloudLayer(self.seed, self.cloud_cover, self.sun_direction, self.sun_share)
        opacity, lit = layer.look(directions, pixel_rad)
        diffuse_lx, _ = self.horizontal_illuminance_lx()
        beam_lx = sky_light.normal_illuminance_lx(self.sun_elevation_rad, self.turbidity, self.sun_distance_au)
        forward = 1 + 2.5 * np.exp(8 * (cos_sun - 1)) * (1 - 0.7 * opacity)
        sunlit = sky_colour.sun(self.sun_elevation_rad, self.turbidity) * np.float32(0.40 * beam_lx / math.pi)
        shaded = sky_colour.daylight(7500.0) * np.float32(0.75 * diffuse_lx / math.pi)
        cloud = sunlit * (lit * forward)[..., None] + shaded
        return np.asarray(light + opacity[..., None] * (cloud - light), dtype=np.float32)

    def environment(self, rows: int, component: Component | None = None) -> Floats:
        """Return the radiance as an equirectangular map (rows, 2 rows, 3), each pixel the mean over its area.

        Longitude 0 (+y) at the centre, growing to the right (+x); zenith up; pixel centres at half integers.
        """
        fine, pixel_rad = min(max(1024 // rows, 2), 8), math.pi / rows
        out = np.empty((rows, 2 * rows, 3), dtype=np.float32)
        longitude = (np.arange(2 * rows * fine) + 0.5) * (pixel_rad / fine) - math.pi
        for row in range(rows):
            latitude = math.pi / 2 - (np.arange(row * fine, (row + 1) * fine) + 0.5) * (pixel_rad / fine)
            directions = outdoors.directions_at(longitude[None, :], latitude[:, None])
            weight = np.cos(latitude)[:, None, None, None]
            light = self.radiance(directions, pixel_rad / fine, component).reshape(fine, 2 * rows, fine, 3)
            out[row] = (light * weight).sum(axis=(0, 2)) / (weight.sum() * fine)
        return out


def _warmth(sine: Floats, cos_sun: Floats) -> Floats:
    """Return how much of the sun's own colour the air has: near the horizon, most below the sun."""
    low = np.exp(-np.maximum(sine, np.float32(0)) / np.float32(0.16))
    return np.asarray(low * (0.35 + 0.65 * np.square(np.maximum(cos_sun, 0))), dtype=np.float32)


@lru_cache(maxsize=64)
def _cie_zenith(sky: Sky) -> float:
    """Return the zenith luminance (cd/m2) with which the bare CIE dome gives the diffuse illuminance."""
    grid = outdoors.cosine_grid()
    cos_sun = np.asarray(grid @ np.array(sky.sun_direction, dtype=np.float32), dtype=np.float32)
    relative = sky_light.relative_luminance(sky.cie_type, grid[..., 2], cos_sun, sky.sun_elevation_rad)
    return sky.horizontal_illuminance_lx()[0] / (math.pi * float(relative.mean(dtype=np.float64)))


@lru_cache(maxsize=64)
def _scale(sky: Sky) -> float:
    """Return the factor that gives a clouded dome the diffuse illuminance again."""
    if sky.cloud_cover == 0:
        return 1.0
    grid = outdoors.cosine_grid()
    light = sky._unscaled(grid, math.pi / 256)  # noqa: SLF001
    luminance = light @ np.array(LUMINANCE_WEIGHTS)
    return sky.horizontal_illuminance_lx()[0] / (math.pi * float(luminance.mean(dtype=np.float64)))


@lru_cache(maxsize=64)
def ambient_of(sky: Sky) -> Ambient:
    """Return the light that the surroundings stand in."""
    return outdoors.ambient(sky.dome, sky.sun_normal_illuminance_rgb, sky.sun_direction, sky.ground_albedo)


def draw_sky(rng: np.random.Generator, moment: Moment, kind: Kind | None = None) -> Sky:
    """Return a sky of the moment; of any kind (45 % clear, 30 % intermediate, 25 % overcast) unless told.

    Raises ValueError when the sun is below the horizon: there is no model of the night.
    """
    drawn = tuple(SHARES)[int(rng.choice(len(SHARES), p=tuple(SHARES.values())))]
    chosen = kind or drawn
    azimuth_rad, elevation_rad = sun_of(moment)
    if elevation_rad <= 0:
        raise ValueError(f"the sun is below the horizon at {moment.utc:%Y-%m-%d %H:%M} UTC: skies are of the day only")
    veil = float(rng.uniform(0.1, 0.7)) if rng.random() < 0.4 else 1.0
    cover = {"clear": (0.0, 0.12), "intermediate": (0.3, 0.75), "overcast": (0.4, 1.0)}[chosen]
    upstairs = bool(rng.random() < 0.35)
    return Sky(
        kind=chosen,
        sun_azimuth_rad=azimuth_rad,
        sun_elevation_rad=elevation_rad,
        cie_type=int(rng.choice(CIE_TYPES[chosen])),
        turbidity=round(float(rng.uniform(1.8, 2.7)), 2),
        sun_share={"clear": 1.0, "intermediate": round(veil, 2), "overcast": 0.0}[chosen],
        cloud_cover=round(float(rng.uniform(*cover)), 2),
        sun_distance_au=round(sun_distance_au(moment), 5),
        eye_height_m=4.9 if upstairs else 2.1,
        seed=int(rng.integers(2**31)),
    )

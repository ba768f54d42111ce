"""The sky over a simulated room: CIE general sky in colour with clouds, its sun, and the land below, absolute units."""

import math
from dataclasses import dataclass, replace
from functools import lru_cache
from typing import Any, Literal, TypeAlias

import numpy as np

from mocks.rooms.noise import fractal, smoothstep
from mocks.rooms.sky import daylight, outdoors
from mocks.rooms.sky.daylight import Moment, sun_distance_au, sun_of
from mocks.rooms.sky.outdoors import Ambient, Component, Surroundings, cosine_grid
from mocks.worlds.light import SUN_RADIUS_RAD, BrightDisc, Vector, direction_of
from processing.ground.arrays import Floats
from processing.ground.colour import LUMINANCE_WEIGHTS
from processing.ground.tables import table_of

EARTH_IN_CLOUD_HEIGHTS = 3200.0  # 6,371 km over clouds at 2 km
CLEARING_RAD = math.radians(3.0)  # around the sun the clouds are as thick as the sun's share of light says


@dataclass(frozen=True)
class CloudLayer:
    """A layer of broken clouds: how much of the sky it covers, and how much of the sun it lets through."""

    seed: int
    cover: float
    sun_direction: Vector
    sun_share: float

    def look(self, directions: Floats, pixel_rad: float) -> tuple[Floats, Floats]:
        """Return opacity and how sunlit the cloud is, both 0..1, for directions of shape (..., 3) above the horizon."""
        x, y, footprint = _on_layer(directions, pixel_rad)
        shape = cloud_height(self.seed, x, y, footprint)
        edge = _edge(self.seed, self.cover)
        opacity = smoothstep(edge, edge + 0.32, shape)
        towards_sun = np.array(self.sun_direction[:2]) / max(self.sun_direction[2], 0.25) * 0.22
        shade = cloud_height(self.seed, x + np.float32(towards_sun[0]), y + np.float32(towards_sun[1]), footprint, 4)
        lit = np.clip(0.62 + 0.9 * (shape - shade) - 0.5 * np.maximum(shape - edge - 0.35, 0), 0, 1)
        chord = directions - np.array(self.sun_direction, dtype=np.float32)
        near = np.exp(-np.square((chord * chord).sum(axis=-1) / CLEARING_RAD**2))
        opacity = opacity + near * ((1 - self.sun_share) - opacity)
        return np.asarray(opacity, dtype=np.float32), np.asarray(lit, dtype=np.float32)


def cloud_height(seed: int, x: Floats, y: Floats, footprint: Floats, octaves: int = 7) -> Floats:
    """Return how far clouds tower at points x, y (any shape, in heights of the layer), about -1..1."""
    bend = fractal(seed + 1, x * np.float32(0.5), y * np.float32(0.5), footprint, 3)
    size = np.float32(0.75)
    return fractal(seed, x * size + bend * np.float32(0.35), y * size, footprint * size, octaves)


@lru_cache(maxsize=64)
def _edge(seed: int, cover: float) -> float:
    """Return the height over which it is cloud, for a mean opacity (by horizontal illuminance) of about ``cover``."""
    x, y, footprint = _on_layer(cosine_grid(48), math.pi / 96)
    return float(np.quantile(cloud_height(seed, x, y, footprint), 1 - cover)) - 0.16


def _on_layer(directions: Floats, pixel_rad: float) -> tuple[Floats, Floats, Floats]:
    """Return where directions meet the layer, and how large a pixel is there, in heights of the layer."""
    z = np.maximum(directions[..., 2], np.float32(0))
    radius = np.float32(EARTH_IN_CLOUD_HEIGHTS)
    way = np.sqrt(np.square(radius * z) + 2 * radius + 1) - radius * z
    footprint = way * way * np.float32(pixel_rad)
    return directions[..., 0] * way, directions[..., 1] * way, np.asarray(footprint, dtype=np.float32)


@dataclass(frozen=True)
class CloudDrift:
    """Passing clouds: how the light changes during a session, relative to time 0.

    ``amplitude`` is the share of the sun's light that the thickest cloud takes; 0 keeps the light constant. Clouds
    come on average every ``interval_s`` and take 20 to 120 s to pass, with soft edges.
    """

    amplitude: float = 0.0
    interval_s: float = 240.0
    seed: int = 0

    def weights(self, t_s: float) -> tuple[float, float]:
        """Return the factors of the light from the sky and of the sun's at ``t_s``; both are 1 at time 0."""
        if self.amplitude == 0.0:
            return 1.0, 1.0
        shade = self._shade(t_s)
        # A cloud before the sun brightens the rest of the sky a little: it scatters what it takes.
        return 1 + 0.12 * shade, 1 - shade

    def _shade(self, t_s: float) -> float:
        """Return the share of the sun's light that clouds take; none at time 0."""
        first = math.floor(t_s / self.interval_s)
        return 1 - math.prod(1 - self._cloud(slot, t_s) for slot in range(first - 1, first + 2))

    def _cloud(self, slot: int, t_s: float) -> float:
        """Return the shade of the one cloud of a slot of time."""
        start, length_s, edge_s, depth = _passing(self.seed, slot)
        if abs((slot + start) * self.interval_s) < length_s / 2:
            # The sky is drawn with the sun free at time 0: a cloud before it would make it brighter than free later.
            return 0.0
        inside_s = length_s / 2 - abs(t_s - (slot + start) * self.interval_s)
        rise = min(max(inside_s / edge_s, 0.0), 1.0)
        return self.amplitude * depth * rise * rise * (3 - 2 * rise)


@lru_cache(maxsize=256)
def _passing(seed: int, slot: int) -> tuple[float, float, float, float]:
    """Return a slot's cloud: when its middle passes (0..1 of the slot), how long (s), its soft edge (s), its depth."""
    rng = np.random.default_rng([seed, 7302, slot + 2**31])
    return float(rng.uniform(0, 1)), float(rng.uniform(20, 120)), float(rng.uniform(5, 15)), float(rng.uniform(0.3, 1))


Kind: TypeAlias = Literal["clear", "intermediate", "overcast"]

OVERCAST_K = 6400.0  # usual colour temperature of overcast skies
KINDS: dict[Kind, dict[str, Any]] = table_of(__package__, "outdoors")["kinds"]
SHARES = {kind: float(facts["share"]) for kind, facts in KINDS.items()}


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
        """Illuminance (lx as RGB, shape (3,)) on a plane that faces the sun."""
        colour = daylight.sun(self.sun_elevation_rad, self.turbidity)
        return np.asarray(colour * np.float32(self._sun_normal_lx), dtype=np.float32)

    @property
    def _sun_normal_lx(self) -> float:
        if self.kind == "overcast":
            return 0.0
        clear = daylight.normal_illuminance_lx(self.sun_elevation_rad, self.turbidity, self.sun_distance_au)
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
            return daylight.overcast_lx(elevation_rad), 0.0
        direct = self._sun_normal_lx * max(math.sin(elevation_rad), 0.0)
        clear = daylight.clear_diffuse_lx(elevation_rad, self.turbidity, self.sun_distance_au)
        if self.kind == "clear":
            return clear, direct
        cloudy = clear + self.cloud_cover * (daylight.partly_cloudy_diffuse_lx(elevation_rad) - clear)
        whole_clear = sum(replace(self, kind="clear", sun_share=1.0).horizontal_illuminance_lx())
        return min(cloudy, daylight.CLOUD_ENHANCEMENT * whole_clear - direct), direct

    def radiance(self, directions: Floats, pixel_rad: float = 0.0, component: Component | None = None) -> Floats:
        """Return the radiance (cd/m2 as RGB) without the sun's disc, from directions of shape (..., 3) in room axes.

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
        """Return the sky's own radiance, shape (..., 3), with a free horizon; below it, that of the horizon."""
        return self._unscaled(directions, pixel_rad) * np.float32(_scale(self))

    def _unscaled(self, directions: Floats, pixel_rad: float) -> Floats:
        """Return the dome as if the CIE distribution gave the whole diffuse light and clouds came on top."""
        cos_sun = np.asarray(directions @ np.array(self.sun_direction, dtype=np.float32), dtype=np.float32)
        luminance = np.float32(_cie_zenith(self)) * daylight.relative_luminance(
            self.cie_type, directions[..., 2], cos_sun, self.sun_elevation_rad
        )
        if self.kind == "overcast":
            if self.cloud_cover > 0:
                x, y, footprint = _on_layer(directions, pixel_rad)
                bend = fractal(self.seed + 1, x * np.float32(0.4), y * np.float32(0.4), footprint, 2)
                relief = fractal(self.seed, x * np.float32(0.5) + bend, y * np.float32(0.9), footprint, 5)
                luminance = luminance * (1 + np.float32(0.16 * self.cloud_cover) * relief)
            return daylight.daylight(OVERCAST_K) * luminance[..., None]
        air = daylight.clear_sky(luminance)
        # The air has the sun's own colour near the horizon, most below the sun.
        low = np.exp(-np.maximum(directions[..., 2], np.float32(0)) / np.float32(0.16))
        share = np.asarray(low * (0.35 + 0.65 * np.square(np.maximum(cos_sun, 0))), dtype=np.float32)
        warm = share[..., None] * daylight.low_sun(self.sun_elevation_rad)
        air = daylight.at_luminance_1(air + warm * daylight.sun(self.sun_elevation_rad, self.turbidity))
        light = np.asarray(air * luminance[..., None], dtype=np.float32)
        return self._with_clouds(light, directions, cos_sun, pixel_rad) if self.cloud_cover > 0 else light

    def _with_clouds(self, light: Floats, directions: Floats, cos_sun: Floats, pixel_rad: float) -> Floats:
        layer = CloudLayer(self.seed, self.cloud_cover, self.sun_direction, self.sun_share)
        opacity, lit = layer.look(directions, pixel_rad)
        diffuse_lx, _ = self.horizontal_illuminance_lx()
        beam_lx = daylight.normal_illuminance_lx(self.sun_elevation_rad, self.turbidity, self.sun_distance_au)
        forward = 1 + 2.5 * np.exp(8 * (cos_sun - 1)) * (1 - 0.7 * opacity)
        sunlit = daylight.sun(self.sun_elevation_rad, self.turbidity) * np.float32(0.40 * beam_lx / math.pi)
        shaded = daylight.daylight(7500.0) * np.float32(0.75 * diffuse_lx / math.pi)
        cloud = sunlit * (lit * forward)[..., None] + shaded
        return np.asarray(light + opacity[..., None] * (cloud - light), dtype=np.float32)

    def environment(self, rows: int, component: Component | None = None) -> Floats:
        """Return the radiance as an equirectangular map (H, 2 H, 3), each pixel the mean over its area.

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


@lru_cache(maxsize=64)
def _cie_zenith(sky: Sky) -> float:
    """Return the zenith luminance (cd/m2) with which the bare CIE dome gives the diffuse illuminance."""
    grid = outdoors.cosine_grid()
    cos_sun = np.asarray(grid @ np.array(sky.sun_direction, dtype=np.float32), dtype=np.float32)
    relative = daylight.relative_luminance(sky.cie_type, grid[..., 2], cos_sun, sky.sun_elevation_rad)
    return sky.horizontal_illuminance_lx()[0] / (math.pi * float(relative.mean(dtype=np.float64)))


@lru_cache(maxsize=64)
def _scale(sky: Sky) -> float:
    """Return the factor that gives a clouded dome the diffuse illuminance again."""
    if sky.cloud_cover == 0:
        return 1.0
    light = sky._unscaled(outdoors.cosine_grid(), math.pi / 256)  # noqa: SLF001
    luminance = light @ np.array(LUMINANCE_WEIGHTS)
    return sky.horizontal_illuminance_lx()[0] / (math.pi * float(luminance.mean(dtype=np.float64)))


@lru_cache(maxsize=64)
def ambient_of(sky: Sky) -> Ambient:
    """Return the light that the surroundings stand in."""
    return outdoors.ambient(sky.dome, sky.sun_normal_illuminance_rgb, sky.sun_direction, sky.ground_albedo)


def drawn_kind(rng: np.random.Generator) -> Kind:
    """Return a kind of sky, each as often as its share says."""
    return tuple(SHARES)[int(rng.choice(len(SHARES), p=tuple(SHARES.values())))]


def draw_sky(rng: np.random.Generator, moment: Moment, kind: Kind | None = None) -> Sky:
    """Return a sky of the moment; of any kind (45 % clear, 30 % intermediate, 25 % overcast) unless given.

    Raises ValueError when the sun is below the horizon: there is no model of the night.
    """
    drawn = drawn_kind(rng)
    chosen = kind or drawn
    azimuth_rad, elevation_rad = sun_of(moment)
    if elevation_rad <= 0:
        raise ValueError(f"the sun is below the horizon at {moment.utc:%Y-%m-%d %H:%M} UTC: skies are of the day only")
    veil = float(rng.uniform(0.1, 0.7)) if rng.random() < 0.4 else 1.0
    upstairs = bool(rng.random() < 0.35)
    return Sky(
        kind=chosen,
        sun_azimuth_rad=azimuth_rad,
        sun_elevation_rad=elevation_rad,
        cie_type=int(rng.choice(KINDS[chosen]["cie"])),
        turbidity=round(float(rng.uniform(1.8, 2.7)), 2),
        sun_share={"clear": 1.0, "intermediate": round(veil, 2), "overcast": 0.0}[chosen],
        cloud_cover=round(float(rng.uniform(*KINDS[chosen]["cover"])), 2),
        sun_distance_au=round(sun_distance_au(moment), 5),
        eye_height_m=4.9 if upstairs else 2.1,
        seed=int(rng.integers(2**31)),
    )

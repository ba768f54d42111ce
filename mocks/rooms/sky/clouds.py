"""Clouds: as the eye sees them over a room, and as they change the light while it is photographed."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from mocks.rooms.noise import fractal, smoothstep
from mocks.rooms.sky.outdoors import cosine_grid
from mocks.worlds.light import Vector
from processing.ground.arrays import Floats

EARTH_IN_CLOUD_HEIGHTS = 3200.0
CLEARING_RAD = math.radians(3.0)
"""Around the sun the clouds are as thick as the sun's share of light says."""


@dataclass(frozen=True)
class CloudLayer:
    """A layer of broken clouds: how much of the sky it covers, and how much of the sun it lets through."""

    seed: int
    cover: float
    sun_direction: Vector
    sun_share: float

    def look(self, directions: Floats, pixel_rad: float) -> tuple[Floats, Floats]:
        """Return opacity (0..1) and how sunlit the cloud is (0..1) for directions above the horizon."""
        x, y, footprint = _on_layer(directions, pixel_rad)
        shape = cloud_height(self.seed, x, y, footprint)
        edge = _edge(self.seed, self.cover)
        opacity = smoothstep(edge, edge + 0.32, shape)
        towards_sun = np.array(self.sun_direction[:2]) / max(self.sun_direction[2], 0.25) * 0.22
        shade = cloud_height(self.seed, x + np.float32(towards_sun[0]), y + np.float32(towards_sun[1]), footprint, 4)
        lit = np.clip(0.62 + 0.9 * (shape - shade) - 0.5 * np.maximum(shape - edge - 0.35, 0), 0, 1)
        chord = directions - np.array(self.sun_direction, dtype=np.float32)
        near = np.exp(-np.square((chord * chord).sum(axis=-1) / CLEARING_RAD**2))
        return (
            np.asarray(opacity + near * ((1 - self.sun_share) - opacity), dtype=np.float32),
            np.asarray(lit, dtype=np.float32),
        )


def cloud_height(seed: int, x: Floats, y: Floats, footprint: Floats, octaves: int = 7) -> Floats:
    """Return how far clouds tower at points of the layer (in heights of the layer), about -1..1."""
    bend = fractal(seed + 1, x * np.float32(0.5), y * np.float32(0.5), footprint, 3)
    size = np.float32(0.75)
    return fractal(seed, x * size + bend * np.float32(0.35), y * size, footprint * size, octaves)


@lru_cache(maxsize=64)
def _edge(seed: int, cover: float) -> float:
    """Return the height over which it is cloud, for a mean opacity (by horizontal illuminance) of about ``cover``."""
    x, y, footprint = _on_layer(cosine_grid(48), math.pi / 96)
    return float(np.quantile(cloud_height(seed, x, y, footprint), 1 - cover)) - 0.16


def overcast_relief(seed: int, directions: Floats, pixel_rad: float) -> Floats:
    """Return the undulation of a closed cloud deck, around 0, about -1..1."""
    x, y, footprint = _on_layer(directions, pixel_rad)
    bend = fractal(seed + 1, x * np.float32(0.4), y * np.float32(0.4), footprint, 2)
    return fractal(seed, x * np.float32(0.5) + bend, y * np.float32(0.9), footprint, 5)


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
        passed = 1.0
        for slot in range(first - 1, first + 2):
            passed *= 1 - self._cloud(slot, t_s)
        return 1 - passed

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
    return (
        float(rng.uniform(0, 1)),
        float(rng.uniform(20, 120)),
        float(rng.uniform(5, 15)),
        float(rng.uniform(0.3, 1.0)),
    )

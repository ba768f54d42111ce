"""The meter's spot against dense quadrature of the world over the same disc."""

from __future__ import annotations

import math
import tempfile
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np

from mocks.worlds.hdr_world import HdrWorld
from mocks.worlds.light import Site, UniformWorld, Vector, World, direction_of, unit
from mocks.worlds.simple_room import SimpleRoom
from mocks.worlds.world import meter_luminance_cd_m2
from processing.ground.arrays import Floats
from processing.ground.colour import LUMINANCE_WEIGHTS

SPOT_RAD = math.radians(1 / 3)
RINGS, SECTORS = 256, 512
EDGES, DIRECTIONS = 12, 5


@dataclass(frozen=True)
class PaintedWorld(UniformWorld):
    """A uniform world seen through a pattern: direction -> share of the light."""

    pattern: Callable[[Floats], Floats] = lambda directions: np.ones(directions.shape[:-1], dtype=np.float32)

    def radiance(self, site: Site, directions: Floats, pixel_rad: float = 0.0, component: int | None = None) -> Floats:
        """Return the pattern at each direction."""
        light = super().radiance(site, directions, pixel_rad, component)
        return np.asarray(light * self.pattern(directions)[..., None], dtype=np.float32)


def edge(turn_rad: float, offset_rad: float) -> Callable[[Floats], Floats]:
    """Return a pattern near +y: 1 on one side of a line, 0.02 on the other."""

    def pattern(directions: Floats) -> Floats:
        across = math.cos(turn_rad) * directions[..., 0] + math.sin(turn_rad) * directions[..., 2]
        return np.where(across > offset_rad, 1.0, 0.02).astype(np.float32)

    return pattern


def gradient(directions: Floats) -> Floats:
    """Return a light that doubles within the spot."""
    return np.asarray(1.5 + directions[..., 0] / np.float32(SPOT_RAD), dtype=np.float32)


def spot_errors(seed: int) -> dict[str, float]:
    """Return the meter's error in per cent by world: uniform, gradient, edges, an HDR picture, the built-in room.

    Edges have a closed form (a segment of a circle); the others are compared with dense quadrature.
    """
    ahead = (0.0, 1.0, 0.0)
    errors = {
        "uniform": _error(UniformWorld(100.0), ahead),
        "gradient": _error(PaintedWorld(100.0, pattern=gradient), ahead),
    }
    rng = np.random.default_rng([seed, 17])
    for number in range(EDGES):
        turn_rad, offset = float(rng.uniform(0, 2 * math.pi)), float(rng.uniform(-0.7, 0.4))
        world = PaintedWorld(100.0, pattern=edge(turn_rad, offset * SPOT_RAD / 2))
        beyond = (math.acos(offset) - offset * math.sqrt(1 - offset**2)) / math.pi
        wanted = 100 * (beyond + 0.02 * (1 - beyond))
        errors[f"edge {number + 1}"] = 100 * (meter_luminance_cd_m2(world, ahead) / wanted - 1)
    with tempfile.TemporaryDirectory() as folder:
        picture = Path(folder) / "noise.hdr"
        cv2.imwrite(str(picture), rng.lognormal(0, 2, (512, 1024, 3)).astype(np.float32))
        for name, seen in {"picture": HdrWorld(picture, picture), "room": SimpleRoom(seed=seed)}.items():
            for number in range(DIRECTIONS):
                direction = direction_of(float(rng.uniform(-math.pi, math.pi)), float(rng.uniform(-0.7, 0.7)))
                errors[f"{name} {number + 1}"] = _error(seen, direction)
    return errors


def _error(world: World, direction: Vector) -> float:
    return 100 * (meter_luminance_cd_m2(world, direction) / dense_luminance_cd_m2(world, direction) - 1)


def dense_luminance_cd_m2(world: World, direction: Vector) -> float:
    """Return the mean luminance over the spot from 131,072 directions: rings of equal solid angle, equal sectors."""
    centre = np.array(unit(direction))
    side = np.cross(centre, (0.0, 0.0, 1.0) if abs(centre[2]) < 0.9 else (1.0, 0.0, 0.0))
    side /= np.linalg.norm(side)
    other = np.cross(centre, side)
    cosine = 1 - (1 - math.cos(SPOT_RAD / 2)) * (np.arange(RINGS) + 0.5) / RINGS
    angle = (np.arange(SECTORS) + 0.5) * 2 * math.pi / SECTORS
    flat = np.cos(angle)[:, None] * side + np.sin(angle)[:, None] * other
    spot = cosine[:, None, None] * centre + np.sqrt(1 - cosine**2)[:, None, None] * flat
    directions = spot.reshape(-1, 3).astype(np.float32)
    light = sum(
        weight * world.radiance(Site.INDOOR, directions, 0.0, component).astype(np.float64)
        for component, weight in enumerate(world.weights(0.0))
    )
    return float(np.mean(light @ np.array(LUMINANCE_WEIGHTS)))

"""Light as the simulated instruments meet it: what a world must answer, and the small types around it.

World axes: x right, y ahead, z up (metres, right-handed). Directions are unit vectors, float32, shape (..., 3).
Radiance is linear RGB (Rec. 709 primaries) scaled so that ``0.2127 R + 0.7151 G + 0.0722 B`` is cd/m2.
"""

import math
from collections.abc import Iterable
from dataclasses import dataclass, field
from enum import StrEnum
from typing import Protocol, SupportsFloat, TypeAlias

import numpy as np
import numpy.typing as npt

from drivers.errors import DaylitError
from processing.ground import colour
from processing.ground.arrays import Flags, Floats

Vector: TypeAlias = tuple[float, float, float]

LUMINANCE_WEIGHTS = np.array(colour.LUMINANCE_WEIGHTS, dtype=np.float32)
SUN_RADIUS_RAD = math.radians(0.53 / 2)


class WorldFileError(DaylitError, code="SIM-001", exit_code=2):
    """A picture that cannot be a world: wrong format, wrong shape, or values that light cannot have."""


class Site(StrEnum):
    """Where one stands: in the room at camera height, or outside under the open sky."""

    INDOOR = "indoor"
    OUTDOOR = "outdoor"


@dataclass(frozen=True)
class BrightDisc:
    """The sun, or anything like it: a uniform disc too small and too bright to be hit by point samples.

    ``component`` is the one of the world's components that it varies with.
    """

    direction: Vector
    radius_rad: float
    radiance_rgb: Vector
    component: int = 0

    @property
    def solid_angle_sr(self) -> float:
        """Solid angle of the whole disc."""
        return 2.0 * math.pi * (1.0 - math.cos(self.radius_rad))

    def covers(self, directions: Floats) -> Flags:
        """Return which directions, shape (..., 3), fall on the disc.

        The chord is compared, not the cosine: a cosine in float32 is the same for 0.2 and 0.21 degrees.
        """
        chord = directions - np.array(self.direction, dtype=np.float32)
        return np.asarray(np.einsum("...i,...i->...", chord, chord) < (2 * math.sin(self.radius_rad / 2)) ** 2)


class World(Protocol):
    """What the instruments look at.

    The light is a sum of components, each with a brightness of its own over time: a cloud dims the sun and not the
    sky. A world whose light keeps its proportions has one component, and its pictures cost one image.
    """

    @property
    def key(self) -> str:
        """Text that is equal for worlds of equal light and differs otherwise (pictures are cached by it)."""

    @property
    def components(self) -> tuple[str, ...]:
        """Name the parts of the light that vary apart from one another, such as sky, sun and lamps."""

    def weights(self, t_s: float) -> tuple[float, ...]:
        """Return how bright each component is at ``t_s``, relative to time 0."""

    def radiance(self, site: Site, directions: Floats, pixel_rad: float = 0.0, component: int | None = None) -> Floats:
        """Return radiance at time 0 from directions of shape (..., 3), without the bright discs.

        ``pixel_rad`` is the angle that one sample stands for; textures are averaged over it. ``component`` asks for
        one component's share; None for all of it.
        """

    def discs(self, site: Site) -> tuple[BrightDisc, ...]:
        """Return the bright discs above this site (`open_sky` says whether they are hidden)."""

    def open_sky(self, site: Site, directions: Floats) -> Floats:
        """Return the transmittance (0..1) of the way from the site to the sky, for directions of shape (..., 3)."""


def mean_weights(world: World, start_s: float, duration_s: float) -> tuple[float, ...]:
    """Return the weights of the world's components averaged over an exposure (five instants of it)."""
    instants = [world.weights(start_s + duration_s * (i + 0.5) / 5) for i in range(5)]
    return tuple(math.fsum(parts) / 5 for parts in zip(*instants, strict=True))


@dataclass(frozen=True)
class LightDrift:
    """Slow change of daylight, as clouds make it: three sines with seeded phases.

    ``amplitude`` is the largest relative departure; 0 keeps the light constant. The factor at time 0 is 1.
    """

    amplitude: float = 0.0
    period_s: float = 240.0
    seed: int = 0

    def factor(self, t_s: float) -> float:
        """Return the light at ``t_s`` relative to time 0."""
        return 1.0 if self.amplitude == 0.0 else self._raw(t_s) / self._raw(0.0)

    def _raw(self, t_s: float) -> float:
        phases = np.random.default_rng(self.seed).uniform(0, 2 * math.pi, 3)
        parts = [
            weight * math.sin(2 * math.pi * t_s * rate / self.period_s + phase)
            for weight, rate, phase in zip((0.6, 0.3, 0.1), (1.0, 2.3, 5.1), phases, strict=True)
        ]
        return 1.0 + self.amplitude * sum(parts)


class OneLight:
    """Part of a world whose light keeps its proportions: a single component that drifts."""

    drift: LightDrift

    @property
    def components(self) -> tuple[str, ...]:
        """Return the only component."""
        return ("light",)

    def weights(self, t_s: float) -> tuple[float, ...]:
        """Return the drift."""
        return (self.drift.factor(t_s),)

    def discs(self, site: Site) -> tuple[BrightDisc, ...]:
        """Return none: the world is closed, or its light holds the sun."""
        return ()

    def open_sky(self, site: Site, directions: Floats) -> Floats:
        """Return 1 for directions of any shape (..., 3): there is no disc to hide."""
        return np.ones(directions.shape[:-1], dtype=np.float32)


def luminance_cd_m2(radiance: Floats) -> Floats:
    """Return the luminance (cd/m2) of RGB radiance, shape (..., 3)."""
    return np.asarray(radiance @ LUMINANCE_WEIGHTS, dtype=np.float32)


def vector_of(values: Iterable[SupportsFloat]) -> Vector:
    """Return three numbers, such as an array of shape (3,), as a vector of the same unit."""
    x, y, z = (float(v) for v in values)
    return (x, y, z)


def unit(vector: tuple[float, float, float] | npt.NDArray[np.floating]) -> Vector:
    """Return the vector, shape (3,), at length 1."""
    x, y, z = vector_of(vector)
    length = math.sqrt(x * x + y * y + z * z)
    return (x / length, y / length, z / length)


def direction_of(azimuth_rad: float, elevation_rad: float) -> Vector:
    """Return the direction at ``azimuth_rad`` from y (ahead) towards x (right) and an elevation over the horizon."""
    flat = math.cos(elevation_rad)
    return (flat * math.sin(azimuth_rad), flat * math.cos(azimuth_rad), math.sin(elevation_rad))


def spread_over_disc(direction: Vector, radius_rad: float, count: int) -> Floats:
    """Return directions (N, 3) spread evenly over a small round disc, each for the same solid angle."""
    centre = np.array(unit(direction))
    side = np.cross(centre, (0.0, 0.0, 1.0) if abs(centre[2]) < 0.9 else (1.0, 0.0, 0.0))
    side /= np.linalg.norm(side)
    other = np.cross(centre, side)
    radius = radius_rad * np.sqrt((np.arange(count) + 0.5) / count)
    turn = np.arange(count) * math.pi * (3 - math.sqrt(5))
    offset = (np.cos(turn) * np.sin(radius))[:, None] * side + (np.sin(turn) * np.sin(radius))[:, None] * other
    return np.asarray(np.cos(radius)[:, None] * centre + offset, dtype=np.float32)


@dataclass(frozen=True)
class UniformWorld(OneLight):
    """The same light from everywhere, as inside an integrating sphere: the ruler for exposure and response."""

    luminance_cd_m2: float = 100.0
    tint_rgb: Vector = (1.0, 1.0, 1.0)
    drift: LightDrift = field(default_factory=LightDrift)

    @property
    def key(self) -> str:
        """Return the parameters as text."""
        return repr(self)

    def radiance(self, site: Site, directions: Floats, pixel_rad: float = 0.0, component: int | None = None) -> Floats:
        """Return the same radiance for directions of any shape (..., 3); the tint keeps its luminance."""
        tint = np.array(self.tint_rgb, dtype=np.float32)
        colour = tint * (self.luminance_cd_m2 / luminance_cd_m2(tint))
        return np.broadcast_to(colour, directions.shape).astype(np.float32)

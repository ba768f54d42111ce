"""A clear sky with its sun, and the land under it."""

import math
from dataclasses import dataclass

import numpy as np

from mocks.worlds.light import SUN_RADIUS_RAD, BrightDisc, Vector, direction_of, luminance_cd_m2, vector_of
from processing.ground.arrays import Floats


@dataclass(frozen=True)
class SimpleSky:
    """CIE standard clear sky (type 12 of ISO 15469) in plausible colours, over hedges and grass.

    Angles: azimuth from y (ahead) towards x (right). ``sun_luminance_cd_m2`` of 1e9 gives about 67 klx on a
    plane facing the sun.
    """

    sun_azimuth_rad: float = math.radians(48)
    sun_elevation_rad: float = math.radians(44)
    sun_luminance_cd_m2: float = 1.0e9
    zenith_luminance_cd_m2: float = 2500.0
    ground_luminance_cd_m2: float = 1800.0

    @property
    def sun_direction(self) -> Vector:
        """Unit vector to the sun's centre."""
        return direction_of(self.sun_azimuth_rad, self.sun_elevation_rad)

    @property
    def sun(self) -> BrightDisc:
        """The sun's disc."""
        rgb = vector_of(float(v) * self.sun_luminance_cd_m2 for v in _colour((1.05, 1.0, 0.88)))
        return BrightDisc(self.sun_direction, SUN_RADIUS_RAD, rgb)

    @property
    def sun_normal_illuminance_rgb(self) -> Floats:
        """Illuminance (lx as RGB, shape (3,)) on a plane that faces the sun."""
        sun = self.sun
        return np.array(sun.radiance_rgb, dtype=np.float32) * np.float32(sun.solid_angle_sr)

    def radiance(self, directions: Floats) -> Floats:
        """Return sky, hedge and ground radiance for directions, shape (..., 3), without the sun's disc."""
        x, y, z = directions[..., 0], directions[..., 1], directions[..., 2]
        sky = self._sky(directions, np.maximum(z, 0.01))
        ground_gain = self.ground_luminance_cd_m2 * (0.75 + 0.25 * np.clip(-4 * z, 0, 1))
        ground = _colour((0.95, 1.03, 0.70)) * ground_gain[..., None]
        # Hedges reach from the horizon to about 6 degrees; ``skyline`` is their height as the z of a direction.
        azimuth = np.arctan2(x, y)
        wave = 0.5 + 0.3 * np.sin(3 * azimuth + 1.1) + 0.15 * np.sin(11 * azimuth)
        skyline = np.asarray(0.02 + 0.08 * np.clip(wave + 0.05 * np.sin(43 * azimuth), 0, 1), dtype=np.float32)
        hedge = _colour((0.80, 1.10, 0.55)) * (0.28 * self.ground_luminance_cd_m2)
        over_ground = np.where((z < -0.02)[..., None], ground, hedge)
        return np.where((z < skyline)[..., None], over_ground, sky).astype(np.float32)

    def _sky(self, directions: Floats, z: Floats) -> Floats:
        cos_sun = np.clip(directions @ np.array(self.sun_direction, dtype=np.float32), -1, 1)
        zenith_rad = math.pi / 2 - self.sun_elevation_rad
        relative = _gradation(z) * _indicatrix(cos_sun, np.arccos(cos_sun))
        at_zenith = _gradation(np.float32(1)) * _indicatrix(np.float32(math.cos(zenith_rad)), np.float32(zenith_rad))
        luminance = self.zenith_luminance_cd_m2 * relative / at_zenith
        # Blue overhead, white towards the horizon and around the sun.
        whiteness = np.clip((1 - z) ** 4 * 0.8 + np.maximum(cos_sun, 0) ** 24, 0, 1)[..., None]
        tint = _colour((0.62, 0.98, 1.75)) * (1 - whiteness) + _colour((1.0, 1.0, 1.04)) * whiteness
        return np.asarray(tint * luminance[..., None], dtype=np.float32)


def _gradation(cos_zenith: Floats | np.float32) -> Floats:
    return np.asarray(1 - np.exp(-0.32 / cos_zenith), dtype=np.float32)


def _indicatrix(cos_sun: Floats | np.float32, angle_rad: Floats | np.float32) -> Floats:
    peak = 10 * (np.exp(-3 * angle_rad) - math.exp(-3 * math.pi / 2))
    return np.asarray(1 + peak + 0.45 * cos_sun**2, dtype=np.float32)


def _colour(rgb: Vector) -> Floats:
    """Return the colour at luminance 1."""
    colour = np.array(rgb, dtype=np.float32)
    return np.asarray(colour / luminance_cd_m2(colour), dtype=np.float32)

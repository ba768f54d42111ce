"""Lenses of the simulated cameras: pixel to direction and back, pixel sizes, and fall-off towards the edge.

Pixel coordinates are continuous: the first pixel reaches from 0 to 1, its centre is 0.5. World axes: x right,
y ahead, z up. Written for the simulation alone; processing has its own projections, so that each checks the other.
"""

import math
from dataclasses import dataclass
from typing import Protocol, TypeAlias

import cv2
import numpy as np

from mocks.worlds.light import Vector
from processing.ground.arrays import Doubles, Flags, Floats

Size: TypeAlias = tuple[int, int]  # width and height in pixels


class Lens(Protocol):
    """How a camera maps directions to its picture."""

    def directions(self, x: Floats, y: Floats, size: Size) -> tuple[Floats, Flags]:
        """Return unit directions (..., 3) of points ``x``, ``y`` (pixels, broadcast to shape ...), and which see."""

    def pixel_of(self, direction: Vector, size: Size) -> tuple[float, float] | None:
        """Return the picture point of a direction, None where the lens does not see it."""

    def rows_near(self, direction: Vector, angle_rad: float, size: Size) -> range:
        """Return the rows in which anything within ``angle_rad`` of a direction can lie."""

    def solid_angle_sr(self, x: Floats, y: Floats, size: Size) -> Floats:
        """Return the solid angle (broadcast shape, sr) of the pixels around ``x``, ``y``; 0 where nothing is seen."""

    def pixel_rad(self, size: Size) -> float:
        """Return the angle of a pixel at the picture's middle."""

    def falloff(self, x: Floats, y: Floats, size: Size) -> Floats:
        """Return the vignetting (broadcast shape of ``x``, ``y``), 1 in the middle, 0 where nothing is seen."""


@dataclass(frozen=True)
class EquirectangularLens:
    """A stitched panorama of two fisheyes that look along y and -y; the middle column sees ``yaw_rad`` from y.

    ``vignetting``: see `_pupil`; the default is a copy within 1.2 % of a published measurement of a Theta Z1.
    """

    yaw_rad: float = 0.0
    vignetting: tuple[float, ...] = (0.21, 0.9, 0.08)

    def directions(self, x: Floats, y: Floats, size: Size) -> tuple[Floats, Flags]:
        """Return directions (broadcast shape, 3); every point sees."""
        longitude = (np.asarray(x, dtype=np.float64) / size[0] - 0.5) * (2 * math.pi) + self.yaw_rad
        latitude = (0.5 - np.asarray(y, dtype=np.float64) / size[1]) * math.pi
        flat = np.cos(latitude)
        parts = np.broadcast_arrays(flat * np.sin(longitude), flat * np.cos(longitude), np.sin(latitude))
        out = np.stack(parts, axis=-1).astype(np.float32)
        return out, np.ones(out.shape[:-1], dtype=bool)

    def pixel_of(self, direction: Vector, size: Size) -> tuple[float, float] | None:
        """Return column and row of a direction."""
        longitude = math.atan2(direction[0], direction[1]) - self.yaw_rad
        longitude = math.remainder(longitude, 2 * math.pi)
        latitude = math.asin(max(-1.0, min(1.0, direction[2])))
        return ((longitude / (2 * math.pi) + 0.5) * size[0], (0.5 - latitude / math.pi) * size[1])

    def rows_near(self, direction: Vector, angle_rad: float, size: Size) -> range:
        """Return the rows of a band of latitude."""
        latitude = math.asin(max(-1.0, min(1.0, direction[2])))
        first = math.floor((0.5 - (latitude + angle_rad) / math.pi) * size[1])
        last = math.ceil((0.5 - (latitude - angle_rad) / math.pi) * size[1])
        return range(max(first, 0), min(last + 1, size[1]))

    def solid_angle_sr(self, x: Floats, y: Floats, size: Size) -> Floats:
        """Return exact pixel solid angles (broadcast shape, sr); they depend on the row only."""
        height = size[1]
        upper = np.sin((0.5 - (np.asarray(y, np.float64) - 0.5) / height) * math.pi)
        lower = np.sin((0.5 - (np.asarray(y, np.float64) + 0.5) / height) * math.pi)
        area = (upper - lower) * (2 * math.pi / size[0])
        return np.broadcast_to(area, np.broadcast(x, y).shape).astype(np.float32)

    def pixel_rad(self, size: Size) -> float:
        """Return the angle of a row."""
        return math.pi / size[1]

    def falloff(self, x: Floats, y: Floats, size: Size) -> Floats:
        """Return the fall-off (broadcast shape, 0..1) of whichever fisheye sees the point."""
        longitude = (np.asarray(x, np.float32) / size[0] - 0.5) * np.float32(2 * math.pi)
        latitude = (0.5 - np.asarray(y, np.float32) / size[1]) * np.float32(math.pi)
        theta_rad = np.arccos(np.minimum(np.abs(np.cos(latitude) * np.cos(longitude)), np.float32(1)))
        return np.asarray(_pupil(theta_rad, self.vignetting), dtype=np.float32)


@dataclass(frozen=True)
class EquisolidFisheye:
    """A fisheye with image height r = 2 f sin(theta / 2), looking at the zenith.

    ``top_azimuth_rad`` is the azimuth (from y towards x) at the picture's upper edge; seen from below the sky,
    what lies to the right of north on a map lies to the left. ``vignetting``: see `_pupil`; for f/16 none is
    published, so the default continues the trend of a measured lens from f/5.6 to f/11.
    """

    focal_length_mm: float = 8.0
    sensor_width_mm: float = 36.0
    half_field_rad: float = math.pi / 2
    top_azimuth_rad: float = 0.0
    vignetting: tuple[float, ...] = (0.22, 0.85, 0.36)

    def directions(self, x: Floats, y: Floats, size: Size) -> tuple[Floats, Flags]:
        """Return directions (broadcast shape, 3); points outside the image circle see nothing: theirs is the zenith."""
        right, up, r2 = self._plane(x, y, size)
        s2 = r2 / (2 * self._focal_px(size)) ** 2
        seen = s2 <= math.sin(self.half_field_rad / 2) ** 2
        s2 = np.where(seen, s2, 0)
        # sin(theta) = 2 s sqrt(1 - s2) with s = r / 2f, so the flat part is (right, up) / f * sqrt(1 - s2).
        scale = np.where(seen, np.sqrt(1 - s2) / self._focal_px(size), 0)
        right, up = right * scale, up * scale
        cos_top, sin_top = math.cos(self.top_azimuth_rad), math.sin(self.top_azimuth_rad)
        # Up in the picture is (sin, cos); right in the picture, seen from below, is (-cos, sin).
        parts = (up * sin_top - right * cos_top, up * cos_top + right * sin_top, 1 - 2 * s2)
        return np.stack(parts, axis=-1).astype(np.float32), seen

    def pixel_of(self, direction: Vector, size: Size) -> tuple[float, float] | None:
        """Return the picture point, None outside the field."""
        dx, dy, dz = direction
        theta = math.acos(max(-1.0, min(1.0, dz)))
        if theta > self.half_field_rad:
            return None
        r = 2 * self._focal_px(size) * math.sin(theta / 2)
        flat = math.hypot(dx, dy) or 1.0
        cos_top, sin_top = math.cos(self.top_azimuth_rad), math.sin(self.top_azimuth_rad)
        up, right = (dx * sin_top + dy * cos_top) / flat, (dy * sin_top - dx * cos_top) / flat
        return size[0] / 2 + r * right, size[1] / 2 - r * up

    def rows_near(self, direction: Vector, angle_rad: float, size: Size) -> range:
        """Return the rows around the direction's picture; nothing outside the field."""
        theta = math.acos(max(-1.0, min(1.0, direction[2])))
        if theta > self.half_field_rad + angle_rad:
            return range(0)
        flat = math.hypot(direction[0], direction[1]) or 1.0
        cos_top, sin_top = math.cos(self.top_azimuth_rad), math.sin(self.top_azimuth_rad)
        up = (direction[0] * sin_top + direction[1] * cos_top) / flat
        row = size[1] / 2 - 2 * self._focal_px(size) * math.sin(theta / 2) * up
        # Tangentially the picture is stretched by at most sqrt(2) inside a half sphere.
        reach = 1.5 * angle_rad * self._focal_px(size) + 1
        return range(max(math.floor(row - reach), 0), min(math.ceil(row + reach) + 1, size[1]))

    def solid_angle_sr(self, x: Floats, y: Floats, size: Size) -> Floats:
        """Return f-2 (broadcast shape, sr) inside the field: an equisolid pixel covers the same everywhere."""
        _, _, r2 = self._plane(x, y, size)
        limit = (2 * self._focal_px(size) * math.sin(self.half_field_rad / 2)) ** 2
        return np.where(r2 <= limit, self._focal_px(size) ** -2, 0).astype(np.float32)

    def pixel_rad(self, size: Size) -> float:
        """Return the angle of a pixel at the zenith."""
        return 1 / self._focal_px(size)

    def falloff(self, x: Floats, y: Floats, size: Size) -> Floats:
        """Return the fall-off (broadcast shape, 0..1), 0 outside the field."""
        _, _, r2 = self._plane(x, y, size)
        s2 = r2 / (2 * self._focal_px(size)) ** 2
        kept = _pupil(2 * np.arcsin(np.sqrt(np.minimum(s2, 1))), self.vignetting)
        return np.where(s2 <= math.sin(self.half_field_rad / 2) ** 2, kept, 0).astype(np.float32)

    def _focal_px(self, size: Size) -> float:
        return self.focal_length_mm / self.sensor_width_mm * size[0]

    def _plane(self, x: Floats, y: Floats, size: Size) -> tuple[Doubles, Doubles, Doubles]:
        right, up = np.broadcast_arrays(
            np.asarray(x, dtype=np.float64) - size[0] / 2, size[1] / 2 - np.asarray(y, dtype=np.float64)
        )
        return right, up, right * right + up * up


@dataclass(frozen=True)
class TwoFisheyes:
    """What a panorama camera's raw file holds: both lenses' pictures side by side, each with faults of its own.

    A ray at ``theta`` from a lens's axis falls at ``sin(squeeze theta)`` from the centre; circles reach ``circle`` of
    half the height. Lists are of the lens that looks along y and of the one behind. Numbers are chosen as a body's are.
    """

    half_field_rad: float = math.radians(97)
    squeeze: float = 0.42
    circle: float = 0.965
    centres: tuple[tuple[float, float], ...] = ((0.004, -0.006), (-0.005, 0.003))
    """Right and down of each half's middle, in half heights."""
    rolls_rad: tuple[float, ...] = (math.pi / 2 + 0.010, -math.pi / 2 - 0.006)
    tilts_rad: tuple[tuple[float, float], ...] = ((0.010, -0.008), (-0.006, 0.012))
    """Of each axis: to the right and upwards."""
    gains: tuple[float, ...] = (1.01, 0.97)
    edge_loss: float = 0.3
    """Of the light, at a right angle from the axis."""

    def directions(self, number: int, side_px: int) -> tuple[Doubles, Doubles, Flags]:
        """Return what a lens's pixels see: directions (S, S, 3), angles from its axis (S, S), and which see."""
        x, y = np.meshgrid(*2 * ((np.arange(side_px) + 0.5) * 2 / side_px - 1,))
        x, y = x - self.centres[number][0], y - self.centres[number][1]
        sine = np.hypot(x, y) / self.circle * math.sin(self.squeeze * self.half_field_rad)
        theta = np.arcsin(np.minimum(sine, 1)) / self.squeeze
        around = np.arctan2(-y, x) + self.rolls_rad[number]
        yaw, pitch = self.tilts_rad[number][0] + math.pi * number, self.tilts_rad[number][1]
        ahead = np.array((math.sin(yaw) * math.cos(pitch), math.cos(yaw) * math.cos(pitch), math.sin(pitch)))
        right = np.array((math.cos(yaw), -math.sin(yaw), 0.0))
        flat = np.cos(around)[..., None] * right + np.sin(around)[..., None] * np.cross(right, ahead)
        rays = np.cos(theta)[..., None] * ahead + np.sin(theta)[..., None] * flat
        return rays, theta, theta <= self.half_field_rad

    def picture(self, light: Floats, side_px: int) -> Floats:
        """Return both pictures (S, 2 S, 3) of a panorama's light (H, 2 H, 3); black around the circles."""
        height, halves = light.shape[0], []
        for number, gain in enumerate(self.gains):
            rays, theta, seen = self.directions(number, side_px)
            x = (np.arctan2(rays[..., 0], rays[..., 1]) / (2 * math.pi) + 0.5) * light.shape[1] - 0.5
            y = np.clip((0.5 - np.arcsin(np.clip(rays[..., 2], -1, 1)) / math.pi) * height - 0.5, 0, height - 1)
            half = cv2.remap(light, x.astype(np.float32), y.astype(np.float32), cv2.INTER_LINEAR, None, cv2.BORDER_WRAP)
            kept = gain * (1 - self.edge_loss * (np.sin(theta / 2) / math.sin(math.pi / 4)) ** 2.6)
            halves.append(half * (kept * seen)[..., None].astype(np.float32))
        return np.concatenate(halves, axis=1)


def _pupil(theta_rad: Floats | Doubles, vignetting: tuple[float, ...]) -> Floats | Doubles:
    """Return the light kept at angles from the axis; ``vignetting`` (): all of it.

    The pupil turns away by a share of the angle (1st number), and beyond a knee (2nd, rad) the mount cuts it, by a loss
    a squared radian (3rd). It is no polynomial of the image height, as which fall-off is published and fitted."""
    if not vignetting:
        return np.ones_like(theta_rad)
    turn, knee_rad, loss = vignetting
    return np.cos(turn * theta_rad) * (1 - loss * np.maximum(theta_rad - knee_rad, 0) ** 2)

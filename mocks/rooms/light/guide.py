"""What each pixel of the cube around the camera meets: the surfaces that baked light belongs to."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from mocks.rooms.light.cube import Cube
from mocks.rooms.light.geometry import Geometry, Hits
from processing.ground.arrays import Flags, Floats

PLANE_TOLERANCE_M = 0.02
PURE = 0.99
_SAME_NORMAL = 0.9
_FINE = 3


@dataclass(frozen=True)
class Guide:
    """Arrays (6, side, side, ...): what the ray through each pixel's middle meets, and how mixed the pixel is.

    ``part`` is -1 where the ray leaves the room. ``plane_m`` is the distance of the surface's plane from the camera,
    along the normal: it keeps parallel surfaces apart. ``purity`` is the share of the pixel that lies on the surface of
    its middle; ``albedo`` the mean over the pixel, what looks outside counting as black.
    """

    cube: Cube
    part: npt.NDArray[np.int32]
    distance_m: Floats
    normal: Floats
    plane_m: Floats
    purity: Floats
    albedo: Floats

    @classmethod
    def of(cls, geometry: Geometry, eye: Floats, cube: Cube) -> Guide:
        """Cast rays from ``eye``, shape (3,), through the middle and through nine places of every pixel."""
        middle = _Met.by(geometry, eye, cube.directions().reshape(-1, 3))
        shape = (6, cube.side_px, cube.side_px)
        rays = cube.directions(_FINE).reshape(6, cube.side_px, _FINE, cube.side_px, _FINE, 3)
        colours = np.array([p.material.colour for p in geometry.parts] + [(0.0, 0.0, 0.0)], np.float32)
        same = np.zeros(len(middle.part), np.float32)
        albedo = np.zeros((len(middle.part), 3), np.float32)
        for place in range(_FINE**2):
            some = np.ascontiguousarray(rays[:, :, place // _FINE, :, place % _FINE]).reshape(-1, 3)
            met = _Met.by(geometry, eye, some)
            same += met.alike(middle)
            albedo += colours[met.part]
        return cls(
            cube,
            middle.part.reshape(shape),
            middle.distance_m.reshape(shape),
            middle.normal.reshape(*shape, 3),
            middle.plane_m.reshape(shape),
            (same / np.float32(_FINE**2)).reshape(shape),
            (albedo / np.float32(_FINE**2)).reshape(*shape, 3),
        )

    @property
    def pure(self) -> Flags:
        """Return the pixels, shape (6, side, side), that lie on one surface only."""
        return self.purity > PURE


@dataclass(frozen=True)
class _Met:
    part: npt.NDArray[np.int32]
    distance_m: Floats
    normal: Floats
    plane_m: Floats

    @classmethod
    def by(cls, geometry: Geometry, eye: Floats, rays: Floats) -> _Met:
        hits = geometry.cast(eye, rays)
        normal = facing_normals(geometry, hits, rays)
        part = np.where(hits.face >= 0, geometry.part_of[hits.face], -1).astype(np.int32)
        distance = np.where(hits.face >= 0, hits.distance_m, 0).astype(np.float32)
        plane = np.einsum("ij,ij->i", normal, rays) * distance
        return cls(part, distance, normal, plane.astype(np.float32))

    def alike(self, other: _Met) -> Flags:
        close = np.abs(self.plane_m - other.plane_m) < PLANE_TOLERANCE_M
        turned = np.einsum("ij,ij->i", self.normal, other.normal) > _SAME_NORMAL
        outside = self.part < 0
        return np.asarray((self.part == other.part) & (outside | (close & turned)))


def facing_normals(geometry: Geometry, hits: Hits, directions: Floats) -> Floats:
    """Return shading normals (N, 3) turned towards where the rays (N, 3) come from."""
    normal = geometry.shading_normals(hits)
    away = np.einsum("ij,ij->i", normal, directions) > 0
    normal[away] *= -1
    return normal

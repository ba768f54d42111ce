"""Pictures all around a point as the six sides of a cube, and the guide pictures that noise is removed by."""

from dataclasses import dataclass
from typing import Self

import numpy as np

from mocks.rooms.light.geometry import Geometry, Hits
from mocks.worlds.light import Vector
from processing.ground.arrays import Flags, Floats, Int32s

_BORDER_FRAC = 1 / 16

# Forward, right and up of each face.
FACES: tuple[tuple[Vector, Vector, Vector], ...] = (
    ((0, 1, 0), (1, 0, 0), (0, 0, 1)),
    ((1, 0, 0), (0, -1, 0), (0, 0, 1)),
    ((0, -1, 0), (-1, 0, 0), (0, 0, 1)),
    ((-1, 0, 0), (0, 1, 0), (0, 0, 1)),
    ((0, 0, 1), (1, 0, 0), (0, -1, 0)),
    ((0, 0, -1), (1, 0, 0), (0, 1, 0)),
)


@dataclass(frozen=True)
class Cube:
    """Six faces of ``face_px`` pixels a side over exactly 90 degrees, each with a border that looks further."""

    face_px: int

    @property
    def border_px(self) -> int:
        """Pixels of the border on each side."""
        return max(4, round(self.face_px * _BORDER_FRAC))

    @property
    def side_px(self) -> int:
        """Pixels a side with the borders."""
        return self.face_px + 2 * self.border_px

    @property
    def half_width(self) -> float:
        """Tangent of the angle from a face's middle to its outermost edge."""
        return self.side_px / self.face_px

    def directions(self, fine: int = 1) -> Floats:
        """Return unit directions of the pixel centres, shape (6, S, S, 3), or of ``fine`` places a side in each."""
        side = self.side_px * fine
        step = (np.arange(side) + 0.5) / side * 2 - 1
        right, up = step * self.half_width, -step * self.half_width
        out = np.empty((6, side, side, 3), np.float32)
        for index, axes in enumerate(FACES):
            ahead, aside, above = (np.array(axis, dtype=np.float64) for axis in axes)
            rays = ahead + right[None, :, None] * aside + up[:, None, None] * above
            out[index] = rays / np.linalg.norm(rays, axis=-1, keepdims=True)
        return out

    def place(self, directions: Floats) -> tuple[Int32s, Floats, Floats]:
        """Return face, column and row of directions (N, 3); a pixel's centre is at whole numbers.

        Always well inside the face's picture, by the width of its border.
        """
        x, y, z = directions[:, 0], directions[:, 1], directions[:, 2]
        ax, ay, az = np.abs(x), np.abs(y), np.abs(z)
        level = (az <= ax) | (az <= ay)
        along_x = ax > ay
        face = np.where(level, np.where(along_x, np.where(x > 0, 1, 3), np.where(y > 0, 0, 2)), np.where(z > 0, 4, 5))
        depth = np.where(level, np.where(along_x, ax, ay), az)
        aside = np.where(face == 1, -y, np.where(face == 2, -x, np.where(face == 3, y, x)))
        above = np.where(level, z, np.where(face == 4, -y, y))
        scale = np.asarray(np.float32(self.face_px / 2) / depth, dtype=np.float32)
        middle = np.float32((self.side_px - 1) / 2)
        return face.astype(np.int32), aside * scale + middle, middle - above * scale

    def place_in(self, face: int, directions: Floats) -> tuple[Floats, Floats, Floats]:
        """Return column, row and weight of directions (N, 3) on one face, its border included.

        The weights of all faces that see a direction fade into one another across their shared borders; 0 where the
        face does not see it.
        """
        ahead, aside, above = (np.array(axis, dtype=np.float32) for axis in FACES[face])
        depth = directions @ ahead
        seen = depth > 1e-3
        scale = np.where(seen, 1 / np.where(seen, depth, 1), 0)
        right, up = (directions @ aside) * scale, (directions @ above) * scale
        extent = np.maximum(np.abs(right), np.abs(up))
        margin = np.float32(self.half_width - 1)
        weight = np.where(seen, np.clip((1 + margin - extent) / (2 * margin), 0, 1), 0)
        middle = np.float32((self.side_px - 1) / 2)
        column, row = right * np.float32(self.face_px / 2) + middle, middle - up * np.float32(self.face_px / 2)
        return column.astype(np.float32), row.astype(np.float32), weight.astype(np.float32)


PLANE_TOLERANCE_M = 0.02  # chosen: a board's thickness lies in another plane
PURE = 0.99  # chosen: a texel that one surface fills
_SAME_NORMAL = 0.9  # chosen: cosine, 26 degrees
_FINE = 3  # chosen: 9 samples a pixel at edges


@dataclass(frozen=True)
class Guide:
    """Arrays (6, side, side, ...): what the ray through each pixel's middle meets, and how mixed the pixel is.

    ``part`` is -1 where the ray leaves the room. ``plane_m`` is the distance of the surface's plane from the camera,
    along the normal: it parts parallel surfaces. ``purity`` is the share of the pixel that lies on the surface of
    its middle; ``albedo`` the mean over the pixel, what looks outside counting as black.
    """

    cube: Cube
    part: Int32s
    distance_m: Floats
    normal: Floats
    plane_m: Floats
    purity: Floats
    albedo: Floats

    @classmethod
    def of(cls, geometry: Geometry, eye: Floats, cube: Cube) -> Self:
        """Cast rays from ``eye`` (shape (3,), metres) through the middle and through nine places of every pixel."""
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
        """Return the pixels, shape (6, S, S), that lie on one surface only."""
        return self.purity > PURE


@dataclass(frozen=True)
class _Met:
    part: Int32s
    distance_m: Floats
    normal: Floats
    plane_m: Floats

    @classmethod
    def by(cls, geometry: Geometry, eye: Floats, rays: Floats) -> Self:
        hits = geometry.cast(eye, rays)
        normal = facing_normals(geometry, hits, rays)
        part = np.where(hits.face >= 0, geometry.part_of[hits.face], -1).astype(np.int32)
        distance = np.where(hits.face >= 0, hits.distance_m, 0).astype(np.float32)
        plane = np.einsum("ij,ij->i", normal, rays) * distance
        return cls(part, distance, normal, plane.astype(np.float32))

    def alike(self, other: Self) -> Flags:
        close = np.abs(self.plane_m - other.plane_m) < PLANE_TOLERANCE_M
        turned = np.einsum("ij,ij->i", self.normal, other.normal) > _SAME_NORMAL
        outside = self.part < 0
        return np.asarray((self.part == other.part) & (outside | (close & turned)))


def facing_normals(geometry: Geometry, hits: Hits, directions: Floats) -> Floats:
    """Return shading normals (N, 3) turned towards where the rays come from."""
    normal = geometry.shading_normals(hits)
    normal[np.einsum("ij,ij->i", normal, directions) > 0] *= -1
    return normal

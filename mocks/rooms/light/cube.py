"""Six square pictures around a point: what the renderer draws and the view looks up."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from mocks.worlds.light import Vector
from processing.ground.arrays import Floats

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
        """Return unit directions, shape (6, side, side, 3), of pixel centres, or of ``fine`` places a side in each."""
        side = self.side_px * fine
        step = (np.arange(side) + 0.5) / side * 2 - 1
        right, up = step * self.half_width, -step * self.half_width
        out = np.empty((6, side, side, 3), np.float32)
        for index, axes in enumerate(FACES):
            ahead, aside, above = (np.array(axis, dtype=np.float64) for axis in axes)
            rays = ahead + right[None, :, None] * aside + up[:, None, None] * above
            out[index] = rays / np.linalg.norm(rays, axis=-1, keepdims=True)
        return out

    def place(self, directions: Floats) -> tuple[npt.NDArray[np.int32], Floats, Floats]:
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

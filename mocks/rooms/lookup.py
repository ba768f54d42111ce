"""Light from the cube's pixels to any direction: interpolated, but never across the edge of a surface."""

from __future__ import annotations

from processing.ground.arrays import Floats

from dataclasses import dataclass
from functools import cached_property

import cv2
import numpy as np
import numpy.typing as npt

from mocks.rooms.guide import PLANE_TOLERANCE_M, Guide

_REMAP_WIDTH = 8192
_SAME_NORMAL = 0.85


@dataclass(frozen=True)
class Seen:
    """What rays meet: part index, normal (n, 3) and distance of the plane, as in `Guide`."""

    part: npt.NDArray[np.int32]
    normal: Floats
    plane_m: Floats

    def only(self, chosen: npt.NDArray[np.intp]) -> Seen:
        """Return some of them."""
        return Seen(self.part[chosen], self.normal[chosen], self.plane_m[chosen])


class CubeLookup:
    """Interpolates pictures on the cube. One is made for each room and camera position."""

    def __init__(self, guide: Guide) -> None:
        self._guide = guide
        self.side_px = guide.cube.side_px
        self._part = guide.part.reshape(-1)
        self._normal = guide.normal.reshape(-1, 3)
        self._plane = guide.plane_m.reshape(-1)
        self._purity = guide.purity.reshape(-1)

    @cached_property
    def _uniform(self) -> npt.NDArray[np.int32]:
        """Part of each 2 x 2 block (by its upper left pixel) that lies on one smooth surface, else -2."""
        g = self._guide
        same = g.pure.copy()
        for down, right in ((0, 1), (1, 0), (1, 1)):
            other = (slice(None), slice(down, None), slice(right, None))
            mine = (slice(None), slice(None, self.side_px - down), slice(None, self.side_px - right))
            close = np.abs(g.plane_m[other] - g.plane_m[mine]) < PLANE_TOLERANCE_M
            alike = (g.normal[other] * g.normal[mine]).sum(axis=-1) > 0.98
            ok = (g.part[other] == g.part[mine]) & close & alike & g.pure[other]
            padded = np.zeros_like(same)
            padded[mine] = ok
            same &= padded
        return np.where(same, g.part, -2).astype(np.int32).reshape(-1)

    def at(self, directions: Floats, seen: Seen, pictures: list[Floats]) -> list[Floats]:
        """Return each picture (6, side, side, 3) at directions (n, 3), taken from pixels of the same surface."""
        face, column, row = self._guide.cube.place(directions)
        left, top = np.floor(column).astype(np.int32), np.floor(row).astype(np.int32)
        corner = (face * self.side_px + top) * self.side_px + left
        out = [_bilinear(p, column, row + np.float32(self.side_px) * face) for p in pictures]
        hard = np.flatnonzero(self._uniform[corner] != seen.part)
        if hard.size:
            weights, index = self._weights(
                seen.only(hard), corner[hard], column[hard] - left[hard], row[hard] - top[hard]
            )
            for picture, result in zip(pictures, out, strict=True):
                result[hard] = np.einsum("nk,nkc->nc", weights, picture.reshape(-1, 3)[index])
        return out

    def _weights(
        self, seen: Seen, corner: npt.NDArray[np.int32], x: Floats, y: Floats
    ) -> tuple[Floats, npt.NDArray[np.int32]]:
        """Return weights (n, 16) and pixel numbers of the 4 x 4 neighbours: near ones of the same surface."""
        index = np.empty((len(corner), 16), np.int32)
        weights = np.empty((len(corner), 16), np.float32)
        for k in range(16):
            down, right = k // 4 - 1, k % 4 - 1
            pixel = corner + down * self.side_px + right
            index[:, k] = pixel
            near = np.exp(-1.5 * ((x - right) ** 2 + (y - down) ** 2))
            alike = np.einsum("ij,ij->i", self._normal[pixel], seen.normal)
            apart = np.abs(self._plane[pixel] - seen.plane_m)
            match = (self._part[pixel] == seen.part) * np.clip((alike - _SAME_NORMAL) / (1 - _SAME_NORMAL), 0, 1) ** 2
            match = match * self._purity[pixel] ** 8 * (PLANE_TOLERANCE_M / (apart + PLANE_TOLERANCE_M)) ** 2
            # The last terms decide only where no neighbour matches: same part, else alike normals, else anything seen.
            spare = (
                1e-3 * (self._part[pixel] == seen.part) + 1e-4 * np.maximum(alike, 0) + 1e-7 * (self._part[pixel] >= 0)
            )
            weights[:, k] = near * (match + spare) + 1e-12
        weights /= weights.sum(axis=1, keepdims=True)
        return weights, index


def _bilinear(picture: Floats, column: Floats, row: Floats) -> Floats:
    tall = picture.reshape(-1, picture.shape[2], 3)
    rows = max(1, -(-column.size // _REMAP_WIDTH))
    block = np.zeros((2, rows * _REMAP_WIDTH), np.float32)
    block[0, : column.size], block[1, : row.size] = column, row
    x, y = block.reshape(2, rows, _REMAP_WIDTH)
    found = cv2.remap(tall, x, y, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)
    return np.asarray(found.reshape(-1, 3)[: column.size], dtype=np.float32)

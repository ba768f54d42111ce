"""What a plane's texture is divided into: the surface itself, and openings, each filled from its own pixels only."""

from __future__ import annotations

import math
from collections.abc import Iterator

import numpy as np

from processing.ground.arrays import Flags, Floats
from processing.ground.room_model import RoomModel
from processing.removal.smooth import blurred
from processing.sphere import Equirectangular
from processing.surfaces.maps import boundary_rows
from processing.surfaces.planes import FIRST_WALL, Plane

TEXELS = {"draft": 400_000, "standard": 1_600_000, "reference": 4_000_000}
"""Of the largest texture."""
FINER = 1.25
"""Texels to a panorama's pixel where the plane is nearest, so that copying costs no sharpness."""
FRAME_M = 0.08
"""Around an opening: its frame belongs to it."""


def texture_density(plane: Plane, room: RoomModel, geometry: Equirectangular, quality: str) -> float:
    """Return pixels a metre that do justice to the panorama where it sees the plane best, within the limit."""
    px_rad = geometry.height_px / math.pi
    offset = np.array([0.0, 0.0, room.camera_height_m]) - plane.origin_m
    nearest_m = max(abs(float(offset @ plane.normal)), 0.3)
    most = math.sqrt(TEXELS[quality] / max(plane.width_m * plane.height_m, 1e-6))
    return min(FINER * px_rad / nearest_m, most)


def opening_regions(plane: Plane, room: RoomModel, shape: tuple[int, int], px_per_m: float) -> Iterator[Flags]:
    """Yield (h, w) for each opening of a wall: its rectangle with its frame."""
    v, u = ((np.arange(n) + 0.5) / px_per_m for n in shape)
    for opening in room.openings:
        if opening.wall + FIRST_WALL != plane.index:
            continue
        right, left = plane.width_m - opening.start_m + FRAME_M, plane.width_m - opening.end_m - FRAME_M
        top = plane.height_m - opening.head_m - FRAME_M
        low = plane.height_m - opening.sill_m + (FRAME_M if opening.sill_m > 0 else 0.0)
        yield ((v >= top) & (v <= low))[:, None] & ((u >= left) & (u <= right))[None, :]


def too_bright(luminance: Floats, known: Flags, factor: float = 6.0) -> Flags:
    """Return known pixels far brighter than their surface around: lamps, glints; nothing is to be copied from them."""
    if not known.any():
        return np.zeros_like(known)
    wide = max(3.0, 0.08 * max(known.shape))
    share = blurred(known.astype(np.float32), wide)
    level = np.where(known, np.log(np.maximum(luminance, 1e-9)), 0).astype(np.float32)
    local = blurred(level, wide) / np.maximum(share, 1e-4)
    return known & (level > local + math.log(factor))


# Pixels on the edges of floor and ceiling show two planes: filled ones are mixed as a camera would, not in steps.


def soften_edges(out: Floats, target: Flags, room: RoomModel, geometry: Equirectangular) -> None:
    """Mix, in place, the target's pixels of a panorama (H, W, 3) that lie on an edge of floor or ceiling.

    Of the row in which a column's edge lies, the share beyond the edge is what the next row shows. Nothing outside the
    target changes. Edges between walls are upright in the picture, and have no steps.
    """
    before = out.copy()
    for edge in boundary_rows(room, geometry):
        row = np.floor(edge).astype(np.intp)
        columns = np.flatnonzero((row >= 1) & (row < len(out) - 1))
        row = row[columns]
        lower = (row + 1 - edge[columns])[:, None]
        # The pixel's middle tells which side it was drawn for.
        above, below = before[row - 1, columns], before[row + 1, columns]
        mixed = np.where(lower > 0.5, lower * before[row, columns] + (1 - lower) * above, 0)
        mixed = np.where(lower > 0.5, mixed, (1 - lower) * before[row, columns] + lower * below)
        chosen = target[row, columns]
        out[row[chosen], columns[chosen]] = mixed[chosen]

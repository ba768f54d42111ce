"""How well an estimated room meets the true one: the figures of the layout literature."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
import shapely

from processing.ground.room_model import RoomModel

WIDTH, HEIGHT = 1024, 512


@dataclass(frozen=True)
class RoomScore:
    """2D and 3D IoU; corner error in % of the picture's diagonal (1024 x 512); error of the ceiling height in %."""

    iou2d: float
    iou3d: float
    corner_err_pct: float
    height_err_pct: float
    corners: int
    true_corners: int


def score_room(found: RoomModel, true: RoomModel) -> RoomScore:
    """Return the figures of a room; lengths of ``found`` are first scaled to the true camera height."""
    scale = true.camera_height_m / found.camera_height_m
    ours, theirs = shapely.Polygon(np.asarray(found.floor) * scale), shapely.Polygon(true.floor)
    common = float(ours.intersection(theirs).area)
    iou2d = common / (ours.area + theirs.area - common)
    high, true_high = found.ceiling_height_m * scale, true.ceiling_height_m
    volume = common * min(high, true_high)
    iou3d = volume / (ours.area * high + theirs.area * true_high - volume)
    return RoomScore(
        iou2d=float(iou2d),
        iou3d=float(iou3d),
        corner_err_pct=corner_error_pct(found, true),
        height_err_pct=100 * abs(high / true_high - 1),
        corners=len(found.floor),
        true_corners=len(true.floor),
    )


def corner_error_pct(found: RoomModel, true: RoomModel) -> float:
    """Return the mean distance on the picture from each true corner, seen ones only, to the nearest found one.

    In % of the diagonal, floor and ceiling corners alike; and from found to true, the mean of both ways: missed and
    invented corners count by how far away the next one is.
    """
    one, other = _places(found), _places(true)
    gap = one[:, None] - other[None]
    gap[..., 0] = (gap[..., 0] + WIDTH / 2) % WIDTH - WIDTH / 2
    far = np.hypot(gap[..., 0], gap[..., 1])
    both = (far.min(axis=0).mean() + far.min(axis=1).mean()) / 2
    return float(100 * both / math.hypot(WIDTH, HEIGHT))


def _places(room: RoomModel) -> np.ndarray:
    """Return picture places (2 n, 2) of the corners in sight, ceiling and floor."""
    from processing.surfaces.maps import in_sight

    corners = np.asarray(room.floor, dtype=np.float64)
    corners = corners[in_sight(room.floor, corners * (1 - 1e-6))]
    distance = np.hypot(corners[:, 0], corners[:, 1])
    x = (np.arctan2(corners[:, 0], corners[:, 1]) / (2 * math.pi) + 0.5) * WIDTH
    heights = (room.ceiling_height_m - room.camera_height_m, -room.camera_height_m)
    return np.concatenate([np.stack([x, (0.5 - np.arctan2(h, distance) / math.pi) * HEIGHT], axis=-1) for h in heights])

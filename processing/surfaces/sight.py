"""What the camera sees of a room in plan: how far away the nearest wall is in a direction, and which wall it is.

A ray from the camera stays inside the room until its first wall, so that floor and ceiling are seen up to there and
no farther: this alone decides all occlusion in a room of vertical walls, convex or not.
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from processing.errors import RoomError
from processing.ground.arrays import Doubles, Flags, Int16s
from processing.ground.room_model import RoomModel, geometry_problems

TOUCH = 1e-9
"""Relative: a place this much behind a wall lies on it."""


def check_stands(room: RoomModel) -> None:
    """Raise `RoomError` for a room that cannot stand, or whose camera is not in it: nothing could be seen rightly."""
    problems = geometry_problems(room)
    if problems:
        raise RoomError("; ".join(problems[:3]), where="room model", problems=problems)


def wall_ranges(floor: npt.ArrayLike, azimuth_rad: npt.ArrayLike) -> tuple[Doubles, Int16s]:
    """Return the horizontal distance of the nearest wall (m) and its number, for azimuths (N,) from +y towards +x.

    ``floor`` (K, 2), counter-clockwise around the camera at (0, 0). Inf and -1 where no wall is met, which does
    not happen for a camera inside.
    """
    corners = np.asarray(floor, dtype=np.float64)
    azimuth = np.asarray(azimuth_rad, dtype=np.float64)
    rays = np.stack([np.sin(azimuth), np.cos(azimuth)], axis=-1)
    # side > 0: the corner lies to the left of the ray. A wall seen from inside runs from right to left.
    side = rays[:, :1] * corners[:, 1] - rays[:, 1:] * corners[:, 0]
    ahead = np.roll(side, -1, axis=1)
    following = np.roll(corners, -1, axis=0)
    doubled_area = corners[:, 0] * following[:, 1] - corners[:, 1] * following[:, 0]
    met = (side <= 0) & (ahead > 0) & (doubled_area > 0)
    distance = np.where(met, doubled_area / np.where(met, ahead - side, 1.0), np.inf)
    nearest = distance.argmin(axis=1)
    found = np.take_along_axis(distance, nearest[:, None], axis=1)[:, 0]
    return found, np.where(np.isfinite(found), nearest, -1).astype(np.int16)


def in_sight(floor: npt.ArrayLike, points_m: npt.ArrayLike) -> Flags:
    """Return which places, of shape (..., 2), of the plan the camera at (0, 0) sees: no wall stands before them.

    A place on a wall is seen if the wall shows its inner side; a place outside the room is not seen.
    """
    corners = np.asarray(floor, dtype=np.float64)
    points = np.asarray(points_m, dtype=np.float64)
    x, y = points[..., 0], points[..., 1]
    seen = np.ones(points.shape[:-1], dtype=bool)
    for (x0, y0), (x1, y1) in zip(corners, np.roll(corners, -1, axis=0), strict=True):
        doubled_area = x0 * y1 - y0 * x1
        if doubled_area <= 0:
            continue
        side, ahead = x * y0 - y * x0, x * y1 - y * x1
        seen &= ~((side <= 0) & (ahead > 0) & (doubled_area < (ahead - side) * (1 - TOUCH)))
    return seen


def boundary_latitudes(room: RoomModel, azimuth_rad: npt.ArrayLike) -> tuple[Doubles, Doubles]:
    """Return the latitudes (rad) at which the nearest wall meets ceiling and floor, for azimuths (N,)."""
    distance, _ = wall_ranges(room.floor, azimuth_rad)
    up = np.arctan2(room.ceiling_height_m - room.camera_height_m, distance)
    return up, np.arctan2(-room.camera_height_m, distance)

"""A room's planes with their axes: floor, ceiling, then the walls in the room's order."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from processing.ground.arrays import Doubles
from processing.ground.room_model import RoomModel

FLOOR, CEILING, FIRST_WALL = 0, 1, 2
"""Indices of planes; wall i of the room is plane FIRST_WALL + i."""


@dataclass(frozen=True)
class Plane:
    """Floor, ceiling or a wall. A texture's column and row grow along ``u_axis`` and ``v_axis`` from ``origin_m``.

    Walls are seen from inside, upright: u to the right, v down. The floor is seen from above with +y up the texture
    (u = +x, v = -y); the ceiling from below (u = +x, v = +y). World axes as in docs/reference/coordinates.md.
    """

    index: int
    name: str
    """floor, ceiling, wall-0 .. wall-n."""
    origin_m: Doubles
    """(3,)."""
    u_axis: Doubles
    """(3,), unit."""
    v_axis: Doubles
    normal: Doubles
    """(3,), unit, into the room."""
    width_m: float
    height_m: float
    outline_m: Doubles
    """(N, 2): the plane's polygon in (u, v)."""

    def world(self, u_m: npt.ArrayLike, v_m: npt.ArrayLike) -> Doubles:
        """Return world positions (m), of shape (..., 3), of places (u, v) on the plane."""
        u, v = np.asarray(u_m, np.float64)[..., None], np.asarray(v_m, np.float64)[..., None]
        return np.asarray(self.origin_m + u * self.u_axis + v * self.v_axis)

    def coordinates(self, points_m: npt.ArrayLike) -> Doubles:
        """Return the (u, v), of shape (..., 2), of world positions (..., 3), m, dropped onto the plane."""
        offset = np.asarray(points_m, np.float64) - self.origin_m
        return np.stack([offset @ self.u_axis, offset @ self.v_axis], axis=-1)


def planes_of(room: RoomModel) -> tuple[Plane, ...]:
    """Return the planes of a room: index 0 the floor, 1 the ceiling, 2 + i wall i.

    A wall's texture begins at its *second* corner: seen from inside, walls run from right to left, as the floor's
    corners are counter-clockwise. A place that is s metres along wall i from corner i has u = width_m - s.
    """
    corners, top = np.asarray(room.floor, dtype=np.float64), room.ceiling_height_m
    (x0, y0), (x1, y1) = corners.min(axis=0), corners.max(axis=0)
    right, ahead, up = np.eye(3)
    back, down, size = 0.0 - ahead, 0.0 - up, (float(x1 - x0), float(y1 - y0))
    below = np.stack([corners[:, 0] - x0, y1 - corners[:, 1]], axis=-1)
    floor = Plane(FLOOR, "floor", np.array([x0, y1, 0.0]), right, back, up, *size, below)
    ceiling = Plane(CEILING, "ceiling", np.array([x0, y0, top]), right, ahead, down, *size, corners - [x0, y0])
    return (floor, ceiling, *(_wall(corners, wall, top) for wall in range(len(corners))))


def _wall(corners: Doubles, wall: int, ceiling_height_m: float) -> Plane:
    start, end = corners[wall], corners[(wall + 1) % len(corners)]
    length = float(np.hypot(*(end - start)))
    along = (end - start) / length
    return Plane(
        index=FIRST_WALL + wall,
        name=f"wall-{wall}",
        origin_m=np.array([*end, ceiling_height_m]),
        u_axis=np.array([-along[0], -along[1], 0.0]),
        v_axis=np.array([0.0, 0.0, -1.0]),
        normal=np.array([-along[1], along[0], 0.0]),
        width_m=length,
        height_m=ceiling_height_m,
        outline_m=np.array([[0.0, 0.0], [length, 0.0], [length, ceiling_height_m], [0.0, ceiling_height_m]]),
    )

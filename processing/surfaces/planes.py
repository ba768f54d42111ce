"""A room's planes with their axes: floor, ceiling, then the walls in the room's order."""

from __future__ import annotations

from processing.ground.arrays import Doubles

import numpy as np
import numpy.typing as npt

from processing.room.model import RoomModel
from processing.surfaces.plane import CEILING, FIRST_WALL, FLOOR, Plane



def planes_of(room: RoomModel) -> tuple[Plane, ...]:
    """Return the planes of a room: index 0 the floor, 1 the ceiling, 2 + i wall i.

    A wall's texture begins at its *second* corner: seen from inside, walls run from right to left, as the floor's
    corners are counter-clockwise. A place that is s metres along wall i from corner i has u = width_m - s.
    """
    floor = np.asarray(room.floor, dtype=np.float64)
    walls = (_wall(floor, i, room.ceiling_height_m) for i in range(len(floor)))
    return (_floor(floor), _ceiling(floor, room.ceiling_height_m), *walls)


def _floor(corners: Doubles) -> Plane:
    low, high = corners.min(axis=0), corners.max(axis=0)
    return Plane(
        index=FLOOR,
        name="floor",
        origin_m=np.array([low[0], high[1], 0.0]),
        u_axis=np.array([1.0, 0.0, 0.0]),
        v_axis=np.array([0.0, -1.0, 0.0]),
        normal=np.array([0.0, 0.0, 1.0]),
        width_m=float(high[0] - low[0]),
        height_m=float(high[1] - low[1]),
        outline_m=np.stack([corners[:, 0] - low[0], high[1] - corners[:, 1]], axis=-1),
    )


def _ceiling(corners: Doubles, ceiling_height_m: float) -> Plane:
    low, high = corners.min(axis=0), corners.max(axis=0)
    return Plane(
        index=CEILING,
        name="ceiling",
        origin_m=np.array([low[0], low[1], ceiling_height_m]),
        u_axis=np.array([1.0, 0.0, 0.0]),
        v_axis=np.array([0.0, 1.0, 0.0]),
        normal=np.array([0.0, 0.0, -1.0]),
        width_m=float(high[0] - low[0]),
        height_m=float(high[1] - low[1]),
        outline_m=corners - low,
    )


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
        outline_m=np.array(
            [[0.0, 0.0], [length, 0.0], [length, ceiling_height_m], [0.0, ceiling_height_m]], dtype=np.float64
        ),
    )

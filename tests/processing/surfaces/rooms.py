"""Small rooms for the tests of surfaces, and a panorama painted by position."""

from __future__ import annotations

import numpy as np

from processing.ground.room_model import Opening, OpeningKind, RoomModel
from processing.sphere import Equirectangular, directions
from processing.surfaces.maps import surface_maps

BOX = ((-2.0, -1.5), (3.0, -1.5), (3.0, 2.5), (-2.0, 2.5))
ELL = ((-1.0, -1.0), (4.0, -1.0), (4.0, 1.0), (1.0, 1.0), (1.0, 5.0), (-1.0, 5.0))
"""Seen from (0, 0): the arm to the right hides nothing of itself, its end wall and the arm ahead are partly hidden."""


def model(floor, *, camera=1.6, ceiling=2.6, openings=()) -> RoomModel:
    return RoomModel(
        source="given", floor=floor, camera_height_m=camera, ceiling_height_m=ceiling, openings=tuple(openings)
    )


def window(wall: int, start: float, end: float, sill: float = 0.9, head: float = 2.1) -> Opening:
    return Opening(kind=OpeningKind.WINDOW, wall=wall, start_m=start, end_m=end, sill_m=sill, head_m=head)


def points(room: RoomModel, geometry: Equirectangular) -> np.ndarray:
    """World positions (H, W, 3) that the pixels see."""
    rays, _ = directions(geometry)
    return rays * surface_maps(room, geometry).depth_m[..., None] + np.array([0, 0, room.camera_height_m])


def pattern(places: np.ndarray) -> np.ndarray:
    """A smooth picture (..., 3) of positions."""
    x, y, z = np.moveaxis(places, -1, 0)
    return np.stack([1 + 0.5 * np.sin(x + 2 * y), 2 + 0.3 * y + 0.2 * x, 1 + 0.4 * z + 0.1 * x * y], axis=-1).astype(
        np.float32
    )

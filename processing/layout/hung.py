"""What hangs on a room's walls, from what a network saw: pictures, mirrors, radiators, curtains as rectangles."""

from __future__ import annotations

import math

import cv2
import numpy as np

from processing.ground.arrays import Floats
from processing.ground.room_model import OpeningKind, RoomModel
from processing.layout.plan import Hung
from processing.surfaces.maps import FIRST_WALL, in_sight, planes_of

CELL_M = 0.04
"""Of the grid on a wall (chosen: finer than a pixel of the evidence, 0.7 degrees, beyond 3 m)."""
SURE = 0.5
"""Probability from which a place shows a fixture (chosen: more likely than all else)."""
LEAST_M, LEAST_M2 = 0.16, 0.04
"""Side and area of the least that counts (chosen: sockets, switches and frames of doors are none)."""
CORNICE_M = 0.12
"""What lies this near to the ceiling or, as skirting, to the floor is the wall's own."""
BESIDE_M = 0.35
"""A curtain begins at most this far from its window."""


def hung_things(room: RoomModel, fixtures: Floats) -> tuple[Hung, ...]:
    """Return what hangs on the walls, largest first.

    ``fixtures`` (H, 2 H): probability, in an upright panorama from the room's camera, of what stays that is neither
    wall nor opening (`SceneClass.FIXTURE`).
    """
    height, width = fixtures.shape
    found: list[Hung] = []
    for wall, plane in enumerate(planes_of(room)[FIRST_WALL:]):
        columns, rows = (max(1, round(size / CELL_M)) for size in (plane.width_m, plane.height_m))
        u, v = (np.arange(columns) + 0.5) * CELL_M, (np.arange(rows) + 0.5) * CELL_M
        places = plane.world(u[None, :], v[:, None])
        way = places - (0.0, 0.0, room.camera_height_m)
        far = np.linalg.norm(way, axis=-1)
        x = ((np.arctan2(way[..., 0], way[..., 1]) / (2 * np.pi) + 0.5) * width).astype(int) % width
        y = ((0.5 - np.arcsin(way[..., 2] / far) / np.pi) * height).astype(int).clip(0, height - 1)
        there = (fixtures[y, x] > SURE) & in_sight(room.floor, places[..., :2])
        there &= (v[:, None] > CORNICE_M) & (v[:, None] < plane.height_m - CORNICE_M)
        for opening in (o for o in room.openings if o.wall == wall):
            u0, u1 = plane.width_m - opening.end_m, plane.width_m - opening.start_m
            v0, v1 = plane.height_m - opening.head_m, plane.height_m - opening.sill_m
            there &= ~((u > u0) & (u < u1) & (v[:, None] > v0) & (v[:, None] < v1))
        closed = cv2.morphologyEx(there.astype(np.uint8), cv2.MORPH_OPEN, np.ones((3, 3), np.uint8))
        count, _, boxes, _ = cv2.connectedComponentsWithStats(closed, connectivity=4)
        for left, top, wide, high, cells in boxes[1:count].tolist():
            if min(wide, high) * CELL_M < LEAST_M or cells * CELL_M**2 < LEAST_M2:
                continue
            end = plane.width_m - left * CELL_M
            sides = max(0.0, end - wide * CELL_M), end
            levels = plane.height_m - (top + high) * CELL_M, plane.height_m - top * CELL_M
            found.append(Hung(wall, *sides, *levels, _kind(room, wall, sides, levels)))
    return tuple(sorted(found, key=lambda h: -h.width_m * (h.head_m - h.sill_m)))


def _kind(room: RoomModel, wall: int, sides: tuple[float, float], levels: tuple[float, float]) -> str:
    """Return what a rectangle on a wall is, by where it hangs and how tall it is."""
    windows = [o for o in room.openings if o.wall == wall and o.kind is OpeningKind.WINDOW]
    gaps = [max(o.start_m - sides[1], sides[0] - o.end_m) for o in windows]
    if min(gaps, default=math.inf) < BESIDE_M and levels[1] - levels[0] > 1.0:
        return "curtain"
    return "radiator" if levels[0] < 0.4 and levels[1] < 1.1 else "picture"

"""A room drawn on its panorama: which plane and which opening each pixel sees, how far away, and how it is turned."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from processing.ground.arrays import Doubles, Floats, Int16s
from processing.ground.room_model import RoomModel
from processing.sphere import Equirectangular
from processing.surfaces.planes import CEILING, FIRST_WALL, FLOOR, planes_of
from processing.surfaces.sight import boundary_latitudes, check_stands, wall_ranges

ROWS_AT_ONCE = 256
NONE = -1


@dataclass(frozen=True)
class SurfaceMaps:
    """A room as pictures (H, W), of each pixel's middle; the room without anything in it."""

    plane: Int16s
    """0 floor, 1 ceiling, 2 + i wall i."""
    opening: Int16s
    """Index into the room's openings, -1 where there is none; ``plane`` is its wall all the same."""
    depth_m: Floats
    """Distance from the camera along the ray; through an opening, that of its wall."""
    normal: Floats
    """(H, W, 3): unit, into the room."""


@dataclass(frozen=True)
class Columns:
    """What is seen over the azimuth of each column of a panorama."""

    azimuth_rad: Doubles
    range_m: Doubles
    wall: Int16s
    ceiling_rad: Doubles
    floor_rad: Doubles


def columns_of(room: RoomModel, geometry: Equirectangular) -> Columns:
    """Return wall, distance and boundaries of a panorama's columns (at their middles)."""
    azimuth = longitudes(geometry)
    distance, wall = wall_ranges(room.floor, azimuth)
    ceiling, floor = boundary_latitudes(room, azimuth)
    return Columns(azimuth, distance, wall, ceiling, floor)


def longitudes(geometry: Equirectangular) -> Doubles:
    """Return the longitudes (W,) of column middles."""
    turns = (np.arange(geometry.width_px) + 0.5) / geometry.width_px - 0.5
    return np.asarray(turns * (2 * math.pi) + geometry.yaw_rad)


def latitudes(geometry: Equirectangular) -> Doubles:
    """Return the latitudes (H,) of row middles."""
    return np.asarray((0.5 - (np.arange(geometry.height_px) + 0.5) / geometry.height_px) * math.pi)


def plane_map(room: RoomModel, geometry: Equirectangular) -> Int16s:
    """Return `SurfaceMaps.plane`, shape (H, W), alone."""
    check_stands(room)
    return _planes(columns_of(room, geometry), latitudes(geometry))


def boundary_rows(room: RoomModel, geometry: Equirectangular) -> tuple[Doubles, Doubles]:
    """Return where each column's wall meets ceiling and floor, (W,) each, in rows from the picture's upper edge."""
    check_stands(room)
    columns = columns_of(room, geometry)
    ceiling, floor = ((0.5 - edge / math.pi) * geometry.height_px for edge in (columns.ceiling_rad, columns.floor_rad))
    return ceiling, floor


def surface_maps(room: RoomModel, geometry: Equirectangular) -> SurfaceMaps:
    """Return what an upright panorama with the camera at (0, 0, camera height) sees of a room; exact.

    Raises
    ------
    RoomError
        The room cannot stand: `processing.ground.room_model.geometry_problems` says why.
    """
    check_stands(room)
    columns, latitude = columns_of(room, geometry), latitudes(geometry)
    plane = _planes(columns, latitude)
    depth = np.empty(plane.shape, np.float32)
    normal = np.empty((*plane.shape, 3), np.float32)
    normals = np.array([p.normal for p in planes_of(room)], dtype=np.float32)
    for start in range(0, len(latitude), ROWS_AT_ONCE):
        rows = slice(start, start + ROWS_AT_ONCE)
        depth[rows] = _depths(room, columns, latitude[rows], plane[rows])
        normal[rows] = normals[plane[rows]]
    return SurfaceMaps(plane, _openings(room, columns, latitude), depth, normal)


def _planes(columns: Columns, latitude: Doubles) -> Int16s:
    wall = columns.wall + np.int16(FIRST_WALL)
    up, down = latitude[:, None] > columns.ceiling_rad, latitude[:, None] < columns.floor_rad
    return np.where(down, np.int16(FLOOR), np.where(up, np.int16(CEILING), wall))


def _depths(room: RoomModel, columns: Columns, latitude: Doubles, plane: Int16s) -> Doubles:
    sine = np.sin(latitude)
    # The horizon itself meets neither floor nor ceiling.
    safe = np.where(np.abs(sine) > 1e-12, sine, 1.0)
    floor = -room.camera_height_m / safe
    ceiling = (room.ceiling_height_m - room.camera_height_m) / safe
    level = columns.range_m / np.cos(latitude)[:, None]
    return np.where(plane == FLOOR, floor[:, None], np.where(plane == CEILING, ceiling[:, None], level))


def _openings(room: RoomModel, columns: Columns, latitude: Doubles) -> Int16s:
    found = np.full((len(latitude), len(columns.wall)), NONE, np.int16)
    floor = np.asarray(room.floor, dtype=np.float64)
    climb = np.tan(latitude)
    for index, opening in enumerate(room.openings):
        start, end = floor[opening.wall], floor[(opening.wall + 1) % len(floor)]
        along = (end - start) / np.hypot(*(end - start))
        x, y = columns.range_m * np.sin(columns.azimuth_rad), columns.range_m * np.cos(columns.azimuth_rad)
        place = (x - start[0]) * along[0] + (y - start[1]) * along[1]
        within = (columns.wall == opening.wall) & (place >= opening.start_m) & (place <= opening.end_m)
        seen = np.flatnonzero(within)
        height = room.camera_height_m + columns.range_m[seen] * climb[:, None]
        inside = (height >= opening.sill_m) & (height <= opening.head_m)
        # Floor and ceiling are nearer than what the wall's plane would show below and above.
        inside &= (height >= 0) & (height <= room.ceiling_height_m)
        part = found[:, seen]
        part[inside] = index
        found[:, seen] = part
    return found

"""A room's planes, what the camera sees of them in plan, and the room drawn on its panorama.

A ray from the camera stays inside the room until its first wall, so that floor and ceiling are seen up to there and
no farther: this alone decides all occlusion in a room of vertical walls, convex or not.
"""

import math
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from processing.errors import RoomError
from processing.ground.arrays import Doubles, Flags, Floats, Int16s, bands
from processing.ground.room_model import RoomModel, geometry_problems
from processing.ground.seam import row_latitudes
from processing.sphere import Equirectangular

FLOOR, CEILING, FIRST_WALL = 0, 1, 2  # indices of planes; wall i of the room is plane FIRST_WALL + i
TOUCH = 1e-9  # relative: a place this much behind a wall lies on it
ROWS_AT_ONCE = 256  # chosen: bounds the memory of the directions
NONE = -1  # a mark: no plane or opening there


@dataclass(frozen=True)
class Facet:
    """A flat piece of a room. A texture's column and row grow along ``u_axis`` and ``v_axis`` from ``origin_m``."""

    name: str
    """floor, ceiling, wall-0 .. wall-n; of a rendered scene, reveals too."""
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


@dataclass(frozen=True)
class Plane(Facet):
    """Floor, ceiling or a wall.

    Walls are seen from inside, upright: u to the right, v down. The floor is seen from above with +y up the texture
    (u = +x, v = -y); the ceiling from below (u = +x, v = +y). World axes as in docs/reference/coordinates.md.
    """

    index: int

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
    floor = Plane("floor", np.array([x0, y1, 0.0]), right, back, up, *size, below, FLOOR)
    above = np.array([x0, y0, top])
    ceiling = Plane("ceiling", above, right, ahead, down, *size, corners - [x0, y0], CEILING)
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


def plane_map(room: RoomModel, geometry: Equirectangular) -> Int16s:
    """Return `SurfaceMaps.plane`, shape (H, W), alone."""
    check_stands(room)
    return _planes(columns_of(room, geometry), row_latitudes(geometry.height_px))


def opening_map(room: RoomModel, geometry: Equirectangular, behind_m: float = 0, frame_m: float = 0) -> Int16s:
    """Return `SurfaceMaps.opening`, shape (H, W), alone; or of what is ``behind_m`` its wall's face, less a frame."""
    check_stands(room)
    return _openings(room, columns_of(room, geometry), row_latitudes(geometry.height_px), behind_m, frame_m)


def boundary_rows(room: RoomModel, geometry: Equirectangular) -> tuple[Doubles, Doubles]:
    """Return where each column's wall meets ceiling and floor, (W,) each, in rows from the picture's upper edge."""
    check_stands(room)
    columns = columns_of(room, geometry)
    ceiling, floor = ((0.5 - edge / math.pi) * geometry.height_px for edge in (columns.ceiling_rad, columns.floor_rad))
    return ceiling, floor


def surface_maps(room: RoomModel, geometry: Equirectangular) -> SurfaceMaps:
    """Return what an upright panorama with the camera at (0, 0, camera height) sees of a room; exact.

    Raises `RoomError`: the room cannot stand: `processing.ground.room_model.geometry_problems` says why.
    """
    check_stands(room)
    columns, latitude = columns_of(room, geometry), row_latitudes(geometry.height_px)
    plane = _planes(columns, latitude)
    depth = np.empty(plane.shape, np.float32)
    normal = np.empty((*plane.shape, 3), np.float32)
    normals = np.array([p.normal for p in planes_of(room)], dtype=np.float32)
    for rows in bands(len(latitude), ROWS_AT_ONCE):
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


def _openings(room: RoomModel, columns: Columns, latitude: Doubles, behind_m: float = 0, frame_m: float = 0) -> Int16s:
    found = np.full((len(latitude), len(columns.wall)), NONE, np.int16)
    floor = np.asarray(room.floor, dtype=np.float64)
    climb = np.tan(latitude)
    for index, opening in enumerate(room.openings):
        start, end = floor[opening.wall], floor[(opening.wall + 1) % len(floor)]
        along = (end - start) / np.hypot(*(end - start))
        away = float(start[0] * along[1] - start[1] * along[0])  # of the wall from the camera
        reach = columns.range_m * (1 + behind_m / max(away, 1e-9))
        x, y = reach * np.sin(columns.azimuth_rad), reach * np.cos(columns.azimuth_rad)
        place = (x - start[0]) * along[0] + (y - start[1]) * along[1]
        within = (place >= opening.start_m + frame_m) & (place <= opening.end_m - frame_m)
        seen = np.flatnonzero(within & (columns.wall == opening.wall))
        height = room.camera_height_m + reach[seen] * climb[:, None]
        inside = (height >= opening.sill_m + frame_m) & (height <= opening.head_m - frame_m)
        # Floor and ceiling are nearer than what the wall's plane would show below and above.
        height = room.camera_height_m + columns.range_m[seen] * climb[:, None]
        inside &= (height >= 0) & (height <= room.ceiling_height_m)
        part = found[:, seen]
        part[inside] = index
        found[:, seen] = part
    return found

"""Where the sun's light falls in a room: windows projected along the sun's direction onto floor and walls."""

import math

import numpy as np
import numpy.typing as npt

from processing.ground.arrays import Doubles, Flags, Floats, Int16s, Int32s
from processing.ground.room_model import Opening, OpeningKind, RoomModel
from processing.surfaces.maps import planes_of

# How a patch of sun differs from its surface in the shade: by brightness, hardly by colour. Furniture does by both.

LEAST_RATIO = 1.8  # of sunlit to shaded luminance of one surface, below which it is no direct sun
RED_IN_SUN, BLUE_IN_SUN = (-0.25, 1.0), (-2.5, 0.3)
"""Natural logarithms of red and blue over green, against the surface in the shade: a low sun is warmer than the sky."""


def coloured_as_behind(rgb: Floats, plane: Int16s, places: Flags, hidden: Flags) -> Flags:
    """Return those of the ``places`` (H, W) that have the colour of the plane behind, or that in warm sunlight.

    ``rgb`` (H, W, 3) is linear light, ``plane`` (H, W) numbers the room's planes; a plane's colour is that of what
    nothing has ``hidden``.
    """
    sunlike = np.zeros_like(places)
    logs = np.log(np.maximum(rgb, 1e-6))
    red, blue = logs[..., 0] - logs[..., 1], logs[..., 2] - logs[..., 1]
    for index in np.unique(plane[places]):
        known = (plane == index) & ~hidden & (rgb > 0).all(axis=-1)
        here = places & (plane == index)
        if not known.any():
            continue
        redder, bluer = red[here] - np.median(red[known]), blue[here] - np.median(blue[known])
        warm = (redder > RED_IN_SUN[0]) & (redder < RED_IN_SUN[1])
        sunlike[here] = warm & (bluer > BLUE_IN_SUN[0]) & (bluer < BLUE_IN_SUN[1])
    return sunlike


OUTSIDE = -10.0  # signed distance (m) of a place that no window's light can reach
AZIMUTH_SLACK_RAD, ELEVATION_SLACK_RAD = math.radians(6), math.radians(2)
"""By which a given direction may be off: heading (on level ground); clock and levelling."""


def sun_vector(azimuth_rad: float, elevation_rad: float) -> Doubles:
    """Return the unit vector to the sun, of shape (3,); azimuth from +y (ahead) towards +x (right)."""
    level = math.cos(elevation_rad)
    return np.array([level * math.sin(azimuth_rad), level * math.cos(azimuth_rad), math.sin(elevation_rad)])


def glazed(room: RoomModel) -> list[Opening]:
    """Return the openings through which the sun may shine: windows, glass doors among them."""
    return [opening for opening in room.openings if opening.kind is OpeningKind.WINDOW]


def window_depth(room: RoomModel, points_m: npt.ArrayLike, sun: npt.ArrayLike) -> tuple[Floats, Int32s]:
    """Return how far inside a window's beam places lie, and which window it is.

    ``points_m``: of shape (..., 3), on the room's surfaces.
    ``sun`` (3,), unit, towards the sun.

    Returns signed distance (m) in the window's plane from its edge, (...), positive in the beam, `OUTSIDE` where no
    window faces the sun; and the index among `glazed` (-1: none). Other walls that stand in the way are not looked at:
    the beam of a window that another wing of the room hides is none (``wall_between``).
    """
    points = np.asarray(points_m, dtype=np.float64)
    direction = np.asarray(sun, dtype=np.float64)
    best = np.full(points.shape[:-1], OUTSIDE)
    which = np.full(points.shape[:-1], -1, dtype=np.int32)
    walls = planes_of(room)[2:]
    for index, opening in enumerate(glazed(room)):
        wall = walls[opening.wall]
        towards = float(direction @ wall.normal)
        # The sun must stand outside this wall: against its inward normal.
        if towards > -1e-6:
            continue
        away = (points - wall.origin_m) @ wall.normal
        t = -away / towards
        uv = wall.coordinates(points + np.maximum(t, 0.0)[..., None] * direction)
        low, high = wall.width_m - opening.end_m, wall.width_m - opening.start_m
        top, bottom = wall.height_m - opening.head_m, wall.height_m - opening.sill_m
        u, v = uv[..., 0], uv[..., 1]
        inside = np.minimum(np.minimum(u - low, high - u), np.minimum(v - top, bottom - v))
        # Places on the window's own wall are not lit by it.
        inside = np.where(away > 1e-3, inside, OUTSIDE)
        better = inside > best
        best = np.where(better, inside, best)
        which = np.where(better, index, which)
    return np.maximum(best, OUTSIDE).astype(np.float32), which


def wall_between(room: RoomModel, points_m: npt.ArrayLike, sun: npt.ArrayLike) -> Flags:
    """Return which points, of shape (..., 3), another wall hides from the sun: the way leaves the room twice."""
    points = np.asarray(points_m, dtype=np.float64)
    direction = np.asarray(sun, dtype=np.float64)[:2]
    corners = np.asarray(room.floor, dtype=np.float64)
    crossed = np.zeros(points.shape[:-1], dtype=np.int32)
    for start, end in zip(corners, np.roll(corners, -1, axis=0), strict=True):
        edge = end - start
        cross = direction[0] * edge[1] - direction[1] * edge[0]
        if abs(cross) < 1e-12:
            continue
        offset = start - points[..., :2]
        along = (offset[..., 0] * edge[1] - offset[..., 1] * edge[0]) / cross
        place = (offset[..., 0] * direction[1] - offset[..., 1] * direction[0]) / cross
        crossed += ((along > 1e-3) & (place >= 0) & (place < 1)).astype(np.int32)
    return crossed > 1

"""Stand-ins for a room's old furniture: voxels that its mask, its foot on the floor and the line of sight leave it.

Of furniture that is to be removed only an outline is known. Where it stands is where its outline meets the floor; how
high it is, the line of sight over its upper edge says; how deep it is, nobody sees, so that it ends where that line has
come down to the height that furniture usually has. Whatever the camera would see through is then taken away, and so is
what would stand well before the distance that the room network estimates; what is seen there is added.
"""

import math
from typing import NamedTuple

import numpy as np
from scipy import ndimage

from processing.ground.arrays import Doubles, Flags, Floats, Indices, Int32s
from processing.ground.polygons import inside
from processing.ground.room_model import RoomModel
from processing.ground.seam import components, row_latitudes
from processing.light.scene.scene import Material, Part
from processing.sphere import Equirectangular
from processing.surfaces.maps import Columns, columns_of

VOXEL_M = 0.08  # chosen: finer than furniture is deep, and some 50,000 voxels in a room
EDGE_M, UNEVEN = 0.5, 0.25
"""Height of the lower edge of what stands on legs: chairs and tables, whose thin legs masks leave out. A piece counts
as such as far as this share of its columns ends above the floor; beds and cabinets end on it (fitted to six validation
rooms: docs/measurements/emptying.md)."""
SLAB_M = 0.12  # thickness that what floats has at least: table tops with their frame; chosen
LOW_M = 0.6
"""Height at which furniture that the camera looks down on ends: between seats (0.45 m) and tables (0.75 m); chosen."""
DEPTH_M = 0.4  # of what is as high as the camera or higher: shelves and wardrobes have 0.3 to 0.6 m
MOST_DEPTH_M = 2.2  # no piece is deeper: the length of a bed
HUNG_M = 0.1  # depth of what hangs on a wall; chosen
FLOATS = 1.15  # times the distance of the feet around it, from which a column's lower edge is not on the floor; chosen
AROUND_RAD = math.radians(4.0)  # within which those feet are looked for: half a table at 3 m
SURE, SKIN = 0.15, 0.05
"""Of an estimated distance: so much nearer nothing stands, so much farther something does (fitted to two rooms)."""
LEAST_FOOT_M = 0.25  # nearer to the camera stands its own tripod
LEAST_PIXELS = 4  # of a mask's piece; chosen, less is noise
USUAL_ALBEDO = (0.35, 0.35, 0.35)  # before it is measured: the mean of simulated rooms (training seeds)


class _Grid(NamedTuple):
    """Voxels (X, Y, Z) over a room's floor, and where the camera sees them."""

    origin_m: Doubles
    """(3,)."""
    height_m: Doubles
    """(Z,): of the voxels' middles."""
    level_m: Doubles
    """(X, Y): horizontal distance from the camera."""
    column: np.ndarray
    """(X, Y): of the panorama."""
    indoors: Flags
    """(X, Y)."""


class _Outline(NamedTuple):
    """One piece's mask by the panorama's columns (W,)."""

    used: Flags
    top_rad: Doubles
    """Latitude of its upper edge."""
    bottom_rad: Doubles
    foot_m: Doubles
    """Horizontal distance of the floor at its lower edge; inf where that is not before the floor."""


def standins_of(room: RoomModel, furniture: Flags, reach_m: Floats | None = None) -> tuple[Part, ...]:
    """Return a closed mesh for each piece of a furniture mask (H, W) of an upright panorama, in the world, m.

    ``reach_m`` (any height, twice as wide): estimated distance of what is seen. Nothing is made of what stands nearer
    than `LEAST_FOOT_M`: the camera's own tripod.
    """
    geometry = Equirectangular(furniture.shape[1], furniture.shape[0])
    columns, grid = columns_of(room, geometry), _grid_of(room, geometry)
    count, labels = components(furniture)
    solid = np.zeros((*grid.level_m.shape, len(grid.height_m)), bool)
    sizes = np.bincount(labels.ravel(), minlength=count + 1)
    for number, box in enumerate(ndimage.find_objects(labels), 1):
        if sizes[number] >= LEAST_PIXELS:
            outline = _outline_of(labels[box] == number, box, columns, room, geometry)
            stands = np.isfinite(outline.foot_m[outline.used]).any()
            solid |= (_standing if stands else _hung)(outline, columns, grid, room)
    seen = furniture[_rows(grid, room, len(furniture)), grid.column[..., None]]
    seen = seen & (grid.level_m > LEAST_FOOT_M)[..., None]
    if reach_m is not None:
        away = _beyond(reach_m, grid, room, furniture.shape[1])
        solid = (solid & (away > 1 - SURE)) | (seen & grid.indoors[..., None] & (away > 1) & (away < 1 + SKIN))
    return _meshes(solid & seen, grid)


def _grid_of(room: RoomModel, geometry: Equirectangular) -> _Grid:
    floor = np.asarray(room.floor, np.float64)
    low, high = floor.min(axis=0), floor.max(axis=0)
    across, along = (low[k] + VOXEL_M * (np.arange(math.ceil((high[k] - low[k]) / VOXEL_M)) + 0.5) for k in (0, 1))
    x, y = np.meshgrid(across, along, indexing="ij")
    height = VOXEL_M * (np.arange(math.ceil(room.ceiling_height_m / VOXEL_M)) + 0.5)
    turn = np.arctan2(x, y) / (2 * math.pi) + 0.5
    column = np.floor(turn * geometry.width_px).astype(int) % geometry.width_px
    indoors = inside(floor, np.column_stack([x.ravel(), y.ravel()])).reshape(x.shape)
    return _Grid(np.array([*low, 0.0]), np.asarray(height, np.float64), np.hypot(x, y), column, indoors)


def _outline_of(
    piece: Flags, box: tuple[slice, slice], columns: Columns, room: RoomModel, geometry: Equirectangular
) -> _Outline:
    """Return the outline of a piece, (h, w) in its ``box`` of the panorama."""
    (high, across), rows = box, geometry.height_px
    latitude = row_latitudes(rows)
    used = np.zeros(geometry.width_px, bool)
    first, last = np.zeros(geometry.width_px, int), np.full(geometry.width_px, rows - 1)
    used[across], first[across] = piece.any(axis=0), high.start + piece.argmax(axis=0)
    last[across] = high.stop - 1 - piece[::-1].argmax(axis=0)
    # The lower edge of the lowest pixel, not its middle.
    bottom = latitude[last] - math.pi / (2 * rows)
    before_floor = used & (bottom <= columns.floor_rad + math.pi / rows)
    foot = room.camera_height_m / np.tan(np.maximum(-bottom, 1e-3))
    return _Outline(used, latitude[first], bottom, np.where(before_floor, np.minimum(foot, columns.range_m), np.inf))


def _standing(outline: _Outline, columns: Columns, grid: _Grid, room: RoomModel) -> Flags:
    """Return the voxels of what stands on the floor."""
    eye = room.camera_height_m
    reach = 2 * max(1, round(AROUND_RAD / (2 * math.pi) * len(outline.used))) + 1
    around = ndimage.minimum_filter1d(np.where(np.isfinite(outline.foot_m), outline.foot_m, 1e9), reach, mode="wrap")
    floats = outline.used & (outline.foot_m > FLOATS * around)
    edge = EDGE_M * min(float(floats.sum() / outline.used.sum()) / UNEVEN, 1.0)
    near = np.where(floats, around, outline.foot_m)
    near = np.where(near > 1e8, outline.foot_m[np.isfinite(outline.foot_m)].min(), near)
    start = near * (eye - edge) / eye
    slope = np.tan(np.clip(outline.top_rad, -1.5, 1.4))
    front = eye + start * slope
    low = max(LOW_M, edge + SLAB_M)
    room_behind = columns.range_m - start
    looked_down_on = (slope < 0) & (front > low)
    depth = np.where(looked_down_on, np.minimum((low - eye) / np.minimum(slope, -1e-6) - start, MOST_DEPTH_M), DEPTH_M)
    depth = np.maximum(np.minimum(depth, room_behind), VOXEL_M)
    top = np.where(slope >= 0, np.maximum(front, eye + (start + depth) * slope), np.where(front > low, low, front))
    at = grid.column
    own = outline.used & (near > LEAST_FOOT_M)
    foot = grid.indoors & own[at] & (grid.level_m >= start[at] - VOXEL_M / 2)
    foot &= grid.level_m <= (start + depth)[at] + VOXEL_M / 2
    sight = eye + grid.level_m * slope[at]
    limit = np.where(slope[at] >= 0, np.minimum(sight, top[at]), np.maximum(np.minimum(sight, top[at]), VOXEL_M))
    height = grid.height_m
    return np.asarray(foot[..., None] & (height >= edge - SLAB_M) & (height <= limit[..., None]))


def _hung(outline: _Outline, columns: Columns, grid: _Grid, room: RoomModel) -> Flags:
    """Return the voxels of what hangs on a wall, or whose foot is hidden: thin, before the wall."""
    eye, at, wall = room.camera_height_m, grid.column, columns.range_m
    low, high = (eye + wall * np.tan(np.minimum(edge, 1.4)) for edge in (outline.bottom_rad, outline.top_rad))
    thin = grid.indoors & outline.used[at] & (grid.level_m > wall[at] - max(HUNG_M, VOXEL_M))
    height = grid.height_m
    return np.asarray(thin[..., None] & (height >= low[at][..., None]) & (height <= high[at][..., None]))


def _rows(grid: _Grid, room: RoomModel, rows: int) -> Indices:
    """Return the row of a picture of so many in which the camera sees each voxel (X, Y, Z)."""
    latitude = np.arctan2(grid.height_m - room.camera_height_m, np.maximum(grid.level_m, 1e-6)[..., None])
    return np.floor((0.5 - latitude / math.pi) * rows).astype(np.intp).clip(0, rows - 1)


def _beyond(reach_m: Floats, grid: _Grid, room: RoomModel, width_px: int) -> Doubles:
    """Return the distance of each voxel (X, Y, Z) in units of that of what the camera sees there."""
    column = (grid.column * reach_m.shape[1] // width_px)[..., None]
    seen = np.maximum(reach_m[_rows(grid, room, len(reach_m)), column], 1e-3)
    return np.asarray(np.hypot(grid.level_m[..., None], grid.height_m - room.camera_height_m) / seen, np.float64)


def _meshes(solid: Flags, grid: _Grid) -> tuple[Part, ...]:
    """Return the outer faces of voxels (X, Y, Z), a part for each body that hangs together."""
    labels, count = ndimage.label(solid, structure=np.ones((3, 3, 3)))
    corners, body = _faces(solid, labels)
    parts = []
    for number in range(1, count + 1):
        quads: Floats = grid.origin_m + VOXEL_M * corners[body == number]
        # What stands on the floor does not lie in it.
        quads[..., 2] = np.maximum(quads[..., 2], 0.004)
        halves = np.array([[0, 1, 2], [0, 2, 3]])
        faces: Int32s = (4 * np.arange(len(quads))[:, None, None] + halves).reshape(-1, 3).astype(np.int32)
        material = Material(f"old furniture {number}", USUAL_ALBEDO)
        parts.append(Part(material.name, quads.reshape(-1, 3).astype(np.float64), faces, material))
    return tuple(parts)


def _faces(solid: Flags, labels: Int32s) -> tuple[Doubles, Int32s]:
    """Return the corners (F, 4, 3) of the outer faces in voxels, counter-clockwise from outside, and whose they are."""
    padded = np.pad(solid, 1)
    corners, body = [], []
    for axis in range(3):
        one, other = np.eye(3)[(axis + 1) % 3], np.eye(3)[(axis + 2) % 3]
        square = np.stack([0 * one, one, one + other, other])
        for ahead in (1, -1):
            beside = np.roll(padded, -ahead, axis=axis)[1:-1, 1:-1, 1:-1]
            cells = np.argwhere(solid & ~beside)
            face = square + np.eye(3)[axis] if ahead > 0 else square[::-1]
            corners.append(cells[:, None, :] + face)
            body.append(labels[tuple(cells.T)])
    return np.concatenate(corners).astype(np.float64), np.concatenate(body).astype(np.int32)

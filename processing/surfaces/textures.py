"""Rectified textures of a room's planes, from the panorama and back into it."""

import math
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np

from processing.errors import ParameterError
from processing.ground.arrays import Bytes, Doubles, Flags, Floats, Indices, Int16s
from processing.ground.kernels import compiled, inner
from processing.ground.room_model import RoomModel
from processing.sphere import Equirectangular
from processing.surfaces.maps import FIRST_WALL, Plane, check_stands, in_sight, plane_map

MOST_FINE = 8  # samples across a texel or pixel: finer detail is lost to aliasing, which is then below 1 in 64
LEAST_KNOWN = 0.5  # share of a texel's samples that must be known
FRAME_M = 0.08  # around an opening: its frame belongs to it
CLEAR = 1e-3  # weight of masked pixels that spoils a sample


class _Rectified(NamedTuple):
    """A texture as the compiled code fills and reads it."""

    axes: Doubles
    """(4, 3): the plane's origin as seen from the camera (m), unit vectors along its u and v, and its normal."""
    px_per_m: float
    inside: Floats
    """(H, W): 1 for texels that count, else 0."""
    values: Floats
    """(H, W, C)."""


class _Seen(NamedTuple):
    """The panorama's pixels of which a room's plane is wanted."""

    planes: Int16s
    """(H, W): index of the plane that each pixel sees."""
    rows: Indices
    """(N,)."""
    columns: Indices
    """(N,)."""
    yaw_rad: float
    floor: Doubles
    """(K, 2): the room's corners, m."""
    camera_m: float
    ceiling_m: float


@inner
def _fineness(extent_px: float) -> int:
    return min(MOST_FINE, max(1, int(np.ceil(0.8 * extent_px))))


@inner
def _add_sample(picture: Any, marks: Any, masked: Any, x: float, y: float, sums: Any) -> bool:
    """Add panorama and marks at a place in pixels to ``sums``; False where a masked pixel has part in it."""
    height, width, channels = picture.shape
    # Within half a row of a pole, the pole's own row.
    y = min(max(y - 0.5, 0.0), height - 1.0)
    x = x - 0.5
    left, up = int(np.floor(x)), int(y)
    right_part, down_part = x - left, y - up
    down = min(up + 1, height - 1)
    right = (left + 1) % width
    left %= width
    if masked.size > 0:
        hidden = (1 - down_part) * ((1 - right_part) * masked[up, left] + right_part * masked[up, right])
        hidden += down_part * ((1 - right_part) * masked[down, left] + right_part * masked[down, right])
        if hidden > CLEAR:
            return False
    for c in range(channels):
        above = (1 - right_part) * picture[up, left, c] + right_part * picture[up, right, c]
        below = (1 - right_part) * picture[down, left, c] + right_part * picture[down, right, c]
        sums[c] += (1 - down_part) * above + down_part * below
    if marks.size > 0 and marks[up, left] | marks[up, right] | marks[down, left] | marks[down, right]:
        for c in range(sums.shape[0] - channels):
            above = (1 - right_part) * (marks[up, left] >> c & 1) + right_part * (marks[up, right] >> c & 1)
            below = (1 - right_part) * (marks[down, left] >> c & 1) + right_part * (marks[down, right] >> c & 1)
            sums[channels + c] += (1 - down_part) * above + down_part * below
    return True


@compiled
def _unwrapped(
    picture: Any, marks: Any, masked: Any, yaw_rad: float, texture: _Rectified, known: Any, density: Any
) -> None:
    """Fill a texture's values and its ``known`` and ``density`` (H, W), from a panorama (H, W, C) and marks on it."""
    axes, px_per_m, seen, values = texture
    corner, u_axis, v_axis, normal = axes[0], axes[1], axes[2], axes[3]
    texel_m = 1 / px_per_m
    height, width, channels = picture.shape[0], picture.shape[1], values.shape[2]
    row_rad, column_rad = np.pi / height, 2 * np.pi / width
    sums = np.zeros(channels)
    for i in range(values.shape[0]):
        for j in range(values.shape[1]):
            if not seen[i, j]:
                continue
            u, v = (j + 0.5) * texel_m, (i + 0.5) * texel_m
            dx = corner[0] + u * u_axis[0] + v * v_axis[0]
            dy = corner[1] + u * u_axis[1] + v * v_axis[1]
            dz = corner[2] + u * u_axis[2] + v * v_axis[2]
            distance = np.sqrt(dx**2 + dy**2 + dz**2)
            facing = abs(dx * normal[0] + dy * normal[1] + dz * normal[2]) / distance
            flat = max(np.sqrt(dx**2 + dy**2) / distance, np.sin(row_rad / 2))
            density[i, j] = facing * (texel_m / distance) ** 2 / (row_rad * column_rad * flat)
            fine = _fineness(texel_m / distance / row_rad)
            sums[:] = 0.0
            count = 0
            for a in range(fine * fine):
                across = (j + (a % fine + 0.5) / fine) * texel_m
                along = (i + (a // fine + 0.5) / fine) * texel_m
                dx = corner[0] + across * u_axis[0] + along * v_axis[0]
                dy = corner[1] + across * u_axis[1] + along * v_axis[1]
                dz = corner[2] + across * u_axis[2] + along * v_axis[2]
                x = (np.arctan2(dx, dy) - yaw_rad) / column_rad + width / 2
                y = height / 2 - np.arctan2(dz, np.sqrt(dx * dx + dy * dy)) / row_rad
                count += _add_sample(picture, marks, masked, x, y, sums)
            if count >= LEAST_KNOWN * fine * fine:
                known[i, j] = True
                for c in range(channels):
                    values[i, j, c] = sums[c] / count


@inner
def _plane_met(floor: Any, dx: float, dy: float, dz: float, camera_m: float, ceiling_m: float) -> int:
    """Return which plane a ray from the camera meets: 0 floor, 1 ceiling, 2 + i wall i."""
    nearest, wall = np.inf, -1
    n = floor.shape[0]
    for i in range(n):
        x0, y0 = floor[i, 0], floor[i, 1]
        x1, y1 = floor[(i + 1) % n, 0], floor[(i + 1) % n, 1]
        side, ahead, area = dx * y0 - dy * x0, dx * y1 - dy * x1, x0 * y1 - y0 * x1
        if side <= 0 < ahead and area > 0 and area < nearest * (ahead - side):
            nearest, wall = area / (ahead - side), i
    height = camera_m + nearest * dz
    if height < 0:
        return 0
    return 1 if height > ceiling_m else 2 + wall


@inner
def _add_texel(texture: Any, inside: Any, x: float, y: float, sums: Any) -> None:
    """Add a texture's value at a place in texels, from texels that count where there are any."""
    height, width, channels = texture.shape
    x = min(max(x - 0.5, 0.0), width - 1.0)
    y = min(max(y - 0.5, 0.0), height - 1.0)
    left, up = int(x), int(y)
    right, down = min(left + 1, width - 1), min(up + 1, height - 1)
    right_part, down_part = x - left, y - up
    a = (1 - right_part) * (1 - down_part)
    b, c, d = right_part * (1 - down_part), (1 - right_part) * down_part, right_part * down_part
    ia, ib, ic, id_ = a * inside[up, left], b * inside[up, right], c * inside[down, left], d * inside[down, right]
    total = ia + ib + ic + id_
    if total > 1e-6:
        a, b, c, d = ia / total, ib / total, ic / total, id_ / total
    for k in range(channels):
        sums[k] += a * texture[up, left, k] + b * texture[up, right, k]
        sums[k] += c * texture[down, left, k] + d * texture[down, right, k]


@inner
def _alone(planes: Any, row: int, column: int) -> bool:
    """Return whether a pixel's neighbours all see its plane."""
    height, width = planes.shape
    for i in (-1, 0, 1):
        for j in (-1, 0, 1):
            if planes[min(max(row + i, 0), height - 1), (column + j) % width] != planes[row, column]:
                return False
    return True


@compiled
def _wrapped(texture: _Rectified, index: int, seen: _Seen, out: Any) -> None:
    """Fill ``out`` (N, C) for pixels that see plane ``index``, each averaged over the part of it that sees the plane.

    The plane is met at most once by a ray: u and v of the place are dot products with the plane's axes."""
    axes, px_per_m, inside, values = texture
    planes, rows, columns, yaw_rad, floor, camera_m, ceiling_m = seen
    corner, u_axis, v_axis, normal = axes[0], axes[1], axes[2], axes[3]
    height, width = planes.shape
    row_rad, column_rad = np.pi / height, 2 * np.pi / width
    sums = np.zeros(values.shape[2])
    middles, right = np.pi / 2 - (np.arange(height) + 0.5) * row_rad, np.arange(width) + 0.5 - width / 2
    right = right * column_rad + yaw_rad
    sines, cosines, tangents = np.sin(middles), np.cos(middles), np.tan(middles)
    rights, aheads = np.sin(right), np.cos(right)
    distance = corner[0] * normal[0] + corner[1] * normal[1] + corner[2] * normal[2]
    for p in range(rows.shape[0]):
        whole = _alone(planes, rows[p], columns[p])
        i, j = rows[p], columns[p]
        facing = cosines[i] * (rights[j] * normal[0] + aheads[j] * normal[1])
        facing = max(abs(facing + sines[i] * normal[2]), 1e-6)
        fine = _fineness(abs(distance) / facing**2 * row_rad * px_per_m)
        sums[:] = 0.0
        count = 0
        for a in range(fine * fine):
            dx, dy, dz = rights[j], aheads[j], tangents[i]
            if fine > 1:
                lat = np.pi / 2 - (i + (a // fine + 0.5) / fine) * row_rad
                lon = (j + (a % fine + 0.5) / fine - width / 2) * column_rad + yaw_rad
                dx, dy, dz = np.sin(lon), np.cos(lon), np.tan(lat)
            if not whole and _plane_met(floor, dx, dy, dz, camera_m, ceiling_m) != index:
                continue
            towards = dx * normal[0] + dy * normal[1] + dz * normal[2]
            scale = distance / towards
            ox, oy, oz = dx * scale - corner[0], dy * scale - corner[1], dz * scale - corner[2]
            u = (ox * u_axis[0] + oy * u_axis[1] + oz * u_axis[2]) * px_per_m
            v = (ox * v_axis[0] + oy * v_axis[1] + oz * v_axis[2]) * px_per_m
            _add_texel(values, inside, u, v, sums)
            count += 1
        for c in range(values.shape[2]):
            out[p, c] = sums[c] / max(count, 1)


MOST_TEXELS = 64_000_000  # chosen: three quarters of a GB of RGB float32


@dataclass(frozen=True)
class Texture:
    """A plane's picture, rectified; column j, row i show the plane at u = (j + 0.5) / px_per_m, v likewise."""

    plane: Plane
    px_per_m: float
    values: Floats
    """(H, W) or (H, W, C), as the picture; 0 where unknown."""
    known: Flags
    """(H, W): inside the plane's outline, seen from the camera, not masked."""
    density: Floats
    """(H, W): panorama pixels to a texel (of their areas); 0 where the camera does not see the plane."""


def texture_shape(plane: Plane, px_per_m: float) -> tuple[int, int]:
    """Return rows and columns of a plane's texture: at least one texel each way, the last ones may stand over."""
    if not (math.isfinite(px_per_m) and px_per_m > 0):
        raise ParameterError(f"a texture of {px_per_m} pixels a metre", advice="give a number above 0")
    height, width = (max(1, math.ceil(side * px_per_m - 1e-9)) for side in (plane.height_m, plane.width_m))
    if height * width > MOST_TEXELS:
        raise ParameterError(f"a texture of {width} x {height} pixels", advice=f"at most {MOST_TEXELS} in all")
    return height, width


def texel_places(plane: Plane, px_per_m: float) -> Doubles:
    """Return world positions (H, W, 3) of the texels' middles."""
    height, width = texture_shape(plane, px_per_m)
    u, v = (np.arange(width) + 0.5) / px_per_m, (np.arange(height) + 0.5) / px_per_m
    return plane.world(u[None, :], v[:, None])


def outline_mask(plane: Plane, px_per_m: float) -> Flags:
    """Return which texels' middles (H, W) lie inside the plane's outline."""
    import shapely

    height, width = texture_shape(plane, px_per_m)
    u, v = (np.arange(width) + 0.5) / px_per_m, (np.arange(height) + 0.5) / px_per_m
    outline = shapely.Polygon(plane.outline_m)
    shapely.prepare(outline)
    return np.asarray(shapely.contains_xy(outline, *np.meshgrid(u, v)))


def unwrap(
    picture: Floats,
    geometry: Equirectangular,
    room: RoomModel,
    plane: Plane,
    px_per_m: float,
    *,
    mask: Flags | None = None,
    marks: tuple[Bytes, int] | None = None,
) -> Texture:
    """Return a plane as the panorama shows it, rectified.

    ``picture`` (H, W) or (H, W, C) float32 of the geometry's size, upright, finite.
    ``mask`` (H, W): what hides the plane (furniture, tripod); no texel takes anything from these pixels.
    ``marks`` (H, W): bits that are further channels of the texture, 0 or 1 in the picture, and how many.

    Texels coarser than the panorama's pixels are means of up to 64 samples; finer ones are linear between pixels.
    Raises `ParameterError`: sizes that do not fit; `RoomError`: the room cannot stand."""
    light = _checked(picture, geometry)
    check_stands(room)
    hidden = np.zeros((0, 0), np.uint8) if mask is None else _checked_mask(mask, geometry).view(np.uint8)
    bits, count = (np.zeros((0, 0), np.uint8), 0) if marks is None else marks
    shape = texture_shape(plane, px_per_m)
    seen = _seen(room, plane, px_per_m).astype(np.float32)
    values = np.zeros((*shape, light.shape[2] + count), np.float32)
    known, density = np.zeros(shape, bool), np.zeros(shape, np.float32)
    rectified = _Rectified(_axes(room, plane), px_per_m, seen, values)
    _unwrapped(light, bits, hidden, geometry.yaw_rad, rectified, known, density)
    return Texture(plane, px_per_m, values[..., 0] if picture.ndim == 2 else values, known, density)


def wrap(
    values: Floats,
    texture: Texture,
    room: RoomModel,
    geometry: Equirectangular,
    where: Flags,
    planes: Int16s | None = None,
) -> tuple[Floats, Flags]:
    """Return what those pixels of ``where`` (H, W) show that see a plane, (n,) or (n, C), and which they are (H, W).

    ``values`` (h, w) or (h, w, C) are of the ``texture``'s plane, laid out as its own. Those returned are in the order
    of ``picture[mask]``: each pixel is the mean over the part of it that sees the plane, from texels that the camera
    sees; values must be right there, and nowhere else. ``planes`` (H, W): `plane_map`, if known.

    Raises `ParameterError`: values that do not have the texture's size; a mask of another size; `RoomError`: the room
    cannot stand."""
    plane, shape = texture.plane, texture.density.shape
    if values.ndim not in (2, 3) or values.shape[:2] != shape:
        raise ParameterError(f"values of shape {values.shape} for {plane.name}", advice=f"give {shape}")
    planes = plane_map(room, geometry) if planes is None else planes
    mask = _checked_mask(where, geometry) & (planes == plane.index)
    rows, columns = np.nonzero(mask)
    laid = np.ascontiguousarray(values.reshape(*shape, -1), dtype=np.float32)
    out, known = np.zeros((len(rows), laid.shape[2]), np.float32), (texture.density > 0).astype(np.float32)
    floor = np.asarray(room.floor, dtype=np.float64)
    seen = _Seen(planes, rows, columns, geometry.yaw_rad, floor, room.camera_height_m, room.ceiling_height_m)
    _wrapped(_Rectified(_axes(room, plane), float(texture.px_per_m), known, laid), plane.index, seen, out)
    return (out[:, 0] if values.ndim == 2 else out), mask


def _axes(room: RoomModel, plane: Plane) -> Doubles:
    """Return (4, 3): the plane's origin as seen from the camera, its axes and its normal."""
    corner = plane.origin_m - np.array([0.0, 0.0, room.camera_height_m])
    return np.stack([corner, plane.u_axis, plane.v_axis, plane.normal])


def _seen(room: RoomModel, plane: Plane, px_per_m: float) -> Flags:
    height, width = texture_shape(plane, px_per_m)
    if plane.index < FIRST_WALL:
        return in_sight(room.floor, texel_places(plane, px_per_m)[..., :2]) & outline_mask(plane, px_per_m)
    if plane.origin_m @ plane.normal >= 0:
        return np.zeros((height, width), bool)
    u = (np.arange(width) + 0.5) / px_per_m
    columns = in_sight(room.floor, plane.world(u, 0.0)[:, :2]) & (u < plane.width_m)
    return columns & ((np.arange(height)[:, None] + 0.5) / px_per_m < plane.height_m)


def _checked(picture: Floats, geometry: Equirectangular) -> Floats:
    if picture.ndim not in (2, 3) or picture.shape[:2] != (geometry.height_px, geometry.width_px):
        raise ParameterError(f"a picture of shape {picture.shape} for {geometry}", advice="give (H, W) or (H, W, C)")
    if not all(np.isfinite(row).all() for row in picture):  # row by row: little memory
        raise ParameterError("a picture with NaN or Inf", advice="set such pixels to 0 and mask them")
    return np.ascontiguousarray(picture.reshape(*picture.shape[:2], -1), dtype=np.float32)


def _checked_mask(mask: Flags, geometry: Equirectangular) -> Flags:
    if mask.shape != (geometry.height_px, geometry.width_px) or mask.dtype != np.bool_:
        raise ParameterError(f"a mask {mask.shape} of {mask.dtype}", advice="give booleans of the picture's size")
    return mask


def opening_regions(plane: Plane, room: RoomModel, shape: tuple[int, int], px_per_m: float) -> Iterator[Flags]:
    """Yield (H, W) for each opening of a wall: its rectangle with its frame; of one without a sill, to the last row."""
    v, u = ((np.arange(n) + 0.5) / px_per_m for n in shape)
    for opening in room.openings:
        if opening.wall + FIRST_WALL != plane.index:
            continue
        right, left = plane.width_m - opening.start_m + FRAME_M, plane.width_m - opening.end_m - FRAME_M
        top = plane.height_m - opening.head_m - FRAME_M
        low = plane.height_m - opening.sill_m + FRAME_M if opening.sill_m > 0 else math.inf
        yield ((v >= top) & (v <= low))[:, None] & ((u >= left) & (u <= right))[None, :]

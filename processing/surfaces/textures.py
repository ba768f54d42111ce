"""Rectified textures of a room's planes, from the panorama and back into it."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from processing.errors import ParameterError
from processing.ground.arrays import Flags, Floats
from processing.ground.room_model import RoomModel
from processing.sphere import Equirectangular
from processing.surfaces.maps import plane_map
from processing.surfaces.planes import FIRST_WALL, Plane
from processing.surfaces.sight import check_stands, in_sight
from processing.surfaces.texture_kernels import unwrapped, wrapped

MOST_TEXELS = 64_000_000


@dataclass(frozen=True)
class Texture:
    """A plane's picture, rectified; column j, row i show the plane at u = (j + 0.5) / px_per_m, v likewise."""

    plane: Plane
    px_per_m: float
    values: Floats
    """(h, w) or (h, w, C), as the picture; 0 where unknown."""
    known: Flags
    """(h, w): inside the plane's outline, seen from the camera, not masked."""
    density: Floats
    """(h, w): panorama pixels to a texel (of their areas); 0 where the camera does not see the plane."""


def texture_shape(plane: Plane, px_per_m: float) -> tuple[int, int]:
    """Return rows and columns of a plane's texture: at least one texel each way, the last ones may stand over."""
    if not (math.isfinite(px_per_m) and px_per_m > 0):
        raise ParameterError(f"a texture of {px_per_m} pixels a metre", advice="give a number above 0")
    height, width = (
        max(1, math.ceil(plane.height_m * px_per_m - 1e-9)),
        max(1, math.ceil(plane.width_m * px_per_m - 1e-9)),
    )
    if height * width > MOST_TEXELS:
        raise ParameterError(f"a texture of {width} x {height} pixels", advice=f"at most {MOST_TEXELS} in all")
    return height, width


def texel_places(plane: Plane, px_per_m: float) -> npt.NDArray[np.float64]:
    """Return world positions (h, w, 3) of the texels' middles."""
    height, width = texture_shape(plane, px_per_m)
    u, v = (np.arange(width) + 0.5) / px_per_m, (np.arange(height) + 0.5) / px_per_m
    return plane.world(u[None, :], v[:, None])


def outline_mask(plane: Plane, px_per_m: float) -> Flags:
    """Return which texels' middles (h, w) lie inside the plane's outline."""
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
) -> Texture:
    """Return a plane as the panorama shows it, rectified.

    Parameters
    ----------
    picture
        (H, W) or (H, W, C) float32 of the geometry's size, upright, finite.
    mask
        (H, W): what hides the plane (furniture, tripod); no texel takes anything from these pixels.

    Texels coarser than the panorama's pixels are means of up to 64 samples; finer ones are linear between pixels.

    Raises
    ------
    ParameterError
        Sizes that do not fit.
    RoomError
        The room cannot stand.
    """
    light = _checked(picture, geometry)
    check_stands(room)
    hidden = np.zeros((0, 0), np.float32) if mask is None else _checked_mask(mask, geometry).astype(np.float32)
    shape = texture_shape(plane, px_per_m)
    seen = _seen(room, plane, px_per_m)
    values = np.zeros((*shape, light.shape[2]), np.float32)
    known, density = np.zeros(shape, bool), np.zeros(shape, np.float32)
    unwrapped(
        light, hidden, _axes(room, plane), 1 / px_per_m, geometry.yaw_rad, seen, values, known, density
    )  # fmt: skip
    return Texture(plane, px_per_m, values[..., 0] if picture.ndim == 2 else values, known, density)


def wrap(
    texture_values: Floats, plane: Plane, px_per_m: float, room: RoomModel, geometry: Equirectangular, where: Flags
) -> tuple[Floats, Flags]:
    """Return what those pixels of ``where`` (H, W) show that see a plane, (n,) or (n, C), and which they are (H, W).

    Values are in the order of ``picture[mask]``. Each pixel is the mean over the part of it that sees the plane, from
    texels inside the plane's outline; texels must be right there, and nowhere else.

    Raises
    ------
    ParameterError
        A texture that does not have the plane's size at this density; a mask of another size.
    RoomError
        The room cannot stand.
    """
    shape = texture_shape(plane, px_per_m)
    if texture_values.ndim not in (2, 3) or texture_values.shape[:2] != shape:
        raise ParameterError(f"a texture of shape {texture_values.shape} for {plane.name}", advice=f"give {shape}")
    planes = plane_map(room, geometry)
    mask = _checked_mask(where, geometry) & (planes == plane.index)
    rows, columns = np.nonzero(mask)
    texture = np.ascontiguousarray(texture_values.reshape(*shape, -1), dtype=np.float32)
    values = np.zeros((len(rows), texture.shape[2]), np.float32)
    wrapped(
        texture, outline_mask(plane, px_per_m).astype(np.float32), planes, plane.index, rows, columns,
        _axes(room, plane), float(px_per_m), geometry.yaw_rad, np.asarray(room.floor, dtype=np.float64),
        room.camera_height_m, room.ceiling_height_m, values,
    )  # fmt: skip
    return (values[:, 0] if texture_values.ndim == 2 else values), mask


def _axes(room: RoomModel, plane: Plane) -> npt.NDArray[np.float64]:
    """Return (4, 3): the plane's origin as seen from the camera, its axes and its normal."""
    corner = plane.origin_m - np.array([0.0, 0.0, room.camera_height_m])
    return np.stack([corner, plane.u_axis, plane.v_axis, plane.normal])


def _seen(room: RoomModel, plane: Plane, px_per_m: float) -> Flags:
    height, width = texture_shape(plane, px_per_m)
    if plane.index < FIRST_WALL:
        places = texel_places(plane, px_per_m)[..., :2]
        return in_sight(room.floor, places) & outline_mask(plane, px_per_m)
    if plane.origin_m @ plane.normal >= 0:
        return np.zeros((height, width), bool)
    u = (np.arange(width) + 0.5) / px_per_m
    columns = in_sight(room.floor, plane.world(u, 0.0)[:, :2]) & (u < plane.width_m)
    return columns & ((np.arange(height)[:, None] + 0.5) / px_per_m < plane.height_m)


def _checked(picture: Floats, geometry: Equirectangular) -> Floats:
    if picture.ndim not in (2, 3) or picture.shape[:2] != (geometry.height_px, geometry.width_px):
        raise ParameterError(
            f"a picture of shape {picture.shape} for {geometry}", advice="give (H, W) or (H, W, C) of its size"
        )
    if not np.isfinite(picture).all():
        raise ParameterError("a picture with NaN or Inf", advice="set such pixels to 0 and mask them")
    return np.ascontiguousarray(picture.reshape(*picture.shape[:2], -1), dtype=np.float32)


def _checked_mask(mask: Flags, geometry: Equirectangular) -> Flags:
    if mask.shape != (geometry.height_px, geometry.width_px) or mask.dtype != np.bool_:
        raise ParameterError(
            f"a mask of shape {mask.shape} and type {mask.dtype}", advice="give booleans of the picture's size"
        )
    return mask

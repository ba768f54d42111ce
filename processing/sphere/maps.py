"""Pixels to directions and back, in float64, for every geometry; exact at poles and seam.

Directions are (..., 3) unit vectors in the world's axes; those handed in may have any length above 0.
"""

import math

import numpy as np
import numpy.typing as npt

from processing.errors import ParameterError
from processing.ground.arrays import Doubles, Flags
from processing.sphere.geometry import Equirectangular, Fisheye, Geometry, Perspective, polar_of_radius, radius_of_polar

EDGE_TOLERANCE = 1e-9  # relative: a point computed to lie on the field's edge is inside it
NEAREST_DEPTH = 1e-9  # cosine to a view's axis below which a direction has no place in its plane


def directions(geometry: Geometry, rows: slice | None = None) -> tuple[Doubles, Flags]:
    """Return the directions of pixel centres (h, w, 3) and which pixels see anything (h, w); ``rows`` takes a band.

    Outside a fisheye's circle the direction is that of the nearest point of its edge. H and W are the picture's (H, W),
    or the band's rows.
    """
    y = np.arange(geometry.height_px)[rows or slice(None)] + 0.5
    return point_directions(geometry, np.arange(geometry.width_px) + 0.5, y[:, None])


def point_directions(geometry: Geometry, x: npt.ArrayLike, y: npt.ArrayLike) -> tuple[Doubles, Flags]:
    """Return unit directions (..., 3) of picture points (pixels, broadcast), and which points see anything.

    Points beside the picture are legal: they continue its plane (an equirectangular picture goes round; beyond its
    poles it comes down on the other side). ``x`` and ``y`` have any shapes that broadcast; pixels.
    """
    px, py = np.asarray(x, dtype=np.float64), np.asarray(y, dtype=np.float64)
    if not (np.isfinite(px).all() and np.isfinite(py).all()):
        raise ParameterError("picture coordinates that are not finite", likely="a division by 0 before")
    if isinstance(geometry, Equirectangular):
        return _equirectangular_directions(geometry, px, py)
    if isinstance(geometry, Perspective):
        return _perspective_directions(geometry, px, py)
    return _fisheye_directions(geometry, px, py)


def pixels(geometry: Geometry, directions: npt.ArrayLike) -> tuple[Doubles, Doubles, Flags]:
    """Return columns and rows of directions (..., 3) of any length, and which of them the picture shows.

    Never NaN: what a fisheye does not show falls on the edge of its circle, what a view does not show beside it where
    the view's plane continues, and at (-1, -1) behind it. Columns of an equirectangular picture are in [0, width). All
    results have the shape (...), float64 pixels.
    """
    d = np.asarray(directions, dtype=np.float64)
    if d.shape[-1:] != (3,) or not np.isfinite(d).all():
        raise ParameterError("directions must be finite and of shape (..., 3)", likely="NaN from an earlier step")
    x, y, placed = places(geometry, d)
    return (x, y, placed) if isinstance(geometry, Equirectangular) else (x, y, placed & _inside(geometry, x, y))


def places(geometry: Geometry, directions: Doubles) -> tuple[Doubles, Doubles, Flags]:
    """Return what `pixels` does, but with which directions have a place in the picture's plane, in its frame or not.

    ``directions``: float64 of shape (..., 3).
    """
    if isinstance(geometry, Equirectangular):
        return _equirectangular_pixels(geometry, directions)
    if isinstance(geometry, Perspective):
        return _perspective_pixels(geometry, directions)
    return _fisheye_pixels(geometry, directions)


def view_axes(view: Perspective) -> Doubles:
    """Return the rows right, up, ahead of a view (3, 3). Of shape (3, 3), unit rows."""
    sin_yaw, cos_yaw = math.sin(view.yaw_rad), math.cos(view.yaw_rad)
    sin_pitch, cos_pitch = math.sin(view.pitch_rad), math.cos(view.pitch_rad)
    ahead = np.array([sin_yaw * cos_pitch, cos_yaw * cos_pitch, sin_pitch])
    right = np.array([cos_yaw, -sin_yaw, 0.0])
    up = np.array([-sin_yaw * sin_pitch, -cos_yaw * sin_pitch, cos_pitch])
    # Rolled clockwise as seen from behind the camera: its up leans to the right.
    sin_roll, cos_roll = math.sin(view.roll_rad), math.cos(view.roll_rad)
    return np.stack([right * cos_roll - up * sin_roll, up * cos_roll + right * sin_roll, ahead])


def _equirectangular_directions(geometry: Equirectangular, x: Doubles, y: Doubles) -> tuple[Doubles, Flags]:
    longitude = (x / geometry.width_px - 0.5) * (2 * math.pi) + geometry.yaw_rad
    latitude = (0.5 - y / geometry.height_px) * math.pi
    flat = np.cos(latitude)
    out = _stacked(flat * np.sin(longitude), flat * np.cos(longitude), np.sin(latitude))
    return out, np.ones(out.shape[:-1], dtype=bool)


def _equirectangular_pixels(geometry: Equirectangular, d: Doubles) -> tuple[Doubles, Doubles, Flags]:
    turns = (np.arctan2(d[..., 0], d[..., 1]) - geometry.yaw_rad) / (2 * math.pi) + 0.5
    x = (turns - np.floor(turns)) * geometry.width_px
    # A turn just below 1 may round to the full width, which is column 0.
    x = np.where(x >= geometry.width_px, 0.0, x)
    latitude = np.arctan2(d[..., 2], np.hypot(d[..., 0], d[..., 1]))
    return x, (0.5 - latitude / math.pi) * geometry.height_px, np.ones(d.shape[:-1], dtype=bool)


def _perspective_directions(view: Perspective, x: Doubles, y: Doubles) -> tuple[Doubles, Flags]:
    right, up = np.broadcast_arrays(x - view.width_px / 2, view.height_px / 2 - y)
    ahead = view.focal_px
    axes = view_axes(view) / np.sqrt(right**2 + up**2 + ahead**2)[..., None, None]
    out = right[..., None] * axes[..., 0, :] + up[..., None] * axes[..., 1, :] + ahead * axes[..., 2, :]
    return out, _inside(view, x, y)


def _perspective_pixels(view: Perspective, d: Doubles) -> tuple[Doubles, Doubles, Flags]:
    seen_from = d @ view_axes(view).T
    depth = seen_from[..., 2]
    front = depth > NEAREST_DEPTH * np.sqrt((seen_from**2).sum(axis=-1))
    scale = view.focal_px / np.where(front, depth, 1.0)
    x = np.where(front, view.width_px / 2 + seen_from[..., 0] * scale, -1.0)
    y = np.where(front, view.height_px / 2 - seen_from[..., 1] * scale, -1.0)
    return x, y, front


def _fisheye_directions(lens: Fisheye, x: Doubles, y: Doubles) -> tuple[Doubles, Flags]:
    column, row = lens.axis_px
    right, up = np.broadcast_arrays((x - column) / lens.radius_px, (row - y) / lens.radius_px)
    radius = np.hypot(right, up)
    seen = radius <= 1 + EDGE_TOLERANCE
    sine, cosine = polar_of_radius(lens, np.minimum(radius, 1.0))
    # On the axis itself any azimuth is right; its sine is 0.
    scale = sine / np.where(radius > 0, radius, 1.0)
    right, up = right * scale, up * scale
    sin_top, cos_top = math.sin(lens.top_azimuth_rad), math.cos(lens.top_azimuth_rad)
    # Up in the picture is (sin, cos); right in the picture, seen from below, is (-cos, sin).
    out = _stacked(up * sin_top - right * cos_top, up * cos_top + right * sin_top, cosine)
    return out, seen & _inside(lens, x, y)


def _fisheye_pixels(lens: Fisheye, d: Doubles) -> tuple[Doubles, Doubles, Flags]:
    flat = np.hypot(d[..., 0], d[..., 1])
    radius, seen = radius_of_polar(lens, flat, d[..., 2])
    scale = lens.radius_px * radius / np.where(flat > 0, flat, 1.0)
    sin_top, cos_top = math.sin(lens.top_azimuth_rad), math.cos(lens.top_azimuth_rad)
    up = (d[..., 0] * sin_top + d[..., 1] * cos_top) * scale
    right = (d[..., 1] * sin_top - d[..., 0] * cos_top) * scale
    x, y = lens.axis_px[0] + right, lens.axis_px[1] - up
    return x, y, seen


def _inside(geometry: Perspective | Fisheye, x: Doubles, y: Doubles) -> Flags:
    slack_x, slack_y = EDGE_TOLERANCE * geometry.width_px, EDGE_TOLERANCE * geometry.height_px
    across = (x >= -slack_x) & (x <= geometry.width_px + slack_x)
    return np.asarray(across & (y >= -slack_y) & (y <= geometry.height_px + slack_y))


def _stacked(*parts: Doubles) -> Doubles:
    return np.stack(np.broadcast_arrays(*parts), axis=-1)

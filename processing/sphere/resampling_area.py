"""Resampling that keeps energy: every source pixel's radiance times solid angle is handed on, whole, by exact overlaps.

One picture is the net: its cells become quadrilaterals in the plane of the other, which is never equirectangular, so
that neither pole nor seam lies in it (between two equirectangular pictures overlaps are products of intervals).
A target pixel's value is the mean of the source over its cell, weighted by solid angle: it cannot ring, is never
negative, a constant stays that constant, and sums of radiance times solid angle are kept.
"""

from __future__ import annotations

import math
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace

import numpy as np
from scipy.sparse import csr_array

from processing.ground.arrays import Doubles, Floats, Int8s
from processing.sphere import Equirectangular, Fisheye, Geometry, Perspective, point_directions, solid_angles
from processing.sphere.area import fisheye_areas
from processing.sphere.maps import places
from processing.sphere.overlap import CLEAR, CUT, HIDDEN, Net, gather, scatter

CELL_RAD = 0.01
"""Cells of the net are divided until they are smaller: their straight sides then miss the true ones by 1.3e-5 rad."""
CORNERS_AT_ONCE = 1 << 19  # for memory
THREADS = 2  # chosen


def area_resample(picture: Floats, source: Geometry, target: Geometry, weights: Floats) -> tuple[Floats, Floats]:
    """Return the target picture (h, w, C) and the share of each of its cells that valid source pixels cover (h, w).

    ``picture``: (H, W, C) radiance, >= 0; ``weights``: (H, W), 0..1.
    """
    if isinstance(source, Equirectangular) and isinstance(target, Equirectangular):
        return _by_intervals(picture, source, target, weights)
    if _target_is_plane(source, target):
        light, weight = _scattered(picture, source, target, weights)
        return _finished(light, weight, solid_angles(target))
    return _gathered(picture, source, target, weights)


def _target_is_plane(source: Geometry, target: Geometry) -> bool:
    """Choose the plane: never the equirectangular picture, rather a fisheye than a view, else the source."""
    if isinstance(source, Equirectangular):
        return True
    return isinstance(target, Fisheye) and not isinstance(source, Fisheye)


def _finished(light: Doubles, weight: Doubles, solid: Doubles) -> tuple[Floats, Floats]:
    # What rounding leaves at a cell's corner is no cover; nor are the slivers of target cells beyond a fisheye's field,
    # whose corners all fall onto the field's edge.
    covered = (solid > 0) & (weight > 1e-9 * solid)
    values = np.where(covered[..., None], light / np.where(covered, weight, 1.0)[..., None], 0.0)
    share = np.where(covered, np.minimum(weight / np.where(solid > 0, solid, 1.0), 1.0), 0.0)
    return values.astype(np.float32), share.astype(np.float32)


def _scattered(picture: Floats, source: Geometry, target: Geometry, weights: Floats) -> tuple[Doubles, Doubles]:
    light = np.zeros((target.height_px, target.width_px, picture.shape[2]))
    weight = np.zeros(light.shape[:2])
    net, parts = _net(source)
    density, solid = _density(target), solid_angles(net)
    band = _band(net, parts)
    for start in range(0, source.height_px, band):
        stop = min(start + band, source.height_px)
        corners = Net(*_corners(net, target, start * parts, stop * parts), parts)
        cells = solid[start * parts : stop * parts]
        scatter(corners, picture[start:stop], cells, weights[start:stop], density, light, weight)
    return light, weight


def _gathered(picture: Floats, source: Geometry, target: Geometry, weights: Floats) -> tuple[Floats, Floats]:
    out = np.zeros((target.height_px, target.width_px, picture.shape[2]), dtype=np.float32)
    share = np.zeros(out.shape[:2], dtype=np.float32)
    net, parts = _net(target)
    density, solid = _density(source), solid_angles(target)
    band = _band(net, parts)

    def work(start: int) -> None:
        stop = min(start + band, target.height_px)
        corners = Net(*_corners(net, source, start * parts, stop * parts), parts)
        light, weight = np.zeros((stop - start, *out.shape[1:])), np.zeros((stop - start, out.shape[1]))
        gather(corners, picture, density, weights, light, weight)
        out[start:stop], share[start:stop] = _finished(light, weight, solid[start:stop])

    with ThreadPoolExecutor(THREADS) as pool:
        list(pool.map(work, range(0, target.height_px, band)))
    return out, share


def _band(net: Geometry, parts: int) -> int:
    return max(1, CORNERS_AT_ONCE // (net.width_px * parts))


def _net(geometry: Geometry) -> tuple[Geometry, int]:
    """Return a geometry whose pixels divide the given one's into parts x parts small cells."""
    if isinstance(geometry, Equirectangular):
        widest = max(2 * math.pi / geometry.width_px, math.pi / geometry.height_px)
    elif isinstance(geometry, Perspective):
        widest = 1 / geometry.focal_px
    else:
        widest = geometry.half_field_rad / geometry.radius_px
    parts = max(1, math.ceil(widest / CELL_RAD))
    finer = replace(geometry, width_px=geometry.width_px * parts, height_px=geometry.height_px * parts)
    if isinstance(finer, Fisheye) and isinstance(geometry, Fisheye):
        column, row = geometry.axis_px
        finer = replace(finer, radius_px=geometry.radius_px * parts, centre_px=(column * parts, row * parts))
    return finer, parts


def _corners(net: Geometry, plane: Geometry, start: int, stop: int) -> tuple[Doubles, Doubles, Int8s]:
    """Return the places in the plane of the corners of the net's rows start..stop, (stop - start + 1, w + 1)."""
    d, _ = point_directions(net, np.arange(net.width_px + 1), np.arange(start, stop + 1)[:, None])
    x, y, placed = places(plane, d)
    beside = CUT if isinstance(plane, Fisheye) else HIDDEN
    return x, y, np.where(placed, CLEAR, beside).astype(np.int8)


def _density(plane: Geometry) -> Doubles:
    """Return the solid angle of a square pixel of picture in each of the plane's cells (H, W)."""
    solid = solid_angles(plane)
    if not isinstance(plane, Fisheye):
        return solid
    inside = fisheye_areas(plane)
    return np.where(inside > 1e-9, solid / np.maximum(inside, 1e-9), 0.0)


def _by_intervals(
    picture: Floats, source: Equirectangular, target: Equirectangular, weights: Floats
) -> tuple[Floats, Floats]:
    down = _overlaps(_caps(target.height_px), _caps(source.height_px))
    shift = (target.yaw_rad - source.yaw_rad) / (2 * math.pi) % 1.0
    twice = _overlaps(
        np.arange(target.width_px + 1) / target.width_px + shift, np.arange(2 * source.width_px + 1) / source.width_px
    )
    across = twice[:, : source.width_px] + twice[:, source.width_px :]
    light = np.empty((target.height_px, target.width_px, picture.shape[2]))
    for channel in range(picture.shape[2]):
        light[..., channel] = (across @ (down @ (picture[..., channel] * weights.astype(np.float64))).T).T
    weight = (across @ (down @ weights.astype(np.float64)).T).T
    cells = np.diff(_caps(target.height_px))[:, None] / target.width_px
    return _finished(light, weight, np.broadcast_to(cells, weight.shape))


def _caps(rows: int) -> Doubles:
    """Return 1 - sin(latitude) at the edges of rows (rows + 1,): a band's solid angle over 2 pi is the difference."""
    return np.asarray(2 * np.sin(np.arange(rows + 1) / rows * (math.pi / 2)) ** 2)


def _overlaps(target: Doubles, source: Doubles) -> csr_array:
    """Return the lengths that intervals between ascending edges have in common, (targets, sources)."""
    edges = np.union1d(target, source)
    middle, length = (edges[1:] + edges[:-1]) / 2, np.diff(edges)
    row, column = np.searchsorted(target, middle) - 1, np.searchsorted(source, middle) - 1
    shape = (len(target) - 1, len(source) - 1)
    ok = (row >= 0) & (row < shape[0]) & (column >= 0) & (column < shape[1])
    return csr_array((length[ok], (row[ok], column[ok])), shape=shape)

"""Resampling that keeps energy: every source pixel's radiance times solid angle is handed on, whole, by exact overlaps.

One picture is the net: its cells become quadrilaterals in the plane of the other, which is never equirectangular, so
that neither pole nor seam lies in it (between two equirectangular pictures overlaps are products of intervals).
A target pixel's value is the mean of the source over its cell, weighted by solid angle: it cannot ring, is never
negative, a constant stays that constant, and sums of radiance times solid angle are kept.
"""

import math

import numpy as np
from scipy.sparse import csr_array

from processing.ground.arrays import Doubles, Flags, Floats, Int8s, bands
from processing.ground.threads import side_by_side
from processing.sphere import Equirectangular, Fisheye, Geometry, Perspective, point_directions, solid_angles
from processing.sphere.area import fisheye_areas
from processing.sphere.geometry import FIELD_TOLERANCE_RAD, LensMapping, in_pixels, polar_of_radius, radius_of_polar
from processing.sphere.maps import places
from processing.sphere.overlap import CLEAR, CUT, HIDDEN, Net, finish, gather, interval_means, scatter, turned_corners

CELL_RAD = 0.01
"""Cells of the net are divided until they are smaller: their straight sides then miss the true ones by 1.3e-5 rad."""
CORNERS_AT_ONCE, LEAST_BANDS = 1 << 19, 8  # for memory; for threads
RADII = 1 << 15  # steps of the table between two fisheyes' radii: its lines miss the curve by less than 2e-7 pixels


def area_resample(
    picture: Floats, source: Geometry, target: Geometry, weights: Floats, near: Flags | None = None
) -> tuple[Floats, Floats]:
    """Return the target picture (h, w, C) and the share of each of its cells that valid source pixels cover (h, w).

    ``picture``: (H, W, C) radiance, >= 0; ``weights``: (H, W), 0..1; ``near`` (H, W): where cells need exact overlaps,
    None: everywhere. Elsewhere, where weights must be 1, a box stands for a cell of a fisheye or view.
    """
    if isinstance(source, Equirectangular) and isinstance(target, Equirectangular):
        return _by_intervals(picture, source, target, weights)
    # The plane is never the equirectangular picture, rather a fisheye than a view, else the source.
    if isinstance(source, Equirectangular) or (isinstance(target, Fisheye) and not isinstance(source, Fisheye)):
        light, weight = _scattered(picture, source, target, weights)
        return _finished(light, weight, solid_angles(target))
    return _gathered(picture, source, target, weights, np.ones(weights.shape, bool) if near is None else near)


def _finished(light: Doubles, weight: Doubles, solid: Doubles) -> tuple[Floats, Floats]:
    values, share = np.empty(light.shape, np.float32), np.empty(weight.shape, np.float32)
    finish(light, weight, solid, values, share)
    return values, share


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


def _gathered(
    picture: Floats, source: Geometry, target: Geometry, weights: Floats, near: Flags
) -> tuple[Floats, Floats]:
    net, parts = _net(target)
    density, solid = _density(source), solid_angles(target)
    out = np.zeros((*solid.shape, picture.shape[2]), dtype=np.float32)
    share = np.zeros(solid.shape, dtype=np.float32)
    band, plane = min(_band(net, parts), -(-target.height_px // LEAST_BANDS)), (picture, density, weights)
    # Marks and the like may be 0 wherever nothing is near.
    live = max((c + 1 for c in range(picture.shape[2]) if np.any(picture[..., c], where=~near)), default=0)

    def work(start: int) -> None:
        stop = min(start + band, target.height_px)
        corners = Net(*_corners(net, source, start * parts, stop * parts), parts)
        light, weight = np.zeros((stop - start, *out.shape[1:])), np.zeros((stop - start, out.shape[1]))
        gather(corners, plane, near, live, solid[start:stop], light, weight)
        out[start:stop], share[start:stop] = _finished(light, weight, solid[start:stop])

    side_by_side(work, range(0, target.height_px, band))
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
    return in_pixels(geometry, geometry.width_px * parts, geometry.height_px * parts), parts


def _corners(net: Geometry, plane: Geometry, start: int, stop: int) -> tuple[Doubles, Doubles, Int8s]:
    """Return the places in the plane of the corners of the net's rows start..stop, (stop - start + 1, w + 1)."""
    if isinstance(net, Fisheye) and isinstance(plane, Fisheye):
        return _turned(net, plane, start, stop)
    d, _ = point_directions(net, np.arange(net.width_px + 1), np.arange(start, stop + 1)[:, None])
    x, y, placed = places(plane, d)
    return x, y, np.where(placed, CLEAR, CUT if isinstance(plane, Fisheye) else HIDDEN).astype(np.int8)


def _turned(net: Fisheye, plane: Fisheye, start: int, stop: int) -> tuple[Doubles, Doubles, Int8s]:
    """Return what `_corners` does of two fisheyes: they look the same way, so that one radius is all that changes."""
    even = np.linspace(0, 1, RADII + 1)
    # An orthographic rim is steep: there its angle goes on evenly, not its radius.
    steep = net.mapping is LensMapping.ORTHOGRAPHIC and net.half_field_rad == math.pi / 2
    sine, cosine = polar_of_radius(net, np.sin(even * (math.pi / 2)) if steep else even)
    radii = radius_of_polar(plane, sine, cosine)[0] * plane.radius_px
    turn = net.top_azimuth_rad - plane.top_azimuth_rad
    field = min(plane.half_field_rad + FIELD_TOLERANCE_RAD, math.pi)
    sees_all = net.half_field_rad <= field
    edge = 2.0 if sees_all else float(radius_of_polar(net, np.sin([field]), np.cos([field]))[0][0])
    way = np.array([*net.axis_px, net.radius_px, steep, *plane.axis_px, math.cos(turn), math.sin(turn), edge])
    x, y = np.empty((2, stop - start + 1, net.width_px + 1))
    state = np.empty(x.shape, np.int8)
    turned_corners(way, radii, start, x, y, state)
    return x, y, state


def _density(plane: Geometry) -> Doubles:
    """Return the solid angle of a square pixel of picture in each of the plane's cells (H, W)."""
    solid = solid_angles(plane)
    if not isinstance(plane, Fisheye):
        return solid
    inside = fisheye_areas(plane)
    some = inside > 1e-9
    np.divide(solid, inside, out=inside, where=some)
    inside[~some] = 0.0
    return inside


def _by_intervals(
    picture: Floats, source: Equirectangular, target: Equirectangular, weights: Floats
) -> tuple[Floats, Floats]:
    down = _overlaps(_caps(target.height_px), _caps(source.height_px))
    shift = (target.yaw_rad - source.yaw_rad) / (2 * math.pi) % 1.0
    twice = _overlaps(
        np.arange(target.width_px + 1) / target.width_px + shift, np.arange(2 * source.width_px + 1) / source.width_px
    )
    across = twice[:, : source.width_px] + twice[:, source.width_px :]
    values = np.empty((target.height_px, target.width_px, picture.shape[2]), np.float32)
    share = np.empty(values.shape[:2], np.float32)
    cells = np.diff(_caps(target.height_px)) / target.width_px
    rows, columns = ((one.indptr, one.indices, one.data) for one in (down, across))

    def work(part: slice) -> None:
        interval_means(picture, weights, rows, columns, (part.start, cells), values[part], share[part])

    side_by_side(work, bands(target.height_px, max(1, target.height_px // 64)))
    return values, share


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

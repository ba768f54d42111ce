"""Solid angles of pixels, and solid angles projected onto a plane: what turns radiance into illuminance.

Every picture's cells tile the part of the sphere that it shows, so their sums have no error of rasterisation: a uniform
sphere gives 4 pi, a hemisphere seen by the plane below it gives pi. Equirectangular and perspective cells have closed
forms. Fisheye cells are cut exactly by the image circle: by Green's theorem the integral over a cell is one along its
edges, of F(theta) dphi, where F is the integral from the axis: 1 - cos(theta) for the solid angle. Edges end at the
circle, whose own arcs add F(half field) times their angle. Neighbours share their edges, so that nothing is counted
twice or lost. Far from the edge of a large picture the cells are so small that Gauss's rule inside each is as exact and
much cheaper.
"""

import functools
import math
from collections.abc import Callable, Iterator
from dataclasses import replace
from typing import Any

import numpy as np
import numpy.typing as npt

from processing.errors import ParameterError
from processing.ground.arrays import Doubles, Indices, Vector, bands
from processing.ground.kernels import compiled
from processing.ground.threads import FORGET, side_by_side
from processing.sphere.geometry import (
    Equirectangular,
    Fisheye,
    Geometry,
    LensMapping,
    Perspective,
    polar_of_radius,
    radial_density,
)
from processing.sphere.maps import directions, point_directions, view_axes

Integral = Callable[[Doubles, Doubles, Doubles, Doubles], Doubles]
"""From sine and cosine of theta, and cosine and sine of the azimuth in the picture, to F."""

LARGE_RADIUS_PX, VERY_LARGE_RADIUS_PX = 256, 1024
"""In pixels; chosen: from here Gauss's rule of 2 points, of 1 point will do."""
RIM_PX, STEEP_RIM_PX = 2, 20
"""Cells this near are integrated along their edges; of orthographic lenses more: Gauss's rule misses 1.5e-3 / n^4."""
CELLS_AT_ONCE, ROWS = 1 << 18, 64  # for memory, and for threads
RADII = 1 << 16  # steps of the table of what depends on the radius alone: its lines miss the curves by 4e-7
CROSSED_SAMPLES = 2048  # a cell that the plane's horizon crosses is divided until so many parts lie across the picture
MOST_PARTS = 64  # chosen, for time
SAMPLES_AT_ONCE = 1 << 18  # for memory


@functools.lru_cache(maxsize=1)
def fisheye_solid_angles(lens: Fisheye) -> Doubles:
    """Return the solid angle of each cell's part inside the circle (H, W), in steradians; kept, and read only."""
    whole = float(_cap(*polar_of_radius(lens, np.array(1.0))))
    found = _cells(lens, lambda sine, cosine, _c, _s: _cap(sine, cosine), lambda phi: whole * phi, None)
    # A cell that the circle only touches may come out as minus a rounding error.
    np.maximum(found, 0.0, out=found).setflags(write=False)
    return found


FORGET.append(fisheye_solid_angles.cache_clear)


def fisheye_areas(lens: Fisheye) -> Doubles:
    """Return the area of each cell's part inside the circle (H, W), in square pixels."""
    whole = replace(lens, mapping=LensMapping.EQUISOLID, half_field_rad=math.pi, polynomial=())
    return np.asarray(fisheye_solid_angles(whole) * (lens.radius_px**2 / 4))


def fisheye_projected(lens: Fisheye, normal: Doubles) -> Doubles:
    """Return the signed integral of ``normal . direction`` over each cell's part inside the circle (H, W)."""
    sin_top, cos_top = math.sin(lens.top_azimuth_rad), math.cos(lens.top_azimuth_rad)
    right, up = -normal[0] * cos_top + normal[1] * sin_top, normal[0] * sin_top + normal[1] * cos_top
    axial = float(normal[2])

    def integral(sine: Doubles, cosine: Doubles, cos_phi: Doubles, sin_phi: Doubles) -> Doubles:
        return np.asarray((right * cos_phi + up * sin_phi) * _level(sine, cosine) + axial * sine * sine / 2)

    sine, cosine = (np.asarray(v) for v in polar_of_radius(lens, np.array(1.0)))
    level, cap = float(_level(sine, cosine)), float(sine * sine / 2)

    def rim(phi: Doubles) -> Doubles:
        return np.asarray(level * (right * np.sin(phi) - up * np.cos(phi)) + axial * cap * phi)

    return _cells(lens, integral, rim, (right, up, axial))


def _cap(sine: Doubles, cosine: Doubles) -> Doubles:
    """Return 1 - cos(theta) without cancellation."""
    return np.where(cosine > 0, sine * sine / (1 + np.abs(cosine)), 1 - cosine)


def _level(sine: Doubles, cosine: Doubles) -> Doubles:
    """Return the integral of sin2 from 0 to theta, without cancellation."""
    theta = np.arctan2(sine, cosine)
    t2 = theta * theta
    series = theta * t2 * (1 / 3 - t2 * (1 / 15 - t2 * (2 / 315 - t2 / 2835)))
    return np.where(theta < 0.1, series, (theta - sine * cosine) / 2)


def _cells(lens: Fisheye, integral: Integral, rim: Callable[[Doubles], Doubles], normal: Vector | None) -> Doubles:
    """Return all cells' integrals: inside by Gauss's rule where the picture is large, else and at the rim by edges."""
    out = np.zeros((lens.height_px, lens.width_px))
    column, row = lens.axis_px
    rim_px = STEEP_RIM_PX if lens.mapping is LensMapping.ORTHOGRAPHIC else RIM_PX
    u = _relative(np.arange(lens.width_px) + 0.5 - column, lens)
    v = _relative(row - (np.arange(lens.height_px) + 0.5), lens)
    inner = 1 - rim_px / lens.radius_px if lens.radius_px >= LARGE_RADIUS_PX else 0.0
    shift = 0.5 / math.sqrt(3) / lens.radius_px  # an orthographic density bends most
    once = lens.radius_px >= VERY_LARGE_RADIUS_PX and lens.mapping is not LensMapping.ORTHOGRAPHIC
    shifts = np.array([0.0]) if once else np.array([-shift, shift])
    which = np.array([*(normal or (0.0, 0.0, 0.0)), normal is not None], np.float64)
    limits, table = (inner, 1 + 1 / lens.radius_px, 1 / (len(shifts) ** 2 * lens.radius_px**2)), _by_radius(lens)
    bands = range(0, lens.height_px, ROWS)
    side_by_side(lambda y: _gauss_sums(u, v[y : y + ROWS], shifts, table, which, limits, out[y : y + ROWS]), bands)
    at_y, at_x = np.nonzero(np.isnan(out))
    out[at_y, at_x] = _by_edges(lens, at_y, at_x, integral)
    _add_arcs(lens, out, rim)
    return out


@functools.lru_cache(maxsize=4)
def _by_radius(lens: Fisheye) -> Doubles:
    """Return solid angle per area, sine over radius and cosine of the angle at even steps of the radius, (3, N)."""
    radius = np.maximum(np.linspace(0, 1, RADII + 1), 1e-9)
    sine, cosine = polar_of_radius(lens, radius)
    return np.stack([radial_density(lens, radius), sine / radius, cosine])


@compiled
def _gauss_sums(u: Any, v: Any, shifts: Any, table: Any, which: Any, limits: Any, out: Any) -> None:
    """Fill sums over Gauss's points, times a cell's area, of cells (h, w) with middles ``u`` (w,), ``v`` (h,): radii.

    ``which`` (4,): the plane's normal, and whether one is asked for. ``limits``: radii up to which it is done, and up
    to which NaN says that it is not; that area."""
    last = table.shape[1] - 1
    for j in range(v.shape[0]):
        for i in range(u.shape[0]):
            middle = np.sqrt(u[i] * u[i] + v[j] * v[j])
            if middle >= limits[0]:
                out[j, i] = np.nan if middle < limits[1] else 0.0
                continue
            total = 0.0
            for du in shifts:
                for dv in shifts:
                    x, y = u[i] + du, v[j] + dv
                    step = np.sqrt(x * x + y * y) * last
                    k = min(int(step), last - 1)
                    share = step - k
                    value = table[0, k] + share * (table[0, k + 1] - table[0, k])
                    if which[3] > 0:
                        flat = table[1, k] + share * (table[1, k + 1] - table[1, k])
                        along = table[2, k] + share * (table[2, k + 1] - table[2, k])
                        value *= flat * (x * which[0] + y * which[1]) + along * which[2]
                    total += value
            out[j, i] = total * limits[2]


def _by_edges(lens: Fisheye, row: Indices, column: Indices, integral: Integral) -> Doubles:
    """Return the integrals along the four edges of cells, as far as they lie inside the circle, anticlockwise."""
    centre_x, centre_y = lens.axis_px
    left, right = _relative(column - centre_x, lens), _relative(column + 1 - centre_x, lens)
    upper, lower = _relative(centre_y - row, lens), _relative(centre_y - row - 1, lens)

    def across(v: Doubles) -> Doubles:
        return -_line(lens, v, left, right, integral)

    def along(u: Doubles) -> Doubles:
        return _line(lens, u, lower, upper, lambda s, c, up, fixed: integral(s, c, fixed, up))

    return across(lower) + along(right) - across(upper) - along(left)


def _line(lens: Fisheye, fixed: Doubles, start: Doubles, end: Doubles, integral: Integral) -> Doubles:
    """Return the integral of fixed F / r2 over the part of a grid line inside the circle.

    With along = c sin(a), c the half chord, the root that F has at an orthographic circle's edge is smooth in a."""
    chord = np.sqrt(np.maximum(1 - fixed * fixed, 0.0))
    safe = np.where(chord > 0, chord, 1.0)
    a0, a1 = (np.where(chord > 0, np.arcsin(np.clip(t / safe, -1.0, 1.0)), 0.0) for t in (start, end))
    nodes, weights = np.polynomial.legendre.leggauss(48 if lens.radius_px < 4 else 16 if lens.radius_px < 64 else 6)
    total = np.zeros_like(a0)
    for node, weight in zip(nodes, weights, strict=True):
        a = (a0 + a1) / 2 + (a1 - a0) / 2 * node
        place = chord * np.sin(a)
        radius = np.sqrt(place * place + fixed * fixed)
        sine, cosine = polar_of_radius(lens, np.minimum(radius, 1.0))
        r = np.maximum(radius, 1e-150)
        total += weight * integral(sine, cosine, place / r, fixed / r) / (r * r) * chord * np.cos(a)
    return np.asarray(fixed * total * (a1 - a0) / 2)


def _relative(distance_px: npt.NDArray[Any], lens: Fisheye) -> Doubles:
    return np.asarray(distance_px / lens.radius_px, dtype=np.float64)


def _add_arcs(lens: Fisheye, out: Doubles, rim: Callable[[Doubles], Doubles]) -> None:
    """Add the circle's own part, cut into arcs where it crosses the lines between pixels."""
    centre_x, centre_y = lens.axis_px
    u = (np.arange(lens.width_px + 1) - centre_x) / lens.radius_px
    v = (centre_y - np.arange(lens.height_px + 1)) / lens.radius_px
    u, v = np.arccos(u[np.abs(u) <= 1]), np.arcsin(v[np.abs(v) <= 1])
    cuts = np.concatenate([u, -u, v, math.pi - v, [0.0, 2 * math.pi]])
    cuts = np.sort(np.where(cuts < 0, cuts + 2 * math.pi, cuts))
    middle = (cuts[1:] + cuts[:-1]) / 2
    x = np.floor(centre_x + lens.radius_px * np.cos(middle)).astype(np.intp)
    y = np.floor(centre_y - lens.radius_px * np.sin(middle)).astype(np.intp)
    inside = (x >= 0) & (x < lens.width_px) & (y >= 0) & (y < lens.height_px)
    np.add.at(out, (y[inside], x[inside]), np.diff(rim(cuts))[inside])


def solid_angles(geometry: Geometry) -> Doubles:
    """Return the solid angle of each pixel's cell (H, W) in steradians; 0 where the cell sees nothing.

    A cell that a fisheye's edge cuts has the solid angle of its part inside, even if its centre lies outside.
    """
    if isinstance(geometry, Equirectangular):
        return np.repeat(_row_solid(geometry)[:, None], geometry.width_px, axis=1)
    if isinstance(geometry, Perspective):
        right, up = _grid(geometry)
        # The solid angle of the rectangle from the axis to a corner; differences give a cell's.
        corner = np.arctan2(np.outer(up, right), np.sqrt(1 + up[:, None] ** 2 + right[None, :] ** 2))
        return -np.diff(np.diff(corner, axis=0), axis=1)
    return fisheye_solid_angles(geometry)


def projected_solid_angles(geometry: Geometry, normal: npt.ArrayLike) -> Doubles:
    """Return the integral of max(0, normal . direction) over each pixel's cell (H, W), in steradians.

    The illuminance on a plane with that ``normal`` (3,), of any length, is the sum of these times luminance. Closed
    form per cell, but for those that the plane's own horizon crosses, which are divided finely: 2e-6 of the whole at
    16 rows, less above (docs/reference/sphere.md).
    """
    return np.concatenate([weights for _, weights in projected_bands(geometry, normal)])


def projected_bands(geometry: Geometry, normal: npt.ArrayLike) -> Iterator[tuple[slice, Doubles]]:
    """Yield rows and `projected_solid_angles` (H, W), steradians; ``normal`` (3,). A panorama comes in bands."""
    n = np.asarray(normal, dtype=np.float64)
    if n.shape != (3,) or not np.isfinite(n).all() or not n.any():
        raise ParameterError(f"a plane's normal of {normal!r}", advice="give three finite numbers, not all 0")
    n = n / np.sqrt(n @ n)
    whole, step = isinstance(geometry, Equirectangular), max(1, CELLS_AT_ONCE // geometry.width_px)
    for rows in bands(geometry.height_px, step if whole else geometry.height_px):
        if isinstance(geometry, Equirectangular):
            step_x, step_y = 2 * math.pi / geometry.width_px, math.pi / geometry.height_px
            longitude, latitude = _middles(geometry, rows)
            across = (n[0] * np.sin(longitude) + n[1] * np.cos(longitude)) * (2 * math.sin(step_x / 2))
            # Integrals over a row of cos2 and of sin cos.
            level = (step_y + np.cos(2 * latitude) * math.sin(step_y)) / 2
            upward = np.sin(2 * latitude) * math.sin(step_y) / 2
            signed = np.asarray(level[:, None] * across[None, :] + n[2] * step_x * upward[:, None])
        elif isinstance(geometry, Perspective):
            signed = _perspective_projected(geometry, n)
        else:
            signed = fisheye_projected(geometry, n)
        y, x = _crossed_cells(geometry, n, rows)
        out = np.maximum(signed, 0.0, out=signed)
        if y.size:
            row = isinstance(geometry, Equirectangular)
            solid = _row_solid(geometry)[y] if row else solid_angles(geometry)[y, x]  # type: ignore[arg-type]
            out[y - rows.start, x] = solid * _mean_positive(geometry, n, (y, x))
        yield rows, out


def _row_solid(geometry: Equirectangular) -> Doubles:
    """Return the solid angle of each row's cells (H,), differences of sines without cancellation."""
    latitude = (0.5 - (np.arange(geometry.height_px) + 0.5) / geometry.height_px) * math.pi
    return 2 * np.cos(latitude) * math.sin(math.pi / geometry.height_px / 2) * (2 * math.pi / geometry.width_px)


def _middles(geometry: Equirectangular, rows: slice) -> tuple[Doubles, Doubles]:
    """Return the longitude of each column (W,) and the latitude of some rows."""
    longitude = (np.arange(geometry.width_px) + 0.5) * (2 * math.pi / geometry.width_px) - math.pi + geometry.yaw_rad
    latitude = math.pi / 2 - (np.arange(geometry.height_px)[rows] + 0.5) * (math.pi / geometry.height_px)
    return np.asarray(longitude), np.asarray(latitude)


def _grid(view: Perspective) -> tuple[Doubles, Doubles]:
    """Return the plane's coordinates (focal length 1) of the lines between columns (W+1,) and rows (H+1,)."""
    right = (np.arange(view.width_px + 1) - view.width_px / 2) / view.focal_px
    up = (view.height_px / 2 - np.arange(view.height_px + 1)) / view.focal_px
    return np.asarray(right, dtype=np.float64), np.asarray(up, dtype=np.float64)


def _perspective_projected(view: Perspective, n: Doubles) -> Doubles:
    """Return Lambert's polygon formula: half the sum over a cell's edges of angle times the edge's normal."""
    right, up = _grid(view)
    local = view_axes(view) @ n
    # The edge between (x0, y) and (x1, y) lies on the plane with normal (0, 1, -y): its angle is that of two points
    # at distance sqrt(1 + y2) from the plane x = 0.
    far = np.sqrt(1 + up**2)[:, None]
    angle = np.diff(np.arctan2(right[None, :], far), axis=1)
    across = angle * ((up * local[2] - local[1]) / far[:, 0])[:, None] / 2
    far = np.sqrt(1 + right**2)[None, :]
    angle = -np.diff(np.arctan2(up[:, None], far), axis=0)
    along = angle * ((local[0] - right * local[2]) / far[0])[None, :] / 2
    return np.asarray(-(np.diff(across, axis=0) + np.diff(along, axis=1)))


def _crossed_cells(geometry: Geometry, n: Doubles, rows: slice) -> tuple[Indices, Indices]:
    """Return rows (of ``rows``) and columns of the cells that may lie on both sides of the plane's horizon."""
    if isinstance(geometry, Equirectangular):
        longitude, latitude = _middles(geometry, rows)
        across = n[0] * np.sin(longitude) + n[1] * np.cos(longitude)
        middle = np.cos(latitude)[:, None] * across + n[2] * np.sin(latitude)[:, None]
        y, x = np.nonzero(np.abs(middle) <= _cell_reach(geometry))
        return y + rows.start, x
    if isinstance(geometry, Fisheye) and math.hypot(n[0], n[1]) < 1e-12 and geometry.half_field_rad <= math.pi / 2:
        # The plane's horizon is the picture's edge, or beyond it.
        none = np.zeros(0, dtype=np.intp)
        return none, none
    found_y, found_x = [], []
    reach = _cell_reach(geometry)
    for part in bands(geometry.height_px, max(1, SAMPLES_AT_ONCE // geometry.width_px)):
        centre, _ = directions(geometry, part)
        y, x = np.nonzero(np.abs(centre @ n) <= reach)
        found_y.append(y + part.start)
        found_x.append(x)
    return np.concatenate(found_y), np.concatenate(found_x)


def _cell_reach(geometry: Geometry) -> float:
    """Return an angle within which all of a cell lies around its centre."""
    if isinstance(geometry, Equirectangular):
        return math.hypot(math.pi / geometry.width_px, math.pi / 2 / geometry.height_px) + 1e-12
    if isinstance(geometry, Perspective):
        return math.sqrt(0.5) / geometry.focal_px + 1e-12
    # The largest angle between neighbours in a fisheye picture, in rad per pixel, along a radius or across
    column, row = geometry.axis_px
    wide = replace(geometry, width_px=1, height_px=1)
    r = np.linspace(0, geometry.radius_px, 4097)
    d, _ = point_directions(wide, column + r, np.full_like(r, row))
    theta = np.arctan2(np.hypot(d[:, 0], d[:, 1]), d[:, 2])
    radial = np.diff(theta).max() / (r[1] - r[0]) if geometry.radius_px > 1 else geometry.half_field_rad
    steepest = float(min(max(radial, 1 / geometry.radius_px * math.pi), geometry.half_field_rad))
    return math.sqrt(0.5) * steepest + 1e-12


def _mean_positive(geometry: Geometry, n: Doubles, cells: tuple[Indices, Indices]) -> Doubles:
    """Return the mean of max(0, n . direction) over cells, weighted by solid angle, from a fine division of each."""
    parts = max(2, min(MOST_PARTS, math.ceil(CROSSED_SAMPLES / max(geometry.width_px, geometry.height_px))))
    offset = (np.arange(parts) + 0.5) / parts
    out = np.empty(cells[0].size)
    for part in bands(out.size, max(1, SAMPLES_AT_ONCE // parts**2)):
        y, x = cells[0][part], cells[1][part]
        px, py = np.broadcast_arrays(x[:, None, None] + offset, y[:, None, None] + offset[:, None])
        d, seen = point_directions(geometry, px, py)
        weight = np.where(seen, _density(geometry, px, py, d), 0.0)
        total = weight.sum(axis=(1, 2))
        light = (np.maximum(d @ n, 0.0) * weight).sum(axis=(1, 2))
        centre, _ = point_directions(geometry, x + 0.5, y + 0.5)
        out[part] = np.where(total > 0, light / np.where(total > 0, total, 1.0), np.maximum(centre @ n, 0.0))
    return out


def _density(geometry: Geometry, x: Doubles, y: Doubles, d: Doubles) -> Doubles:
    """Return solid angle per picture area, up to a constant factor."""
    if isinstance(geometry, Equirectangular):
        return np.asarray(np.cos((0.5 - y / geometry.height_px) * math.pi))
    if isinstance(geometry, Perspective):
        return np.asarray((d @ view_axes(geometry)[2]) ** 3)
    column, row = geometry.axis_px
    return radial_density(geometry, np.minimum(np.hypot(x - column, y - row) / geometry.radius_px, 1.0))

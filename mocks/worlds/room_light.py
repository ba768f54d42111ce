"""Daylight in the built-in room: sky through the window by sampling, then the bounces by radiosity.

Each face has a light map of irradiance (lx as RGB). Direct sun is not in the maps: it has sharp edges and is added
pixel by pixel; what it bounces is.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import cv2
import numpy as np
import numpy.typing as npt

from mocks.worlds.room_plan import RoomPlan
from mocks.worlds.room_rays import WINDOW_WALL, Faces, blocked, in_window, pane_distance_m, sun_visibility
from mocks.worlds.sky import SUN_RADIUS_RAD, SimpleSky
from processing.ground.arrays import Floats, Int32s

GLASS_TRANSMITTANCE = 0.65
_FINE_M, _COARSE_M, _COARSE_SOLID_M = 0.14, 0.38, 0.24
_BOUNCES = 12


@dataclass(frozen=True)
class LightMaps:
    """Irradiance of all faces in one list of texels; face f owns ``rows[f] x columns[f]`` from ``offset[f]``."""

    columns: Int32s
    rows: Int32s
    offset: Int32s
    texels: Floats

    def at(self, face: Int32s, u: Floats, v: Floats) -> Floats:
        """Return bilinear irradiance at fractions u, v of each face."""
        columns, rows, offset = self.columns[face], self.rows[face], self.offset[face]
        x = np.clip(u * columns - 0.5, 0, columns - 1)
        y = np.clip(v * rows - 0.5, 0, rows - 1)
        x0, y0 = x.astype(np.int32), y.astype(np.int32)
        x1, y1 = np.minimum(x0 + 1, columns - 1), np.minimum(y0 + 1, rows - 1)
        fx, fy = (x - x0).astype(np.float32)[:, None], (y - y0).astype(np.float32)[:, None]
        upper = self.texels[offset + y0 * columns + x0] * (1 - fx) + self.texels[offset + y0 * columns + x1] * fx
        lower = self.texels[offset + y1 * columns + x0] * (1 - fx) + self.texels[offset + y1 * columns + x1] * fx
        return np.asarray(upper * (1 - fy) + lower * fy)


@dataclass(frozen=True)
class _Grid:
    """Texel centres of every face at one coarseness."""

    columns: Int32s
    rows: Int32s
    offset: Int32s
    face: Int32s
    point: Floats
    normal: Floats
    area_m2: Floats


def bake(plan: RoomPlan, faces: Faces, albedo: Floats, sky: SimpleSky) -> LightMaps:
    """Return the light maps; ``albedo`` is each face's mean reflectance (faces, 3)."""
    fine, coarse = _grid(faces, _FINE_M, _FINE_M), _grid(faces, _COARSE_M, _COARSE_SOLID_M)
    sky_fine = _sky_light(plan, fine, sky)
    bounced = _bounce(plan, coarse, albedo, _sky_light(plan, coarse, sky) + _sun_light(plan, coarse, sky))
    texels = sky_fine
    for face in range(len(faces)):
        rows, columns = int(coarse.rows[face]), int(coarse.columns[face])
        start = coarse.offset[face]
        patch = bounced[start : start + rows * columns].reshape(rows, columns, 3)
        size = (int(fine.columns[face]), int(fine.rows[face]))
        smooth = cv2.resize(patch, size, interpolation=cv2.INTER_LINEAR).reshape(-1, 3)
        texels[fine.offset[face] : fine.offset[face] + len(smooth)] += smooth
    return LightMaps(fine.columns, fine.rows, fine.offset, texels)


def _grid(faces: Faces, wall_step_m: float, solid_step_m: float) -> _Grid:
    columns, rows, points, normals, areas, owner = [], [], [], [], [], []
    for face in range(len(faces)):
        length_u, length_v = faces.extent_m(face)
        step_m = wall_step_m if face < 6 else solid_step_m
        nu, nv = max(1, round(length_u / step_m)), max(1, round(length_v / step_m))
        v, u = np.meshgrid((np.arange(nv) + 0.5) / nv, (np.arange(nu) + 0.5) / nu, indexing="ij")
        columns.append(nu)
        rows.append(nv)
        points.append(faces.points(face, u.ravel(), v.ravel()))
        normals.append(np.broadcast_to(faces.normal(face), (nu * nv, 3)))
        areas.append(np.full(nu * nv, length_u * length_v / (nu * nv), np.float32))
        owner.append(np.full(nu * nv, face, np.int32))
    counts = np.array(columns, np.int32) * np.array(rows, np.int32)
    offset = np.concatenate([[0], np.cumsum(counts)[:-1]]).astype(np.int32)
    point, normal = np.concatenate(points), np.concatenate(normals)
    size = (np.array(columns, np.int32), np.array(rows, np.int32), offset)
    return _Grid(*size, np.concatenate(owner), point + normal * np.float32(2e-3), normal, np.concatenate(areas))


def _sky_light(plan: RoomPlan, grid: _Grid, sky: SimpleSky) -> Floats:
    """Return irradiance from sky and ground seen through the panes (10 x 7 samples of the inner opening)."""
    window = plan.window
    nx, nz = 10, 7
    x = window.a0 + (np.arange(nx) + 0.5) / nx * (window.a1 - window.a0)
    z = window.z0 + (np.arange(nz) + 0.5) / nz * (window.z1 - window.z0)
    cell_m2 = np.float32((window.a1 - window.a0) * (window.z1 - window.z0) / (nx * nz))
    total = np.zeros((len(grid.point), 3), dtype=np.float32)
    for sample_x in x:
        for sample_z in z:
            target = np.array([sample_x, plan.high[1], sample_z], dtype=np.float32)
            total += _through_cell(plan, grid, target, sky) * cell_m2
    return total * np.float32(GLASS_TRANSMITTANCE)


def _through_cell(plan: RoomPlan, grid: _Grid, target: Floats, sky: SimpleSky) -> Floats:
    """Return the light from one cell of the window, per square metre of it."""
    way = target - grid.point
    distance2 = np.einsum("ij,ij->i", way, way)
    direction = way / np.sqrt(distance2)[:, None]
    cos_here = np.einsum("ij,ij->i", direction, grid.normal)
    useful = np.flatnonzero((cos_here > 1e-4) & (direction[:, 1] > 1e-3))
    out = np.zeros_like(grid.point)
    if useful.size == 0:
        return out
    direction = direction[useful]
    x = target[0] + direction[:, 0] / direction[:, 1] * plan.wall_thickness_m
    z = target[2] + direction[:, 2] / direction[:, 1] * plan.wall_thickness_m
    # Cells are coarser than the frame's bars, so the edge of a pane is as soft as a cell is wide.
    pane = np.clip(pane_distance_m(plan, x, z) / 0.15 + 0.5, 0, 1)
    clear = pane * ~blocked(plan, grid.point[useful], np.broadcast_to(target, direction.shape))
    form = cos_here[useful] * direction[:, 1] / np.maximum(distance2[useful], 0.01)
    out[useful] = sky.radiance(direction) * (form * clear)[:, None]
    return out


def _sun_light(plan: RoomPlan, grid: _Grid, sky: SimpleSky) -> Floats:
    """Return each coarse patch's irradiance by the sun, averaged over 6 x 6 points of the patch."""
    sun = np.array(sky.sun_direction, dtype=np.float32)
    cos_sun = np.maximum(grid.normal @ sun, 0)
    side = np.sqrt(grid.area_m2)
    share = np.zeros(len(grid.point), dtype=np.float32)
    steps = (np.arange(6) + 0.5) / 6 - 0.5
    axis = np.abs(grid.normal).argmax(axis=1)
    every = np.arange(len(axis))
    for du in steps:
        for dv in steps:
            point = grid.point.copy()
            point[every, np.where(axis == 0, 1, 0)] += du * side
            point[every, np.where(axis == 2, 1, 2)] += dv * side
            share += sun_visibility(plan, point, sky.sun_direction, SUN_RADIUS_RAD) / 36
    flux = sky.sun_normal_illuminance_rgb * np.float32(GLASS_TRANSMITTANCE)
    return np.asarray((share * cos_sun)[:, None] * flux, dtype=np.float32)


def _bounce(plan: RoomPlan, grid: _Grid, albedo: Floats, direct: Floats) -> Floats:
    """Return the irradiance that arrives after one and more reflections between the patches."""
    factors = _form_factors(plan, grid)
    covered = factors.sum(axis=1) < 0.5
    reflect = albedo[grid.face].copy()
    wall = grid.face == WINDOW_WALL
    reflect[wall & in_window(plan, grid.point[:, 0], grid.point[:, 2])] = 0.05
    bounced = np.zeros_like(direct)
    for _ in range(_BOUNCES):
        bounced = factors @ (reflect * (direct + bounced))
    _fill_covered(bounced, grid, covered)
    return bounced


def _fill_covered(light: Floats, grid: _Grid, covered: npt.NDArray[np.bool_]) -> None:
    """Give patches whose centre lies against another solid the light of the nearest open patch of their face."""
    for patch in np.flatnonzero(covered):
        open_here = np.flatnonzero(~covered & (grid.face == grid.face[patch]))
        if open_here.size:
            away = np.linalg.norm(grid.point[open_here] - grid.point[patch], axis=1)
            light[patch] = light[open_here[away.argmin()]]
        else:
            light[patch] = 0.3 * light[~covered].mean(axis=0)


def _form_factors(plan: RoomPlan, grid: _Grid) -> Floats:
    """Return the share of patch j in what patch i sees; rows sum to 1, because a room is closed."""
    count = len(grid.point)
    factors = np.zeros((count, count), dtype=np.float32)
    for start in range(0, count, 64):
        part = slice(start, start + 64)
        way = grid.point[None, :, :] - grid.point[part, None, :]
        distance2 = np.maximum(np.einsum("ijk,ijk->ij", way, way), 1e-6)
        cos_i = np.einsum("ijk,ik->ij", way, grid.normal[part])
        cos_j = -np.einsum("ijk,jk->ij", way, grid.normal)
        seen = (cos_i > 0) & (cos_j > 0)
        form = cos_i * cos_j / distance2 * grid.area_m2 / (math.pi * distance2 + grid.area_m2)
        hidden = blocked(plan, grid.point[part, None, :], grid.point[None, :, :])
        factors[part] = np.where(seen & ~hidden, form, 0)
    total = factors.sum(axis=1, keepdims=True)
    return np.asarray(factors / np.maximum(total, 1e-6))

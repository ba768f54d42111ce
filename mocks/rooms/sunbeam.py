"""Sunlight's first bounce: the patches that the sun paints in a room, as small lamps for the renderer.

A path tracer finds a small bright patch by chance, and so noisily. The patches are known: parallel rays through a grid
of cells on each window give, cell by cell, the parallelogram that it lights; together they tile the sunlit surfaces.
"""

from __future__ import annotations

from processing.ground.arrays import Doubles

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from mocks.light import Vector
from mocks.rooms.geometry import Geometry
from mocks.rooms.mesh import Mesh
from mocks.rooms.shell import Pane
from mocks.rooms.sunlight import windows_of

CELL_M = 0.03
_LIFT_M = 5e-4
_GRAZING = 0.03


@dataclass(frozen=True)
class SunPatch:
    """What the sun lights of one part at one slope: a lamp of even radiance, matte with the part's albedo."""

    mesh: Mesh
    albedo: Vector
    radiance_rgb: Vector

    @property
    def power(self) -> float:
        """Area times radiance: the patch's share of the light."""
        corners = self.mesh.vertices[self.mesh.faces]
        sides = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
        return float(np.linalg.norm(sides, axis=1).sum() / 2 * sum(self.radiance_rgb))


@dataclass(frozen=True)
class _Cells:
    """Lit cells: the part that each lies on, the surface's normal (n, 3), and the cell's corners (n, 4, 3)."""

    part: Doubles
    normal: Doubles
    corners: Doubles


def sun_patches(
    geometry: Geometry, panes: Sequence[Pane], direction: Vector, normal_illuminance_rgb: Vector
) -> tuple[SunPatch, ...]:
    """Return what the sun lights, given the direction to it and the illuminance (lx, RGB) on a plane facing it."""
    towards = np.array(direction)
    found = [
        _lit(geometry, window, towards) for window in windows_of(panes) if np.cross(window[1], window[2]) @ towards > 0
    ]
    if not found:
        return ()
    part = np.concatenate([cells.part for cells in found])
    normal = np.concatenate([cells.normal for cells in found])
    corners = np.concatenate([cells.corners for cells in found])
    kinds, kind_of = np.unique(np.column_stack([part, np.round(normal, 2) + 0.0]), axis=0, return_inverse=True)
    patches = []
    for number, kind in enumerate(kinds):
        mine = kind_of.ravel() == number
        albedo = geometry.parts[int(kind[0])].material.colour
        slope = float((normal[mine] @ towards).mean())
        light = [a * e * slope / math.pi for a, e in zip(albedo, normal_illuminance_rgb, strict=True)]
        mesh = _tiles(corners[mine], normal[mine])
        patches.append(SunPatch(mesh, albedo, (light[0], light[1], light[2])))
    return tuple(patches)


def _lit(geometry: Geometry, window: tuple[Doubles, Doubles, Doubles], towards: Doubles) -> _Cells:
    """Cast a ray of the sun through every cell of a window and lay the cell's shadow where it ends."""
    corner, u, v = window
    across, up = (max(1, round(float(np.linalg.norm(side)) / CELL_M)) for side in (u, v))
    a, b = np.meshgrid((np.arange(across) + 0.5) / across, (np.arange(up) + 0.5) / up)
    start = corner + a.reshape(-1, 1) * u + b.reshape(-1, 1) * v
    rays = np.broadcast_to(-towards.astype(np.float32), start.shape)
    hits = geometry.cast(start.astype(np.float32), rays)
    normal = geometry.face_normals[hits.face].astype(np.float64)
    normal *= np.where(normal @ towards < 0, -1, 1)[:, None]
    slope = normal @ towards
    good = np.flatnonzero((hits.face >= 0) & (slope > _GRAZING))
    normal, slope = normal[good], slope[good]
    middle = start[good] - towards * hits.distance_m[good, None] + normal * _LIFT_M
    half_u, half_v = ((side - towards * ((normal @ side) / slope)[:, None]) / 2 for side in (u / across, v / up))
    ring = [middle - half_u - half_v, middle + half_u - half_v, middle + half_u + half_v, middle - half_u + half_v]
    return _Cells(geometry.part_of[hits.face[good]].astype(np.float64), normal, np.stack(ring, axis=1))


def _tiles(corners: Doubles, normal: Doubles) -> Mesh:
    """Return parallelograms as a mesh that shows its front to where the normals point."""
    count = len(corners)
    turn = np.cross(corners[:, 1] - corners[:, 0], corners[:, 3] - corners[:, 0])
    backwards = np.einsum("ij,ij->i", turn, normal) < 0
    corners = np.where(backwards[:, None, None], corners[:, ::-1], corners)
    halves = np.array([[0, 1, 2], [0, 2, 3]], dtype=np.int32)
    faces = (4 * np.arange(count, dtype=np.int32)[:, None, None] + halves).reshape(-1, 3)
    return Mesh(corners.reshape(-1, 3), np.repeat(normal, 4, axis=0), np.zeros((4 * count, 2)), faces)

"""Triangle meshes with normals and texture coordinates in metres, and the parts that a room is built of."""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass, replace

import numpy as np

from mocks.rooms.model import Material, Role
from mocks.worlds.light import Vector
from processing.ground.arrays import Doubles, Int32s


@dataclass(frozen=True)
class Mesh:
    """Triangles. Vertices (n, 3) and uv (n, 2) in metres, unit normals (n, 3), faces (m, 3).

    Faces turn counter-clockwise seen from the side the normals point to. Flat surfaces meet with vertices of their
    own, so that each has its own normal.
    """

    vertices: Doubles
    normals: Doubles
    uv: Doubles
    faces: Int32s

    def placed(self, position_m: Vector, turn_rad: float = 0.0) -> Mesh:
        """Return the mesh turned counter-clockwise about z, then moved."""
        c, s = math.cos(turn_rad), math.sin(turn_rad)
        turn = np.array([[c, s, 0.0], [-s, c, 0.0], [0.0, 0.0, 1.0]])
        return replace(self, vertices=self.vertices @ turn + np.array(position_m), normals=self.normals @ turn)


@dataclass(frozen=True)
class Part:
    """A mesh of one material, and what it is to the truth. ``instance`` is 0 for the shell and its fixtures."""

    mesh: Mesh
    material: Material
    surface: str
    """floor, ceiling, wall, reveal, window frame, door, radiator, ... or the item's kind."""
    ade: int
    """ADE20K class, see `mocks.rooms.model`."""
    role: Role
    instance: int = 0
    wall: int = -1
    """Of walls: which edge of the polygon."""

    def placed(self, position_m: Vector, turn_rad: float = 0.0) -> Part:
        """Return the part turned about z, then moved."""
        return replace(self, mesh=self.mesh.placed(position_m, turn_rad))


def merge(meshes: Iterable[Mesh]) -> Mesh:
    """Return one mesh of several."""
    found = list(meshes)
    offsets = np.cumsum([0, *(len(m.vertices) for m in found[:-1])])
    return Mesh(
        np.concatenate([m.vertices for m in found]),
        np.concatenate([m.normals for m in found]),
        np.concatenate([m.uv for m in found]),
        np.concatenate([m.faces + int(o) for m, o in zip(found, offsets, strict=True)]).astype(np.int32),
    )


def quad(corner: Vector, u: Vector, v: Vector, uv_origin: tuple[float, float] = (0.0, 0.0)) -> Mesh:
    """Return a rectangle with corner ``corner`` and sides u, v; its normal is u x v; uv in metres from the corner."""
    base, a, b = (np.array(t, dtype=np.float64) for t in (corner, u, v))
    normal = np.cross(a, b)
    normal /= np.linalg.norm(normal)
    length_u, length_v = float(np.linalg.norm(a)), float(np.linalg.norm(b))
    uv = np.array([(0, 0), (length_u, 0), (length_u, length_v), (0, length_v)], dtype=np.float64) + uv_origin
    vertices = np.stack([base, base + a, base + a + b, base + b])
    return Mesh(vertices, np.tile(normal, (4, 1)), uv, np.array([[0, 1, 2], [0, 2, 3]], dtype=np.int32))


def box(low: Vector, high: Vector) -> Mesh:
    """Return a block with sides along the axes, normals outwards."""
    x0, y0, z0 = low
    x1, y1, z1 = high
    dx, dy, dz = x1 - x0, y1 - y0, z1 - z0
    return merge(
        [
            quad((x0, y0, z0), (dx, 0, 0), (0, 0, dz)),
            quad((x1, y0, z0), (0, dy, 0), (0, 0, dz)),
            quad((x1, y1, z0), (-dx, 0, 0), (0, 0, dz)),
            quad((x0, y1, z0), (0, -dy, 0), (0, 0, dz)),
            quad((x0, y0, z1), (dx, 0, 0), (0, dy, 0)),
            quad((x0, y1, z0), (dx, 0, 0), (0, -dy, 0)),
        ]
    )

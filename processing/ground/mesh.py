"""Triangle meshes: their topology, normals and placing. What rooms, furniture and training pictures are built from.

Metres, z up; faces wind counter-clockwise seen from outside.
"""

import math
from collections.abc import Iterable
from dataclasses import dataclass, replace
from typing import Self

import numpy as np
import numpy.typing as npt

from processing.ground.arrays import Doubles, Floats, Int32s, Vector


@dataclass(frozen=True)
class Mesh:
    """Triangles: ``vertices`` (N, 3) and ``uv`` (N, 2) in metres, unit ``normals`` (N, 3), ``faces`` (M, 3).

    Flat surfaces meet with vertices of their own, so that each has its own normal.
    """

    vertices: Doubles
    normals: Doubles
    uv: Doubles
    faces: Int32s

    def placed(self, position_m: Vector, turn_rad: float = 0.0) -> Self:
        """Return the mesh turned counter-clockwise about z, then moved."""
        c, s = math.cos(turn_rad), math.sin(turn_rad)
        turn = np.array([[c, s, 0.0], [-s, c, 0.0], [0.0, 0.0, 1.0]])
        return replace(self, vertices=self.vertices @ turn + np.array(position_m), normals=self.normals @ turn)


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


def crosses(vertices: Doubles, faces: npt.NDArray[np.integer]) -> Doubles:
    """Return normals (M, 3) of faces (M, 3) over vertices (N, 3), as long as twice each face's area in m2."""
    a, b, c = (vertices[faces[:, k]] for k in range(3))
    return np.cross(b - a, c - a)


def y_up(vectors: npt.NDArray[np.floating]) -> Floats:
    """Return (N, 3) vectors of our frame (z up, metres) in glTF's (y up, metres)."""
    # Adding 0 makes -0 plain.
    return np.column_stack([vectors[:, 0], vectors[:, 2], -vectors[:, 1]]).astype(np.float32) + np.float32(0)


def grid_faces(rows: int, columns: int) -> Int32s:
    """Return the triangles (M, 3) of a grid of vertices (row by row), normals along d/drow x d/dcolumn."""
    index = np.arange(rows * columns, dtype=np.int32).reshape(rows, columns)
    p, q, r, s = index[:-1, :-1], index[1:, :-1], index[1:, 1:], index[:-1, 1:]
    return np.concatenate([np.stack([p, q, r], -1).reshape(-1, 3), np.stack([p, r, s], -1).reshape(-1, 3)])


def grid_rim(rows: int, columns: int) -> Int32s:
    """Return the vertices (K,) around a grid's rim, with the grid's upper side to their right."""
    index = np.arange(rows * columns, dtype=np.int32).reshape(rows, columns)
    return np.concatenate([index[:-1, 0], index[-1, :-1], index[:0:-1, -1], index[0, :0:-1]])


def band_faces(upper: npt.NDArray[np.integer], lower: npt.NDArray[np.integer]) -> npt.NDArray[np.integer]:
    """Return the triangles (2 K, 3) between two closed lines of vertices (K,), such as the rims of two sheets."""
    after_upper, after_lower = np.roll(upper, -1), np.roll(lower, -1)
    return np.concatenate([np.stack([upper, lower, after_lower], 1), np.stack([upper, after_lower, after_upper], 1)])


def carried(tangents: Doubles, first: Doubles) -> Doubles:
    """Return two unit directions (N, 2, 3) across each unit tangent (N, 3) of a path, turning as little as they can.

    ``first`` (3,) is any direction not along the path's beginning; each frame is the one before, made normal again.
    """
    frames = np.empty((len(tangents), 2, 3))
    for k, tangent in enumerate(tangents):
        first = first - tangent * (first @ tangent)
        first = first / np.linalg.norm(first)
        frames[k] = first, np.cross(tangent, first)
    return frames


def smooth(mesh: Mesh) -> Mesh:
    """Return the mesh with each normal the mean (by area) of the faces that meet at its place."""
    across = crosses(mesh.vertices, mesh.faces)
    _, place = np.unique(np.round(mesh.vertices, 6), axis=0, return_inverse=True)
    place = place.reshape(-1)
    total = np.zeros((int(place.max()) + 1, 3))
    for corner in range(3):
        np.add.at(total, place[mesh.faces[:, corner]], across)
    normals = total[place]
    return replace(mesh, normals=normals / np.maximum(np.linalg.norm(normals, axis=1, keepdims=True), 1e-12))


def no_slivers(mesh: Mesh) -> Mesh:
    """Return the mesh without triangles of no area."""
    return replace(mesh, faces=mesh.faces[np.linalg.norm(crosses(mesh.vertices, mesh.faces), axis=1) > 1e-12])


def moved(mesh: Mesh, by: Vector) -> Mesh:
    """Return the mesh moved."""
    return replace(mesh, vertices=mesh.vertices + np.array(by))


def turned(mesh: Mesh, axis: Vector, angle_rad: float, about: Vector = (0.0, 0.0, 0.0)) -> Mesh:
    """Return the mesh turned about an axis through a point, counter-clockwise seen from the axis' tip."""
    x, y, z = np.array(axis) / np.linalg.norm(axis)
    cross = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
    matrix = np.eye(3) + math.sin(angle_rad) * cross + (1 - math.cos(angle_rad)) * cross @ cross
    return replace(mesh, vertices=(mesh.vertices - about) @ matrix.T + about, normals=mesh.normals @ matrix.T)

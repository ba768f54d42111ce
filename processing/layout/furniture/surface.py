"""From plain triangles to what is rendered: normals smooth up to a crease, texture coordinates in metres."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from processing.ground.arrays import Doubles, Int64s
from processing.ground.mesh import crosses
from processing.layout.furniture.model import Material, Part

CREASE_RAD = np.radians(50.0)


@dataclass(frozen=True, eq=False)
class Solid:
    """A closed surface of shared vertices, and where its vertices lay when it was made (for textures)."""

    vertices: Doubles
    faces: Int64s
    rest: Doubles

    def moved(self, x: float, y: float, z: float) -> Solid:
        """Return the solid, moved."""
        return Solid(self.vertices + np.array([x, y, z]), self.faces, self.rest)

    def turned(self, axis: str, angle_rad: float) -> Solid:
        """Return the solid, turned about an axis through the origin."""
        return Solid(self.vertices @ rotation(axis, angle_rad).T, self.faces, self.rest)

    def scaled(self, x: float, y: float, z: float) -> Solid:
        """Return the solid, stretched; factors are positive."""
        return Solid(self.vertices * np.array([x, y, z]), self.faces, self.rest)

    def mirrored(self) -> Solid:
        """Return the solid mirrored in x = 0, its winding outward again."""
        return Solid(self.vertices * np.array([-1.0, 1.0, 1.0]), self.faces[:, ::-1], self.rest)


def solid(vertices: npt.ArrayLike, faces: npt.ArrayLike) -> Solid:
    """Return a solid of vertices (N, 3) and faces (M, 3) whose rest positions are its vertices."""
    points = np.asarray(vertices, dtype=np.float64)
    return Solid(points, np.asarray(faces, dtype=np.int64), points)


def rotation(axis: str, angle_rad: float) -> Doubles:
    """Return the matrix, shape (3, 3), of a right-handed turn about x, y or z."""
    c, s = np.cos(angle_rad), np.sin(angle_rad)
    i, j = {"x": (1, 2), "y": (2, 0), "z": (0, 1)}[axis]
    matrix = np.eye(3)
    matrix[i, i] = matrix[j, j] = c
    matrix[i, j], matrix[j, i] = -s, s
    return matrix


def joined(solids: list[Solid]) -> Solid:
    """Return several solids as one."""
    starts = np.cumsum([0, *(len(s.vertices) for s in solids[:-1])])
    return Solid(
        np.concatenate([s.vertices for s in solids]),
        np.concatenate([s.faces + start for s, start in zip(solids, starts, strict=True)]),
        np.concatenate([s.rest for s in solids]),
    )


def signed_volume_m3(vertices: Doubles, faces: Int64s) -> float:
    """Return the volume enclosed by faces (M, 3) over vertices (N, 3); negative where triangles wind inwards."""
    a, b, c = (vertices[faces[:, k]] for k in range(3))
    return float(np.einsum("ij,ij->", a, np.cross(b, c)) / 6.0)


def corner_normals(vertices: Doubles, faces: Int64s, crease_rad: float = CREASE_RAD) -> Doubles:
    """Return (M, 3, 3): each corner's normal, the area-weighted mean of the faces around it within a crease."""
    cross = crosses(vertices, faces)
    unit = cross / np.maximum(np.linalg.norm(cross, axis=1, keepdims=True), 1e-300)
    corner_vertex = faces.ravel()
    order = np.argsort(corner_vertex, kind="stable")
    count = np.bincount(corner_vertex, minlength=len(vertices))
    start = np.concatenate([[0], np.cumsum(count)[:-1]])
    degree = count[corner_vertex]
    mine = np.repeat(np.arange(len(corner_vertex)), degree)
    step = np.arange(len(mine)) - np.repeat(np.cumsum(degree) - degree, degree)
    other_face = order[np.repeat(start[corner_vertex], degree) + step] // 3
    near = np.einsum("ij,ij->i", unit[mine // 3], unit[other_face]) >= np.cos(crease_rad)
    total = np.stack(
        [np.bincount(mine[near], cross[other_face[near], k], minlength=len(corner_vertex)) for k in range(3)], axis=1
    )
    length = np.linalg.norm(total, axis=1, keepdims=True)
    total = np.where(length > 1e-300, total / np.maximum(length, 1e-300), np.repeat(unit, 3, axis=0))
    return np.asarray(total.reshape(-1, 3, 3), dtype=np.float64)


def box_uv(rest: Doubles, faces: Int64s, grain: int) -> Doubles:
    """Return (M, 3, 2): the corners' places in metres, seen along the axis each face looks to; v is the grain."""
    facing = np.argmax(np.abs(crosses(rest, faces)) + np.array([3e-12, 2e-12, 1e-12]), axis=1)
    others = np.array([[a for a in range(3) if a != f] for f in range(3)])[facing]
    swap = others[:, 0] == grain
    u_axis = np.where(swap, others[:, 1], others[:, 0])
    v_axis = np.where(swap, others[:, 0], others[:, 1])
    corners = rest[faces]
    rows = np.arange(len(faces))[:, None]
    u, v = (corners[rows, np.arange(3)[None, :], axis[:, None]] for axis in (u_axis, v_axis))
    return np.asarray(np.stack([u, v], axis=2), dtype=np.float64)


def part_of(body: Solid, material: Material, uv: Doubles | None = None, crease_rad: float = CREASE_RAD) -> Part:
    """Return a solid as a part: its vertices divided where normals or texture coordinates (M, 3, 2) differ."""
    normals = corner_normals(body.vertices, body.faces, crease_rad).reshape(-1, 3)
    owner = body.faces.ravel()
    columns = [owner, *np.rint(normals.T * 2e4).astype(np.int64)]
    flat_uv = None if uv is None else uv.reshape(-1, 2)
    if flat_uv is not None:
        columns += list(np.rint(flat_uv.T * 1e6).astype(np.int64))
    with np.errstate(over="ignore"):
        key = np.zeros(len(owner), dtype=np.uint64)
        for column in columns:
            key = (key ^ column.astype(np.uint64)) * np.uint64(0x9E3779B97F4A7C15)
            key ^= key >> np.uint64(29)
    _, first, place = np.unique(key, return_index=True, return_inverse=True)
    return Part(
        vertices=np.asarray(body.vertices[owner[first]], dtype=np.float32),
        faces=np.asarray(place.reshape(-1, 3), dtype=np.int32),
        normals=np.asarray(normals[first], dtype=np.float32),
        uv=None if flat_uv is None else np.asarray(flat_uv[first], dtype=np.float32),
        material=material,
    )

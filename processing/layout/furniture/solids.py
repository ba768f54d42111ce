"""Solids that furniture is made of, and their surfaces: outward normals, creases, texture coordinates."""

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Self

import numpy as np
import numpy.typing as npt

from processing.ground.arrays import Doubles, Int64s, Vector
from processing.ground.mesh import carried, crosses
from processing.ground.shapes import rounded_box
from processing.layout.furniture.model import Material, Part

CREASE_RAD = np.radians(50.0)


@dataclass(frozen=True, eq=False)
class Solid:
    """A closed surface of shared vertices, and where its vertices lay when it was made (for textures)."""

    vertices: Doubles
    faces: Int64s
    rest: Doubles

    def moved(self, x: float, y: float, z: float) -> Self:
        """Return the solid, moved."""
        return replace(self, vertices=self.vertices + np.array([x, y, z]))

    def turned(self, axis: str, angle_rad: float) -> Self:
        """Return the solid, turned about an axis through the origin."""
        return replace(self, vertices=self.vertices @ rotation(axis, angle_rad).T)

    def scaled(self, x: float, y: float, z: float) -> Self:
        """Return the solid, stretched; factors are positive."""
        return replace(self, vertices=self.vertices * np.array([x, y, z]))


def solid(vertices: npt.ArrayLike, faces: npt.ArrayLike) -> Solid:
    """Return a solid of vertices (N, 3), metres, and faces (F, 3), whose rest positions are its vertices."""
    points = np.asarray(vertices, dtype=np.float64)
    return Solid(points, np.asarray(faces, dtype=np.int64), points)


def rotation(axis: str, angle_rad: float) -> Doubles:
    """Return the rotation matrix, shape (3, 3), of a right-handed turn about x, y or z."""
    c, s = np.cos(angle_rad), np.sin(angle_rad)
    i, j = {"x": (1, 2), "y": (2, 0), "z": (0, 1)}[axis]
    matrix = np.eye(3)
    matrix[i, i] = matrix[j, j] = c
    matrix[i, j], matrix[j, i] = -s, s
    return matrix


def joined(solids: list[Solid]) -> Solid:
    """Return several solids as one."""
    starts = np.cumsum([0, *(len(s.vertices) for s in solids[:-1])])
    faces = np.concatenate([s.faces + start for s, start in zip(solids, starts, strict=True)])
    return Solid(np.concatenate([s.vertices for s in solids]), faces, np.concatenate([s.rest for s in solids]))


def signed_volume_m3(vertices: Doubles, faces: Int64s) -> float:
    """Return the volume in m3 that vertices (N, 3) and faces (F, 3) enclose; negative where triangles wind inwards."""
    a, b, c = (vertices[faces[:, k]] for k in range(3))
    return float(np.einsum("ij,ij->", a, np.cross(b, c)) / 6.0)


def corner_normals(vertices: Doubles, faces: Int64s, crease_rad: float = CREASE_RAD) -> Doubles:
    """Return (F, 3, 3): each corner's normal, the area-weighted mean of the faces around it within a crease."""
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
    """Return (F, 3, 2): the corners' places in metres, seen along the axis each face looks to; v is the grain."""
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
    """Return a solid as a part: its vertices divided where normals or texture coordinates (F, 3, 2) differ."""
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


Spot = Vector


def loft(rings: npt.ArrayLike) -> Solid:
    """Return the skin over (M, N, 3) rings with fans as ends; rings run counter-clockwise seen from the last one.

    Rings whose points all coincide are fine as ends (a tip).
    """
    r = np.asarray(rings, dtype=np.float64)
    m, n = r.shape[:2]
    vertices = [r.reshape(-1, 3)]
    faces = [_between(m, n, m - 1)]
    around = np.arange(n)
    for end, k in ((0, m * n), (m - 1, m * n + 1)):
        vertices.append(r[end].mean(axis=0, keepdims=True))
        first, second = end * n + around, end * n + (around + 1) % n
        order = [second, first] if end == 0 else [first, second]
        faces.append(np.stack([*order, np.full(n, k)], axis=1))
    return cleaned(np.concatenate(vertices), np.concatenate(faces))


def cleaned(vertices: Doubles, faces: Int64s) -> Solid:
    """Return a solid of vertices (N, 3) and faces (M, 3): coinciding vertices are one, faces without area gone."""
    key = np.rint(vertices * 1e7).astype(np.int64)
    with np.errstate(over="ignore"):
        mixed = key @ np.array([73856093, 19349669000003, 83492791000000007], dtype=np.int64)
    _, first, place = np.unique(mixed, return_index=True, return_inverse=True)
    f = place[faces]
    keep = (f[:, 0] != f[:, 1]) & (f[:, 1] != f[:, 2]) & (f[:, 0] != f[:, 2])
    return solid(vertices[first], f[keep])


def box(low: Spot, high: Spot, bevel_m: float = 0.003, steps: int = 1) -> Solid:
    """Return a box between two corners with rounded edges; `steps` 0 gives sharp ones (12 triangles)."""
    lo, hi = np.array(low, dtype=np.float64), np.array(high, dtype=np.float64)
    half = (hi - lo) / 2
    r = float(min(bevel_m, 0.499 * half.min())) if steps else 0.0
    return cube_grid(half, r, max(steps, 0), 1).moved(*((lo + hi) / 2))


def cube_grid(half: Doubles, r: float, steps: int, inner: int) -> Solid:
    """Return a box of half extents (shape (3,), metres) with edges of radius r, each flat field cut in `inner`."""
    x, y, z = (float(v) for v in half)
    mesh = rounded_box((-x, -y, -z), (x, y, z), r, steps, (inner, inner, inner))
    return cleaned(mesh.vertices, mesh.faces.astype(np.int64))


def circle(radius_m: float, sides: int, z: float = 0.0, start_rad: float = 0.0) -> Doubles:
    """Return a ring (N, 3) about the z axis, counter-clockwise seen from above; extents are exact for 4k sides."""
    a = start_rad + 2 * np.pi * np.arange(sides) / sides
    return np.stack([radius_m * np.cos(a), radius_m * np.sin(a), np.full(sides, z)], axis=1)


def rounded_rectangle(width_m: float, depth_m: float, radius_m: float, z: float = 0.0, steps: int = 5) -> Doubles:
    """Return a ring (N, 3) of 4 (steps + 1) points about the z axis."""
    r = min(radius_m, width_m / 2 - 1e-4, depth_m / 2 - 1e-4)
    ring = []
    for k, (sx, sy) in enumerate(((1, 1), (-1, 1), (-1, -1), (1, -1))):
        a = np.pi / 2 * (k + np.linspace(0, 1, steps + 1))
        ring.append(np.stack([sx * (width_m / 2 - r) + r * np.cos(a), sy * (depth_m / 2 - r) + r * np.sin(a)], axis=1))
    flat = np.concatenate(ring)
    return np.column_stack([flat, np.full(len(flat), z)])


def slab(
    width_m: float, depth_m: float, low_z: float, high_z: float, *, corner_m: float, edge_m: float, steps: int = 5
) -> Solid:
    """Return a plate with rounded corners and rounded upper and lower edges, about the z axis."""
    e = min(edge_m, 0.49 * (high_z - low_z), 0.4 * min(width_m, depth_m))
    c = max(corner_m, e + 1e-4)
    arc = np.linspace(0, np.pi / 2, 4)
    rows = [(e * (1 - math.sin(t)), low_z + e * (1 - math.cos(t))) for t in arc]
    rows += [(e * (1 - math.cos(t)), high_z - e * (1 - math.sin(t))) for t in arc]
    return loft(
        [rounded_rectangle(width_m - 2 * cut, depth_m - 2 * cut, max(c - cut, 1e-4), z, steps) for cut, z in rows]
    )


def turned_piece(profile: Sequence[tuple[float, float]], sides: int = 32) -> Solid:
    """Return the body of a profile of (radius, height), from its lower to its upper end, about the z axis."""
    return loft([circle(max(r, 0.0), sides, z) for r, z in profile])


def vessel(profile: Sequence[tuple[float, float]], wall_m: float, sides: int = 32) -> Solid:
    """Return an open vessel: the outside's (radius, height), foot to rim, and a wall of one thickness."""
    outside = [(0.0, profile[0][1]), *profile]
    inside = [(max(r - wall_m, 1e-3), max(z, profile[0][1] + wall_m)) for r, z in reversed(profile)]
    return turned_piece([*outside, *inside, (0.0, inside[-1][1])], sides)


def tube(path: npt.ArrayLike, radius_m: float | Sequence[float], sides: int = 12, *, closed: bool = False) -> Solid:
    """Return a round bar along (M, 3) points with slightly rounded ends; a ring where `closed`."""
    p = np.asarray(path, dtype=np.float64)
    radii = np.broadcast_to(np.asarray(radius_m, dtype=np.float64), len(p))
    if closed:
        return _ring_tube(p, float(radii[0]), sides)
    tangents = np.gradient(p, axis=0)
    tangents /= np.linalg.norm(tangents, axis=1, keepdims=True)
    first = np.cross(tangents[0], (0.0, 0.0, 1.0))
    frames = carried(tangents, first if np.linalg.norm(first) >= 1e-6 else np.array((1.0, 0.0, 0.0)))
    a = 2 * np.pi * np.arange(sides) / sides
    rings = p[:, None, :] + radii[:, None, None] * (np.stack([np.cos(a), np.sin(a)], axis=1) @ frames)
    head = p[0] + 0.6 * (rings[0] - p[0]) - 0.0
    tail = p[-1] + 0.6 * (rings[-1] - p[-1])
    t0, t1 = p[1] - p[0], p[-1] - p[-2]
    rings[0] += t0 / np.linalg.norm(t0) * min(0.4 * radii[0], 0.4 * float(np.linalg.norm(t0)))
    rings[-1] -= t1 / np.linalg.norm(t1) * min(0.4 * radii[-1], 0.4 * float(np.linalg.norm(t1)))
    return loft(np.concatenate([head[None], rings, tail[None]]))


def _ring_tube(p: Doubles, radius_m: float, sides: int) -> Solid:
    tangents = np.roll(p, -1, axis=0) - np.roll(p, 1, axis=0)
    tangents /= np.linalg.norm(tangents, axis=1, keepdims=True)
    outward = np.cross(tangents, np.linalg.svd(p - p.mean(axis=0))[2][2])
    a = 2 * np.pi * np.arange(sides) / sides
    rings = p[:, None] + radius_m * (
        np.cos(a)[None, :, None] * outward[:, None] + np.sin(a)[None, :, None] * np.cross(tangents, outward)[:, None]
    )
    return closed_band(rings)


def closed_band(rings: Doubles) -> Solid:
    """Return the skin over (M, N, 3) rings, metres, of which the last meets the first."""
    m, n = rings.shape[:2]
    return solid(rings.reshape(-1, 3), _between(m, n, m))


def _between(m: int, n: int, bands: int) -> Int64s:
    """Return the faces (2 n bands, 3) between each of so many of m rings of n points and the next."""
    i, j = np.meshgrid(np.arange(bands), np.arange(n), indexing="ij")
    a, b = i * n + j, i * n + (j + 1) % n
    c, d = (i + 1) % m * n + j, (i + 1) % m * n + (j + 1) % n
    return np.concatenate([np.stack([a, b, d], -1).reshape(-1, 3), np.stack([a, d, c], -1).reshape(-1, 3)])


def leg(foot: Spot, hip: Spot, foot_r: float, hip_r: float, sides: int = 16) -> Solid:
    """Return a turned leg from its foot (cut level with the floor) up to its hip, thickening evenly."""
    f, h = np.array(foot), np.array(hip)
    rows = []
    for t, scale in ((0.0, 0.85), (0.015, 1.0), (1.0, 1.0)):
        r = (foot_r + (hip_r - foot_r) * t) * scale
        rows.append(f + (h - f) * t + circle(r, sides))
    return loft(rows)


def square_leg(foot: Spot, hip: Spot, foot_m: float, hip_m: float, bevel_m: float = 0.003) -> Solid:
    """Return a square leg from its foot (cut level with the floor) up to its hip, its sides along x and y."""
    f, h = np.array(foot), np.array(hip)
    rows = []
    for t, inset in ((0.0, bevel_m), (0.01, 0.0), (1.0, 0.0)):
        side = foot_m + (hip_m - foot_m) * t - 2 * inset
        rows.append(f + (h - f) * t + rounded_rectangle(side, side, bevel_m * 1.2, steps=1))
    return loft(rows)


def curve(points: Sequence[Spot], steps: int = 8) -> Doubles:
    """Return a smooth line (N, 3) through points (Catmull and Rom 1974)."""
    p = np.asarray(points, dtype=np.float64)
    if len(p) < 3:
        return p
    ext = np.concatenate([[2 * p[0] - p[1]], p, [2 * p[-1] - p[-2]]])
    out = []
    for k in range(len(p) - 1):
        a, b, c, d = ext[k : k + 4]
        t = np.linspace(0, 1, steps, endpoint=False)[:, None]
        out.append(0.5 * (2 * b + (c - a) * t + (2 * a - 5 * b + 4 * c - d) * t**2 + (3 * b - a - 3 * c + d) * t**3))
    return np.concatenate([*out, p[-1:]])

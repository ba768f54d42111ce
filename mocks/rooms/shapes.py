"""Shapes that furniture is made of: rounded blocks, tubes, turned and soft bodies. Metres, normals outwards.

All are closed bodies, so that light never meets the back of a surface; texture coordinates are metres along the
surface, v along the longest side (the grain of wood).
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import replace
from itertools import pairwise

import numpy as np

from mocks.rooms.mesh import Mesh, merge
from mocks.worlds.light import Vector
from processing.ground.arrays import Doubles, Int32s

CREASE_RAD = math.radians(35.0)
"""A turned profile that bends more than this has a sharp edge there."""


def rounded_box(
    low: Vector, high: Vector, radius_m: float, steps: int = 1, cells: tuple[int, int, int] = (1, 1, 1)
) -> Mesh:
    """Return a block with rounded edges and corners.

    ``steps`` is the number of facets on each half of an edge's arc, ``cells`` how often the flat parts are divided
    along x, y, z (for bodies that are deformed afterwards).
    """
    lo, hi = np.array(low, dtype=np.float64), np.array(high, dtype=np.float64)
    half, middle = (hi - lo) / 2, (hi + lo) / 2
    radius = float(min(radius_m, *half))
    grain = int(np.argmax(half))
    scales = [_scale(float(h) - radius, steps, n) for h, n in zip(half, cells, strict=True)]
    sides = [_side(axis, sign, half - radius, radius, scales, grain) for axis in range(3) for sign in (1.0, -1.0)]
    whole = merge(sides)
    return replace(whole, vertices=whole.vertices + middle)


def _scale(flat: float, steps: int, cells: int) -> Doubles:
    """Return, along one axis, the (centre of curvature, tangent of the normal) of each line of the grid."""
    arc = np.tan(np.linspace(0.0, math.pi / 4, steps + 1))
    flats = np.linspace(-flat, flat, cells + 1) if flat > 1e-9 else np.zeros(1)
    centres = np.concatenate([np.full(steps, -flat), flats, np.full(steps, flat)])
    tangents = np.concatenate([-arc[:0:-1], np.zeros(len(flats)), arc[1:]])
    return np.stack([centres, tangents], axis=1)


def _side(axis: int, sign: float, flat: Doubles, radius: float, scales: list[Doubles], grain: int) -> Mesh:
    """Return one of the six sides of a rounded block around the origin."""
    a, b = (axis + 1) % 3, (axis + 2) % 3
    if sign < 0:
        a, b = b, a
    grid_a, grid_b = scales[a], scales[b]
    centre = np.zeros((len(grid_a), len(grid_b), 3))
    normal = np.zeros_like(centre)
    centre[..., a], normal[..., a] = grid_a[:, None, 0], grid_a[:, None, 1]
    centre[..., b], normal[..., b] = grid_b[None, :, 0], grid_b[None, :, 1]
    centre[..., axis], normal[..., axis] = sign * flat[axis], sign
    normal /= np.linalg.norm(normal, axis=-1, keepdims=True)
    vertices = (centre + radius * normal).reshape(-1, 3)
    u, v = (a if grain == b else b, grain) if grain != axis else sorted((a, b))
    return Mesh(vertices, normal.reshape(-1, 3), vertices[:, [u, v]], grid_faces(len(grid_a), len(grid_b)))


def grid_faces(rows: int, columns: int) -> Int32s:
    """Return the triangles of a grid of vertices (row by row), normals along d/drow x d/dcolumn."""
    index = np.arange(rows * columns).reshape(rows, columns)
    p, q, r, s = index[:-1, :-1], index[1:, :-1], index[1:, 1:], index[:-1, 1:]
    return np.concatenate([np.stack([p, q, r], -1).reshape(-1, 3), np.stack([p, r, s], -1).reshape(-1, 3)]).astype(
        np.int32
    )


def deformed(mesh: Mesh, move: Callable[[Doubles], Doubles]) -> Mesh:
    """Return the mesh with its vertices moved and smooth normals made anew."""
    return smooth(replace(mesh, vertices=move(mesh.vertices.copy())))


def smooth(mesh: Mesh) -> Mesh:
    """Return the mesh with each normal the mean (by area) of the faces that meet at its place."""
    corners = mesh.vertices[mesh.faces]
    across = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    _, place = np.unique(np.round(mesh.vertices, 6), axis=0, return_inverse=True)
    place = place.reshape(-1)
    total = np.zeros((int(place.max()) + 1, 3))
    for corner in range(3):
        np.add.at(total, place[mesh.faces[:, corner]], across)
    normals = total[place]
    return replace(mesh, normals=normals / np.maximum(np.linalg.norm(normals, axis=1, keepdims=True), 1e-12))


def turned(mesh: Mesh, axis: Vector, angle_rad: float, about: Vector = (0.0, 0.0, 0.0)) -> Mesh:
    """Return the mesh turned about an axis through a point, counter-clockwise seen from the axis' tip."""
    x, y, z = np.array(axis) / np.linalg.norm(axis)
    cross = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
    matrix = np.eye(3) + math.sin(angle_rad) * cross + (1 - math.cos(angle_rad)) * cross @ cross
    vertices = (mesh.vertices - about) @ matrix.T + about
    return replace(mesh, vertices=vertices, normals=mesh.normals @ matrix.T)


def beam(start: Vector, end: Vector, width_m: float, thickness_m: float, radius_m: float = 0.003) -> Mesh:
    """Return a bar between the middles of its ends; ``width_m`` lies as level as it can, across the bar."""
    a, b = np.array(start, dtype=np.float64), np.array(end, dtype=np.float64)
    length = float(np.linalg.norm(b - a))
    w, t = width_m / 2, thickness_m / 2
    bar = rounded_box((-w, -t, 0.0), (w, t, length), radius_m)
    along = (b - a) / length
    level = np.cross((0.0, 0.0, 1.0) if abs(along[2]) < 0.8 else (0.0, -1.0, 0.0), along)
    level /= np.linalg.norm(level)
    frame = np.stack([level, np.cross(along, level), along])
    return replace(bar, vertices=bar.vertices @ frame + a, normals=bar.normals @ frame)


def tube(points: Sequence[Vector], radius_m: float | Sequence[float], sides: int = 10) -> Mesh:
    """Return a round bar along a line of points, with flat ends; the radius may differ from point to point."""
    path = np.array(points, dtype=np.float64)
    radii = np.broadcast_to(np.asarray(radius_m, dtype=np.float64), len(path))
    steps = np.diff(path, axis=0)
    lengths = np.linalg.norm(steps, axis=1)
    along = steps / lengths[:, None]
    tangent = np.concatenate([along[:1], along[:-1] + along[1:], along[-1:]])
    tangent /= np.linalg.norm(tangent, axis=1, keepdims=True)
    rings, normals = _rings(path, tangent, radii, sides)
    slope = np.gradient(radii, np.concatenate([[0.0], np.cumsum(lengths)]))
    normals = normals - slope[:, None, None] * tangent[:, None, :]
    normals /= np.linalg.norm(normals, axis=-1, keepdims=True)
    way = np.concatenate([[0.0], np.cumsum(lengths)])
    around = np.linspace(0.0, 2 * math.pi, sides + 1) * float(radii.max())
    uv = np.stack(np.meshgrid(way, around, indexing="ij")[::-1], -1).reshape(-1, 2)
    faces = grid_faces(len(path), sides + 1)[:, ::-1].astype(np.int32)
    hull = Mesh(rings.reshape(-1, 3), normals.reshape(-1, 3), uv, faces)
    return merge([hull, disc(rings[0, ::-1][:-1], -tangent[0]), disc(rings[-1, :-1], tangent[-1])])


def _rings(path: Doubles, tangent: Doubles, radii: Doubles, sides: int) -> tuple[Doubles, Doubles]:
    """Return rings of points around a path and the directions outwards, carried along without twist."""
    angles = np.linspace(0.0, 2 * math.pi, sides + 1)
    first = np.cross(tangent[0], (1.0, 0.0, 0.0) if abs(tangent[0, 0]) < 0.7 else (0.0, 1.0, 0.0))
    out = np.empty((len(path), sides + 1, 3))
    for k, t in enumerate(tangent):
        first = first - t * (first @ t)
        first = first / np.linalg.norm(first)
        second = np.cross(t, first)
        out[k] = np.cos(angles)[:, None] * first + np.sin(angles)[:, None] * second
    return path[:, None, :] + radii[:, None, None] * out, out


def disc(rim: Doubles, normal: Doubles) -> Mesh:
    """Return a flat face within a convex rim that runs counter-clockwise about its normal."""
    middle = rim.mean(axis=0)
    first = rim[0] - middle
    first /= max(float(np.linalg.norm(first)), 1e-12)
    second = np.cross(normal, first)
    vertices = np.concatenate([middle[None], rim])
    uv = np.stack([(vertices - middle) @ first, (vertices - middle) @ second], axis=1)
    k = np.arange(len(rim))
    faces = np.stack([np.zeros_like(k), k + 1, (k + 1) % len(rim) + 1], axis=1).astype(np.int32)
    return Mesh(vertices, np.tile(normal, (len(vertices), 1)), uv, faces)


def lathe(profile: Sequence[tuple[float, float]], sides: int = 24) -> Mesh:
    """Return a body turned about z from its profile of (radius, z).

    The body lies to the left of the profile: up on the outside, down on the inside.
    """
    points = np.array(profile, dtype=np.float64)
    step = np.diff(points, axis=0)
    lengths = np.linalg.norm(step, axis=1)
    outwards = np.stack([step[:, 1], -step[:, 0]], axis=1) / lengths[:, None]
    bend = np.arccos(np.clip((outwards[:-1] * outwards[1:]).sum(axis=1), -1.0, 1.0))
    cuts = [0, *(int(k) + 1 for k in np.flatnonzero(bend > CREASE_RAD)), len(points) - 1]
    way = np.concatenate([[0.0], np.cumsum(lengths)])
    strips = [(points[a : b + 1], outwards[a:b], way[a : b + 1]) for a, b in pairwise(cuts)]
    return merge([_turned_strip(*strip, sides) for strip in strips])


def _turned_strip(points: Doubles, outwards: Doubles, way: Doubles, sides: int) -> Mesh:
    """Return a smooth strip of a turned body."""
    normal = np.concatenate([outwards[:1], outwards[:-1] + outwards[1:], outwards[-1:]])
    normal /= np.linalg.norm(normal, axis=1, keepdims=True)
    angles = np.linspace(0.0, 2 * math.pi, sides + 1)
    turn = np.stack([np.cos(angles), np.sin(angles)], axis=1)
    vertices, normals = np.empty((2, len(points), sides + 1, 3))
    vertices[..., :2], vertices[..., 2] = points[:, None, :1] * turn, points[:, None, 1]
    normals[..., :2], normals[..., 2] = normal[:, None, :1] * turn, normal[:, None, 1]
    around = angles * float(points[:, 0].max())
    uv = np.stack(np.meshgrid(way, around, indexing="ij")[::-1], -1).reshape(-1, 2)
    faces = grid_faces(len(points), sides + 1)[:, ::-1].astype(np.int32)
    return without_slivers(Mesh(vertices.reshape(-1, 3), normals.reshape(-1, 3), uv, faces))


def without_slivers(mesh: Mesh) -> Mesh:
    """Return the mesh without triangles of no area."""
    corners = mesh.vertices[mesh.faces]
    area = np.linalg.norm(np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]), axis=1)
    return replace(mesh, faces=mesh.faces[area > 1e-12])


def moved(mesh: Mesh, by: Vector) -> Mesh:
    """Return the mesh moved."""
    return replace(mesh, vertices=mesh.vertices + np.array(by))


def cylinder(bottom: Vector, radius_m: float, height_m: float, edge_m: float = 0.0, sides: int = 24) -> Mesh:
    """Return an upright cylinder whose rims are bevelled by ``edge_m``."""
    r, h, e = radius_m, height_m, min(edge_m, radius_m / 2, height_m / 2)
    profile = [(0.0, 0.0), (r - e, 0.0), (r, e), (r, h - e), (r - e, h), (0.0, h)]
    if e == 0.0:
        profile = [(0.0, 0.0), (r, 0.0), (r, h), (0.0, h)]
    return moved(lathe(profile, sides), bottom)


def ball(middle: Vector, radius_m: float, sides: int = 20) -> Mesh:
    """Return a sphere."""
    angles = np.linspace(-math.pi / 2, math.pi / 2, sides // 2 + 1)
    profile = [(abs(radius_m * math.cos(a)) if abs(a) < 1.57 else 0.0, radius_m * math.sin(a)) for a in angles]
    return moved(lathe(profile, sides), middle)

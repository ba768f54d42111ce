"""What shell and fixtures are put together from: flat faces with holes, mouldings, places on a wall."""

from __future__ import annotations

from processing.ground.arrays import Doubles

import math
import zlib
from collections.abc import Iterable, Sequence
from dataclasses import replace

import numpy as np
import shapely
from shapely.geometry import Polygon

from mocks.light import Vector
from mocks.rooms.ade import ADE20K
from mocks.rooms.mesh import Mesh, Part, merge
from mocks.rooms.model import Material, Plan, Role


def part_of(
    meshes: Mesh | Iterable[Mesh],
    material: Material,
    surface: str,
    ade: str = "wall",
    role: Role = Role.SHELL,
) -> Part:
    """Return one part of the meshes; ``ade`` is the name of its class."""
    mesh = meshes if isinstance(meshes, Mesh) else merge(meshes)
    return Part(mesh, material, surface, ADE20K[ade], role)


def on_wall(plan: Plan, wall: int, parts: Iterable[Part]) -> list[Part]:
    """Return parts made in a wall's own frame (x along it, y into the room, z up) in their place in the room."""
    (x, y), _ = plan.wall_ends(wall)
    along, _ = plan.wall_axes(wall)
    turn = math.atan2(along[1], along[0])
    return [part.placed((x, y, 0.0), turn) for part in parts]


def flat(area: Polygon, origin: Vector, u: Vector, v: Vector, back: bool = False) -> Mesh:
    """Return a polygon of the plane (u, v) at ``origin``; its normal is u x v, or against it for the ``back``.

    Texture coordinates are the polygon's own.
    """
    pieces = shapely.get_parts(shapely.constrained_delaunay_triangles(area))
    corners = np.array([shapely.get_coordinates(piece)[:3] for piece in pieces])
    flat_corners, index = np.unique(corners.reshape(-1, 2), axis=0, return_inverse=True)
    faces = index.reshape(-1, 3)
    a, b, c = (corners[:, k] for k in range(3))
    left = (b[:, 0] - a[:, 0]) * (c[:, 1] - a[:, 1]) - (b[:, 1] - a[:, 1]) * (c[:, 0] - a[:, 0]) > 0
    faces = np.where((left != back)[:, None], faces, faces[:, ::-1])
    axes = np.array([u, v], dtype=np.float64)
    normal = np.cross(axes[0], axes[1]) * (-1.0 if back else 1.0)
    vertices = flat_corners @ axes + np.array(origin)
    return Mesh(vertices, np.tile(normal, (len(vertices), 1)), flat_corners, np.asarray(faces, dtype=np.int32))


def swept(profile: Sequence[tuple[float, float]], start_m: float, end_m: float, cut: tuple[float, float]) -> Mesh:
    """Return a moulding along a wall: its profile of (y, z) swept along x, both ends closed.

    The profile runs so that the body lies to its left when seen against x. ``cut`` is how far each end gives way per
    metre from the wall, the cotangent of half the corner's angle for a mitre.
    """
    line = np.array(profile, dtype=np.float64)
    ends = np.stack([start_m + cut[0] * line[:, 0], end_m - cut[1] * line[:, 0]], axis=1)
    faces = []
    for k in range(len(line)):
        n = (k + 1) % len(line)
        step = line[n] - line[k]
        length = float(np.linalg.norm(step))
        normal = np.array([0.0, step[1], -step[0]]) / length
        low, high = (np.array([[ends[j, e], *line[j]] for e in (0, 1)]) for j in (k, n))
        vertices = np.array([low[0], low[1], high[1], high[0]])
        uv = np.stack([vertices[:, 0], np.array([0.0, 0.0, length, length])], axis=1)
        faces.append(_facing(Mesh(vertices, np.tile(normal, (4, 1)), uv, np.array([[0, 1, 2], [0, 2, 3]], np.int32))))
    section = Polygon(profile)
    for end, way, slope in ((start_m, -1.0, cut[0]), (end_m, 1.0, -cut[1])):
        cap = flat(section, (end, 0.0, 0.0), (slope, 1.0, 0.0), (0.0, 0.0, 1.0))
        normal = np.array([1.0, -slope, 0.0]) * way / math.hypot(1.0, slope)
        faces.append(_facing(replace(cap, normals=np.tile(normal, (len(cap.vertices), 1)))))
    return merge(faces)


def repeated(mesh: Mesh, moves: Doubles) -> Mesh:
    """Return one mesh of copies of a mesh, each moved by a row of ``moves`` (n, 3)."""
    count, size = len(moves), len(mesh.vertices)
    vertices = (mesh.vertices[None] + np.asarray(moves)[:, None]).reshape(-1, 3)
    faces = (mesh.faces[None] + size * np.arange(count)[:, None, None]).reshape(-1, 3)
    return Mesh(vertices, np.tile(mesh.normals, (count, 1)), np.tile(mesh.uv, (count, 1)), faces.astype(np.int32))


def mirrored(mesh: Mesh, axis: int) -> Mesh:
    """Return the mesh mirrored at the plane through the origin across an axis (0 is x)."""
    sign = np.ones(3)
    sign[axis] = -1.0
    return replace(
        mesh,
        vertices=mesh.vertices * sign,
        normals=mesh.normals * sign,
        faces=np.ascontiguousarray(mesh.faces[:, ::-1]),
    )


def _facing(mesh: Mesh) -> Mesh:
    """Return the mesh with every face turned the way of its normals."""
    corners: Doubles = mesh.vertices[mesh.faces]
    across = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    against = np.einsum("nc,nc->n", across, mesh.normals[mesh.faces[:, 0]]) < 0
    return replace(mesh, faces=np.where(against[:, None], mesh.faces[:, ::-1], mesh.faces).astype(np.int32))


def plan_rng(plan: Plan, number: int) -> np.random.Generator:
    """Return a generator for details that the plan leaves open; equal plans give equal details."""
    digest = zlib.crc32(repr((plan.polygon, plan.height_m, plan.skirting_m)).encode())
    return np.random.default_rng([digest, number])

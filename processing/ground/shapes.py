"""Shapes that things are made of: rounded blocks, tubes, turned bodies, cushions and cloth. Metres, normals outwards.

All are closed bodies, so that light never meets the back of a surface; texture coordinates are metres along the
surface, v along the longest side (the grain of wood).
"""

import math
from collections.abc import Callable, Sequence
from dataclasses import replace
from itertools import pairwise

import numpy as np

from processing.ground.arrays import Doubles, Vector
from processing.ground.mesh import Mesh, band_faces, carried, grid_faces, grid_rim, merge, moved, no_slivers, smooth

CREASE_RAD = math.radians(35.0)  # a turned profile that bends more than this has a sharp edge there


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


def deformed(mesh: Mesh, move: Callable[[Doubles], Doubles]) -> Mesh:
    """Return the mesh with its vertices (N, 3) moved and smooth normals made anew."""
    return smooth(replace(mesh, vertices=move(mesh.vertices.copy())))


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
    # Rings of points around a path and the directions outwards, carried along without twist
    angles = np.linspace(0.0, 2 * math.pi, sides + 1)[:, None]
    first = np.cross(tangent[0], (1.0, 0.0, 0.0) if abs(tangent[0, 0]) < 0.7 else (0.0, 1.0, 0.0))
    frames = carried(tangent, first)
    out = np.cos(angles) * frames[:, :1] + np.sin(angles) * frames[:, 1:]
    rings, normals = path[:, None, :] + radii[:, None, None] * out, out
    slope = np.gradient(radii, np.concatenate([[0.0], np.cumsum(lengths)]))
    normals = normals - slope[:, None, None] * tangent[:, None, :]
    normals /= np.linalg.norm(normals, axis=-1, keepdims=True)
    way = np.concatenate([[0.0], np.cumsum(lengths)])
    around = np.linspace(0.0, 2 * math.pi, sides + 1) * float(radii.max())
    uv = np.stack(np.meshgrid(way, around, indexing="ij")[::-1], -1).reshape(-1, 2)
    faces = grid_faces(len(path), sides + 1)[:, ::-1].astype(np.int32)
    hull = Mesh(rings.reshape(-1, 3), normals.reshape(-1, 3), uv, faces)
    return merge([hull, disc(rings[0, ::-1][:-1], -tangent[0]), disc(rings[-1, :-1], tangent[-1])])


def disc(rim: Doubles, normal: Doubles) -> Mesh:
    """Return a flat face within a convex rim (N, 3) that runs counter-clockwise about its normal."""
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
    return no_slivers(Mesh(vertices.reshape(-1, 3), normals.reshape(-1, 3), uv, faces))


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


def pad(low: Vector, high: Vector, radius_m: float, crown_m: float, cells: int = 5) -> Mesh:
    """Return a seat cushion: a rounded block whose broad sides swell by ``crown_m`` within the given bounds."""
    lo, hi = np.array(low, dtype=np.float64), np.array(high, dtype=np.float64)
    half, middle = (hi - lo) / 2, (hi + lo) / 2
    thin = int(np.argmin(half))
    counts = [cells, cells, cells]
    counts[thin] = 1
    lo[thin] += crown_m
    hi[thin] -= crown_m
    block = rounded_box(_vector(lo), _vector(hi), radius_m, 2, (counts[0], counts[1], counts[2]))

    def swell(vertices: Doubles) -> Doubles:
        place = (vertices - middle) / half
        dome = np.ones(len(vertices))
        for axis in range(3):
            if axis != thin:
                dome *= 1 - np.clip(np.abs(place[:, axis]), 0, 1) ** 3
        vertices[:, thin] += crown_m * dome * np.sign(place[:, thin])
        return vertices

    return deformed(block, swell)


def pillow(size_m: Vector, cells: int = 8) -> Mesh:
    """Return a pillow lying around the origin: thin at the seams, with drawn-out corners; size is x, y, z."""
    w, d, h = (s / 2 for s in size_m)
    line = np.sin(np.linspace(-math.pi / 2, math.pi / 2, cells + 1))
    x, y = np.meshgrid(line, line, indexing="ij")
    full = np.sqrt(np.clip(1 - x**4, 0, 1) * np.clip(1 - y**4, 0, 1))
    waist_x, waist_y = 1 - 0.07 * np.cos(y * math.pi / 2), 1 - 0.07 * np.cos(x * math.pi / 2)
    flat = np.stack([w * x * waist_x, d * y * waist_y], axis=-1)
    layers = [np.concatenate([flat, (s * h * (0.04 + 0.96 * full))[..., None]], axis=-1) for s in (1.0, -1.0)]
    return _two_sided(layers[0], layers[1], flat)


def _two_sided(top: Doubles, bottom: Doubles, uv: Doubles) -> Mesh:
    """Return the closed body between two grids of points (N, M, 3), the top's normals along d/drow x d/dcolumn.

    The rim has normals of its own, as a seam or the edge of a leaf has."""
    n, m = top.shape[:2]
    faces, rim = grid_faces(n, m), grid_rim(n, m)
    k = np.arange(len(rim))
    band = band_faces(k, k + len(rim))
    flat = uv.reshape(-1, 2)
    points = [top.reshape(-1, 3), bottom.reshape(-1, 3)]
    edge = np.concatenate([points[0][rim], points[1][rim]])
    sides = ((points[0], flat, faces), (points[1], flat, faces[:, ::-1]), (edge, np.tile(flat[rim], (2, 1)), band))
    return merge([smooth(Mesh(v, np.zeros_like(v), t, f.astype(np.int32))) for v, t, f in sides])


def sheet(surface: Doubles, thickness_m: float) -> Mesh:
    """Return cloth of a thickness under a grid of points (N, M, 3); its upper side looks along d/drow x d/dcolumn."""
    rows, columns = (np.gradient(surface, axis=k) for k in (0, 1))
    normal = np.cross(rows, columns)
    normal /= np.maximum(np.linalg.norm(normal, axis=-1, keepdims=True), 1e-12)
    way = [np.linalg.norm(np.diff(surface, axis=k), axis=-1) for k in (0, 1)]
    u = np.concatenate([np.zeros((1, surface.shape[1])), np.cumsum(way[0], axis=0)])
    v = np.concatenate([np.zeros((surface.shape[0], 1)), np.cumsum(way[1], axis=1)], axis=1)
    return _two_sided(surface, surface - thickness_m * normal, np.stack([u, v], axis=-1))


def _vector(values: Doubles) -> Vector:
    return (float(values[0]), float(values[1]), float(values[2]))

"""Soft and thin shapes: seat cushions, pillows, cloth laid over edges, leaves. Metres; closed bodies."""

from __future__ import annotations

import math

import numpy as np

from mocks.rooms.mesh import Mesh, merge
from mocks.rooms.shapes import deformed, grid_faces, rounded_box, smooth
from mocks.worlds.light import Vector
from processing.ground.arrays import Doubles


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
    """Return the closed body between two grids of points (n, m, 3), the top's normals along d/drow x d/dcolumn.

    The rim has normals of its own, as a seam or the edge of a leaf has.
    """
    n, m = top.shape[:2]
    faces, index = grid_faces(n, m), np.arange(n * m).reshape(n, m)
    rim = np.concatenate([index[:-1, 0], index[-1, :-1], index[:0:-1, -1], index[0, :0:-1]])
    k = np.arange(len(rim))
    after = (k + 1) % len(rim)
    band = np.concatenate(
        [np.stack([k, k + len(rim), after + len(rim)], -1), np.stack([k, after + len(rim), after], -1)]
    )
    flat = uv.reshape(-1, 2)
    points = [top.reshape(-1, 3), bottom.reshape(-1, 3)]
    edge = np.concatenate([points[0][rim], points[1][rim]])
    sides = ((points[0], flat, faces), (points[1], flat, faces[:, ::-1]), (edge, np.tile(flat[rim], (2, 1)), band))
    return merge([smooth(Mesh(v, np.zeros_like(v), t, f.astype(np.int32))) for v, t, f in sides])


def sheet(surface: Doubles, thickness_m: float) -> Mesh:
    """Return cloth of a thickness under a grid of points (n, m, 3); its upper side looks along d/drow x d/dcolumn."""
    rows, columns = (np.gradient(surface, axis=k) for k in (0, 1))
    normal = np.cross(rows, columns)
    normal /= np.maximum(np.linalg.norm(normal, axis=-1, keepdims=True), 1e-12)
    way = [np.linalg.norm(np.diff(surface, axis=k), axis=-1) for k in (0, 1)]
    u = np.concatenate([np.zeros((1, surface.shape[1])), np.cumsum(way[0], axis=0)])
    v = np.concatenate([np.zeros((surface.shape[0], 1)), np.cumsum(way[1], axis=1)], axis=1)
    return _two_sided(surface, surface - thickness_m * normal, np.stack([u, v], axis=-1))


def leaf(length_m: float, width_m: float, bend_rad: float, fold: float = 0.25, cells: int = 5) -> Mesh:
    """Return a leaf that grows from the origin along y, rising first and drooping by ``bend_rad`` over its length."""
    t = np.linspace(0.0, 1.0, cells + 1)
    angle = -bend_rad * t
    step = np.stack([np.cos(angle), np.sin(angle)], axis=1) * (length_m / cells)
    line = np.concatenate([np.zeros((1, 2)), np.cumsum(step[:-1], axis=0)])
    half = width_m / 2 * np.maximum(np.sin(math.pi * np.clip(t, 0.02, 0.985) ** 0.75), 0.03)
    across = np.array([-1.0, 0.0, 1.0])
    x = half[:, None] * across
    y = np.broadcast_to(line[:, :1], x.shape)
    z = line[:, 1:] + fold * half[:, None] * np.abs(across)
    surface = np.stack([x, y, z], axis=-1).transpose(1, 0, 2)
    return sheet(surface, 0.0012)


def blade(length_m: float, width_m: float, lean_rad: float, bend_rad: float, cells: int = 6) -> Mesh:
    """Return an upright sword leaf: wide in the middle, pointed, leaning and bending towards y."""
    t = np.linspace(0.0, 1.0, cells + 1)
    angle = math.pi / 2 - lean_rad - bend_rad * t
    step = np.stack([np.cos(angle), np.sin(angle)], axis=1) * (length_m / cells)
    line = np.concatenate([np.zeros((1, 2)), np.cumsum(step[:-1], axis=0)])
    half = width_m / 2 * np.clip(np.minimum(0.55 + t, (1.0 - t) * 2.2), 0.03, 1.0)
    x = half[:, None] * np.array([-1.0, 0.0, 1.0])
    surface = np.stack([x, np.broadcast_to(line[:, :1], x.shape), np.broadcast_to(line[:, 1:], x.shape)], axis=-1)
    return sheet(surface.transpose(1, 0, 2), 0.002)


def _vector(values: Doubles) -> Vector:
    return (float(values[0]), float(values[1]), float(values[2]))

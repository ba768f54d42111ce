"""Cheap light for training rooms: sky through panes, lamps, one bounce with colour, and direct sun.

Not physical in its amounts, which are drawn anyway; right in its forms: gradients from the windows, contact shadows,
patches of sun where the sun can shine.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from mocks.rooms.light.geometry import Geometry
from processing.ground.arrays import Doubles, Flags, Floats, Int32s

Panes = list[tuple[Doubles, Doubles, Doubles]]

STEP = 4
"""Pixels of the fine picture per point at which light is gathered."""
_PANE_RAYS = 10
_BOUNCE_RAYS = 8
_LIFT_M = 2e-3


@dataclass(frozen=True)
class Points:
    """Surface points of the fine picture (H, W, ...): place, normal towards the camera, and which are surfaces."""

    place: Floats
    normal: Floats
    solid: Flags


@dataclass(frozen=True)
class Gathered:
    """Light at the coarse points (H, W), before any colours are chosen."""

    sky: Floats
    lamps: Floats
    open_share: Floats
    """How far away the surroundings are, 0..1: contact shadows."""
    bounce_face: Int32s
    """(H, W, N): triangles that light comes from; -1 none."""


def coarse(points: Points) -> Points:
    """Return every fourth point each way."""
    at = (slice(STEP // 2 - 1, None, STEP), slice(STEP // 2 - 1, None, STEP))
    return Points(points.place[at], points.normal[at], points.solid[at])


def gather(
    rng: np.random.Generator, geometry: Geometry, points: Points, panes: Panes, lamps: list[tuple[float, float, float]]
) -> Gathered:
    """Return the light at coarse points."""
    shape = points.solid.shape
    mine = np.flatnonzero(points.solid.reshape(-1))
    place = points.place.reshape(-1, 3)[mine]
    normal = points.normal.reshape(-1, 3)[mine]
    start = place + normal * np.float32(_LIFT_M)

    def spread(values: npt.NDArray[np.generic], empty: float, kind: type) -> npt.NDArray[np.generic]:
        out = np.full((points.solid.size, *values.shape[1:]), empty, kind)
        out[mine] = values
        return out.reshape(*shape, *values.shape[1:])

    face, distance = _bounces(rng, geometry, start, normal)
    share = np.minimum(distance, 4.0)
    return Gathered(
        np.asarray(spread(_sky(rng, geometry, start, normal, panes), 0, np.float32), np.float32),
        np.asarray(spread(_lamps(geometry, start, normal, lamps), 0, np.float32), np.float32),
        np.asarray(spread((share / (share + 0.35)).mean(axis=1), 1, np.float32), np.float32),
        np.asarray(spread(face, -1, np.int32), np.int32),
    )


def _sky(rng: np.random.Generator, geometry: Geometry, start: Floats, normal: Floats, panes: Panes) -> Floats:
    out = np.zeros(len(start), np.float32)
    if not panes:
        return out
    corner, u, v = (np.array([pane[k] for pane in panes], np.float32) for k in range(3))
    cross = np.cross(u, v)
    area = np.linalg.norm(cross, axis=1)
    facing = cross / area[:, None]
    chance = area / area.sum()
    for _ in range(_PANE_RAYS):
        pane = rng.choice(len(panes), len(start), p=chance)
        a, b = rng.random((2, len(start), 1), dtype=np.float32)
        away = corner[pane] + a * u[pane] + b * v[pane] - start
        far = np.linalg.norm(away, axis=1)
        ray = away / np.maximum(far, 1e-3)[:, None]
        cosine = np.einsum("ij,ij->i", ray, normal)
        slant = np.abs(np.einsum("ij,ij->i", ray, facing[pane]))
        worth = np.flatnonzero(cosine > 0.01)
        seen = worth[~geometry.blocked(start[worth], ray[worth])]
        out[seen] += (cosine * slant / np.maximum(far, 0.15) ** 2)[seen] * np.float32(area.sum() / _PANE_RAYS)
    return out


def _lamps(geometry: Geometry, start: Floats, normal: Floats, lamps: list[tuple[float, float, float]]) -> Floats:
    out = np.zeros(len(start), np.float32)
    for lamp in lamps[:4]:
        away = np.array(lamp, np.float32) - start
        far = np.linalg.norm(away, axis=1)
        ray = away / np.maximum(far, 1e-3)[:, None]
        cosine = np.einsum("ij,ij->i", ray, normal)
        worth = np.flatnonzero(cosine > 0)
        free = worth[geometry.cast(start[worth], ray[worth]).distance_m > far[worth] - 0.05]
        out[free] += cosine[free] / np.maximum(far[free], 0.3) ** 2
    return out


def _bounces(rng: np.random.Generator, geometry: Geometry, start: Floats, normal: Floats) -> tuple[Int32s, Floats]:
    """Return what is met in directions spread by the cosine: triangles and distances (n, rays)."""
    count = len(start)
    turn, radius = rng.random((2, count, _BOUNCE_RAYS), dtype=np.float32)
    turn, radius = turn * np.float32(2 * np.pi), np.sqrt(radius)
    helper = np.where(np.abs(normal[:, 2:]) < 0.9, np.array([[0, 0, 1]], np.float32), np.array([[1, 0, 0]], np.float32))
    a = np.cross(helper, normal)
    a /= np.linalg.norm(a, axis=1, keepdims=True)
    b = np.cross(normal, a)
    x, y = radius * np.cos(turn), radius * np.sin(turn)
    z = np.sqrt(np.maximum(1 - radius**2, 0))
    rays = x[..., None] * a[:, None] + y[..., None] * b[:, None] + z[..., None] * normal[:, None]
    hits = geometry.cast(np.repeat(start, _BOUNCE_RAYS, axis=0), rays.reshape(-1, 3).astype(np.float32))
    distance = np.where(hits.face < 0, np.float32(50), hits.distance_m)
    return hits.face.reshape(count, -1), distance.reshape(count, -1)


def sunlit(geometry: Geometry, points: Points, direction: Floats) -> Floats:
    """Return 1 where fine points see the sun, (H, W)."""
    out = np.zeros(points.solid.size, np.float32)
    normal = points.normal.reshape(-1, 3)
    mine = np.flatnonzero((normal @ direction > 0.02) & points.solid.reshape(-1))
    start = points.place.reshape(-1, 3)[mine] + normal[mine] * np.float32(_LIFT_M)
    out[mine] = ~geometry.blocked(start, np.broadcast_to(direction, start.shape).astype(np.float32))
    return out.reshape(points.solid.shape)


def smoothed(points: Points, light: Floats, reach: int = 2) -> Floats:
    """Return light (H, W, C) averaged with neighbours on the same plane."""
    total, weight = np.zeros_like(light), np.full(light.shape[:2], 1e-6, np.float32)
    height = light.shape[0]
    rows = np.arange(height)
    plane = np.einsum("ijk,ijk->ij", points.place, points.normal)
    for down in range(-reach, reach + 1):
        source = np.clip(rows + down, 0, height - 1)
        for right in range(-reach, reach + 1):
            n = np.roll(points.normal[source], -right, axis=1)
            p = np.roll(plane[source], -right, axis=1)
            same = (np.einsum("ijk,ijk->ij", n, points.normal) > 0.95) & (np.abs(p - plane) < 0.05)
            same &= np.roll(points.solid[source], -right, axis=1)
            total += np.roll(light[source], -right, axis=1) * same[..., None]
            weight += same
    return np.asarray(total / weight[..., None], dtype=np.float32)

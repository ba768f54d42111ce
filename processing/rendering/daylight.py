"""Light that comes straight from outside: through each pane by solid angle, and the sun's disc with shadow rays."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from processing.rendering.chance import Key, random
from processing.rendering.kernels import FIRST, SECOND, STEP_OFF_M, add_outdoors, pane_rays, towards_panes
from processing.rendering.patches import PANE
from processing.rendering.scene import Doubles, Floats, Pane, Sun
from processing.rendering.stage import RAYS_AT_ONCE, Stage
from processing.rendering.tracer import Hits

RIM_RAYS, RIM_AREA = 12, 0.98
"""Rays to the sun's rim (as a share of its area): if they agree, less than 2 % of the disc can look otherwise."""


def skylight(stage: Stage, points: Floats, normals: Floats, samples: int, key: Key) -> Doubles:
    """Return the irradiance (n, 3) that the panes give, without the sun.

    Parameters
    ----------
    points
        (n, k, 3): one place each (k = 1), or ``samples`` of them, one for each ray.
    samples
        Rays to each pane from each point.
    """
    out = np.zeros((len(normals), 3))
    at_once = max(1, RAYS_AT_ONCE // samples)
    for number, pane in enumerate(stage.scene.panes):
        shifts = random((*key, number), len(normals), 2)
        for start in range(0, len(normals), at_once):
            part = slice(start, start + at_once)
            out[part] += _through(stage, number, pane, points[part], normals[part], shifts[part], samples)
    return out


def _through(
    stage: Stage, number: int, pane: Pane, points: Floats, normals: Floats, shifts: Doubles, samples: int
) -> Doubles:
    shape = (len(normals), samples)
    origins, directions = np.empty((*shape, 3), np.float32), np.empty((*shape, 3), np.float32)
    weight = np.empty(shape, np.float32)
    pane_rays(
        *(points, normals, shifts, 0, samples, pane.corner_m, pane.across_m, pane.up_m, origins, directions, weight)
    )
    useful = np.flatnonzero(weight.ravel() > 0)
    ray_origins, rays = origins.reshape(-1, 3)[useful], directions.reshape(-1, 3)[useful]
    hits = stage.tracer.cast(ray_origins, rays)
    out = np.zeros((len(normals), 3))
    p = stage.patches
    add_outdoors(
        *(p.owner, p.item, number, hits.triangle, useful // samples, rays, weight.ravel()[useful]),
        *(stage.scene.outdoors.rgb, np.asarray(pane.transmittance)),
        *(_cells(pane, ray_origins, rays, hits), pane.clear.ravel(), pane.veil_cd_m2.reshape(-1, 3), samples, out),
    )
    return out


def _cells(pane: Pane, origins: Floats, rays: Floats, hits: Hits) -> npt.NDArray[np.intp]:
    """Return the flat index of the pane's cell that each ray meets; of rays that meet something else, any."""
    if pane.clear.size == 1:
        return np.zeros(len(rays), np.intp)
    distance = np.where(np.isfinite(hits.distance_m), hits.distance_m, 0)
    row, column = pane.cells(origins + distance[:, None] * rays)
    return np.asarray(row * pane.clear.shape[1] + column)


def sunlight(stage: Stage, points: Floats, normals: Floats, samples: int, key: Key) -> Doubles:
    """Return the sun's direct irradiance (n, 3); ``points`` (n, k, 3) with k = 1 or ``samples``."""
    out = np.zeros((len(normals), 3))
    sun, panes = stage.scene.outdoors.sun, stage.scene.panes
    if sun is None or not panes:
        return out
    cosine = normals @ np.asarray(sun.direction, np.float32)
    corners = [np.array([getattr(p, name) for p in panes]) for name in ("corner_m", "across_m", "up_m")]
    for k in range(points.shape[1]):
        near = np.zeros(len(normals), bool)
        towards_panes(points[:, k], np.asarray(sun.direction, np.float64), *corners, near)
        chosen = np.flatnonzero(near & (cosine > 0))
        if points.shape[1] == 1:
            out[chosen] = _adaptive(stage, sun, points[chosen, 0], normals[chosen], samples, key)
        else:
            chance = random((*key, k), len(normals), 2)[chosen]
            out[chosen] += _disc_light(stage, sun, points[chosen, k], normals[chosen], chance) / samples
    return out


def _adaptive(stage: Stage, sun: Sun, points: Floats, normals: Floats, samples: int, key: Key) -> Doubles:
    """Return the sun's irradiance by rays to its rim, and by ``samples`` all over it where those differ."""
    shift = random((*key, 0), len(points), 2)
    rim = np.empty((RIM_RAYS, len(points), 3))
    for k in range(RIM_RAYS):
        spread = np.column_stack([np.full(len(points), RIM_AREA), (shift[:, 1] + k) / RIM_RAYS])
        rim[k] = _disc_light(stage, sun, points, normals, spread)
    out: Doubles = rim.mean(axis=0)
    unsure = np.flatnonzero((rim.max(axis=0) > 1.01 * rim.min(axis=0)).any(axis=1))
    out[unsure] = 0
    for k in range(samples if len(unsure) else 0):
        spread = (shift[unsure] + (k + 0.5) * np.array([FIRST, SECOND])) % 1.0
        out[unsure] += _disc_light(stage, sun, points[unsure], normals[unsure], spread) / samples
    return out


def _disc_light(stage: Stage, sun: Sun, points: Floats, normals: Floats, chance: Doubles) -> Doubles:
    """Return the irradiance by one random place of the sun's disc for each point."""
    rays = disc_directions(sun, chance)
    start = points + np.float32(STEP_OFF_M) * normals
    hits = stage.tracer.cast(start, rays)
    p = stage.patches
    through = (hits.triangle >= 0) & (p.owner[hits.triangle] == PANE)
    tint = np.zeros((len(points), 3))
    for number, pane in enumerate(stage.scene.panes):
        mine = np.flatnonzero(through & (p.item[hits.triangle] == number))
        row, column = pane.cells(start[mine] + hits.distance_m[mine, None] * rays[mine])
        tint[mine] = pane.clear[row, column, None] * np.asarray(pane.transmittance)
    cosine = np.maximum(np.einsum("ij,ij->i", normals, rays), 0)
    return np.asarray(tint * cosine[:, None] * np.asarray(sun.normal_illuminance_lx))


def disc_directions(sun: Sun, chance: Doubles) -> Floats:
    """Return directions (n, 3) spread evenly over the sun's disc by random numbers (n, 2)."""
    axis = np.asarray(sun.direction, np.float64)
    side = np.cross(axis, (0.0, 0.0, 1.0) if abs(axis[2]) < 0.9 else (1.0, 0.0, 0.0))
    side /= np.linalg.norm(side)
    radius = np.tan(sun.radius_rad) * np.sqrt(chance[:, :1])
    angle = 2 * np.pi * chance[:, 1:]
    rays = axis + radius * (np.cos(angle) * side + np.sin(angle) * np.cross(axis, side))
    return np.asarray(rays / np.linalg.norm(rays, axis=1, keepdims=True), dtype=np.float32)

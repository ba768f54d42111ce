"""Light that comes straight from outside: through each pane by solid angle, and the sun's disc with shadow rays."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from processing.ground.arrays import Doubles, Floats, Int32s
from processing.light.scene.patches import PANE
from processing.light.scene.scene import Pane, Sun, transmittance_table
from processing.light.scene.tracer import Hits
from processing.light.solver.kernels import STEP_OFF_M, Key, add_outdoors, pane_rays, random, towards_panes
from processing.light.solver.stage import RAYS_AT_ONCE, Stage
from processing.light.solver.sun_picture import disc_rays, disc_tints

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
        *(stage.scene.outdoors.rgb, transmittance_table(pane.transmittance, pane.sheets), pane.normal),
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
    """Return the sun's irradiance of places (n, 3) by rays to its rim, and all over it where those differ."""
    cosine = np.maximum(normals @ np.asarray(sun.direction), 0)
    tint, _ = sun_tint(stage, sun, points, normals, samples, random((*key, 0), len(points), 2))
    return np.asarray(tint * cosine[:, None] * np.asarray(sun.normal_illuminance_lx))


def sun_tint(
    stage: Stage, sun: Sun, points: Floats, normals: Floats, samples: int, shifts: Doubles
) -> tuple[Floats, npt.NDArray[np.bool_]]:
    """Return what of the sun's disc (n, 3) reaches places (n, 3) through glass, and which (n,) lie in half shadow.

    Rays to its rim tell; where they differ, ``samples`` all over it. ``shifts`` (n, 2) are random numbers.
    """
    glass = _Glass.of(stage, sun)
    frame = disc_frame(sun)
    tint, unsure = _tints(stage, glass, frame, points, normals, shifts, RIM_RAYS, RIM_AREA)
    again = np.flatnonzero(unsure)
    if len(again):
        tint[again], _ = _tints(stage, glass, frame, points[again], normals[again], shifts[again], samples, 0.0)
    return tint, unsure


@dataclass(frozen=True)
class _Glass:
    """A stage's panes as compiled loops take them (`sun_kernels.disc_tints`)."""

    panes: Doubles
    sizes: Int32s
    tints: Doubles
    clear: Floats

    @classmethod
    def of(cls, stage: Stage, sun: Sun) -> _Glass:
        every, towards = stage.scene.panes, np.asarray(sun.direction, np.float64)[None]
        panes = [(p.corner_m, p.across_m / (p.across_m @ p.across_m), p.up_m / (p.up_m @ p.up_m)) for p in every]
        first = np.cumsum([0] + [p.clear.size for p in every[:-1]])
        sizes = [(*p.clear.shape, start) for p, start in zip(every, first, strict=True)]
        tints = [p.through(towards)[0] for p in every]
        clear = np.concatenate([p.clear.ravel() for p in every]).astype(np.float32)
        return cls(np.array(panes, np.float64), np.array(sizes, np.int32), np.array(tints, np.float64), clear)


def _tints(
    stage: Stage,
    glass: _Glass,
    frame: Doubles,
    points: Floats,
    normals: Floats,
    shifts: Doubles,
    samples: int,
    rim_area: float,
) -> tuple[Floats, npt.NDArray[np.bool_]]:
    """Return the mean of what glass lets through of each place's rays (n, 3), and where (n,) those differ."""
    out, apart = np.empty((len(points), 3), np.float32), np.empty(len(points), np.bool_)
    p = stage.patches
    at_once = max(1, RAYS_AT_ONCE // samples)
    for start in range(0, len(points), at_once):
        part = slice(start, start + at_once)
        origins, rays = np.empty((2, len(points[part]), samples, 3), np.float32)
        disc_rays(points[part], normals[part], shifts[part], frame, rim_area, samples, origins, rays)
        hits = stage.tracer.cast(origins.reshape(-1, 3), rays.reshape(-1, 3))
        disc_tints(
            *(p.owner, p.item, hits.triangle, hits.distance_m, origins, rays),
            *(glass.panes, glass.sizes, glass.tints, glass.clear, out[part], apart[part]),
        )
    return out, apart


def disc_frame(sun: Sun) -> Doubles:
    """Return the way to the sun's middle and two sides across it, as long as its radius at a distance of 1: (3, 3)."""
    axis = np.asarray(sun.direction, np.float64)
    side = np.cross(axis, (0.0, 0.0, 1.0) if abs(axis[2]) < 0.9 else (1.0, 0.0, 0.0))
    side /= np.linalg.norm(side)
    return np.asarray(np.array([axis, *(np.tan(sun.radius_rad) * np.array([side, np.cross(axis, side)]))]))


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
        tint[mine] = pane.clear[row, column, None] * pane.through(rays[mine])
    cosine = np.maximum(np.einsum("ij,ij->i", normals, rays), 0)
    return np.asarray(tint * cosine[:, None] * np.asarray(sun.normal_illuminance_lx))


def disc_directions(sun: Sun, chance: Doubles) -> Floats:
    """Return directions (n, 3) spread evenly over the sun's disc by random numbers (n, 2)."""
    axis, side, other = disc_frame(sun)
    angle = 2 * np.pi * chance[:, 1:]
    rays = axis + np.sqrt(chance[:, :1]) * (np.cos(angle) * side + np.sin(angle) * other)
    return np.asarray(rays / np.linalg.norm(rays, axis=1, keepdims=True), dtype=np.float32)

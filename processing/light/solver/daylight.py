"""Light that comes straight from outside: through each pane by solid angle, and the sun's disc with shadow rays."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from processing.ground.arrays import Doubles, Floats, Int32s
from processing.light.scene.scene import Pane, Sun, transmittance_table
from processing.light.scene.tracer import Hits
from processing.light.solver.kernels import (
    FIRST,
    PANE,
    SECOND,
    STEP_OFF_M,
    Key,
    add_outdoors,
    compiled,
    pane_rays,
    random,
    towards_panes,
)
from processing.light.solver.stage import RAYS_AT_ONCE, Stage


@compiled
def disc_rays(points, normals, shifts, frame, rim_area, samples, origins, directions):  # type: ignore[no-untyped-def]
    """Fill rays (n, samples, 3) to the sun's disc: even over it, or with ``rim_area`` > 0 around that share of it.

    ``frame`` (3, 3): the way to its middle, and two sides as long as its radius at a distance of 1.
    """
    for i in range(points.shape[0]):
        for s in range(samples):
            if rim_area > 0:
                u, v = rim_area, (shifts[i, 1] + s) / samples
            else:
                u = (shifts[i, 0] + (s + 0.5) * FIRST) % 1.0
                v = (shifts[i, 1] + (s + 0.5) * SECOND) % 1.0
            radius, angle = math.sqrt(u), 2 * math.pi * v
            p, q = radius * math.cos(angle), radius * math.sin(angle)
            x = frame[0, 0] + p * frame[1, 0] + q * frame[2, 0]
            y = frame[0, 1] + p * frame[1, 1] + q * frame[2, 1]
            z = frame[0, 2] + p * frame[1, 2] + q * frame[2, 2]
            length = math.sqrt(x * x + y * y + z * z)
            directions[i, s, 0], directions[i, s, 1], directions[i, s, 2] = x / length, y / length, z / length
            for c in range(3):
                origins[i, s, c] = points[i, c] + STEP_OFF_M * normals[i, c]


@compiled
def disc_tints(  # type: ignore[no-untyped-def]
    owner, item, triangle, distance, origins, directions, panes, sizes, tints, clear, out, apart
):
    """Fill the mean of what glass lets through (n, 3) of each point's rays (n, samples), and whether they differ.

    ``panes`` (p, 3, 3): corner, across / length^2, up / length^2; ``sizes`` (p, 3): rows, columns and first cell of
    each in ``clear``; ``tints`` (p, 3).
    """
    samples = directions.shape[1]
    for i in range(directions.shape[0]):
        low, high = 1e30, -1e30
        out[i, 0] = out[i, 1] = out[i, 2] = 0.0
        for s in range(samples):
            k = i * samples + s
            t = triangle[k]
            level = 0.0
            if t >= 0 and owner[t] == PANE:
                j = item[t]
                u = v = 0.0
                for c in range(3):
                    place = origins[i, s, c] + distance[k] * directions[i, s, c] - panes[j, 0, c]
                    u += place * panes[j, 1, c]
                    v += place * panes[j, 2, c]
                rows, columns = sizes[j, 0], sizes[j, 1]
                row = min(max(math.floor((1.0 - v) * rows), 0), rows - 1)
                column = min(max(math.floor(u * columns), 0), columns - 1)
                share = clear[sizes[j, 2] + row * columns + column]
                for c in range(3):
                    out[i, c] += share * tints[j, c]
                    level += share * tints[j, c]
            low, high = min(low, level), max(high, level)
        for c in range(3):
            out[i, c] /= samples
        apart[i] = high > 1.01 * low


@compiled
def settle_blocks(  # type: ignore[no-untyped-def]
    step, label, normals, points, chosen, sure, tint, todo
):
    """Fill what lies within blocks of pixels whose four corners agree, and mark all else as still to be looked at.

    A block counts only where all its pixels are ``chosen``, show one thing, and lie in one plane; ``sure`` (h, w) are
    corners of which ``tint`` (h, w, 3) is known. Blocks share their corners' rows and columns.
    """
    high, wide = label.shape
    for top in range(0, high, step):
        bottom = min(top + step, high - 1)
        for left in range(0, wide, step):
            right = min(left + step, wide - 1)
            alike = sure[top, left] and sure[top, right] and sure[bottom, left] and sure[bottom, right]
            if alike:
                for c in range(3):
                    value = tint[top, left, c]
                    slack = 1e-6 + 0.001 * value
                    alike = alike and abs(tint[top, right, c] - value) <= slack
                    alike = alike and abs(tint[bottom, left, c] - value) <= slack
                    alike = alike and abs(tint[bottom, right, c] - value) <= slack
            alike = alike and _one_plane(top, bottom, left, right, label, normals, points, chosen)
            for r in range(top, min(top + step, high)):
                for k in range(left, min(left + step, wide)):
                    if not chosen[r, k] or sure[r, k]:
                        continue
                    if alike:
                        tint[r, k, 0], tint[r, k, 1], tint[r, k, 2] = (
                            tint[top, left, 0],
                            tint[top, left, 1],
                            tint[top, left, 2],
                        )
                    else:
                        todo[r, k] = True


@compiled
def _one_plane(top, bottom, left, right, label, normals, points, chosen):  # type: ignore[no-untyped-def]
    first = label[top, left]
    for r in range(top, bottom + 1):
        for k in range(left, right + 1):
            if label[r, k] != first or not chosen[r, k]:
                return False
            turned = lift = 0.0
            for c in range(3):
                turned += normals[top, left, c] * normals[r, k, c]
                lift += normals[top, left, c] * (points[r, k, c] - points[top, left, c])
            if turned < 0.99 or abs(lift) > 0.003:
                return False
    return True


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

"""The sun's direct light on all pixels of a picture: one ray to its middle, many only where its edge falls."""

from __future__ import annotations

import math

import cv2
import numpy as np
import numpy.typing as npt

from processing.ground.arrays import Doubles, Floats
from processing.light.scene.patches import PANE
from processing.light.scene.scene import Sun
from processing.light.solver.kernels import random, towards_panes
from processing.light.solver.relight_kernels import disc_rays
from processing.light.solver.stage import Stage

MARGIN_PX = 1.5


def sun_on_places(stage: Stage, points: Floats, normals: Floats, samples: int, shift: Doubles) -> Floats:
    """Return the sun's irradiance (n, 3) on places that may see it, by ``samples`` rays over its disc each."""
    sun = stage.scene.outdoors.sun
    out = np.zeros((len(points), 3), np.float32)
    if sun is None or not len(points):
        return out
    axis = np.asarray(sun.direction, np.float64)
    side = np.cross(axis, (0.0, 0.0, 1.0) if abs(axis[2]) < 0.9 else (1.0, 0.0, 0.0))
    side /= np.linalg.norm(side)
    origins, rays = np.empty((2, len(points), samples, 3), np.float32)
    tangent = math.tan(sun.radius_rad)
    disc_rays(points, normals, axis, side, np.cross(axis, side), tangent, shift, samples, origins, rays)
    share = _through(stage, origins.reshape(-1, 3), rays.reshape(-1, 3)).reshape(len(points), samples, 3).mean(axis=1)
    cosine = np.maximum(normals @ axis.astype(np.float32), 0)
    return np.asarray(share * cosine[:, None] * np.asarray(sun.normal_illuminance_lx, np.float32))


def _through(stage: Stage, origins: Floats, rays: Floats) -> Floats:
    """Return what share (n, 3) of the light along each ray its pane lets in; 0 where it meets no pane."""
    hits = stage.tracer.cast(origins, rays)
    p = stage.patches
    out = np.zeros((len(rays), 3), np.float32)
    through = np.flatnonzero((hits.triangle >= 0) & (p.owner[hits.triangle] == PANE))
    which = p.item[hits.triangle[through]]
    for number in np.unique(which):
        pane, mine = stage.scene.panes[number], through[which == number]
        glass = pane.through(rays[mine])
        if pane.clear.size == 1:
            out[mine] = pane.clear[0, 0] * glass
        else:
            row, column = pane.cells(origins[mine] + hits.distance_m[mine, None] * rays[mine])
            out[mine] = pane.clear[row, column, None] * glass
    return out


def may_see_sun(stage: Stage, sun: Sun, points: Floats, normals: Floats) -> npt.NDArray[np.bool_]:
    """Return which places (n,) face the sun through a pane, were nothing else in the way."""
    near = np.zeros(len(points), bool)
    panes = stage.scene.panes
    if panes:
        corners = [np.array([getattr(p, name) for p in panes]) for name in ("corner_m", "across_m", "up_m")]
        towards_panes(points, np.asarray(sun.direction, np.float64), *corners, near)
    return near & (normals @ np.asarray(sun.direction, np.float32) > 0)


def sun_on_picture(
    stage: Stage, points: Floats, normals: Floats, shape: tuple[int, int], samples: int, seed: int
) -> Floats:
    """Return the sun's irradiance (n, 3) of a panorama's pixels (n = H x W, row by row).

    Where a pixel's neighbours see as much of the sun's middle as it does, the middle tells of all its disc; within the
    width of the half shadow of others, ``samples`` rays do.
    """
    out = np.zeros((len(points), 3), np.float32)
    sun = stage.scene.outdoors.sun
    if sun is None:
        return out
    near = np.flatnonzero(may_see_sun(stage, sun, points, normals))
    if not len(near):
        return out
    middle = sun_on_places(stage, points[near], normals[near], 1, np.zeros((len(near), 2)))
    out[near] = middle
    cosine = normals[near] @ np.asarray(sun.direction, np.float32)
    edge = _edges(near, middle.sum(axis=1) / np.maximum(cosine, 1e-3), shape)
    if len(edge):
        shift = random((seed, 90), len(edge), 2)
        out[near[edge]] = sun_on_places(stage, points[near[edge]], normals[near[edge]], samples, shift)
    return out


def _edges(near: npt.NDArray[np.int64], level: Floats, shape: tuple[int, int]) -> npt.NDArray[np.int64]:
    """Return which of the pixels near the sun's patch lie within the width of a half shadow of its edge."""
    full = np.full(shape[0] * shape[1], -1.0, np.float32)
    full[near] = level
    whole = full.reshape(shape)
    radius = MARGIN_PX + 0.02 * shape[0] / math.pi  # the sun is 0.0093 wide; its shadow's edge may lie beside the eye
    size = 2 * math.ceil(radius) + 1
    kernel = cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (size, size))
    side = size // 2
    padded = np.concatenate([whole[:, -side:], whole, whole[:, :side]], axis=1)
    high, low = cv2.dilate(padded, kernel), cv2.erode(np.where(padded < 0, np.float32(1e9), padded), kernel)
    apart = (high > 1.01 * np.maximum(low, 0) + 1e-6)[:, side : side + shape[1]]
    return np.flatnonzero(apart.ravel()[near])

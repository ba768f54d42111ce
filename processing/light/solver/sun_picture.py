"""The sun's direct light on all that a picture sees.

In a large picture, what is lit and what is shaded are large areas: every few pixels one is looked at, and all within a
block whose four corners agree is as they are; only along the edges of light every pixel has shadow rays of its own.
"""

from __future__ import annotations

import math

import numpy as np
import numpy.typing as npt

from processing.ground.arrays import Floats
from processing.light.scene.scene import Sun
from processing.light.solver.daylight import sun_tint
from processing.light.solver.kernels import FIRST, PANE, SECOND, STEP_OFF_M, compiled, random, towards_panes
from processing.light.solver.sight import Sight
from processing.light.solver.stage import Stage

# Compiled loops over rays to the sun's disc: where they go, and through which glass they come.


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


BLOCK_RAD, MOST_STEP = 0.004, 8
"""Width of a block: 1 cm at 2.5 m, thinner than what shades a room; in pixels at most ``MOST_STEP``."""


def sun_of(stage: Stage, sight: Sight, samples: int, seed: int, among: npt.NDArray[np.bool_] | None = None) -> Floats:
    """Return the sun's direct irradiance (n, 3) of what pixels see; of those not ``among`` (n,) 0.

    ``samples`` rays go to its disc from places in half shadow.
    """
    out = np.zeros((len(sight.label), 3), np.float32)
    sun, panes = stage.scene.outdoors.sun, stage.scene.panes
    if sun is None or not panes:
        return out
    cosine = sight.normal @ np.asarray(sun.direction, np.float32)
    chosen = sight.solid & (cosine > 0)
    if among is not None:
        chosen &= among
    pixels = np.flatnonzero(chosen)
    near = np.zeros(len(pixels), bool)
    corners = [np.array([getattr(p, name) for p in panes]) for name in ("corner_m", "across_m", "up_m")]
    towards_panes(sight.point[pixels], np.asarray(sun.direction, np.float64), *corners, near)
    chosen[pixels[~near]] = False
    if not near.any():
        return out
    tint = _tint(stage, sun, sight, samples, seed, chosen)
    pixels = pixels[near]
    out[pixels] = tint[pixels] * cosine[pixels, None] * np.asarray(sun.normal_illuminance_lx, np.float32)
    return out


def _tint(stage: Stage, sun: Sun, sight: Sight, samples: int, seed: int, chosen: npt.NDArray[np.bool_]) -> Floats:
    """Return what of the sun's disc reaches each chosen pixel (n, 3)."""
    tint = np.zeros((len(chosen), 3), np.float32)
    shifts = random((seed, 30), len(chosen), 2)

    def look(pixels: npt.NDArray[np.intp]) -> npt.NDArray[np.bool_]:
        seen = sight.point[pixels], sight.normal[pixels]
        tint[pixels], unsure = sun_tint(stage, sun, *seen, samples, shifts[pixels])
        return unsure

    step = _step(sight)
    if step == 1:
        look(np.flatnonzero(chosen))
        return tint
    high, wide = sight.shape
    at = np.zeros(sight.shape, bool)
    rows, columns = np.arange(high), np.arange(wide)
    at |= ((rows % step == 0) | (rows == high - 1))[:, None] & ((columns % step == 0) | (columns == wide - 1))
    corners = np.flatnonzero(at.ravel() & chosen)
    sure, todo = np.zeros(sight.shape, bool), np.zeros(sight.shape, bool)
    unsure = look(corners)
    sure.ravel()[corners[~unsure]] = True
    shaped = (sight.normal.reshape(high, wide, 3), sight.point.reshape(high, wide, 3), chosen.reshape(high, wide))
    settle_blocks(step, sight.label.reshape(high, wide), *shaped, sure, tint.reshape(high, wide, 3), todo)
    todo.ravel()[corners] = False
    look(np.flatnonzero(todo))
    return tint


def _step(sight: Sight) -> int:
    """Return how many pixels wide blocks are."""
    high, wide = sight.shape
    if high < 2 or wide < 2:
        return 1
    apart = float(np.linalg.norm(sight.rays[wide].astype(np.float64) - sight.rays[0]))
    return min(max(math.floor(BLOCK_RAD / max(apart, 1e-9)), 1), MOST_STEP)

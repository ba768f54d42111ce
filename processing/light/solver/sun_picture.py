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
from processing.light.solver.daylight import settle_blocks, sun_tint
from processing.light.solver.kernels import random, towards_panes
from processing.light.solver.sight import Sight
from processing.light.solver.stage import Stage

# Compiled loops over rays to the sun's disc: where they go, and through which glass they come.


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

"""The simulated chart room, cut as perspective views by the simulation's own rays."""

from __future__ import annotations

import math
from copy import deepcopy
from functools import lru_cache
from typing import Any

import numpy as np

from mocks.optics.chart import ChartRoom
from mocks.worlds.light import Site
from processing.pictures.images import RelativeImage
from processing.sphere import Perspective, directions


def chart_view(**how: Any) -> RelativeImage:
    """Return what a camera sees of the chart (`_seen`), a picture of its own."""
    return deepcopy(_seen(**how))


@lru_cache(maxsize=8)
def _seen(
    *,
    width_px: int = 320,
    fov_deg: float = 60.0,
    roll_rad: float = 0.0,
    yaw_rad: float = 0.0,
    site: Site = Site.INDOOR,
    noise: float = 0.01,
    veil: float = 0.0,
    gain: float = 1.0,
    seed: int = 0,
) -> RelativeImage:
    """Return what a camera sees of the chart: 3x3 samples a pixel, noise, a veil of stray light, any scale."""
    pitch = 0.0 if site is Site.INDOOR else math.pi / 2
    fine = Perspective(3 * width_px, width_px * 9 // 4, math.radians(fov_deg), yaw_rad, pitch, roll_rad)
    ways, _ = directions(fine)
    light = ChartRoom(seed).radiance(site, ways.astype(np.float32))
    high = light.shape[0] // 3
    rgb = light[: 3 * high].reshape(high, 3, width_px, 3, 3).mean(axis=(1, 3))
    rng = np.random.default_rng(seed)
    rgb = gain * (rgb + veil) * (1 + noise * rng.standard_normal(rgb.shape))
    view = Perspective(width_px, high, fine.fov_x_rad, yaw_rad, pitch, roll_rad)
    shape = (high, width_px)
    known = np.full(shape, max(noise, 1e-3), dtype=np.float32)
    return RelativeImage(np.maximum(rgb, 0).astype(np.float32), known, np.zeros(shape, dtype=np.uint8), view)

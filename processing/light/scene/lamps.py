"""Light that surfaces give by themselves: electric lamps that are on, told from the calibrated panorama.

No surface reflects more than all that falls on it. Where a pixel shows clearly more than that (apparent albedo above
`LEAST_TIMES`), and neither the sun nor a window explains it, it gives light: the excess over what its surface reflects
is the lamp's radiance, measured. A window that the room's model lacks is such a place too: its light is as real.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import cv2
import numpy as np

from processing.ground.arrays import Doubles, Floats
from processing.light.solver.sight import Sight
from processing.pictures.images import LUMINANCE_WEIGHTS
from processing.sphere import Equirectangular, solid_angles

LEAST_TIMES = 1.6
"""Of all the light that falls on a place: less may be an error of the irradiance, or a highlight."""
LEAST_SR = 5e-5
"""Of a lamp as the camera sees it: 0.4 degrees wide. Smaller spots are noise, or do not matter."""


@dataclass(frozen=True)
class Lamp:
    """A shining spot as the camera sees it."""

    solid_angle_sr: float
    luminance_cd_m2: float
    """Mean."""
    label: int
    """Number of the surface that it is seen on."""
    towards: tuple[float, float, float]
    """Its middle's direction from the camera."""


def find_lamps(
    rgb: Doubles, irradiance: Doubles, usual: Doubles, sight: Sight, usable: np.ndarray
) -> tuple[Floats, list[Lamp]]:
    """Return what pixels give off by themselves (n, 3) cd/m2, and the lamps.

    Parameters
    ----------
    rgb, irradiance
        (n, 3): radiance and irradiance of the pixels of a panorama.
    usual
        (n, 3): the usual albedo of each pixel's surface.
    usable
        (n,): pixels that the sun does not reach, seen and not filled in.
    """
    weights = np.asarray(LUMINANCE_WEIGHTS)
    apparent = math.pi * (rgb @ weights) / np.maximum(irradiance @ weights, 1e-9)
    shining = (sight.solid & usable & (apparent > LEAST_TIMES)).reshape(sight.shape)
    own = np.maximum(rgb - usual * irradiance / math.pi, 0)
    emission = np.zeros(rgb.shape, np.float32)
    area = solid_angles(Equirectangular(sight.shape[1], sight.shape[0])).ravel()
    lamps = []
    count, spots = cv2.connectedComponents(shining.astype(np.uint8), connectivity=8)
    for spot in range(1, count):
        mine = np.flatnonzero(spots.ravel() == spot)
        size = float(area[mine].sum())
        if size < LEAST_SR:
            continue
        emission[mine] = own[mine]
        middle = (sight.rays[mine] * area[mine, None]).sum(axis=0)
        x, y, z = (float(v) for v in middle / np.linalg.norm(middle))
        labels, times = np.unique(sight.label[mine], return_counts=True)
        level = float(np.average(own[mine] @ weights, weights=area[mine]))
        lamps.append(Lamp(size, level, int(labels[times.argmax()]), (x, y, z)))
    return emission, sorted(lamps, key=lambda lamp: -lamp.solid_angle_sr * lamp.luminance_cd_m2)

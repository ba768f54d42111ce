"""Rooms made longer and wider after they were drawn: a panorama of a stretched room is a warp of the panorama.

A room stretched along its walls' directions is seen, from the stretched camera place, along directions that are
known for every pixel, and its boundaries stay exact (the augmentation that HorizonNet, Sun et al. 2019, introduced).
"""

from __future__ import annotations

from typing import Any

import cv2
import numpy as np
import numpy.typing as npt

from processing.ground.arrays import Doubles
from training.labels import column_longitudes

Arrays = dict[str, npt.NDArray[Any]]


def wall_direction_rad(floor_rad: npt.ArrayLike) -> float:
    """Return the azimuth (0 to pi/2) of most of a room's walls, parallel or at right angles, from its boundary (N,)."""
    down = np.minimum(np.asarray(floor_rad, np.float64), -0.03)
    longitude = column_longitudes(len(down))
    reach = 1 / np.tan(-down)
    place = reach * np.exp(1j * longitude)
    step = np.roll(place, -1) - place
    # Leaps from a near wall to a far one behind it run along the line of sight, not along a wall.
    step[np.abs(np.roll(reach, -1) - reach) > 0.35 * reach] = 0
    length = np.abs(step)
    four = (length * np.exp(4j * np.angle(step))).sum()
    return float(np.angle(four) / 4 % (np.pi / 2))


def stretched(arrays: Arrays, along: float, across: float, direction_rad: float) -> Arrays:
    """Return picture (H, W, 3), label (H, W) and columns (W,) of the room stretched by two factors.

    ``along`` is the factor along azimuth ``direction_rad``, ``across`` the one at right angles to it; heights stay.
    """
    rows, columns = arrays["label"].shape
    longitude = column_longitudes(columns) - direction_rad
    source = np.arctan2(np.sin(longitude) / across, np.cos(longitude) / along)
    shrunk = np.hypot(np.sin(longitude) / across, np.cos(longitude) / along)
    latitude = (0.5 - (np.arange(rows) + 0.5) / rows) * np.pi
    from_row = np.arctan2(np.sin(latitude)[:, None], np.cos(latitude)[:, None] * shrunk[None])
    at_row = np.clip((0.5 - from_row / np.pi) * rows - 0.5, 0, rows - 1)
    at_column = ((source + direction_rad) / (2 * np.pi) + 0.5) * columns - 0.5
    map_x = np.broadcast_to(at_column % columns, (rows, columns)).astype(np.float32)
    map_y = at_row.astype(np.float32)
    out: Arrays = {}
    for name, values in arrays.items():
        if values.ndim == 1:
            out[name] = _columns(values, at_column, name, 1 / shrunk)
            continue
        # One column more at either side, so that interpolation meets the seam's other side.
        wide = np.concatenate([values[:, -1:], values, values[:, :1]], axis=1)
        how = cv2.INTER_NEAREST if name == "label" else cv2.INTER_LINEAR
        out[name] = cv2.remap(wide, map_x + 1, map_y, how, borderMode=cv2.BORDER_REPLICATE)
    return out


def _columns(values: npt.NDArray[Any], at: Doubles, name: str, factor: Doubles) -> npt.NDArray[np.float32]:
    count = len(values)
    found = np.interp(at % count, np.arange(-1, count + 1), np.concatenate([values[-1:], values, values[:1]]))
    if name.endswith("_rad"):
        # Walls are farther away by the factor, their edges as high as before.
        found = np.arctan2(np.sin(found), np.cos(found) * factor)
    return np.asarray(found, dtype=np.float32)

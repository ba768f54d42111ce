"""The surroundings of the nadir seen straight from above, without the panorama's stretching: there and back."""

from __future__ import annotations

from processing.ground.arrays import Floats

import math

import cv2
import numpy as np
import numpy.typing as npt

from processing.removal.round_masks import row_latitudes


REACH_RAD = math.radians(50)
SIZE_PX = 320
"""Side of the nadir picture: 0.31 degrees a pixel."""


def radius_map() -> Floats:
    """Return the angle (rad) from the nadir of each pixel of a nadir picture (`SIZE_PX`, `SIZE_PX`)."""
    at = (np.arange(SIZE_PX) + 0.5 - SIZE_PX / 2) * (2 * REACH_RAD / SIZE_PX)
    return np.asarray(np.hypot(at[None, :], at[:, None]), dtype=np.float32)


def nadir_picture(picture: npt.NDArray[np.generic], *, nearest: bool = False) -> npt.NDArray[np.generic]:
    """Return what lies within `REACH_RAD` of the nadir of a panorama (H, W) or (H, W, C): equidistant, ahead up."""
    height, width = picture.shape[:2]
    at = (np.arange(SIZE_PX) + 0.5 - SIZE_PX / 2) * (2 * REACH_RAD / SIZE_PX)
    longitude = np.arctan2(at[None, :], -at[:, None])
    latitude = radius_map() - math.pi / 2
    pad = 2
    wide = np.concatenate([picture[:, width - pad :], picture, picture[:, :pad]], axis=1)
    x = ((longitude / (2 * math.pi) + 0.5) * width - 0.5 + pad).astype(np.float32)
    y = ((0.5 - latitude / math.pi) * height - 0.5).astype(np.float32)
    how = cv2.INTER_NEAREST if nearest else cv2.INTER_LINEAR
    found = cv2.remap(wide, x, np.minimum(y, np.float32(height - 1)), how, borderMode=cv2.BORDER_REPLICATE)
    return found.reshape(SIZE_PX, SIZE_PX, *picture.shape[2:])


def onto_panorama(share: Floats, shape: tuple[int, int]) -> Floats:
    """Return a nadir picture (`SIZE_PX`, `SIZE_PX`) on a panorama (H, W); 0 beyond `REACH_RAD`."""
    height, width = shape
    radius = row_latitudes(height) + math.pi / 2
    rows = np.flatnonzero(radius < REACH_RAD)
    out = np.zeros(shape, np.float32)
    if not rows.size:
        return out
    longitude = ((np.arange(width) + 0.5) / width - 0.5) * (2 * math.pi)
    scale = SIZE_PX / (2 * REACH_RAD)
    x = radius[rows, None] * np.sin(longitude) * scale + SIZE_PX / 2 - 0.5
    y = -radius[rows, None] * np.cos(longitude) * scale + SIZE_PX / 2 - 0.5
    out[rows] = cv2.remap(share, x.astype(np.float32), y.astype(np.float32), cv2.INTER_LINEAR)
    return out

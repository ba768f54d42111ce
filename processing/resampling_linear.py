"""Linear interpolation of float32 pictures with exact positions, whatever the number of channels."""

from __future__ import annotations

from processing.ground.arrays import Floats

import cv2
import numpy as np
import numpy.typing as npt



def linear_samples(picture: Floats, x: Floats, y: Floats, border: int = cv2.BORDER_REPLICATE) -> Floats:
    """Return samples (h, w) or (h, w, C) of a picture; ``x``, ``y`` (h, w) count from the first pixel's centre.

    OpenCV's remap keeps float positions for 1, 3 and 4 channels and rounds them to 1/32 pixel for other numbers (5.0),
    so the channels are taken in such groups.
    """
    if picture.ndim == 2 or picture.shape[2] in (1, 3, 4):
        found = cv2.remap(picture, x, y, cv2.INTER_LINEAR, borderMode=border)
        return np.asarray(found, dtype=np.float32).reshape(*x.shape, *picture.shape[2:])
    out = np.empty((*x.shape, picture.shape[2]), dtype=np.float32)
    start = 0
    while start < picture.shape[2]:
        left = picture.shape[2] - start
        count = 4 if left >= 4 else 3 if left == 3 else 1
        group = np.ascontiguousarray(picture[..., start : start + count])
        out[..., start : start + count] = linear_samples(group, x, y, border)
        start += count
    return out

"""Wide Gaussian blurs at a cost that does not grow with their width."""

from __future__ import annotations

from processing.ground.arrays import Floats

import cv2
import numpy as np
import numpy.typing as npt


NARROW_PX = 4.0
"""Standard deviation up to which the blur is exact; wider ones run on a smaller picture."""


def blurred(picture: Floats, sigma_px: float) -> Floats:
    """Return (h, w[, c]) blurred by a Gaussian; wide ones to within some percent of the picture's range."""
    if sigma_px <= NARROW_PX:
        return np.asarray(cv2.GaussianBlur(picture, (0, 0), sigma_px).reshape(picture.shape), np.float32)
    factor = NARROW_PX / 1.6 / sigma_px
    size = tuple(max(1, round(n * factor)) for n in picture.shape[1::-1])
    small = cv2.resize(picture, size, interpolation=cv2.INTER_AREA)
    scale = (size[0] / picture.shape[1], size[1] / picture.shape[0])
    small = cv2.GaussianBlur(small, (0, 0), sigmaX=max(sigma_px * scale[0], 0.3), sigmaY=max(sigma_px * scale[1], 0.3))
    return np.asarray(
        cv2.resize(small, picture.shape[1::-1], interpolation=cv2.INTER_LINEAR).reshape(picture.shape), np.float32
    )

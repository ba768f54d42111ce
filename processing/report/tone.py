"""How light is shown on the page: one exposure and one tone curve for all states of a room."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from processing.exchange.jpeg_files import TEXT
from processing.ground.arrays import Bytes, Floats
from processing.ground.colour import srgb_of_linear
from processing.pictures.images import LuminanceImage, luminance_cd_m2
from processing.pictures.preview import auto_exposure

BRIGHTER = 1.8
"""Than a preview: rooms for people to like are shown airy."""
_WHITE_SHARE = 0.995
_ROWS = 256


@dataclass(frozen=True)
class Look:
    """How all states of a room are shown."""

    exposure: float
    """Factor from the picture's units to the tone curve's."""
    white: float
    """What the curve shows as white, in its units; 1 or more."""
    yaw_rad: float = 0.0
    """Where views look first."""
    label: str = TEXT
    """On staged pictures; empty: none."""
    other_yaw_rad: float = math.pi
    """Where the second view looks."""

    @classmethod
    def of(
        cls, image: LuminanceImage, *, yaw_rad: float = 0.0, other_yaw_rad: float = math.pi, label: str = TEXT
    ) -> Look:
        """Return the look of a picture and of all that is made from it."""
        exposure = BRIGHTER * auto_exposure(image.rgb)
        step = max(1, image.rgb.shape[1] // 1024)
        sample = luminance_cd_m2(image.rgb[::step, ::step]) * np.float32(exposure)
        return cls(exposure, max(1.0, float(np.quantile(sample, _WHITE_SHARE))), yaw_rad, label, other_yaw_rad)


def shown(rgb: Floats, look: Look) -> Bytes:
    """Return linear light (H, W, 3) as 8-bit sRGB (Reinhard et al. 2002, eq. 4, on luminance)."""
    out = np.empty(rgb.shape, dtype=np.uint8)
    for top in range(0, rgb.shape[0], _ROWS):
        rows = np.maximum(rgb[top : top + _ROWS], 0) * np.float32(look.exposure)
        luminance = luminance_cd_m2(rows)[..., None]
        compressed = rows * ((1 + luminance / np.float32(look.white**2)) / (1 + luminance))
        out[top : top + _ROWS] = srgb_of_linear(compressed)
    return out

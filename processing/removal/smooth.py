"""Values known in some places, spread over a hole as a stretched skin lies: no peaks, no edges (Laplace's equation).

Solved from coarse to fine: averages of the known places, then a few sweeps at each size.
"""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np

from processing.ground.arrays import Flags, Floats
from processing.ground.colour import LUMINANCE_WEIGHTS
from processing.pictures.images import luminance_cd_m2

# Wide Gaussian blurs at a cost that does not grow with their width.


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


# Tones: the logarithm of light, in which illumination and reflectance add up and every error is a relative one.


TOE = 0.03
"""Of the median luminance: what is added before the logarithm, so that noise near black stays small."""
TONE_WEIGHTS = np.array(LUMINANCE_WEIGHTS, np.float32)


@dataclass(frozen=True)
class ToneScale:
    """The light added before the logarithm, in the picture's unit."""

    toe: float

    @classmethod
    def of(cls, rgb: Floats, known: Flags) -> ToneScale:
        """Return the scale that suits the known pixels of (h, w, 3); 1e-6 where nothing is known or all is black."""
        seen = luminance_cd_m2(rgb[known]) if known.any() else np.zeros(1, np.float32)
        return cls(max(TOE * float(np.median(seen)), 1e-6))

    def tone(self, rgb: Floats) -> Floats:
        """Return log(rgb + toe)."""
        return np.asarray(np.log(np.maximum(rgb, 0) + np.float32(self.toe)), np.float32)

    def light(self, tone: Floats) -> Floats:
        """Return the light of tones; never negative."""
        return np.asarray(np.maximum(np.exp(np.minimum(tone, 80.0)) - np.float32(self.toe), 0), np.float32)


def grey(tone: Floats) -> Floats:
    """Return (h, w): the tone's weighted mean over the channels."""
    return np.asarray(tone @ TONE_WEIGHTS, np.float32)


SWEEPS = 6
_CROSS = np.array([[0, 1, 0], [1, 0, 1], [0, 1, 0]], np.float32) / 4


def spread(values: Floats, given: Flags) -> Floats:
    """Return (h, w[, c]): ``values`` where given, elsewhere the membrane through them; zeros where none is given."""
    if not given.any():
        return np.zeros_like(values)
    picture = np.where(given if values.ndim == 2 else given[..., None], values, 0).astype(np.float32)
    return _level(picture, given.astype(np.float32))


def _level(values: Floats, share: Floats) -> Floats:
    """``share`` tells how much of each pixel is given; ``values`` are already multiplied by it."""
    fixed = share > 0
    own = values / _as(np.maximum(share, 1e-12), values)
    if fixed.all() or min(share.shape) < 2:
        mean = values.reshape(-1, *values.shape[2:]).sum(axis=0) / max(float(share.sum()), 1e-12)
        return np.asarray(np.where(_as(fixed, values), own, mean), np.float32)
    height, width = share.shape
    small = (max(1, (width + 1) // 2), max(1, (height + 1) // 2))
    even = (0, height % 2, 0, width % 2)
    coarse = _level(
        _halved(values, even, small),
        _halved(share, even, small),
    )
    up = cv2.resize(coarse, (small[0] * 2, small[1] * 2), interpolation=cv2.INTER_LINEAR)
    up = up.reshape(small[1] * 2, small[0] * 2, *values.shape[2:])[:height, :width]
    out = np.where(_as(fixed, values), own, up).astype(np.float32)
    for _ in range(SWEEPS):
        swept = cv2.filter2D(out, -1, _CROSS, borderType=cv2.BORDER_REPLICATE).reshape(out.shape)
        out = np.where(_as(fixed, values), own, swept)
    return np.asarray(out, np.float32)


def _halved(picture: Floats, even: tuple[int, int, int, int], size: tuple[int, int]) -> Floats:
    """Return the means of squares of four; what ``even`` adds at the lower and right edge counts as not given."""
    padded = cv2.copyMakeBorder(picture, *even, cv2.BORDER_CONSTANT, value=0)
    small = cv2.resize(padded, size, interpolation=cv2.INTER_AREA)
    return np.asarray(small.reshape(size[1], size[0], *picture.shape[2:]), np.float32)


def _as(flat: Floats | Flags, like: Floats) -> Floats:
    return np.asarray(flat if like.ndim == 2 else flat[..., None])

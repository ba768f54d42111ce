"""How well a texture fits itself when shifted: normalised cross-correlation of the known pixels, by FFT.

The masked form of Padfield (2012): each shift's means and variances are those of the pixels known in both.
"""

from __future__ import annotations

from processing.ground.arrays import Doubles, Flags, Floats

from dataclasses import dataclass

import cv2
import numpy as np
import numpy.typing as npt
from scipy import fft

from processing.removal.blurs import blurred


MIN_OVERLAP = 0.12
"""Of the known pixels that a shift must bring onto known ones."""


@dataclass(frozen=True)
class SelfCorrelation:
    """NCC by shift; ``ncc[cy + dy, cx + dx]`` is that of (dx, dy), NaN where too little overlaps."""

    ncc: Doubles
    centre: tuple[int, int]
    """(cy, cx)."""

    def at(self, shifts: npt.ArrayLike) -> Doubles:
        """Return the NCC, bilinear, at shifts (..., 2) as (dx, dy); NaN outside."""
        s = np.asarray(shifts, np.float64)
        x, y = s[..., 0] + self.centre[1], s[..., 1] + self.centre[0]
        height, width = self.ncc.shape
        inside = (x >= 0) & (y >= 0) & (x <= width - 1.001) & (y <= height - 1.001)
        x, y = np.where(inside, x, 0), np.where(inside, y, 0)
        i, j = y.astype(np.intp), x.astype(np.intp)
        fy, fx = y - i, x - j
        n = self.ncc
        top = n[i, j] * (1 - fx) + n[i, j + 1] * fx
        low = n[i + 1, j] * (1 - fx) + n[i + 1, j + 1] * fx
        return np.asarray(np.where(inside, top * (1 - fy) + low * fy, np.nan))


def high_passed(tone: Floats, known: Flags, sigma_px: float) -> Floats:
    """Return (h, w): the tone less its weighted local mean; 0 where unknown."""
    weight = known.astype(np.float32)
    low = blurred(np.where(known, tone, 0).astype(np.float32), sigma_px)
    share = blurred(weight, sigma_px)
    return np.asarray(np.where(known, tone - low / np.maximum(share, 1e-6), 0), np.float32)


def oriented(tone: Floats, known: Flags, sigma_px: float) -> tuple[Floats, Flags]:
    """Return (h, w, 2) which way edges and grain run (cosine and sine of twice the angle), and where that is known.

    Blocks laid crosswise repeat in it where their tones do not: herringbone.
    """
    inner = cv2.erode(known.astype(np.uint8), np.ones((3, 3), np.uint8), borderType=cv2.BORDER_REPLICATE).astype(bool)
    smooth = cv2.GaussianBlur(tone, (0, 0), 0.7)
    gx = np.where(inner, cv2.Sobel(smooth, cv2.CV_32F, 1, 0), 0)
    gy = np.where(inner, cv2.Sobel(smooth, cv2.CV_32F, 0, 1), 0)
    # The root keeps a few strong edges from outweighing all grain.
    size = np.sqrt(np.hypot(gx, gy)) + 1e-12
    parts = np.stack([gx * gx - gy * gy, 2 * gx * gy], axis=-1) / (size**3)[..., None]
    strength = cv2.GaussianBlur(np.where(inner, size, 0).astype(np.float32), (0, 0), sigma_px)
    field = cv2.GaussianBlur(parts.astype(np.float32), (0, 0), sigma_px) / np.maximum(strength, 1e-9)[..., None]
    return np.asarray(np.where(inner[..., None], field, 0), np.float32), inner


def self_correlation(picture: Floats, known: Flags) -> SelfCorrelation:
    """Return the masked NCC of a picture (h, w) or (h, w, c) with itself for all shifts up to 3/4 of its size."""
    height, width = picture.shape[:2]
    size = [fft.next_fast_len(2 * n - 1, real=True) for n in (height, width)]
    fm = fft.rfft2(known.astype(np.float64), s=size)
    count = _back(np.conj(fm) * fm, size)
    n = np.maximum(count, 1)
    covariance, here, there = (np.zeros(size) for _ in range(3))
    for channel in np.moveaxis(picture.reshape(height, width, -1), -1, 0):
        value = np.where(known, channel, 0).astype(np.float64)
        fv, fs = fft.rfft2(value, s=size), fft.rfft2(value * value, s=size)
        sum_here, sum_there = _back(np.conj(fv) * fm, size), _back(np.conj(fm) * fv, size)
        covariance += _back(np.conj(fv) * fv, size) - sum_here * sum_there / n
        here += _back(np.conj(fs) * fm, size) - sum_here**2 / n
        there += _back(np.conj(fm) * fs, size) - sum_there**2 / n
    scale = np.sqrt(np.maximum(here, 0) * np.maximum(there, 0))
    usable = (count > MIN_OVERLAP * max(int(known.sum()), 1)) & (scale > 1e-9 * max(float(here.max()), 1e-12))
    ncc = np.where(usable, covariance / np.where(usable, scale, 1), np.nan)
    reach_y, reach_x = (3 * height) // 4, (3 * width) // 4
    rows, columns = np.arange(-reach_y, reach_y + 1), np.arange(-reach_x, reach_x + 1)
    return SelfCorrelation(np.clip(ncc[np.ix_(rows % size[0], columns % size[1])], -1, 1), (reach_y, reach_x))


def _back(spectrum: npt.NDArray[np.complex128], size: list[int]) -> Doubles:
    return np.asarray(fft.irfft2(spectrum, s=size))

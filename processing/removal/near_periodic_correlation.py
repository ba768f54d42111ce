"""How well a texture fits itself when shifted: normalised cross-correlation of the known pixels, by FFT.

The masked form of Padfield (2012): each shift's means and variances are those of the pixels known in both.
"""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
import numpy.typing as npt
from scipy import fft

Floats = npt.NDArray[np.float32]
Doubles = npt.NDArray[np.float64]
Flags = npt.NDArray[np.bool_]

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
    low = cv2.GaussianBlur(np.where(known, tone, 0).astype(np.float32), (0, 0), sigma_px)
    share = cv2.GaussianBlur(weight, (0, 0), sigma_px)
    return np.asarray(np.where(known, tone - low / np.maximum(share, 1e-6), 0), np.float32)


def self_correlation(picture: Floats, known: Flags) -> SelfCorrelation:
    """Return the masked NCC of a picture (h, w) with itself for all shifts of at most 3/4 of its size."""
    height, width = picture.shape
    size = [fft.next_fast_len(2 * n - 1, real=True) for n in (height, width)]
    mask = known.astype(np.float64)
    value = np.where(known, picture, 0).astype(np.float64)
    fm, fv, fs = (fft.rfft2(p, s=size) for p in (mask, value, value * value))
    back = lambda spectrum: fft.irfft2(spectrum, s=size)  # noqa: E731
    count = np.maximum(back(np.conj(fm) * fm), 0)
    cross = back(np.conj(fv) * fv)
    sum_here, squares_here = back(np.conj(fv) * fm), back(np.conj(fs) * fm)
    sum_there, squares_there = back(np.conj(fm) * fv), back(np.conj(fm) * fs)
    n = np.maximum(count, 1)
    covariance = cross - sum_here * sum_there / n
    here, there = squares_here - sum_here**2 / n, squares_there - sum_there**2 / n
    scale = np.sqrt(np.maximum(here, 0) * np.maximum(there, 0))
    usable = (count > MIN_OVERLAP * max(known.sum(), 1)) & (scale > 1e-9 * max(float(squares_here.flat[0]), 1e-12))
    ncc = np.where(usable, covariance / np.where(usable, scale, 1), np.nan)
    reach_y, reach_x = (3 * height) // 4, (3 * width) // 4
    rows, columns = np.arange(-reach_y, reach_y + 1), np.arange(-reach_x, reach_x + 1)
    return SelfCorrelation(np.clip(ncc[np.ix_(rows % size[0], columns % size[1])], -1, 1), (reach_y, reach_x))

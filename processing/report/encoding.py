"""How numbers travel in the page: luminance as 16-bit logarithms, and pictures whose 8 bits hold a whole room's range.

Luminance is exact to `LARGEST_ERROR` of its value whatever the range; a picture's 8 bits are finest around its middle
(steps of 2 % there, 7 % five stops away) and reach 13 stops to either side, so that the page can expose it anew.
``templates/encoding.js`` is the other half.
"""

from __future__ import annotations

from processing.ground.arrays import Bytes, Floats, UInt16s

import base64
import math
import zlib

import numpy as np
import numpy.typing as npt



STEP = 0.001
"""Of the natural logarithm, from a code to the next."""
LARGEST_ERROR = math.expm1(STEP / 2)
"""Relative: 0.05 %."""
LEAST = 1e-6
"""cd/m2 of code 1; what is darker is told as this."""
NO_VALUE = 0
_MOST = 65535

UNCERTAINTY_LOW, UNCERTAINTY_HIGH = 1e-4, 10.0
"""Relative standard uncertainties of the bytes 1 and 255, evenly spaced in the logarithm; 0: nothing known."""

SHAPE = 0.7
"""Exponent of a picture's code: v^n / (v^n + middle^n)."""


def luminance_codes(luminance: npt.ArrayLike) -> UInt16s:
    """Return 16-bit codes of luminance in cd/m2, of any shape; `NO_VALUE` where it is 0 or less, or not finite."""
    values = np.asarray(luminance, dtype=np.float64)
    there = np.isfinite(values) & (values > 0)
    steps = np.rint(np.log(np.where(there, values, LEAST) / LEAST) / STEP) + 1
    return np.asarray(np.where(there, np.clip(steps, 1, _MOST), NO_VALUE), dtype=np.uint16)


def luminance_of(codes: UInt16s) -> npt.NDArray[np.float64]:
    """Return luminance in cd/m2 of codes; NaN where there is no value."""
    values = LEAST * np.exp((codes.astype(np.float64) - 1) * STEP)
    return np.where(codes == NO_VALUE, math.nan, values)


def uncertainty_codes(relative: npt.ArrayLike) -> Bytes:
    """Return 8-bit codes of relative standard uncertainties (to 2.3 % of their value); 0 where nothing is known."""
    values = np.asarray(relative, dtype=np.float64)
    known = np.isfinite(values) & (values >= 0)
    clipped = np.clip(np.where(known, values, 1.0), UNCERTAINTY_LOW, UNCERTAINTY_HIGH)
    share = np.log(clipped / UNCERTAINTY_LOW) / math.log(UNCERTAINTY_HIGH / UNCERTAINTY_LOW)
    return np.asarray(np.where(known, 1 + np.rint(254 * share), 0), dtype=np.uint8)


def picture_codes(rgb: Floats, middle: float) -> Bytes:
    """Return linear light (H, W, 3) as 8-bit codes of which ``middle`` (> 0, in the picture's units) is the 127th.

    The page gets light back by v = middle (c / (255 - c))^(1 / `SHAPE`).
    """
    raised = np.power(np.clip(rgb, 0, 1e20) / np.float32(middle), np.float32(SHAPE), dtype=np.float32)
    return np.asarray(raised / (1 + raised) * np.float32(255) + np.float32(0.5), dtype=np.uint8)


def packed(codes: UInt16s | Bytes) -> str:
    """Return a map of codes (H, W) as text: row by row differences, bytes apart by weight, zlib, base64."""
    wide = codes.astype(np.int64)
    first = np.concatenate([np.zeros((codes.shape[0], 1), np.int64), wide[:, :-1]], axis=1)
    bits = 8 * codes.dtype.itemsize
    difference = (wide - first + (1 << (bits - 1))) % (1 << bits) - (1 << (bits - 1))
    folded = np.where(difference < 0, -2 * difference - 1, 2 * difference).astype(np.uint32)
    planes = [(folded >> shift & 255).astype(np.uint8).tobytes() for shift in range(bits - 8, -1, -8)]
    return base64.b64encode(zlib.compress(b"".join(planes), 9)).decode("ascii")

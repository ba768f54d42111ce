"""Colour of light: chromaticity and correlated colour temperature (CCT) of whole pictures.

CCT is meaningful near the Planckian locus only, so it comes with a mask (CIE 15:2018: up to 0.05 in u, v of 1960).
The locus is baked as two polynomials; a test holds it, and the maps, against colour-science (Ohno 2013).
"""

from __future__ import annotations

import functools
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
from numpy.polynomial import chebyshev

from processing.ground.arrays import Doubles, Flags, Floats

XYZ_OF_RGB = (
    (0.4123907993, 0.3575843394, 0.1804807884),
    (0.2126390059, 0.7151686788, 0.0721923154),
    (0.0193308187, 0.1191947798, 0.9505321522),
)
"""Rec. 709 primaries and D65 (IEC 61966-2-1, unrounded)."""
MAX_DUV = 0.05
COLDEST_K, HOTTEST_K = 1250.0, 40_000.0

_LOW_MIRED, _HIGH_MIRED = 1e6 / HOTTEST_K, 1e6 / COLDEST_K
_U_OF_MIRED = (
    2.816901483e-01,
    1.126353165e-01,
    6.563410776e-03,
    -5.105569783e-03,
    1.089454734e-03,
    -4.990577099e-05,
    -8.764733939e-05,
    5.631155064e-05,
    -2.308208372e-05,
    6.375761888e-06,
    -1.262011038e-07,
    -1.261652007e-06,
    9.618251769e-07,
    -4.285080109e-07,
    1.022955707e-07,
    1.805089335e-08,
    -3.448487729e-08,
    2.077034726e-08,
    -7.601839055e-09,
)
_V_OF_MIRED = (
    3.337323084e-01,
    4.154757575e-02,
    -2.077288072e-02,
    3.824694753e-03,
    8.276540083e-04,
    -9.062142312e-04,
    3.897704809e-04,
    -1.076911567e-04,
    1.078349791e-05,
    1.089516319e-05,
    -1.006607671e-05,
    5.344400947e-06,
    -1.911538335e-06,
    3.007880696e-07,
    1.784107205e-07,
    -1.931304248e-07,
    1.036206347e-07,
    -3.540939081e-08,
    4.414620444e-09,
)
"""Chebyshev coefficients of u and v (CIE 1960) of the locus over reciprocal temperature; off by at most 1e-8."""
_STEP_MIRED = 0.5
_ROWS = 64


@dataclass(frozen=True)
class CctMap:
    """Correlated colour temperature of each pixel."""

    cct_k: Floats
    """(H, W); 0 where it means nothing."""
    duv: Floats
    """(H, W): distance from the Planckian locus in u, v of 1960, positive above it (greenish); 0 where undefined."""
    meaningful: Flags
    """(H, W): light there is, between 1250 K and 40,000 K, and within 0.05 of the locus."""


def chromaticity(rgb: npt.ArrayLike) -> tuple[Floats, Flags]:
    """Return CIE 1931 x, y of linear RGB (..., 3) as float32 (..., 2), and where they exist; 0, 0 where it is black."""
    xyz = _xyz(rgb)
    return _share(xyz[..., :2], xyz.sum(axis=-1))


def uniform_chromaticity(rgb: npt.ArrayLike) -> tuple[Floats, Flags]:
    """Return CIE 1976 u', v' of linear RGB (..., 3) as float32 (..., 2), and where they exist; else 0."""
    xyz = _xyz(rgb)
    return _share(xyz[..., :2] * (4.0, 9.0), xyz @ (1.0, 15.0, 3.0))


def cct_map(rgb: npt.ArrayLike) -> CctMap:
    """Return the CCT of a picture (H, W, 3), by Robertson's isotherms (1968) half a mired apart.

    Against colour-science's Ohno 2013 it differs by less than 1 K from 2000 K to 20,000 K.
    """
    picture = np.asarray(rgb)
    height, width = picture.shape[:2]
    cct, duv = np.zeros((height, width), np.float32), np.zeros((height, width), np.float32)
    meaningful = np.zeros((height, width), np.bool_)
    for top in range(0, height, _ROWS):
        rows = slice(top, top + _ROWS)
        uv, lit = uniform_chromaticity(picture[rows])
        # v of 1960 is two thirds of v' of 1976.
        cct_k, distance = _cct(*np.moveaxis(uv.astype(np.float64) / (1.0, 1.5), -1, 0))
        good = lit & (np.abs(distance) <= MAX_DUV) & (cct_k > COLDEST_K) & (cct_k < HOTTEST_K)
        meaningful[rows] = good
        cct[rows], duv[rows] = np.where(good, cct_k, 0), np.where(lit, distance, 0)
    return CctMap(cct, duv, meaningful)


def _xyz(rgb: npt.ArrayLike) -> Doubles:
    return np.asarray(np.asarray(rgb, dtype=np.float64) @ np.array(XYZ_OF_RGB).T)


def _share(parts: Doubles, whole: Doubles) -> tuple[Floats, Flags]:
    exists = np.asarray(whole > 0)
    out = np.zeros(parts.shape, dtype=np.float64)
    np.divide(parts, whole[..., None], out=out, where=exists[..., None])
    return out.astype(np.float32), exists


@functools.cache
def _isotherms() -> tuple[Doubles, Doubles, Doubles]:
    """Return reciprocal temperatures (N,), the locus there (N, 2), and its unit tangents (N, 2)."""
    mired = np.arange(_LOW_MIRED, _HIGH_MIRED + _STEP_MIRED / 2, _STEP_MIRED)
    place = (mired - (_LOW_MIRED + _HIGH_MIRED) / 2) / ((_HIGH_MIRED - _LOW_MIRED) / 2)
    curves = [np.array(c) for c in (_U_OF_MIRED, _V_OF_MIRED)]
    points = np.stack([chebyshev.chebval(place, c) for c in curves], axis=-1)
    tangents = np.stack([chebyshev.chebval(place, chebyshev.chebder(c)) for c in curves], axis=-1)
    return mired, points, tangents / np.linalg.norm(tangents, axis=-1, keepdims=True)


def _cct(u: Doubles, v: Doubles) -> tuple[Doubles, Doubles]:
    """Return CCT in K (clipped to the range) and the signed distance from the locus, for arrays of u and v of 1960."""
    mired, points, tangents = _isotherms()

    def along(index: npt.NDArray[np.intp]) -> Doubles:
        """How far a pixel lies beyond an isotherm, towards lower temperatures."""
        to_u, to_v = u - points[index, 0], v - points[index, 1]
        return np.asarray(to_u * tangents[index, 0] + to_v * tangents[index, 1])

    low, high = np.zeros(u.shape, dtype=np.intp), np.full(u.shape, mired.size - 1)
    for _ in range(int(np.ceil(np.log2(mired.size)))):
        middle = (low + high) // 2
        beyond = along(middle) >= 0
        low, high = np.where(beyond, middle, low), np.where(beyond, high, middle)
    low = np.minimum(low, mired.size - 2)
    before, after = along(low), along(low + 1)
    gap = before - after
    share = np.clip(np.divide(before, gap, out=np.zeros_like(gap), where=gap != 0), 0, 1)
    foot = points[low] * (1 - share)[..., None] + points[low + 1] * share[..., None]
    across = (u - foot[..., 0]) * -tangents[low, 1] + (v - foot[..., 1]) * tangents[low, 0]
    return 1e6 / (mired[low] + share * _STEP_MIRED), across

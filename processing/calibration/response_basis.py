"""Smooth functions of the picture code: cubic B-splines whose knots are equally spaced in the root of the code."""

from __future__ import annotations

from processing.ground.arrays import Doubles

from dataclasses import dataclass
from functools import lru_cache
from typing import TypeAlias

import numpy as np
import numpy.typing as npt


N_BASIS = 26
_STEPS = 16
"""Table entries a code; between them the basis is interpolated."""


@dataclass(frozen=True)
class SplineBasis:
    """Tabulated basis: values and first two derivatives (by the code), and the curvature penalty."""

    value: Doubles
    """(255 * 16 + 1, N_BASIS) at codes 0, 1/16, ..., 255."""
    columns: npt.NDArray[np.int64]
    """(255 * 16 + 1, 4): the four that are not 0."""
    four: Doubles
    """(255 * 16 + 1, 4): their values."""
    penalty: Doubles
    """(N_BASIS, N_BASIS): squared second differences; constants and a line over the root of the code cost nothing."""

    def at(self, codes: Doubles) -> Doubles:
        """Return (n, N_BASIS) at codes 0..255 (held at the ends)."""
        place = np.clip(codes, 0, 255) * _STEPS
        first = np.minimum(place.astype(np.int64), len(self.value) - 2)
        share = (place - first)[:, None]
        low = self.value[first]
        return np.asarray(low + share * (self.value[first + 1] - low))

    def entries(self, codes: Doubles) -> tuple[npt.NDArray[np.int64], Doubles]:
        """Return the columns (n, 4), growing, and values (n, 4) of what is not 0 at codes 0..255 (nearest 1/16)."""
        place = np.rint(np.clip(codes, 0, 255) * _STEPS).astype(np.int64)
        return self.columns[place], self.four[place]

    @property
    def codes(self) -> Doubles:
        """Return (256, N_BASIS) at the whole codes."""
        return self.value[::_STEPS]


@lru_cache(maxsize=1)
def spline_basis() -> SplineBasis:
    """Return the basis."""
    from scipy.interpolate import BSpline

    degree = 3
    inner = np.linspace(0, 1, N_BASIS - degree + 1)
    step = inner[1]
    knots = np.concatenate([inner[0] - step * np.arange(degree, 0, -1), inner, 1 + step * np.arange(1, degree + 1)])
    codes = np.linspace(0, 255, 255 * _STEPS + 1)
    root = (np.sqrt(codes + 2) - np.sqrt(2)) / (np.sqrt(257) - np.sqrt(2))
    value = np.asarray(BSpline.design_matrix(np.minimum(root, 1 - 1e-12), knots, degree).toarray(), dtype=np.float64)
    first = np.minimum((root * (N_BASIS - degree)).astype(np.int64), N_BASIS - degree - 1)
    columns = first[:, None] + np.arange(degree + 1)
    second = np.diff(np.eye(N_BASIS), n=2, axis=0)
    return SplineBasis(value, columns, np.take_along_axis(value, columns, axis=1), second.T @ second)


def srgb_log2_exposure() -> Doubles:
    """Return (256,) log2 of the light of each sRGB code (IEC 61966-2-1), 0 at code 255; code 0 counts as half."""
    value = np.maximum(np.arange(256), 0.5) / 255
    linear = np.where(value <= 0.04045, value / 12.92, ((value + 0.055) / 1.055) ** 2.4)
    return np.asarray(np.log2(linear))

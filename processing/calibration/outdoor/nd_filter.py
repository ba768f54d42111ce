"""Neutral-density filters that are not neutral: a 3x3 colour correction and a density, kept apart.

Paper, section 3, step (2); Stumpfel et al. 2004. What a filter does to linear RGB (row vectors) is
``rgb @ tint * 10 ** -density``. The tint leaves the luminance of white light as it is, so that the correction of colour
does not touch the scale: k2, which is measured on a white patch through the filter, holds the density.
"""

import math
from dataclasses import dataclass, replace
from typing import Self

import numpy as np
import numpy.typing as npt

from processing.errors import LensError
from processing.ground.arrays import Doubles, Flags, Floats, Rgb
from processing.ground.colour import largest_channel
from processing.pictures.images import LUMINANCE_WEIGHTS

Matrix = tuple[Rgb, Rgb, Rgb]

_WORST_CONDITION = 50.0  # of a tint that can be undone; chosen: noise would grow as much
_MOST_SPREAD = 1e4  # chosen: real charts are at 2 to 20, equal patches beyond 1e15
_PAINT_FRAC = 0.01  # chosen: what no patch is surer than
_LEAST_PATCHES = 6  # chosen: twice the unknowns of a channel
_UNSURE_FRAC = 0.2  # of a channel: patches less sure are left out where enough are left; chosen
_LEAST_SHARE = 0.1  # of a patch's luminance: what a channel is weighed as at least; chosen on drawn rigs of `hostile`
_MIXED = 0.3  # standard deviation of what a filter mixes of other channels; chosen: published ones mix -0.05 to 0.16
_TINT_FRAC, _HUE_FRAC = 0.025, 0.05  # of a blue sky's luminance and colour, from which a tint is warned of; chosen
_BLUE_SKY = np.array((0.824, 1.012, 1.403))  # daylight of 10,000 K (CIE 15) in linear Rec. 709, luminance 1
_IDENTITY: Matrix = ((1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0))


@dataclass(frozen=True)
class NdFilter:
    """A filter before the lens. ``tint``'s row sums have luminance 1 (see the module)."""

    tint: Matrix = _IDENTITY
    density: float = 0.0
    relative_uncertainty: float = 0.0
    """Standard uncertainty of a blue sky's luminance, beside that of the light the scale is measured in, relative."""
    source: str = ""
    colour_uncertainty: float = 0.0
    """Standard uncertainty of a blue sky's red or blue over its green, the larger, relative."""

    def __post_init__(self) -> None:
        matrix = np.array(self.tint, dtype=np.float64)
        if matrix.shape != (3, 3) or not np.isfinite(matrix).all() or not math.isfinite(self.density):
            raise LensError("a filter's tint is a finite 3x3 matrix and its density a number")
        white = float(matrix.sum(axis=0) @ np.array(LUMINANCE_WEIGHTS))
        if abs(white - sum(LUMINANCE_WEIGHTS)) > 1e-6:
            raise LensError(f"a tint that changes the luminance of white to {white:.4f}", advice="`NdFilter.of_matrix`")
        if np.linalg.cond(matrix) > _WORST_CONDITION:
            text = "a tint that cannot be undone"
            likely = "a chart with too few colours, or clipped patches"
            raise LensError(text, likely=likely, advice="fit it to a chart with 24 patches, none clipped or black")

    @classmethod
    def of_matrix(cls, forward: npt.ArrayLike, *, relative_uncertainty: float = 0.0, source: str = "") -> Self:
        """Return the filter that multiplies linear RGB by a matrix (``rgb @ forward``), split in tint and density.

        ``forward``: shape (3, 3).
        """
        matrix = np.array(forward, dtype=np.float64)
        if matrix.shape != (3, 3) or not np.isfinite(matrix).all():
            raise LensError("a filter's matrix is finite and 3x3")
        passed = float(matrix.sum(axis=0) @ np.array(LUMINANCE_WEIGHTS)) / sum(LUMINANCE_WEIGHTS)
        if passed <= 0:
            raise LensError("a filter that passes no white light", likely="the matrix is a correction of another kind")
        a, b, c = ((float(row[0]), float(row[1]), float(row[2])) for row in matrix / passed)
        return cls((a, b, c), -math.log10(passed), relative_uncertainty, source)

    @property
    def doubt(self) -> str:
        """Return in words how uncertain the tint leaves a blue sky, nothing where that is little."""
        if self.relative_uncertainty < _TINT_FRAC and self.colour_uncertainty < _HUE_FRAC:
            return ""
        return (
            "the rig's chart shows too little of a channel for the filter's colour: a blue sky is uncertain by "
            f"{self.relative_uncertainty:.1%} in luminance, {self.colour_uncertainty:.0%} in colour (1 sigma)"
        )

    @property
    def transmittance(self) -> float:
        """Return what the filter passes of white light's luminance."""
        return float(10**-self.density)

    @property
    def correction(self) -> Doubles:
        """Return the matrix that undoes the tint, not the density: ``rgb @ correction``, of shape (3, 3)."""
        return np.linalg.inv(np.array(self.tint, dtype=np.float64))

    def correct(self, rgb: Floats) -> Floats:
        """Return linear RGB, of shape (..., 3), as before the filter but for its density; its unit; may be negative."""
        return np.asarray(rgb @ self.correction.astype(np.float32), dtype=np.float32)

    def noise_gain(self, rgb: Floats) -> Floats:
        """Return by how much the correction raises the relative noise of luminance, for uncorrected (..., 3) values.

        The channels' relative noise is taken as equal and independent; at least 1. Of shape (...), >= 1.
        """
        weights = np.array(LUMINANCE_WEIGHTS, dtype=np.float32)
        corrected = (self.correction @ np.array(LUMINANCE_WEIGHTS)).astype(np.float32)
        tiny = np.float32(1e-20)
        before = np.sqrt(np.einsum("...c,c->...", rgb * rgb, weights**2)) / np.maximum(rgb @ weights, tiny)
        after = np.sqrt(np.einsum("...c,c->...", rgb * rgb, corrected**2)) / np.maximum(rgb @ corrected, tiny)
        gain = after / np.maximum(before, tiny)
        return np.asarray(np.clip(gain, 1, 1e3), dtype=np.float32)


def without_negatives(rgb: Floats) -> tuple[Floats, Flags]:
    """Return RGB whose negative channels are moved to 0 towards grey, luminance kept, and which pixels (...) that was.

    A pixel of luminance 0 or less becomes black. ``rgb``: shape (..., 3), any unit.
    """
    lowest = -largest_channel(-rgb)
    wrong = lowest < 0
    if not wrong.any():
        return rgb, wrong
    out, some = rgb.copy(), rgb[wrong]
    grey = np.maximum(some @ np.array(LUMINANCE_WEIGHTS, dtype=np.float32) / np.float32(sum(LUMINANCE_WEIGHTS)), 0)
    share = grey / np.maximum(grey - lowest[wrong], np.float32(1e-30))
    out[wrong] = np.maximum(grey[:, None] + share[:, None] * (some - grey[:, None]), 0)
    return out, wrong


def fit_nd_filter(
    filtered: npt.ArrayLike, plain: npt.ArrayLike, uncertainty: npt.ArrayLike = 0.0, *, source: str = ""
) -> NdFilter:
    """Fit a filter to the patches of a colour chart, (N, 3) linear RGB with and without it, of one camera.

    Both are scaled to equal exposure (divided by time, ISO and aperture's area), so that their ratio is the filter's
    alone. Patches with a channel at 0 or not finite are left out. The 3x3 matrix is the least squares of what is seen
    through it, a channel at a time, over the relative ``uncertainty``, (N,) or (N, 3), of each. How far errors of that
    size, or what the fit leaves, move a blue sky is stated. Raises `LensError` for fewer than six patches.
    """
    before, after = np.asarray(plain, dtype=np.float64), np.asarray(filtered, dtype=np.float64)
    if before.shape != after.shape or before.ndim != 2 or before.shape[1] != 3:
        raise LensError("a filter is fitted to the same patches (N, 3) with and without it")
    doubt = np.asarray(uncertainty, dtype=np.float64)
    doubt = np.broadcast_to(doubt[:, None] if doubt.ndim == 1 else doubt, before.shape)
    before, after, doubt = _usable(before, after, doubt)
    weights = np.array(LUMINANCE_WEIGHTS)
    level = (before @ weights)[:, None]
    mean = float(np.mean(after @ weights / level[:, 0]))
    before, after = before / level, after / level / mean
    columns, doubts = zip(*(_column(before, after[:, c], doubt[:, c], c) for c in range(3)), strict=True)
    tint, sky = np.transpose(columns), _BLUE_SKY
    found = NdFilter.of_matrix(tint * mean, source=source)
    # What errors behind the filter move: a sky's luminance beside the chart's light, and its colours; and what no
    # matrix explains of the patches' luminances.
    back = np.linalg.inv(tint)
    red, blue = (back[:, c] / sky[c] - back[:, 1] / sky[1] for c in (0, 2))
    moves = ((sky - before.mean(axis=0), back @ weights), (sky, red), (sky, blue))
    sigmas = [math.sqrt(np.square(by) @ (np.array(doubts) @ light @ light)) for light, by in moves]
    left = math.sqrt(float(np.average((after @ back @ weights - 1) ** 2, weights=doubt[:, 1] ** -2)))
    return replace(found, relative_uncertainty=math.hypot(sigmas[0], left), colour_uncertainty=max(sigmas[1:]))


def _usable(before: Doubles, after: Doubles, doubt: Doubles) -> tuple[Doubles, Doubles, Doubles]:
    """Return patches (M, 3) that are lit in every channel, the surer ones where enough are; and their uncertainty."""
    usable = (np.isfinite(before) & np.isfinite(after) & (before > 0) & (after > 0)).all(axis=1)
    if usable.sum() < _LEAST_PATCHES:
        raise LensError(f"{usable.sum()} patches above 0 in every channel", advice="expose the chart longer")
    sure = usable & (doubt < _UNSURE_FRAC).all(axis=1)
    usable = sure if sure.sum() >= _LEAST_PATCHES else usable
    if max(_spread(before[usable]), _spread(after[usable])) > _MOST_SPREAD:
        text = "the patches hold too few different colours to fit a filter"
        likely = "one patch given several times, clipped patches, or numbers that are no light"
        raise LensError(text, likely=likely, advice="use a chart with 24 patches, none clipped or black")
    return before[usable], after[usable], np.hypot(doubt[usable], _PAINT_FRAC)


def _column(plain: Doubles, seen: Doubles, doubt: Doubles, channel: int) -> tuple[Doubles, Doubles]:
    """Return what a channel (N,) behind the filter has of each of ``plain`` (N, 3), and the covariance (3, 3) of that.

    ``doubt``: (N,), relative."""
    held = np.diag([0.0 if c == channel else _MIXED**-2 for c in range(3)])
    shown = seen
    for _ in range(4):  # A weight by what is seen alone would prefer what noise has made dark, or a gamut has cut.
        over = plain / np.square(doubt * np.maximum(np.maximum(seen, shown), _LEAST_SHARE))[:, None]
        covariance = np.linalg.inv(over.T @ plain + held)
        found = covariance @ (over.T @ seen)
        shown = plain @ found
    off = (shown - seen) / (doubt * np.maximum(np.maximum(seen, shown), _LEAST_SHARE))
    return found, np.asarray(covariance * max(1.0, float(off @ off) / max(len(off) - 3, 1)))


def _spread(patches: Doubles) -> float:
    """Return the condition of patches (N, 3) over their levels; infinite for values that overflow."""
    with np.errstate(all="ignore"):
        relative = patches / patches.mean(axis=1, keepdims=True)
    return float(np.linalg.cond(relative)) if np.isfinite(relative).all() else math.inf

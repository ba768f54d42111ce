"""Our response fit: the most probable smooth curve given patches, their noise, and exposure times.

The logarithm of the exposure is a spline of the code added to a starting curve. The unknown light of each patch is
eliminated exactly (a projection), so that only the spline's coefficients and the times remain. Weights are inverse
variances of a noise model, taken at the *predicted* code: weights and choices that depend on the noisy code itself
would bias the curve where it bends. The prior's strength is chosen from the data by restricted maximum likelihood
(cross-validation over patches chooses a little worse: .0049 against .0043 stop on published curves), and judged by
patches left out.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache
from typing import TYPE_CHECKING

import numpy as np

from processing.calibration.response.curve import FINE_STEPS, FineCurve, PatchNoise
from processing.calibration.response.samples import ChannelSamples
from processing.ground.arrays import Doubles, Int64s
from processing.ground.colour import srgb_decoded

if TYPE_CHECKING:
    from processing.calibration.response.prior import CurvePrior

# Smooth functions of the picture code: cubic B-splines whose knots are equally spaced in the root of the code.


N_BASIS = 26  # splines; chosen


@dataclass(frozen=True)
class SplineBasis:
    """Tabulated basis: values and first two derivatives (by the code), and the curvature penalty."""

    value: Doubles
    """(255 * 16 + 1, N_BASIS) at codes 0, 1/16, ..., 255."""
    columns: Int64s
    """(255 * 16 + 1, 4): the four that are not 0."""
    four: Doubles
    """(255 * 16 + 1, 4): their values."""
    penalty: Doubles
    """(N_BASIS, N_BASIS): squared second differences; constants and a line over the root of the code cost nothing."""

    def at(self, codes: Doubles) -> Doubles:
        """Return the basis, 0..1, of shape (N, N_BASIS) at ``codes`` (N,), 0..255 (held at the ends)."""
        place = np.clip(codes, 0, 255) * FINE_STEPS
        first = np.minimum(place.astype(np.int64), len(self.value) - 2)
        share = (place - first)[:, None]
        low = self.value[first]
        return np.asarray(low + share * (self.value[first + 1] - low))

    def entries(self, codes: Doubles) -> tuple[Int64s, Doubles]:
        """Return the columns (N, 4), growing, and values (N, 4) of what is not 0 at codes 0..255 (nearest 1/16)."""
        place = np.rint(np.clip(codes, 0, 255) * FINE_STEPS).astype(np.int64)
        return self.columns[place], self.four[place]

    @property
    def codes(self) -> Doubles:
        """Return the basis at the whole codes, of shape (256, N_BASIS)."""
        return self.value[::FINE_STEPS]


@lru_cache(maxsize=1)
def spline_basis() -> SplineBasis:
    """Return the basis."""
    from scipy.interpolate import BSpline

    degree = 3
    inner = np.linspace(0, 1, N_BASIS - degree + 1)
    step = inner[1]
    knots = np.concatenate([inner[0] - step * np.arange(degree, 0, -1), inner, 1 + step * np.arange(1, degree + 1)])
    codes = np.linspace(0, 255, 255 * FINE_STEPS + 1)
    root = (np.sqrt(codes + 2) - np.sqrt(2)) / (np.sqrt(257) - np.sqrt(2))
    value = np.asarray(BSpline.design_matrix(np.minimum(root, 1 - 1e-12), knots, degree).toarray(), dtype=np.float64)
    first = np.minimum((root * (N_BASIS - degree)).astype(np.int64), N_BASIS - degree - 1)
    columns = first[:, None] + np.arange(degree + 1)
    second = np.diff(np.eye(N_BASIS), n=2, axis=0)
    return SplineBasis(value, columns, np.take_along_axis(value, columns, axis=1), second.T @ second)


def srgb_log2_exposure() -> Doubles:
    """Return log2 of the light of each sRGB code, of shape (256,), 0 at code 255; code 0 counts as half."""
    return np.asarray(np.log2(srgb_decoded(np.maximum(np.arange(256), 0.5) / 255)))


FIRST_CODE, LAST_CODE = 3.0, 252.0
"""Predicted codes that a fit uses: beyond, noise is cut off by black or white and its mean is no longer the signal."""

_GAUGE_CODE = 128  # where the curve's change is 0
_CELLS, _CELL_PATCHES = 16, 8  # of the code, and patches a cell needs; chosen
CELL_COUNT = 30
"""Patches that count as one in choosing the prior's strength: errors of neighbouring codes and places are alike. Chosen
on published curves left out (median .0038 stop; 1: .0039, 100: .0054) and hostile JPEG (.020; 1: .043)."""
_MOST_SHIFT = 0.2  # stops: a correction of the second order that is larger is none


@dataclass(frozen=True)
class Weighed:
    """Observations under a curve: what they should be, what they are worth, how far off they are."""

    predicted: Doubles
    """Codes."""
    shift: Doubles
    """Stops between the curve at the mean code and the mean log exposure of the patch."""
    weight: Doubles
    """1 / stops2; 0 where the predicted code is outside the usable ones."""
    residual: Doubles
    """Stops, observed minus predicted."""
    standard: Doubles
    """The residual in its own standard deviations, the patch's own share in its prediction taken into account."""


def weigh(data: ChannelSamples, fine: FineCurve, log2_times: Doubles, noise: PatchNoise, rounds: int = 2) -> Weighed:
    """Return predictions from each patch's mean light, and inverse variances at the predicted codes.

    ``log2_times``: (F,) log2 of seconds.
    """
    log2, _, bend = fine.at(data.mean)
    predicted = data.mean
    offset = log2_times[data.frame]
    for _ in range(rounds):
        at, at_slope, _bend = fine.at(predicted)
        variance = noise.mean.variance(at, at_slope)
        usable = (predicted >= FIRST_CODE) & (predicted <= LAST_CODE)
        weight = np.where(usable, 1 / (variance * at_slope**2), 0.0)
        shift = _shift(data, noise.pixel.variance(at, at_slope), noise.pixel.code, variance, at_slope, bend)
        light = log2 + shift - offset
        level = _per_sample(data, weight * light) / np.maximum(_per_sample(data, weight), 1e-300)
        predicted = fine.code(level[data.sample] + offset)
    total = _per_sample(data, weight)[data.sample]
    alone = weight >= total * (1 - 1e-9)
    weight = np.where(alone, 0.0, weight)
    residual = np.where(weight > 0, light - level[data.sample], 0.0)
    free = np.maximum(1 - weight / np.maximum(total, 1e-300), 1e-3)
    return Weighed(predicted, shift, weight, residual, residual * np.sqrt(weight / free))


def _shift(
    data: ChannelSamples,
    pixel_variance: Doubles,
    code_variance: float,
    mean_variance: Doubles,
    slope: Doubles,
    bend: Doubles,
) -> Doubles:
    """Return stops from the curve at a patch's mean code to the mean log light of the patch, to second order.

    Where the curve bends, texture lifts it; noise that enters as light, before the curve, moves the mean code by half
    the curve's second derivative over *linear* light; and the mean code's own noise counts once more."""
    texture2 = data.spread2 - pixel_variance
    light2 = np.maximum(pixel_variance - code_variance, 0.0)
    shift = 0.5 * (bend * (texture2 - mean_variance) + light2 * (slope**2 * np.log(2.0) + bend))
    return np.asarray(np.clip(shift, -_MOST_SHIFT, _MOST_SHIFT))


def dispersion(data: ChannelSamples, found: Weighed, weight: Doubles) -> float:
    """Return how much more the means over cells of frames and codes vary than independent patches would; at least 1.

    Light that changes, a shutter that is off and processing that looks at the whole picture move many patches alike:
    then they are worth as much less. ``weight``: (N,) 1 / stops2, one an observation.
    """
    cell = data.frame * _CELLS + np.minimum(found.predicted * (_CELLS / 256), _CELLS - 1).astype(np.int64)
    total = np.bincount(cell, weight)
    mean = np.bincount(cell, weight * found.residual)
    full = (np.bincount(cell, weight > 0) >= _CELL_PATCHES) & (total > 0)
    return 1.0 if full.sum() < _CELLS / 2 else max(1.0, float(np.mean(mean[full] ** 2 / total[full])))


def _per_sample(data: ChannelSamples, values: Doubles) -> Doubles:
    return np.asarray(np.add.reduceat(values, data.starts))


@dataclass(frozen=True)
class Equations:
    """Normal equations of one channel, the patches' light eliminated: over spline coefficients, then frames."""

    matrix: Doubles
    right: Doubles
    square: float
    """Weighted sum of the squared left-hand sides."""
    count: float
    """Observations less patches: what is free."""

    def misfit(self, coefficients: Doubles) -> float:
        """Return the weighted sum of squared residuals with the coefficients of the curve, times as given.

        ``coefficients``: (K,) of the spline.
        """
        k = len(coefficients)
        return max(float(self.square + coefficients @ (self.matrix[:k, :k] @ coefficients - 2 * self.right[:k])), 0.0)


def equations(
    data: ChannelSamples, fine: FineCurve, log2_times: Doubles, found: Weighed, weight: Doubles, *, times: bool
) -> Equations:
    """Build them: unknown are the change of the curve and, with ``times``, of the log2 times.

    ``log2_times``: (F,) log2 of seconds; ``weight``: (N,) 1 / stops2, one an observation.
    """
    basis = spline_basis()
    k, n_frames = len(basis.penalty), len(log2_times) if times else 0
    log2, _, _ = fine.at(data.mean)
    place, value = basis.entries(data.mean)
    target = log2_times[data.frame] - log2 - found.shift
    columns = [*place.T, *([k + data.frame] if times else []), np.full(len(target), k + n_frames)]
    values = [*value.T, *([np.full(len(target), -1.0)] if times else []), target]
    gram = _gram(data, columns, values, weight, k + n_frames + 1)
    used = _per_sample(data, (weight > 0).astype(np.float64))
    return Equations(gram[:-1, :-1], gram[:-1, -1], float(gram[-1, -1]), float(np.maximum(used - 1, 0).sum()))


def _gram(data: ChannelSamples, columns: list[Int64s], values: list[Doubles], weight: Doubles, size: int) -> Doubles:
    """Return the weighted sum of products (size, size) of sparse rows, each patch's weighted mean taken off."""
    gram = np.zeros(size * size)
    total = np.zeros(data.n_samples * size)
    for a, (column, value) in enumerate(zip(columns, values, strict=True)):
        weighted = weight * value
        total += np.bincount(data.sample * size + column, weighted, total.size)
        for other, other_value in zip(columns[a:], values[a:], strict=True):
            gram += np.bincount(column * size + other, weighted * other_value, gram.size)
    square = gram.reshape(size, size)
    # Each pair of entries was counted once: columns grow along a row, so that all lies above the diagonal.
    square = square + square.T - np.diag(np.diag(square))
    rows = total.reshape(-1, size) / np.sqrt(np.maximum(_per_sample(data, weight), 1e-300))[:, None]
    # Without BLAS, whose threads wait for each other longer than so small a product takes.
    return np.asarray(square - np.einsum("si,sj->ij", rows, rows))


@dataclass(frozen=True)
class Solution:
    """A smooth change of the curve, and what the frames' times would say."""

    change: Doubles
    """(256,) stops to add; 0 at the gauge code."""
    covariance: Doubles
    """(N_BASIS, N_BASIS) of the coefficients."""
    scale2: float
    """Residual variance over what the noise model says."""
    strength: tuple[float, float]
    """Of the prior that was chosen: amplitude of the principal curves, log10 of the rest's stiffness."""
    time_matrix: Doubles
    """(frames, frames) information on the log2 times with the curve eliminated."""
    time_right: Doubles


def solve(eq: Equations, start: Doubles, prior: CurvePrior, independent: float = 1.0) -> Solution:
    """Solve under priors of every strength, each as probable as restricted maximum likelihood makes it.

    The curve is their mean, and what they differ by is doubt of it (Hoeting et al. 1999; Patterson and Thompson 1971).
    ``start``: (N_BASIS,) coefficients of the present curve over the prior's: the prior is on their sum;
    ``independent``: share of the observations that are, where a camera's processing makes neighbours alike.
    """
    basis = spline_basis()
    k = len(basis.penalty)
    data = eq.matrix[:k, :k]
    scale = max(float(np.trace(data)) / k, 1e-300)
    gauge = basis.at(np.array([float(_GAUGE_CODE)]))
    data = data + scale * gauge.T @ gauge + 1e-12 * scale * np.eye(k)
    right = eq.right[:k]
    count = max(eq.count * independent / CELL_COUNT - 2, 1)
    scores, answers = np.empty(len(prior.candidates)), np.empty((len(prior.candidates), k))
    inverses = np.linalg.inv(data + np.array([one.precision for one in prior.candidates]))
    for number, one in enumerate(prior.candidates):
        answers[number] = inverses[number] @ (right - one.precision @ start)
        total = answers[number] + start
        fit = max(eq.misfit(answers[number]) + float(total @ one.precision @ total), 1e-12)
        scores[number] = count * np.log(fit) + np.linalg.slogdet(data + one.precision)[1] - one.log_determinant
    share = np.exp((scores.min() - scores) / 2)
    share /= share.sum()
    chosen = prior.candidates[int(np.argmin(scores))]
    inverse, answer = np.tensordot(share, inverses, 1), np.asarray(share @ answers)
    apart = (answers - answer) * np.sqrt(share)[:, None]
    cross = eq.matrix[k:, :k]
    return Solution(
        answer,
        inverse + apart.T @ apart,
        eq.misfit(answer) / max(eq.count, 1.0),
        (chosen.amplitude, chosen.log_strength),
        np.asarray(eq.matrix[k:, k:] - cross @ inverse @ cross.T),
        np.asarray(eq.right[k:] - cross @ answer),
    )

"""A kernel of stray light from the places where it was measured: shares that are not negative, and their doubt.

The kernel is a sum of scatter that falls off as the cube of the angle beyond one of three widths (Cauchy's distribution
in the plane), and of light that is spread evenly. A clipped light has an unknown factor of what it shows, as likely at
every size, which what it scatters shows together with the shares.
"""

import math
from dataclasses import dataclass

import numpy as np
from scipy.optimize import nnls
from scipy.special import ndtr, ndtri

from processing.ground.arrays import Doubles, Indices

WIDTHS_RAD = (0.1, 0.3, 0.9)
"""Of the three parts of a kernel; chosen: from a cell to half the field, each three times the one before."""
VEIL_INDEX = 0.0125
"""Stray light over the mean luminance where none was measured; chosen: the root mean square of the 0.003 to 0.02 that
good lenses have (ISO 9358)."""
PRIOR_SHARE = VEIL_INDEX / math.sqrt(len(WIDTHS_RAD) + 1)
"""Standard deviation about 0 of each part's share before anything is measured: together a lens's usual index."""
SECTORS = 8  # of the places, around a circle or a lamp, left out in turn (jackknife); chosen
MOST_CLIPPED = 10.0
"""Light that clipping may hide, over all that is shown. Chosen: thrice the most of seven real scenes with their sun."""
LEAST_FACTOR = 0.03  # of the clipped light, over what it shows: from here on it is log-uniform; chosen
_FACTORS = 48  # tried; chosen
_ALIKE = 4  # parts of a sector whose cells err together; chosen, by halos out of the family on validation seeds
_LEAST_MISFIT = 0.02  # relative, of a cell: no glare is smoother than that. Chosen.
_FAINT = 0.2  # of the places' mean: below it errors are alike. Chosen.
_DRAWS, _SWEEPS = 256, 60  # draws, and steps to each; chosen


@dataclass(frozen=True)
class GlareKernel:
    """What a lens does with light: shares that go to each of `WIDTHS_RAD`, and last everywhere alike."""

    shares: tuple[float, ...]
    covariance: tuple[tuple[float, ...], ...]
    misfit: float
    """Root mean square of the measured places' departure from what the kernel gives, over that of their light."""
    index: float
    """Luminance of the glare over the mean luminance of the field (veiling glare index, ISO 9358), where measured."""
    hidden: tuple[float, ...] = (0.0,) * 4
    """Shares times how much more light clipped pixels have than they show; the covariance is of both."""
    two_lenses: bool = False
    """Whether light stays within the lens that it came through: of two, along the panorama's middle and against it."""


def hidden_factors(light: Doubles) -> Doubles:
    """Return what clipped light may hide over what it shows, (H,); ``light`` (N, 2): what is shown, and clipped."""
    most = MOST_CLIPPED * light[:, 0].sum() / max(light[:, 1].sum(), 1e-30)
    return np.geomspace(LEAST_FACTOR, max(most, LEAST_FACTOR), _FACTORS) if light[:, 1].any() else np.zeros(1)


def fit_kernel(parts: Doubles, found: Doubles, sector: Indices, factors: Doubles) -> GlareKernel:
    """Return the kernel of places' light ``found`` (N,), of parts (2, P, N) of the light shown and of the clipped.

    Least squares with the prior's as further rows. Errors go by the root of the light, are as large as what the fit
    leaves, and alike in parts of a ``sector`` (N,). ``factors`` (H,): what clipped light may hide, over what it shows.
    """
    mean = max(float(np.mean(found)), 1e-30)
    level = np.sqrt(np.maximum(found, _FAINT * mean) * mean)
    both = parts.reshape(-1, len(found))
    table = np.vstack([both, found[None]]) / level
    # A few rows have the sums of squares of all.
    sectors = [_short(table[:, sector == k].T) for k in np.unique(sector)]
    rows = _short(np.vstack(sectors))
    alike, relative = math.sqrt(max(len(found) / (_ALIKE * SECTORS), 1)), 0.1
    for _ in range(4):
        likeliest = _likeliest(rows / (relative * alike), factors)
        left = float(np.linalg.norm(rows @ np.append(likeliest, -1)))
        relative = max(left / math.sqrt(len(found)), _LEAST_MISFIT)
    misfit = float(np.linalg.norm(found - likeliest @ both) / max(float(np.linalg.norm(found)), 1e-30))
    scale, count = relative * alike, len(parts[0])
    shares, covariance = _posterior(rows / scale, factors, likeliest)
    others = [np.vstack(sectors[:k] + sectors[k + 1 :]) / scale for k in range(len(sectors))]
    without = np.array([_likeliest(one, factors) for one in others if len(others) > 1])
    if len(without):
        spread = without - without.mean(axis=0)
        covariance += (len(without) - 1) / len(without) * spread.T @ spread
    # A kernel that fits badly shows as little as none. Of clipped light, the spread is the geometric mean of what this
    # kernel hides and of what the prior allows.
    power = np.square(shares)
    known = float(power[count:].sum() / max(power[:count].sum(), 1e-30))
    own = np.repeat([1.0, math.sqrt(known * float(np.mean(factors**2)))], count)
    covariance += misfit * PRIOR_SHARE**2 * np.diag(own)
    rounded = tuple(map(tuple, covariance.tolist()))
    return GlareKernel(tuple(shares[:count].tolist()), rounded, misfit, 0.0, tuple(shares[count:].tolist()))


def _short(rows: Doubles) -> Doubles:
    return np.asarray(np.linalg.qr(rows, mode="r"))


def _at(rows: Doubles, factor: float) -> tuple[Doubles, Doubles]:
    """Return the P columns of light shown plus ``factor`` times the clipped, and what they make."""
    count = rows.shape[1] // 2
    return rows[:, :count] + factor * rows[:, count:-1], rows[:, -1]


def _shares(rows: Doubles, factor: float) -> tuple[Doubles, float]:
    """Return the likeliest shares (P,) >= 0 for a factor, and their sum of squares with the prior's."""
    some, goal = _at(rows, factor)
    unit = np.eye(some.shape[1]) / PRIOR_SHARE
    shares, norm = nnls(np.vstack([some, unit]), np.append(goal, np.zeros(len(unit))))
    return np.asarray(shares), float(norm) ** 2


def _likeliest(rows: Doubles, factors: Doubles) -> Doubles:
    """Return the shares of light shown and of clipped light, (2 P,), of the factor that fits best."""
    tries = [_shares(rows, factor) for factor in factors]
    best = int(np.argmin([squares for _, squares in tries]))
    return np.concatenate([tries[best][0], factors[best] * tries[best][0]])


def _posterior(rows: Doubles, factors: Doubles, likeliest: Doubles) -> tuple[Doubles, Doubles]:
    """Return the shares (2 P,) and their covariance: where light is clipped, over all that it may hide (Gibbs).

    Given the factor, shares are Gaussian, cut off at 0; given shares, the factors' likelihoods are known. It starts
    from factors drawn by the volume of their shares (Laplace)."""
    rng, count = np.random.default_rng(0), rows.shape[1] // 2
    tables = [_at(rows, factor) for factor in factors]
    squares = np.array([some.T @ some for some, _ in tables]) + np.eye(count) / PRIOR_SHARE**2
    if len(factors) == 1:
        covariance = np.zeros((2 * count, 2 * count))
        covariance[:count, :count] = np.linalg.inv(squares[0])
        return likeliest, covariance
    goals = np.array([some.T @ goal for some, goal in tables])
    tries = [_shares(rows, factor) for factor in factors]
    log = -0.5 * (np.array([one[1] for one in tries]) + np.linalg.slogdet(squares)[1])
    weights = np.exp(log - log.max())
    which = rng.choice(len(factors), _DRAWS, p=weights / weights.sum())
    shares = np.array([one[0] for one in tries])[which]
    for _ in range(_SWEEPS):
        square, goal = squares[which], goals[which]
        for k in range(count):
            sigma = 1 / np.sqrt(square[:, k, k])
            middle = shares[:, k] + (goal[:, k] - (square[:, k] * shares).sum(axis=1)) * sigma**2
            below = ndtr(-middle / sigma)
            drawn = ndtri(np.minimum(below + rng.random(_DRAWS) * (1 - below), 1 - 1e-12))
            shares[:, k] = np.maximum(middle + sigma * drawn, 0)
        log = shares @ goals.T - 0.5 * np.einsum("dj,hjk,dk->dh", shares, squares, shares)
        which = np.argmax(log + rng.gumbel(size=log.shape), axis=1)
    draws = np.hstack([shares, factors[which][:, None] * shares])
    return draws.mean(axis=0), np.asarray(np.cov(draws.T))

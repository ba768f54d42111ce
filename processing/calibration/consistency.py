"""Do the frames tell the same story? Offsets between neighbouring frames, from a sparse grid of pixels.

Where both of two frames are well exposed they must give the same radiance, whatever the code. A common offset is a
wrong time or light that changed; an offset that hangs on the code is a wrong response curve. The scatter tells whether
the noise model holds here, and whether the channels' noise is one (JPEG codes luma finely and chroma coarsely).
"""

from __future__ import annotations

from processing.ground.arrays import Doubles, Floats

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from processing.calibration.merge_tables import Samples
from processing.frames import Codes
from processing.images import LUMINANCE_WEIGHTS

Seen = tuple[Floats, Floats]
GRID_SAMPLES = 12_000
MIN_SAMPLES = 120
MARGIN_SIGMAS = 3.0
MAX_SIGMA = 0.25
BINS = 5
CODES_8BIT = 256
CLEAR_OF_BLACK = 8
"""Codes below it are shifted by cut-off noise and by JPEG coding, whatever the curve."""
TINY = 1e-30
MAX_LOOKS = 4
FACTOR_LIMITS = (0.7, 1000.0)


@dataclass(frozen=True)
class Consistency:
    """In stops; frames from the longest time to the shortest."""

    offset: Doubles
    """(F,): how much brighter each frame is than the frames together say; 0 where it cannot be told."""
    curve_error: float
    """How far the offsets of different codes of one pair are apart, at most."""
    noise_factor: float = 1.0
    """Variance of the scatter over what the noise model expects."""
    correlation: float = 0.0
    """Of the noise of two channels, 0..1; a mean that counts pairs of channels as luminance does."""


def frame_consistency(frames: Sequence[Codes], tables: Samples) -> Consistency:
    """Return how well frames (sorted, (H, W, 3)) agree with the times and the curve in the tables."""
    step = max(1, int(np.sqrt(frames[0].shape[0] * frames[0].shape[1] / GRID_SAMPLES)))
    sparse = (slice(step // 2, None, step), slice(step // 2, None, step))
    seen = [tables.sample(f, frame[sparse].reshape(-1, 3)) for f, frame in enumerate(frames)]
    assumed = 1.0
    # The range that both frames show, with a margin for noise, hangs on the noise that is found in it.
    for _ in range(MAX_LOOKS):
        pairs = [_pair(seen[f], seen[f + 1], tables, f, assumed) for f in range(len(frames) - 1)]
        found, correlation = _noise([pair.scatter for pair in pairs])
        if found <= 1.3 * assumed:
            break
        assumed = found
    return Consistency(
        _offsets([pair.offset for pair in pairs]), max((p.curve_error for p in pairs), default=0.0), found, correlation
    )


@dataclass(frozen=True)
class _Pair:
    offset: float | None
    """Of the longer frame against the shorter, in stops."""
    curve_error: float
    scatter: Doubles
    """(n, 3): differences over their expected standard deviation."""


def _pair(longer: Seen, shorter: Seen, tables: Samples, place: int, factor: float) -> _Pair:
    """Compare two frames where both expose well.

    Pixels are chosen by the mean of both, whose noise is independent of their difference: choosing by one frame's code
    would choose its noise too, and show an offset where there is none.
    """
    (a, weight_a), (b, weight_b) = longer, shorter
    ratio = float(np.median(tables.saturation[place + 1] / tables.saturation[place]))
    mean = (ratio * a.astype(np.float64) + b) / (ratio + 1)
    low, high = _range(tables, place, factor)
    good = (mean > low) & (mean < high) & (a > 0) & (b > 0)
    if good.sum() < MIN_SAMPLES:
        return _Pair(None, 0.0, np.empty((0, 3)))
    stops = np.log2(np.maximum(a, TINY).astype(np.float64) / np.maximum(b, TINY))
    whole = good.all(axis=1) & (weight_a > 0).all(axis=1) & (weight_b > 0).all(axis=1)
    apart = (a[whole] - b[whole]) / mean[whole]
    expected = 1 / (weight_a[whole] * mean[whole] ** 2) + 1 / (weight_b[whole] * mean[whole] ** 2)
    scatter = (apart - np.median(apart, axis=0)) / np.sqrt(expected) if whole.any() else np.empty((0, 3))
    return _Pair(float(np.median(stops[good])), _by_level(stops[good], mean[good]), scatter)


def _range(tables: Samples, place: int, factor: float) -> tuple[Doubles, Doubles]:
    """Return the radiances (3,) between which the longer frame does not clip and the shorter is not dark (3 sigma)."""
    (a, weight_a), (b, weight_b) = (tables.sample(p, tables.every) for p in (place, place + 1))
    sigma_a = np.sqrt(factor / np.maximum(weight_a * a.astype(np.float64) ** 2, TINY))
    sigma_b = np.sqrt(factor / np.maximum(weight_b * b.astype(np.float64) ** 2, TINY))
    below = (a * (1 + MARGIN_SIGMAS * sigma_a) < tables.saturation[place]) & (sigma_a < MAX_SIGMA)
    above = (b * (1 - MARGIN_SIGMAS * sigma_b) > 0) & (sigma_b < MAX_SIGMA) & (weight_b > 0)
    if len(above) == CODES_8BIT:
        above[:CLEAR_OF_BLACK] = False
    high = np.max(np.where(below, a, 0.0), axis=0)
    low = np.min(np.where(above, b, np.inf), axis=0)
    return low, high


def _by_level(stops: Doubles, level: Doubles) -> float:
    """Return the spread of the median offset over bins of the level, less what chance makes of it."""
    edges = np.quantile(level, np.linspace(0, 1, BINS + 1)[1:-1])
    bins = np.searchsorted(edges, level)
    medians, doubts = [], []
    for k in range(BINS):
        mine = stops[bins == k]
        if len(mine) >= MIN_SAMPLES // 4:
            medians.append(float(np.median(mine)))
            # Of a median: 1.253 times the mean's.
            doubts.append(1.253 * 1.4826 * float(np.median(np.abs(mine - medians[-1]))) / np.sqrt(len(mine)))
    if len(medians) < 2:
        return 0.0
    return max(0.0, max(medians) - min(medians) - 3.0 * float(np.hypot(max(doubts), max(doubts))))


def _offsets(pairs: Sequence[float | None]) -> Doubles:
    """Return each frame's offset from the median of all, given each pair's difference (None: unknown, taken as 0)."""
    down = np.concatenate([[0.0], np.cumsum([-(p or 0.0) for p in pairs])])
    return np.asarray(down - np.median(down))


def _noise(scatter: Sequence[Doubles]) -> tuple[float, float]:
    """Return the variance of normalised differences (n, 3), and the correlation of channels; robust."""
    sizes = [len(one) for one in scatter]
    if sum(sizes) < MIN_SAMPLES:
        return 1.0, 0.0
    every = np.concatenate([one for one in scatter if len(one)])
    own = float(np.mean(_robust_variance(every)))
    if own <= 0:
        return FACTOR_LIMITS[0], 0.0
    turned = np.roll(every, 1, axis=1)
    plus, minus = _robust_variance(every + turned), _robust_variance(every - turned)
    # Column c: channels c and c - 1; each pair counts as its product counts in luminance.
    pairs = np.array(LUMINANCE_WEIGHTS) * np.roll(LUMINANCE_WEIGHTS, 1)
    correlation = float(np.average((plus - minus) / np.maximum(plus + minus, 1e-30), weights=pairs))
    return float(np.clip(own, *FACTOR_LIMITS)), float(np.clip(correlation, 0.0, 1.0))


def _robust_variance(values: Doubles) -> Doubles:
    """Return the variance (3,) by the median of absolute values: what moved does not count."""
    return np.asarray((1.4826 * np.median(np.abs(values), axis=0)) ** 2)

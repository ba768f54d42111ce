"""Do the frames tell the same story? Offsets between neighbouring frames, from a sparse grid of pixels.

Where both of two frames are well exposed they must give the same radiance, whatever the code. A common offset is a
wrong time or light that changed; an offset that hangs on the code is a wrong response curve. The scatter tells whether
the noise model holds here, and whether the channels' noise is one (JPEG codes luma finely and chroma coarsely).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from processing.calibration.merge_tables import Samples
from processing.frames import Codes
from processing.images import LUMINANCE_WEIGHTS

Reals = npt.NDArray[np.float64]
GRID_SAMPLES = 60_000
MIN_SAMPLES = 120
MIN_SNR2 = 150.0
BINS = 5
FACTOR_LIMITS = (0.7, 1000.0)


@dataclass(frozen=True)
class Consistency:
    """In stops; frames from the longest time to the shortest."""

    offset: Reals
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
    codes = np.stack([frame[step // 2 :: step, step // 2 :: step].reshape(-1, 3) for frame in frames])
    pairs: list[float | None] = []
    curve_error, scatter = 0.0, []
    for f in range(len(frames) - 1):
        (a, weight_a), (b, weight_b) = (tables.sample(g, codes[g]) for g in (f, f + 1))
        good = (weight_a * a**2 > MIN_SNR2) & (weight_b * b**2 > MIN_SNR2)
        if good.sum() < MIN_SAMPLES:
            pairs.append(None)
            continue
        stops = np.log2(a[good].astype(np.float64) / b[good])
        pairs.append(float(np.median(stops)))
        curve_error = max(curve_error, _by_code(stops, codes[f][good]))
        whole = good.all(axis=1)
        ratio = np.log(a[whole].astype(np.float64) / b[whole])
        expected = 1 / (weight_a * a**2)[whole].astype(np.float64) + 1 / (weight_b * b**2)[whole]
        scatter.append((ratio - np.median(ratio, axis=0)) / np.sqrt(expected))
    return Consistency(_offsets(pairs), curve_error, *_noise(scatter))


def _noise(scatter: Sequence[Reals]) -> tuple[float, float]:
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


def _robust_variance(values: Reals) -> Reals:
    """Return the variance (3,) by the median of absolute values: what moved does not count."""
    return np.asarray((1.4826 * np.median(np.abs(values), axis=0)) ** 2)


def _by_code(stops: Reals, codes: Codes) -> float:
    """Return the spread of the median offset over bins of the code."""
    edges = np.quantile(codes, np.linspace(0, 1, BINS + 1)[1:-1])
    bins = np.searchsorted(edges, codes)
    medians = [float(np.median(stops[bins == k])) for k in range(BINS) if np.sum(bins == k) >= MIN_SAMPLES // 4]
    return max(medians) - min(medians) if len(medians) > 1 else 0.0


def _offsets(pairs: Sequence[float | None]) -> Reals:
    """Return each frame's offset from the median of all, given each pair's difference (None: unknown, taken as 0)."""
    down = np.concatenate([[0.0], np.cumsum([-(p or 0.0) for p in pairs])])
    return np.asarray(down - np.median(down))

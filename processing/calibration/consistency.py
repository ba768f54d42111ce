"""Do the frames tell the same story? Offsets between neighbouring frames, from a sparse grid of pixels.

Where both of two frames are well exposed they must give the same radiance, whatever the code. A common offset is a
wrong time or light that changed; an offset that hangs on the code is a wrong response curve.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from processing.calibration.merge_tables import Samples
from processing.frames import Codes

Reals = npt.NDArray[np.float64]
GRID_SAMPLES = 60_000
MIN_SAMPLES = 120
MIN_SNR2 = 150.0
BINS = 5


@dataclass(frozen=True)
class Consistency:
    """In stops; frames from the longest time to the shortest."""

    offset: Reals
    """(F,): how much brighter each frame is than the frames together say; 0 where it cannot be told."""
    curve_error: float
    """How far the offsets of different codes of one pair are apart, at most."""


def frame_consistency(frames: Sequence[Codes], tables: Samples) -> Consistency:
    """Return how well frames (sorted, (H, W, 3)) agree with the times and the curve in the tables."""
    step = max(1, int(np.sqrt(frames[0].shape[0] * frames[0].shape[1] / GRID_SAMPLES)))
    codes = np.stack([frame[step // 2 :: step, step // 2 :: step].reshape(-1, 3) for frame in frames])
    pairs: list[float | None] = []
    curve_error = 0.0
    for f in range(len(frames) - 1):
        (a, weight_a), (b, weight_b) = (tables.sample(g, codes[g]) for g in (f, f + 1))
        good = (weight_a * a**2 > MIN_SNR2) & (weight_b * b**2 > MIN_SNR2)
        if good.sum() < MIN_SAMPLES:
            pairs.append(None)
            continue
        stops = np.log2(a[good].astype(np.float64) / b[good])
        pairs.append(float(np.median(stops)))
        curve_error = max(curve_error, _by_code(stops, codes[f][good]))
    return Consistency(_offsets(pairs), curve_error)


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

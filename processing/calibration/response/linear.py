"""Noise, black level and times of linear frames (camera raw, 16 bits), from the frames themselves.

Two frames of one light are a straight line against each other: its slope is the ratio of the times, its intercept the
black level, the scatter about it the noise (EMVA 1288, section 6: mean against variance).
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from processing.calibration.response.curve import MOST_BLACK, NoiseModel, three
from processing.errors import ParameterError, ResponseError
from processing.ground.arrays import Doubles, UInt16s
from processing.pictures.mosaic import FULL

GRID_SAMPLES = 60_000  # pixels compared; chosen
USABLE = 0.95  # of full scale; chosen: clear of saturation and of what a smaller white level would clip
BRIGHT, DARK = 0.1, 0.03  # of full scale: pixels that give the slope, and the intercept; chosen
ALIKE = 0.9  # ratio of two times above which they show no black level; chosen
LEAST = 200  # pixels for a median; chosen
ROUNDS = 6  # between slope and black level; each is wrong by a twentieth of the other's error
BINS = 24  # of the signal, in which scatter is taken; chosen
LEAST_STOPS = 0.01  # chosen: a time this close to the data is left alone
SIGMAS = 3.0  # of the slope, beyond which a time is changed
TIME_SIGMA = 0.002  # relative, of a time by the frames; chosen: sensors are straight to a few thousandths


@dataclass(frozen=True)
class LinearFit:
    """What linear frames say of their camera."""

    noise: NoiseModel
    """With the black level."""
    times_s: tuple[float, ...]
    time_sigma: tuple[float, ...]
    """Relative."""
    warnings: tuple[str, ...] = ()


def fit_linear(frames: Sequence[UInt16s], times_s: Sequence[float], black: float = 0.0) -> LinearFit:
    """Return what frames (H, W, 3) of times (s) in any order show; ``black``: of full scale, where to begin.

    Raises `ResponseError`: fewer than two frames that show the same light; `ParameterError`: times that are not
    above 0 s, one a frame.
    """
    if not len(times_s) == len(frames) > 0 or not all(0 < time_s < math.inf for time_s in times_s):
        raise ParameterError(f"frames need a time above 0 s each: {len(frames)} frames, times {list(times_s)}")
    order = np.argsort(-np.asarray(times_s), kind="stable")
    height, width = frames[0].shape[:2]
    # Odd, so that all wells of a mosaic's cell have their turn.
    step = max(1, int(math.sqrt(height * width / GRID_SAMPLES))) | 1
    seen = np.stack([frames[k][::step, ::step].reshape(-1, 3) for k in order]) / FULL
    given = np.asarray(times_s, dtype=np.float64)[order]
    level, slopes = np.full(3, black), given[1:] / given[:-1]
    doubt = np.full(len(slopes), np.inf)
    for _ in range(ROUNDS):
        for k in range(len(slopes)):
            slopes[k], doubt[k] = _slope(seen[k] - level, seen[k + 1] - level, slopes[k])
        level = _black(seen, slopes, level)
    if not (np.isfinite(doubt).any() and np.all(np.abs(level) < MOST_BLACK)):
        raise ResponseError("no two frames show the same light", advice="give frames at most six stops apart")
    log2, sigma, warnings = _times(given, slopes, doubt)
    photon, read = zip(*(_noise(seen[..., c] - level[c], slopes) for c in range(3)), strict=True)
    back = np.argsort(order)
    model = NoiseModel(three(photon), three(read), (0.0, 0.0, 0.0), three(level.tolist()))
    return LinearFit(model, tuple(np.exp2(log2)[back].tolist()), tuple(sigma[back].tolist()), warnings)


def _slope(longer: Doubles, shorter: Doubles, given: float) -> tuple[float, float]:
    """Return the shorter frame's light over the longer's, and its relative standard uncertainty (inf: as given)."""
    good = (longer > max(BRIGHT, 1.5 * DARK)) & (longer < USABLE) & (shorter > 0)
    if np.count_nonzero(good) < LEAST:
        return given, math.inf
    ratio = np.log(shorter[good] / longer[good])
    middle = float(np.median(ratio))
    spread = 1.253 * 1.4826 * float(np.median(np.abs(ratio - middle))) / math.sqrt(ratio.size)
    return math.exp(middle), spread


def _black(seen: Doubles, slopes: Doubles, level: Doubles) -> Doubles:
    """Return the black level (3,) by dark pixels' intercepts; ``level`` where there are too few."""
    apart = slopes < ALIKE
    ratio, dark = slopes[apart, None, None], seen[:-1][apart] - level < DARK
    found = (seen[1:][apart] - ratio * seen[:-1][apart]) / (1 - ratio)
    chosen = [found[..., c][dark[..., c]] for c in range(3)]
    return np.array([np.median(one) if one.size >= LEAST else level[c] for c, one in enumerate(chosen)])


def _times(given: Doubles, slopes: Doubles, doubt: Doubles) -> tuple[Doubles, Doubles, tuple[str, ...]]:
    """Return log2 times, relative uncertainties, and what is odd: as given unless the frames say otherwise."""
    off = np.log2(slopes) - np.diff(np.log2(given))
    known = np.isfinite(doubt)
    wrong = known & (np.abs(off) > np.maximum(LEAST_STOPS, SIGMAS * np.where(known, doubt, 0) / math.log(2)))
    moved = np.concatenate([[0.0], np.cumsum(np.where(wrong, off, 0.0))])
    moved -= np.median(moved)
    sigma = np.hypot(TIME_SIGMA, np.concatenate([[0.0], np.where(wrong, doubt, 0.0)]))
    texts = tuple(
        f"the frame of {time:.6g} s is {stops:+.2f} stops against its time; what the frames say is used"
        for time, stops in zip(given, moved, strict=True)
        if abs(stops) > 0.1
    )
    return np.log2(given) + moved, sigma, texts


def _noise(seen: Doubles, slopes: Doubles) -> tuple[float, float]:
    """Return photon and read noise of a channel (F, n) by the scatter of neighbouring frames over bins of the light."""
    from scipy.optimize import nnls

    rows, squares = [], []
    for longer, shorter, slope in zip(seen[:-1], seen[1:], slopes, strict=True):
        use = longer < USABLE
        level, apart = slope * longer[use], (shorter - slope * longer)[use]
        bins = np.digitize(level, np.geomspace(1e-5, 1.0, BINS))
        for b in np.unique(bins):
            mine, light = apart[bins == b], max(float(np.mean(level[bins == b])), 0.0)
            if mine.size >= LEAST:
                squares.append(max((1.4826 * float(np.median(np.abs(mine - np.median(mine))))) ** 2, 1e-14))
                rows.append((light * (1 + slope), 1 + slope**2))
    if not rows:
        return 1e-4, 1e-3
    weighed = np.array(rows) / np.array(squares)[:, None]
    size = np.maximum(weighed.max(axis=0), 1e-30)
    photon, read2 = nnls(weighed / size, np.ones(len(rows)))[0] / size
    return float(photon), math.sqrt(float(read2))

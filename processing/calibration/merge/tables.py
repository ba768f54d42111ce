"""What the merge looks up for each code of each frame, and whether the frames so read agree with one another.

A sample of frame f with code z says that the radiance is v = x(z) / t_f, with the relative variance of the noise
model plus the squared uncertainty of curve and time; its weight is w = 1 / (v2 relative variance). Entries of four
floats (w, w v, w v2, 0) make one vector addition a sample: mean, variance and chi-squared of all frames at once.

Ends: clipped codes weigh nothing, and dark ones only in the longest frame. But so that no sum is empty, the shortest
frame's clipped codes stand for the saturation level with a weight (`TRACE_SNR2`) that any other sample outweighs.

Where both of two neighbouring frames are well exposed they must give the same radiance, whatever the code
(`frame_consistency`, on a sparse grid of pixels). A common offset is a wrong time or light that changed; an offset that
depends on the code is a wrong response curve. The scatter shows whether the noise model holds here, and whether the
channels' noise is one (JPEG codes luma finely and chroma coarsely).
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Protocol

import numpy as np
import numpy.typing as npt

from processing.calibration.response.curve import NoiseModel, ResponseCurve
from processing.ground.arrays import Doubles, Floats, Int64s
from processing.pictures.frames import Codes
from processing.pictures.images import LUMINANCE_WEIGHTS

CODES = 256  # of 8 bits
TRACE_SNR2 = 1e-6  # squared signal to noise of a bound that is no measurement
TAPER_CODES = 6
"""Below the clipping code weights fall to a quarter: whether a sample there counts must not hang on its own noise."""
RISE_SIGMAS = 6.0  # chosen
COMMON_SHARE = 0.45  # measured: see `coding_error`


@dataclass(frozen=True)
class MergeTables:
    """Tables for frames sorted from the longest time to the shortest; see the module."""

    lanes: Floats
    """(F, 3, 256, 4): w, w v, w v2, 0: for sums."""
    samples: Floats
    """(F, 3, 256, 2): v and w of every code, dark ones too (their uncertainty is stated); w = 0 where clipped."""
    saturation: Floats
    """(F, 3): radiance at the last code that is not clipped."""
    any_clipped: int
    """From this code on some channel is clipped."""
    all_clipped: int
    """From this code on every channel is clipped."""
    last: Int64s
    """(F,): where frame k is unclipped, frames after ``last[k]`` are left out."""
    rise: int
    """A code that grows by more from one frame to the next shorter one is not noise."""
    clip_together: bool = False
    """Whether a sample counts only where no channel of its frame is clipped."""

    @property
    def every(self) -> Int64s:
        """All codes, (256, 3). Of shape (n, 3), int64."""
        return np.repeat(np.arange(CODES)[:, None], 3, axis=1)

    def sample(self, place: int, codes: npt.NDArray[np.generic]) -> tuple[Floats, Floats]:
        """Return radiance and weight of codes (..., 3) of frame ``place``; weight 0: clipped, the value is a bound.

        Values are float32 of the shape of ``codes``, radiance in exposures a second.
        """
        entry = self.samples[place].reshape(-1, 2).take(codes + np.arange(3) * self.samples.shape[2], axis=0)
        return entry[..., 0], entry[..., 1]


class Samples(Protocol):
    """What one sample of a frame says, for whatever kind of codes."""

    @property
    def saturation(self) -> Floats:
        """(F, 3): radiance at which each frame clips."""

    @property
    def every(self) -> Int64s:
        """Codes over the whole range, (n, 3), rising. Of shape (n, 3), int64."""

    def sample(self, place: int, codes: npt.NDArray[np.generic]) -> tuple[Floats, Floats]:
        """Return radiance and weight of codes (..., 3) of frame ``place``; weight 0: clipped, the value is a bound.

        Values are float32 of the shape of ``codes``, radiance in exposures a second.
        """


def linear_curve() -> ResponseCurve:
    """Return the curve of 8-bit frames that are linear: exposure 1 at code 255."""
    log2 = np.tile(np.log2(np.maximum(np.arange(CODES), 0.25) / 255.0), (3, 1))
    return ResponseCurve(log2, np.zeros_like(log2), (1, 1, 1), (252, 252, 252), method="linear")


def merge_tables(
    curve: ResponseCurve,
    noise: NoiseModel,
    times_s: Doubles,
    time_sigma: Doubles,
    max_error: float,
    top_code: int = 254,
) -> MergeTables:
    """Return the tables of frames with ``times_s`` (falling) of relative standard uncertainty ``time_sigma``.

    ``max_error``: by what part the uncertainty may grow where frames are left out. ``top_code``: above it, codes count
    as clipped; as do those that a clipped pixel's coding noise (5 sigma) may reach. ``times_s``: (F,) s;
    ``time_sigma``: (F,) relative, >= 0.
    """
    reach = [math.floor(253.5 - 5.0 * math.sqrt(variance)) for variance in noise.code_variance]
    red, green, blue = (
        max(low + 1, min(high, top_code, top)) for low, high, top in zip(curve.low, curve.high, reach, strict=True)
    )
    curve = replace(curve, high=(red, green, blue))
    x = curve.exposure
    own = noise.relative_variance(curve) + (np.log(2) * curve.sigma_log2) ** 2
    codes = np.arange(CODES)[None, :]
    low, high = (np.array(ends)[:, None] for ends in (curve.low, curve.high))
    at_low = np.take_along_axis(x, low, axis=1)
    # Below the lowest code the curve is a guess between 0 and the exposure there.
    own = np.where(codes < low, np.maximum(own, (0.5 * at_low / x) ** 2), own)
    v = x[None] / times_s[:, None, None]
    relative = own[None] + time_sigma[:, None, None] ** 2
    depth = np.clip((codes - (high - TAPER_CODES)) / TAPER_CODES, 0.0, 1.0)
    weight = np.where(codes > high, 0.0, np.asarray(1.0 - 0.75 * depth**2)) / (relative * v**2)
    used = np.where(codes < low, 0.0, weight)
    used[0] = np.where(codes < low, weight[0], used[0])
    saturation = np.take_along_axis(v, np.broadcast_to(high, (len(times_s), 3, 1)), axis=2)
    value = np.where(codes > high, saturation, v)
    used[-1] = np.where(codes > high, TRACE_SNR2 / value[-1] ** 2, used[-1])
    lanes = np.stack([used, used * value, used * value**2, np.zeros_like(used)], axis=-1)
    # By how many codes noise may at most make a pixel brighter in a shorter frame
    log2_sigma = np.sqrt(noise.relative_variance(curve)) / np.log(2)
    in_codes = log2_sigma / curve.log2_slope
    worst = max(float(np.max(in_codes[c, curve.low[c] : curve.high[c] + 1])) for c in range(3))
    return MergeTables(
        np.ascontiguousarray(lanes, dtype=np.float32),
        np.ascontiguousarray(np.stack([value, weight], axis=-1), dtype=np.float32),
        np.ascontiguousarray(saturation[..., 0], dtype=np.float32),
        int(min(curve.high)) + 1,
        int(max(curve.high)) + 1,
        _last_useful(curve, own, times_s, max_error),
        int(np.clip(np.ceil(RISE_SIGMAS * np.sqrt(2) * worst) + 1, 2, 120)),
        curve.clip_together,
    )


def coding_error(curve: ResponseCurve, noise: NoiseModel) -> float:
    """Return the squared relative error that coding leaves alike in all frames, so that differences do not show it.

    JPEG smooths chroma and fine detail of every frame in the same way. Measured on simulated frames with and without
    noise (quality 95, 4:2:0): 0.45 of what the coding noise of one frame is at middle codes.
    """
    slope = np.median(curve.log2_slope[:, 60:200]) * math.log(2)
    codes = float(np.dot(LUMINANCE_WEIGHTS, noise.code_variance))
    return float((COMMON_SHARE * slope) ** 2 * codes)


def _last_useful(curve: ResponseCurve, own: Doubles, times_s: Doubles, max_error: float) -> Int64s:
    """Return for each frame k the last frame that is needed where k is unclipped.

    The frames after it would shrink the standard uncertainty of no code by more than ``max_error``."""
    count = len(times_s)
    last = np.full(count, count - 1, dtype=np.int64)
    for k in range(count):
        information = np.zeros((count, 3, CODES))
        for c in range(3):
            usable = slice(curve.low[c], curve.high[c] + 1)
            grid, snr2 = curve.log2_exposure[c, usable], 1.0 / own[c, usable]
            for f in range(k, count):
                information[f, c, usable] = np.interp(grid + np.log2(times_s[f] / times_s[k]), grid, snr2, left=0.0)
        behind = np.cumsum(information[::-1], axis=0)[::-1]
        total = np.maximum(behind[k], 1e-30)
        for f in range(k, count - 1):
            if np.max(behind[f + 1] / total) <= 1.0 - (1.0 + max_error) ** -2:
                last[k] = f
                break
    return last


Seen = tuple[Floats, Floats]
GRID_SAMPLES = 12_000  # pixels compared; chosen
MIN_SAMPLES = 120  # chosen: a median to a tenth of the scatter
FIRM_SHARE = 0.02  # of the pixels compared; chosen: two frames that share less say little about each other
MARGIN_SIGMAS = 3.0  # clear of clipping and of dark; chosen
MAX_SIGMA = 0.25  # relative, of a sample that is compared; chosen
BINS = 5  # of the level; chosen
PARTS, PART_SAMPLES = (6, 12), 16  # rows and columns of parts whose light may change alone, and their least; chosen
CLEAR_OF_BLACK = 8  # codes below it are shifted by cut-off noise and by JPEG coding, whatever the curve
CLEAR_OF_WHITE = 16
"""Codes below the last unclipped one that do not count: of two all but white frames only they are left, and coding and
tone mapping bend them (a real bracket's white pair showed 0.9 stop that is not there)."""
TINY = 1e-30  # no division by 0
MAX_LOOKS = 4  # rounds; chosen
FACTOR_LIMITS = (0.7, 1000.0)  # chosen


@dataclass(frozen=True)
class Consistency:
    """In stops; frames from the longest time to the shortest."""

    offset: Doubles
    """(F,): how much brighter each frame is than the frames together say; 0 where it cannot be measured."""
    curve_error: float
    """How far the offsets of different codes of one firm pair are apart, at most."""
    noise_factor: float = 1.0
    """Variance of the scatter over what the noise model expects."""
    correlation: float = 0.0
    """Of the noise of two channels, 0..1; a mean that counts pairs of channels as luminance does."""
    neighbours: float = 0.0
    """Correlation of the noise of two pixels side by side: demosaicing, denoising and coding leave some."""
    wander: float = 0.0
    """Relative standard deviation by which parts of the picture change from frame to frame: clouds, flicker."""
    firm: float | Doubles = 0.0
    """(F,): `offset` by pairs of frames that share much of the picture: what a small part says may be its own."""


def frame_consistency(frames: Sequence[Codes], tables: Samples) -> Consistency:
    """Return how well frames (sorted, (H, W, 3)) agree with the times and the curve in the tables."""
    step = max(1, int(np.sqrt(frames[0].shape[0] * frames[0].shape[1] / GRID_SAMPLES)))
    sparse = (slice(step // 2, None, step), slice(step // 2, None, step))
    seen = [tables.sample(f, frame[sparse].reshape(-1, 3)) for f, frame in enumerate(frames)]
    assumed = 1.0
    height, width = frames[0][sparse].shape[:2]
    part = (np.arange(height)[:, None] * PARTS[0] // height) * PARTS[1] + np.arange(width) * PARTS[1] // width
    # The range that both frames show, with a margin for noise, hangs on the noise that is found in it.
    for _ in range(MAX_LOOKS):
        pairs = [_pair(seen[f], seen[f + 1], tables, (f, assumed), part.reshape(-1)) for f in range(len(frames) - 1)]
        found, correlation = _noise([pair.scatter for pair in pairs])
        if found <= 1.3 * assumed:
            break
        assumed = found
    # Each frame's offset is from the median of all; where a pair's difference is unknown, it is taken as 0.
    steps = np.array([-(pair.offset or 0.0) for pair in pairs])
    shared = np.array([pair.count > FIRM_SHARE * 3 * height * width for pair in pairs])
    down, firm = (np.concatenate([[0.0], np.cumsum(part)]) for part in (steps, steps * shared))
    return Consistency(
        np.asarray(down - np.median(down)),
        max((p.curve_error for p, firm in zip(pairs, shared, strict=True) if firm), default=0.0),
        found,
        correlation,
        _neighbours(frames, tables, (sparse[0], slice(step // 2, -1, step)), assumed),
        math.log(2) * math.sqrt(sum(p.wander2 for p in pairs) / max(sum(p.in_parts for p in pairs), 1)),
        np.asarray(firm - np.median(firm)),
    )


def _neighbours(frames: Sequence[Codes], tables: Samples, sparse: tuple[slice, slice], factor: float) -> float:
    """Return the correlation of what pixels and their right neighbours differ by from frame to frame; robust."""
    beside = (sparse[0], slice(sparse[1].start + 1, None, sparse[1].step))
    found = []
    for place in range(len(frames) - 1):
        low, high = _range(tables, place, factor)
        both = []
        for where in (sparse, beside):
            (a, _), (b, weight) = (tables.sample(p, frames[p][where].reshape(-1, 3)) for p in (place, place + 1))
            mean = (a.astype(np.float64) + b) / 2
            good = (mean > low) & (mean < high) & (weight > 0)
            both.append(np.where(good, (a - b) / np.maximum(mean, TINY), np.nan))
        whole = np.isfinite(both[0] + both[1]).all(axis=1)
        if whole.sum() >= MIN_SAMPLES:
            one, other = (part[whole] - np.median(part[whole], axis=0) for part in both)
            found.append(np.stack([_robust_variance(one + other), _robust_variance(one - other)]))
    if not found:
        return 0.0
    plus, minus = np.mean(found, axis=0)
    return float(np.mean((plus - minus) / np.maximum(plus + minus, TINY)))


@dataclass(frozen=True)
class _Pair:
    offset: float | None
    """Of the longer frame against the shorter, in stops."""
    curve_error: float
    scatter: Doubles
    """(n, 3): differences over their expected standard deviation."""
    wander2: float = 0.0
    """Squared stops by which parts of the picture changed apart from the whole, summed over `in_parts`."""
    in_parts: int = 0
    """Samples."""
    count: int = 0
    """Samples of all channels behind the offset."""


def _pair(longer: Seen, shorter: Seen, tables: Samples, assumed: tuple[int, float], part: Int64s) -> _Pair:
    """Compare two frames where both expose well; ``assumed``: place of the longer, factor of its noise's variance.

    Pixels are chosen by the mean of both, whose noise is independent of their difference: choosing by one frame's code
    would choose its noise too, and show an offset where there is none."""
    (a, weight_a), (b, weight_b) = longer, shorter
    place, factor = assumed
    ratio = float(np.median(tables.saturation[place + 1] / tables.saturation[place]))
    mean = (ratio * a.astype(np.float64) + b) / (ratio + 1)
    low, high = _range(tables, place, factor)
    # Where one channel is clipped a camera's colour matrix has bent the others.
    good = (mean > low) & (mean < high).all(axis=1, keepdims=True) & (a > 0) & (b > 0)
    if good.sum() < MIN_SAMPLES:
        return _Pair(None, 0.0, np.empty((0, 3)))
    stops = np.log2(np.maximum(a, TINY).astype(np.float64) / np.maximum(b, TINY))
    whole = good.all(axis=1) & (weight_a > 0).all(axis=1) & (weight_b > 0).all(axis=1)
    apart = (a[whole] - b[whole]) / mean[whole]
    expected = 1 / (weight_a[whole] * mean[whole] ** 2) + 1 / (weight_b[whole] * mean[whole] ** 2)
    scatter = (apart - np.median(apart, axis=0)) / np.sqrt(expected) if whole.any() else np.empty((0, 3))
    green = good[:, 1]
    parts = _wander2(stops[green, 1], mean[green, 1], part[green])
    return _Pair(float(np.median(stops[good])), _by_level(stops[good], mean[good]), scatter, *parts, int(good.sum()))


def _wander2(stops: Doubles, level: Doubles, part: Int64s) -> tuple[float, int]:
    """Return the summed squares of the parts' median change (n,) beyond chance, and of how many samples.

    What hangs on the level is taken off: that is the curve's."""
    if len(stops) < MIN_SAMPLES:
        return 0.0, 0
    bins = np.searchsorted(np.quantile(level, np.linspace(0, 1, BINS + 1)[1:-1]), level)
    stops = stops - np.array([np.median(stops[bins == k]) if (bins == k).any() else 0.0 for k in range(BINS)])[bins]
    chance2 = (1.253 * 1.4826 * float(np.median(np.abs(stops)))) ** 2
    counts = np.bincount(part)
    full = np.flatnonzero(counts >= PART_SAMPLES)
    if len(full) < BINS:
        return 0.0, 0
    found = [counts[k] * float(np.median(stops[part == k])) ** 2 - chance2 for k in full]
    return max(0.0, sum(found)), int(counts[full].sum())


def _range(tables: Samples, place: int, factor: float) -> tuple[Doubles, Doubles]:
    """Return the radiances (3,) between which the longer frame does not clip and the shorter is not dark (3 sigma)."""
    (a, weight_a), (b, weight_b) = (tables.sample(p, tables.every) for p in (place, place + 1))
    sigma_a = np.sqrt(factor / np.maximum(weight_a * a.astype(np.float64) ** 2, TINY))
    sigma_b = np.sqrt(factor / np.maximum(weight_b * b.astype(np.float64) ** 2, TINY))
    below = (a * (1 + MARGIN_SIGMAS * sigma_a) < tables.saturation[place]) & (sigma_a < MAX_SIGMA)
    above = (b * (1 - MARGIN_SIGMAS * sigma_b) > 0) & (sigma_b < MAX_SIGMA) & (weight_b > 0)
    if len(above) == CODES:  # of 8-bit frames
        above[:CLEAR_OF_BLACK] = False
        below &= tables.every <= np.sum(a < tables.saturation[place], axis=0) - CLEAR_OF_WHITE
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


def _noise(scatter: Sequence[Doubles]) -> tuple[float, float]:
    """Return the variance of normalised differences (n, 3), and the correlation of channels; robust."""
    if sum(map(len, scatter)) < MIN_SAMPLES:
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

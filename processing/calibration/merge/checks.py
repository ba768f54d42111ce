"""Do the frames tell the same story? Offsets between neighbouring frames, from a sparse grid of pixels.

Where both of two frames are well exposed they must give the same radiance, whatever the code. A common offset is a
wrong time or light that changed; an offset that hangs on the code is a wrong response curve. The scatter tells whether
the noise model holds here, and whether the channels' noise is one (JPEG codes luma finely and chroma coarsely).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from processing.calibration.merge.tables import Samples
from processing.calibration.response.curve import ResponseCurve
from processing.errors import BracketError, ParameterError
from processing.ground.arrays import Doubles, Floats
from processing.pictures.frames import ArrayFrame, Codes, FrameSource, same_file
from processing.pictures.images import LUMINANCE_WEIGHTS
from processing.sphere import Geometry

# Can these frames be one bracket? Sizes, kinds, times, duplicates; and their order.


MAX_FRAMES = 64


@dataclass(frozen=True)
class Order:
    """Frames from the longest time to the shortest."""

    frames: tuple[FrameSource, ...]
    times_s: Doubles
    time_sigma: Doubles
    numbers: tuple[int, ...]
    """Place of each in the caller's sequence."""
    depth_bits: int
    warnings: tuple[str, ...] = ()

    def only(self, places: Sequence[int]) -> Order:
        """Return the frames at some places."""
        return replace(
            self,
            frames=tuple(self.frames[p] for p in places),
            times_s=self.times_s[list(places)],
            time_sigma=self.time_sigma[list(places)],
            numbers=tuple(self.numbers[p] for p in places),
        )


def check_bracket(
    frames: Sequence[FrameSource],
    times_s: Sequence[float],
    time_sigma: Sequence[float] | None,
    curve: ResponseCurve | None,
    geometry: Geometry,
) -> Order:
    """Return the frames in order, without duplicates, or raise naming what does not fit."""
    times = _times(times_s, len(frames))
    sigma = np.zeros(len(frames)) if time_sigma is None else np.asarray(time_sigma, dtype=np.float64)
    if sigma.shape != times.shape or not np.all(np.isfinite(sigma) & (sigma >= 0)):
        raise ParameterError("time_sigma needs one number from 0 up for each frame")
    depth = _alike(frames, geometry)
    _curve_fits(frames, depth, curve)
    # Stable: frames of one time keep the caller's order.
    places = [int(p) for p in np.argsort(-times, kind="stable")]
    order = Order(tuple(frames[p] for p in places), times[places], sigma[places], tuple(places), depth)
    return _without_duplicates(order)


def _times(times_s: Sequence[float], count: int) -> Doubles:
    if not 1 <= count <= MAX_FRAMES:
        raise BracketError(f"a bracket has 1 to {MAX_FRAMES} frames, not {count}")
    times = np.asarray(times_s, dtype=np.float64)
    if times.shape != (count,):
        raise ParameterError(f"{count} frames need {count} times, not {times.size}")
    if not np.all(np.isfinite(times) & (times > 0)):
        raise ParameterError(f"exposure times are seconds above 0, not {list(times_s)}")
    return times


def _alike(frames: Sequence[FrameSource], geometry: Geometry) -> int:
    first = frames[0]
    for frame in frames:
        if frame.size_px != first.size_px or frame.depth_bits != first.depth_bits or frame.linear != first.linear:
            raise BracketError(
                f"it is {_kind(frame)}, {first.name} is {_kind(first)}",
                where=frame.name,
                likely="frames of different brackets or settings",
            )
    if first.size_px != (geometry.width_px, geometry.height_px):
        raise BracketError(
            f"frames of {first.size_px[0]} x {first.size_px[1]} pixels do not fit a geometry of "
            f"{geometry.width_px} x {geometry.height_px}",
            where=first.name,
        )
    return first.depth_bits


def _kind(frame: FrameSource) -> str:
    width, height = frame.size_px
    return f"{width} x {height}, {frame.depth_bits} bits, {'linear' if frame.linear else 'with a response curve'}"


def _curve_fits(frames: Sequence[FrameSource], depth: int, curve: ResponseCurve | None) -> None:
    if curve is None:
        if not frames[0].linear:
            raise ParameterError(
                "frames that are not linear need a response curve", where=frames[0].name, advice="recover one first"
            )
        return
    if frames[0].linear or depth != 8:
        raise ParameterError(
            "linear frames take no response curve", where=frames[0].name, likely="raw and JPEG frames mixed up"
        )
    if curve.log2_exposure.shape != (3, 256) or curve.sigma_log2.shape != (3, 256):
        raise ParameterError(f"the curve of 8-bit frames is (3, 256), not {curve.log2_exposure.shape}")
    if not np.all(np.isfinite(curve.log2_exposure)) or not np.all(np.diff(curve.log2_exposure, axis=1) > 0):
        raise ParameterError("the response curve must be finite and rise strictly with the code")
    if not all(0 <= low < high <= 254 for low, high in zip(curve.low, curve.high, strict=True)):
        raise ParameterError(f"the curve's ends {curve.low} to {curve.high} are not codes of 0 to 254")


def _without_duplicates(order: Order) -> Order:
    """Leave out frames that are copies of another: counted twice, their noise would seem smaller than it is."""
    kept, warnings = [0], []
    for place in range(1, len(order.frames)):
        twin = next((k for k in kept if _same(order.frames[k], order.frames[place])), None)
        if twin is None:
            kept.append(place)
            continue
        named = f"{order.frames[place].name} (number {order.numbers[place]})"
        if order.times_s[place] != order.times_s[twin]:
            raise BracketError(
                f"it is the same picture as {order.frames[twin].name}, but another time is given for it",
                where=named,
                likely="a copied file, or times in the wrong order",
            )
        warnings.append(f"{named} is the same picture as {order.frames[twin].name}: left out")
    return replace(order.only(kept), warnings=tuple(warnings))


def _same(a: FrameSource, b: FrameSource) -> bool:
    """Return whether two frames are one picture; frames that are clipped or black all over may be alike by right."""
    if isinstance(a, ArrayFrame) and isinstance(b, ArrayFrame):
        sparse = (slice(None, None, 61), slice(None, None, 61))
        alike = np.array_equal(a.array[sparse], b.array[sparse]) and np.array_equal(a.array, b.array)
        return bool(alike) and _tells(a.array)
    return same_file(a, b) and _tells(a.decode(8))


def _tells(codes: Codes) -> bool:
    """Return whether anything is neither clipped nor black."""
    full = np.iinfo(codes.dtype).max
    return bool(np.any((codes > full // 64) & (codes < full - full // 32)))


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

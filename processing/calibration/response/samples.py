"""Which pixels show the response: small smooth patches, seen well exposed in at least two frames of a bracket.

Patches of 3 x 3 pixels: their mean is dithered finer than a code; their spread separates edges and texture from noise.
Nothing is averaged before it is known to be smooth: a mean of codes over an edge is not the code of the mean light.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Self

import numpy as np

from processing.errors import BracketError
from processing.ground.arrays import Bytes, Doubles, Flags, Int64s

CHANNELS = ("red", "green", "blue")
PATCH_PX = 3  # pixels a side; chosen
CANDIDATES = 10_000  # patches looked at in all brackets together
MAX_SAMPLES = 3_200  # patches kept for a channel
FLAT_SPREAD = 0.03
"""Greatest standard deviation within a patch over its mean code where it is exposed well: about a tenth of a stop."""
_WELL_EXPOSED = 235.0  # code; chosen: clear of white
_CLEAR_BELOW, _CLEAR_ABOVE = 1.5, 2.5
"""Standard deviations of its codes by which a patch must be clear of black and of white."""
_SPREAD_BINS = 12  # over the code; chosen
_NOISY, _NOISE_CODES = 1.8, 6.0
"""Times the usual spread of equally bright patches, and codes at most, that still pass as noise."""
TOP_CODE = 249  # of files: a code above it may be a clipped one after coding, chroma at half resolution above all
TIME_RANGE_S = (1e-7, 1e5)  # chosen: beyond any shutter, and squares of times stay within float32
_LEAST_SHARE = 0.25  # of the patches are kept, the smoothest, however rough the scene


@dataclass(frozen=True)
class Bracket8:
    """Frames of one still scene, all (H, W, 3) uint8 RGB of one size, and their exposure times in seconds."""

    frames: Sequence[Bytes]
    times_s: Sequence[float]
    given_s: Sequence[float] | None = None
    """The times as the user gave them, for messages; None: ``times_s``."""
    names: Sequence[str] = ()
    """Of the frames, for messages; empty: their numbers."""

    def check(self, where: str = "bracket") -> None:
        """Refuse what cannot be a bracket.

        Raises `BracketError`: no frames, another number of times, sizes or types that differ, times that are not
        positive numbers.
        """
        if len(self.frames) == 0 or len(self.frames) != len(self.times_s):
            text = f"{len(self.frames)} frames and {len(self.times_s)} times"
            raise BracketError(text, where=where, advice="give one time for each frame")
        shape = np.shape(self.frames[0])
        for number, (frame, time_s) in enumerate(zip(self.frames, self.times_s, strict=True)):
            if np.shape(frame) != shape or len(shape) != 3 or shape[2] != 3 or frame.dtype != np.uint8:
                text = f"frame {number} is {np.shape(frame)} {frame.dtype}; frame 0 is {shape}"
                likely = "frames of different brackets, or pictures that are not 8-bit RGB"
                raise BracketError(text, where=where, likely=likely, advice="give (H, W, 3) uint8 frames of one size")
            if not TIME_RANGE_S[0] <= time_s <= TIME_RANGE_S[1]:
                span = "{:g} to {:g} seconds".format(*TIME_RANGE_S)
                raise BracketError(f"frame {number} has the time {time_s}", where=where, advice=f"give {span}")
        if 0 in shape:
            raise BracketError(f"frames of {shape[1]} x {shape[0]} pixels", where=where, advice="give whole pictures")


@dataclass(frozen=True)
class ChannelSamples:
    """What one channel shows of all samples: one entry an observation, those of a sample next to each other."""

    sample: Int64s
    """(n,) 0..n_samples-1, not decreasing."""
    frame: Int64s
    """(n,) index into all frames of all brackets."""
    mean: Doubles
    """(n,) mean code of the patch."""
    pixels: Bytes
    """(n, 9) codes of its pixels."""
    spread2: Doubles
    """(n,) variance of the codes within the patch: its texture and its noise."""
    starts: Int64s
    """(n_samples,) first observation of each sample."""
    clear: Flags
    """(n,) whether no other channel of the patch is, or may be, clipped in that frame."""

    @property
    def n_samples(self) -> int:
        """Return how many patches there are."""
        return len(self.starts)

    def part(self, count: int) -> Self:
        """Return about ``count`` of the patches, spread over all."""
        return self.only(self.sample % max(self.n_samples // max(count, 1), 1) == 0)

    def only(self, kept: Flags) -> Self:
        """Return the observations ``kept``, of shape (n,), of patches that two frames still show."""
        seen = np.add.reduceat(kept.astype(np.int64), self.starts)[self.sample] if kept.size else kept
        mine = np.flatnonzero(kept & (seen >= 2))
        sample = np.unique(self.sample[mine], return_inverse=True)[1]
        starts = np.flatnonzero(np.diff(sample, prepend=-1))
        frame, mean, pixels = self.frame[mine], self.mean[mine], self.pixels[mine]
        return type(self)(sample, frame, mean, pixels, self.spread2[mine], starts, self.clear[mine])


@dataclass(frozen=True)
class Samples:
    """Samples of all channels, and the frames they come from."""

    channels: tuple[ChannelSamples, ChannelSamples, ChannelSamples]
    log2_times: Doubles
    """(frames of all brackets,) as given."""
    bracket_of_frame: Int64s
    given_s: tuple[float, ...] = ()
    """As the user knows them."""
    names: tuple[str, ...] = ()
    """Of the frames of all brackets, for messages."""
    duplicates: tuple[int, ...] = ()
    """Frames left out since an earlier frame is the same picture with the same time."""


def take_samples(brackets: Sequence[Bracket8]) -> Samples:
    """Return smooth patches of all brackets.

    Raises `BracketError`: see `Bracket8.check`.
    """
    if not brackets:
        raise BracketError("no bracket", advice="give at least one")
    rng = np.random.default_rng(0)
    patches, first, duplicates = [], 0, []
    for number, bracket in enumerate(brackets):
        bracket.check(f"bracket {number}")
        found = _patches(bracket, max(CANDIDATES // len(brackets), 1), rng)
        # Frames that show exactly the codes of an earlier one with the same time: their noise is no news.
        each_s = bracket.times_s
        duplicates += [
            first + j
            for j in range(1, len(each_s))
            if any(each_s[i] == each_s[j] and np.array_equal(found[i], found[j]) for i in range(j))
        ]
        patches.append((found, first))
        first += len(bracket.frames)
    channels = tuple(_channel(patches, c, frozenset(duplicates)) for c in range(3))
    times = np.concatenate([np.log2(np.asarray(b.times_s, dtype=np.float64)) for b in brackets])
    owner = np.concatenate([np.full(len(b.frames), i, dtype=np.int64) for i, b in enumerate(brackets)])
    assert len(channels) == 3
    given = tuple(float(t) for b in brackets for t in (b.times_s if b.given_s is None else b.given_s))
    names = tuple(name for b in brackets for name in b.names or [f"frame {k}" for k in range(len(b.frames))])
    return Samples(channels, times, owner, given, names, tuple(duplicates))


def _patches(bracket: Bracket8, count: int, rng: np.random.Generator) -> Bytes:
    """Return (frames, patches, 9, 3): the codes of patches on a jittered grid."""
    height, width = bracket.frames[0].shape[:2]
    rows, columns = _grid(height, width, count, rng)
    out = np.empty((len(bracket.frames), rows.size, PATCH_PX**2, 3), dtype=np.uint8)
    step = np.arange(PATCH_PX)
    down = np.minimum(rows[:, None] + step, height - 1)[:, :, None]
    across = np.minimum(columns[:, None] + step, width - 1)[:, None, :]
    flat = (down * width + across).reshape(-1, PATCH_PX**2)
    for number, frame in enumerate(bracket.frames):
        if frame.flags.c_contiguous:
            np.take(frame.reshape(-1, 3), flat, axis=0, out=out[number])
        else:
            out[number] = frame[down, across].reshape(-1, PATCH_PX**2, 3)
    return out


def _grid(height: int, width: int, count: int, rng: np.random.Generator) -> tuple[Int64s, Int64s]:
    """Return about ``count`` upper left corners, one in each cell of a grid; patches do not overlap."""
    usable_h, usable_w = max(height - PATCH_PX + 1, 1), max(width - PATCH_PX + 1, 1)
    n_rows = max(1, min(usable_h // PATCH_PX, round((count * usable_h / usable_w) ** 0.5)))
    n_columns = max(1, min(usable_w // PATCH_PX, count // n_rows))
    row = (np.arange(n_rows)[:, None] + rng.random((n_rows, n_columns))) * usable_h / n_rows
    column = (np.arange(n_columns)[None] + rng.random((n_rows, n_columns))) * usable_w / n_columns
    return row.astype(np.int64).ravel(), column.astype(np.int64).ravel()


def _channel(brackets: Sequence[tuple[Bytes, int]], channel: int, left_out: frozenset[int]) -> ChannelSamples:
    parts: list[tuple[Int64s, Int64s, Doubles, Bytes, Doubles, Flags]] = []
    count = 0
    share = max(MAX_SAMPLES // len(brackets), 1)
    for patches, first_frame in brackets:
        codes = patches[..., channel]
        mean, spread2 = _moments(codes)
        known = [j for j in range(len(codes)) if first_frame + j not in left_out]
        usable = np.zeros(mean.shape, dtype=bool)
        usable[known] = _usable(mean[known], spread2[known])
        kept = _spread_over_codes(mean, usable, share)
        sample, frame = np.nonzero(usable[:, kept].T)
        which = (frame, kept[sample])
        others = [_unclipped(*_moments(patches[..., c]), TOP_CODE)[which] for c in range(3) if c != channel]
        clear = np.logical_and(*others)
        parts.append((sample + count, frame + first_frame, mean[which], codes[which], spread2[which], clear))
        count += kept.size
    sample = np.concatenate([p[0] for p in parts])
    frame = np.concatenate([p[1] for p in parts])
    means, spreads = (np.concatenate([p[i] for p in parts]) for i in (2, 4))
    clear = np.concatenate([p[5] for p in parts])
    pixels = np.concatenate([p[3] for p in parts])
    return ChannelSamples(sample, frame, means, pixels, spreads, np.flatnonzero(np.diff(sample, prepend=-1)), clear)


def _moments(codes: Bytes) -> tuple[Doubles, Doubles]:
    """Return mean and variance (frames, patches) over the last axis, in whole numbers until the end."""
    count = codes.shape[2]
    total = codes.sum(axis=2, dtype=np.int64)
    square = np.einsum("fpk,fpk->fp", codes.astype(np.int32), codes.astype(np.int32))
    return total / count, np.maximum(square - total * total / count, 0.0) / (count - 1)


def _unclipped(mean: Doubles, spread2: Doubles, top: float = 254.0) -> Flags:
    return np.asarray(mean + _CLEAR_ABOVE * np.sqrt(spread2) < top + 0.5)


def _usable(mean: Doubles, spread2: Doubles) -> Flags:
    """Return (frames, patches): neither clipped nor dark as a whole, of patches that are smooth where best exposed."""
    seen = (mean > np.maximum(0.5, _CLEAR_BELOW * np.sqrt(spread2))) & _unclipped(mean, spread2)
    best = np.argmax(np.where(mean < _WELL_EXPOSED, mean, 0.0), axis=0)
    each = np.arange(mean.shape[1])
    able = seen.sum(axis=0) >= 2
    if not able.any():
        return np.zeros_like(seen)
    level, spread = mean[best, each], np.sqrt(spread2[best, each])
    # Where all is dark the noise itself spreads the codes: what is usual there is not roughness.
    bins = np.minimum((np.sqrt(level / 256) * _SPREAD_BINS).astype(np.int64), _SPREAD_BINS - 1)
    usual = np.zeros(_SPREAD_BINS)
    for b in np.unique(bins[able]):
        usual[b] = float(np.median(spread[able & (bins == b)]))
    rough = spread / np.maximum(np.maximum(level * FLAT_SPREAD, np.minimum(_NOISY * usual[bins], _NOISE_CODES)), 0.5)
    limit = max(1.0, float(np.quantile(rough[able], _LEAST_SHARE)))
    return np.asarray(seen & (able & (rough <= limit)))


def _spread_over_codes(mean: Doubles, usable: Flags, count: int) -> Int64s:
    """Return up to ``count`` patches, rare (frame, code) first: a large even wall must not crowd out the rest."""
    able = np.flatnonzero(usable.any(axis=0))
    if able.size <= count:
        return able
    bins = np.minimum((np.sqrt(mean[:, able] / 256) * 24).astype(np.int64), 23)
    place = bins + 24 * np.arange(len(mean))[:, None]
    crowd = np.bincount(place[usable[:, able]], minlength=24 * len(mean))
    rarest = np.where(usable[:, able], crowd[place], np.iinfo(np.int64).max).min(axis=0)
    # Of a crowd as many as of any other, whatever their order in the picture.
    rank = np.random.default_rng(able.size).permutation(able.size) * (rarest / rarest.max()) ** 0.5
    return np.sort(able[np.argsort(rank, kind="stable")[:count]])

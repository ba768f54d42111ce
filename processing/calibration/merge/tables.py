"""What the merge looks up for each code of each frame, made once from response curve, noise model and times.

A sample of frame f with code z says that the radiance is v = x(z) / t_f, with the relative variance of the noise
model plus the squared uncertainty of curve and time; its weight is w = 1 / (v2 relative variance). Entries of four
floats (w, w v, w v2, 0) make one vector addition a sample: mean, variance and chi-squared of all frames at once.

Ends: clipped codes weigh nothing, and dark ones only in the longest frame. But so that no sum is empty, the shortest
frame's clipped codes stand for the saturation level with a weight (`TRACE_SNR2`) that any other sample outweighs.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import Protocol

import numpy as np
import numpy.typing as npt

from processing.calibration.response.curve import NoiseModel, ResponseCurve
from processing.ground.arrays import Doubles, Floats
from processing.pictures.images import LUMINANCE_WEIGHTS

CODES = 256
TRACE_SNR2 = 1e-6
"""Squared signal to noise of a bound that is no measurement."""
TAPER_CODES = 6
"""Below the clipping code weights fall to a quarter: whether a sample there counts must not hang on its own noise."""
RISE_SIGMAS = 6.0
COMMON_SHARE = 0.45


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
    last: npt.NDArray[np.int64]
    """(F,): where frame k is unclipped, frames after ``last[k]`` are left out."""
    rise: int
    """A code that grows by more from one frame to the next shorter one is not noise."""

    @property
    def every(self) -> npt.NDArray[np.int64]:
        """All codes, (256, 3)."""
        return np.repeat(np.arange(CODES)[:, None], 3, axis=1)

    def sample(self, place: int, codes: npt.NDArray[np.generic]) -> tuple[Floats, Floats]:
        """Return radiance and weight of codes (..., 3) of frame ``place``; weight 0: clipped, the value is a bound."""
        entry = self.samples[place, np.arange(3), codes]
        return entry[..., 0], entry[..., 1]


class Samples(Protocol):
    """What one sample of a frame says, for whatever kind of codes."""

    @property
    def saturation(self) -> Floats:
        """(F, 3): radiance at which each frame clips."""
        ...

    @property
    def every(self) -> npt.NDArray[np.int64]:
        """Codes over the whole range, (n, 3), rising."""
        ...

    def sample(self, place: int, codes: npt.NDArray[np.generic]) -> tuple[Floats, Floats]:
        """Return radiance and weight of codes (..., 3) of frame ``place``; weight 0: clipped, the value is a bound."""
        ...


def linear_curve() -> ResponseCurve:
    """Return the curve of 8-bit frames that are linear: exposure 1 at code 255."""
    codes = np.maximum(np.arange(CODES), 0.25) / 255.0
    log2 = np.tile(np.log2(codes), (3, 1))
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
    as clipped; as do those that a clipped pixel's coding noise (5 sigma) may reach.
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
    weight = np.where(codes > high, 0.0, _taper(codes, high)) / (relative * v**2)
    used = np.where(codes < low, 0.0, weight)
    used[0] = np.where(codes < low, weight[0], used[0])
    saturation = np.take_along_axis(v, np.broadcast_to(high, (len(times_s), 3, 1)), axis=2)
    value = np.where(codes > high, saturation, v)
    used[-1] = np.where(codes > high, TRACE_SNR2 / value[-1] ** 2, used[-1])
    lanes = np.stack([used, used * value, used * value**2, np.zeros_like(used)], axis=-1)
    return MergeTables(
        np.ascontiguousarray(lanes, dtype=np.float32),
        np.ascontiguousarray(np.stack([value, weight], axis=-1), dtype=np.float32),
        np.ascontiguousarray(saturation[..., 0], dtype=np.float32),
        int(min(curve.high)) + 1,
        int(max(curve.high)) + 1,
        _last_useful(curve, own, times_s, max_error),
        _rise(curve, noise),
    )


def coding_error(curve: ResponseCurve, noise: NoiseModel) -> float:
    """Return the squared relative error that coding leaves alike in all frames, so that differences do not show it.

    JPEG smooths chroma and fine detail of every frame in the same way. Measured on simulated frames with and without
    noise (quality 95, 4:2:0): 0.45 of what the coding noise of one frame is at middle codes.
    """
    slope = np.median(curve.log2_slope[:, 60:200]) * math.log(2)
    codes = float(np.dot(LUMINANCE_WEIGHTS, noise.code_variance))
    return float((COMMON_SHARE * slope) ** 2 * codes)


def _taper(codes: npt.NDArray[np.int64], high: npt.NDArray[np.int64]) -> Doubles:
    """Return 1, falling to 1/4 at the last code before clipping."""
    depth = np.clip((codes - (high - TAPER_CODES)) / TAPER_CODES, 0.0, 1.0)
    return np.asarray(1.0 - 0.75 * depth**2)


def _last_useful(curve: ResponseCurve, own: Doubles, times_s: Doubles, max_error: float) -> npt.NDArray[np.int64]:
    """Return for each frame k the last frame that is needed where k is unclipped.

    The frames after it would shrink the standard uncertainty of no code by more than ``max_error``.
    """
    count = len(times_s)
    last = np.full(count, count - 1, dtype=np.int64)
    for k in range(count):
        information = np.zeros((count, 3, CODES))
        for c in range(3):
            usable = slice(curve.low[c], curve.high[c] + 1)
            grid, snr2 = curve.log2_exposure[c, usable], 1.0 / own[c, usable]
            for f in range(k, count):
                shifted = grid + np.log2(times_s[f] / times_s[k])
                information[f, c, usable] = np.interp(shifted, grid, snr2, left=0.0)
        behind = np.cumsum(information[::-1], axis=0)[::-1]
        total = np.maximum(behind[k], 1e-30)
        for f in range(k, count - 1):
            if np.max(behind[f + 1] / total) <= 1.0 - (1.0 + max_error) ** -2:
                last[k] = f
                break
    return last


def _rise(curve: ResponseCurve, noise: NoiseModel) -> int:
    """Return by how many codes noise may at most make a pixel brighter in a shorter frame."""
    log2_sigma = np.sqrt(noise.relative_variance(curve)) / np.log(2)
    in_codes = log2_sigma / curve.log2_slope
    worst = max(float(np.max(in_codes[c, curve.low[c] : curve.high[c] + 1])) for c in range(3))
    return int(np.clip(np.ceil(RISE_SIGMAS * np.sqrt(2) * worst) + 1, 2, 120))

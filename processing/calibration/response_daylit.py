"""Our method: curve, noise and shutter times from the same patches, in turn, until they agree."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TypeAlias

import numpy as np
import numpy.typing as npt

from processing.calibration.noise_fit import fit_noise
from processing.calibration.response_basis import N_BASIS, spline_basis, srgb_log2_exposure
from processing.calibration.response_fit import (
    FIRST_CODE,
    LAST_CODE,
    FineCurve,
    PatchNoise,
    Solution,
    Weighed,
    equations,
    solve,
    weigh,
)
from processing.calibration.response_samples import ChannelSamples
from processing.errors import ResponseError

Reals: TypeAlias = npt.NDArray[np.float64]
Flags: TypeAlias = npt.NDArray[np.bool_]

ROUNDS = 4
_OUTLIER = 5.0
"""Standard deviations beyond which a patch has moved."""
_LEAST_SAMPLES = 40
_LEAST_CODES = 48
_LEAST_NEAR = 5
_LEAST_SLOPE = 1e-4
_PIXEL_LEAST, _MEAN_LEAST = 1 / 12, 0.005


@dataclass(frozen=True)
class ChannelFit:
    """One channel's curve and what it rests on."""

    log2: Reals
    """(256,) stops, strictly increasing; 0 at code 255 of the extrapolation."""
    coefficients: Reals
    noise: PatchNoise
    solution: Solution
    low: int
    high: int
    moved_share: float
    n_samples: int
    weighed: Weighed
    kept: Flags
    """(n,) observations of patches that did not move."""


def fit_channel(
    data: ChannelSamples, log2_times: Reals, base: Reals | None = None, rounds: int = ROUNDS, name: str = ""
) -> ChannelFit:
    """Fit one channel, starting from ``base`` (256,) or sRGB's curve.

    Raises
    ------
    ResponseError
        Too few patches that are seen well in two frames, or all of nearly the same code.
    """
    check_enough(data, name)
    basis = spline_basis()
    start = srgb_log2_exposure() if base is None else base
    coefficients, noise = np.zeros(N_BASIS), PatchNoise()
    log2, kept = start, np.ones(len(data.mean), dtype=bool)
    for number in range(rounds):
        fine = FineCurve.of(log2)
        if number:
            noise = _noise(data, fine, log2_times, noise)
        found = weigh(data, fine, log2_times, noise)
        weight, kept = _robust(data, found, final=number > 1)
        solution = solve(equations(data, fine, log2_times, found, weight), coefficients)
        coefficients = coefficients + solution.change
        low, high = _support(found.predicted[weight > 0], name)
        log2 = monotone(start + basis.codes @ coefficients, start, low, high)
    moved = 1 - np.add.reduceat(kept.astype(np.float64), data.starts).astype(bool).mean()
    return ChannelFit(
        log2, coefficients, noise, solution, low, high, float(moved), data.n_samples, found, kept & (found.weight > 0)
    )


def check_enough(data: ChannelSamples, name: str) -> None:
    """Refuse samples from which no curve can be told."""
    if data.n_samples >= _LEAST_SAMPLES:
        return
    raise ResponseError(
        f"only {data.n_samples} patches are seen neither clipped nor dark in two frames",
        where=name or "response",
        likely="one frame, all frames clipped or all dark, or stops too far apart",
        advice="give a bracket of at least three exposures, at most four stops apart, of a scene with light and shade",
    )


def _noise(data: ChannelSamples, fine: FineCurve, log2_times: Reals, before: PatchNoise) -> PatchNoise:
    mean = fit_noise(data, data.mean, fine, log2_times, least_code_variance=_MEAN_LEAST)
    pixel = fit_noise(data, data.centre, fine, log2_times, least_code_variance=_PIXEL_LEAST)
    return PatchNoise(mean or before.mean, pixel or before.pixel)


def _robust(data: ChannelSamples, found: Weighed, *, final: bool) -> tuple[Reals, Flags]:
    """Return weights without the patches that moved; before the last rounds the curve itself may be what is off."""
    used = found.weight > 0
    if not used.any():
        return found.weight, used
    size = np.abs(found.standard)
    scale = max(1.4826 * float(np.median(size[used])), 1.0)
    worst = np.maximum.reduceat(size, data.starts)
    still = (worst <= (_OUTLIER if final else 2 * _OUTLIER) * scale)[data.sample]
    return np.where(still, found.weight, 0.0), still


def _support(predicted: Reals, name: str) -> tuple[int, int]:
    """Return the lowest and highest code near which the data say enough."""
    near = np.bincount(np.clip(np.rint(predicted), 0, 255).astype(np.int64), minlength=256)
    near = np.convolve(near, np.ones(5), mode="same")
    seen = np.flatnonzero(near >= _LEAST_NEAR)
    if seen.size < _LEAST_CODES:
        raise ResponseError(
            f"the frames show only {seen.size} different codes",
            where=name or "response",
            likely="a scene that is even all over, or a bracket of few exposures",
            advice="use a bracket of a scene with light and shade, or a profile's curve",
        )
    return int(max(seen[0], np.ceil(FIRST_CODE))), int(min(seen[-1], np.floor(LAST_CODE)))


def monotone(log2: Reals, start: Reals, low: int, high: int) -> Reals:
    """Return the curve strictly increasing; beyond the data in the slopes of the starting curve."""
    slope = np.maximum(np.diff(log2), _LEAST_SLOPE)
    slope[:low] = np.maximum(np.diff(start)[:low], _LEAST_SLOPE)
    join = float(np.clip(slope[high - 3] / max(np.diff(start)[high - 3], _LEAST_SLOPE), 0.3, 3.0))
    slope[high:] = np.maximum(join * np.diff(start)[high:], _LEAST_SLOPE)
    out = np.concatenate([[0.0], np.cumsum(slope)])
    return np.asarray(out - out[255])

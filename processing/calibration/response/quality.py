"""Does a session's bracket agree with the curve of the camera's profile?"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt

from processing.calibration.response.curve import NoiseModel, ResponseCurve
from processing.calibration.response.daylit_method import ChannelFit, fit_daylit
from processing.calibration.response.fit import FineCurve, PatchNoise, spline_basis, weigh
from processing.calibration.response.samples import Bracket8, Samples, take_samples
from processing.errors import ParameterError
from processing.ground.arrays import Doubles

# How sure a fitted curve is, code by code, relative to its gauge.


MODEL_CODES = 0.1
"""Of the standard deviation of one pixel's coding: how far a smooth curve may be from the camera's mean code (kinks of
the tone curve, coders that drop what is small). Measured on simulated cameras of training seeds."""
_BEYOND = 0.003, 0.02
"""Stops a code that the continuation above and below the data adds."""


def curve_sigma(fit: ChannelFit, gauge: int) -> Doubles:
    """Return the standard uncertainty (256,), 0 at the gauge code: of the fit, of the model, and of what is beyond."""
    rows = spline_basis().codes
    inside = np.clip(np.arange(256), fit.low, min(fit.high + 3, 255))
    rows = rows[inside] - rows[inside[gauge]]
    covered = np.einsum("zi,ij,zj->z", rows, fit.solution.covariance, rows)
    covered = np.maximum(covered, 0.0) * max(fit.solution.scale2, 1.0)
    slope = np.gradient(fit.log2)
    model = (MODEL_CODES * slope) ** 2 * fit.noise.pixel.code
    codes = np.arange(256)
    beyond = _BEYOND[0] * np.maximum(codes - fit.high, 0) + _BEYOND[1] * np.maximum(fit.low - codes, 0)
    sigma = np.sqrt(covered + model + model[gauge] + (beyond - beyond[gauge]) ** 2)
    sigma[gauge] = 0.0
    return np.asarray(sigma)


# How well a curve fits its bracket, code by code: what the report plots, and the uncertainty of named methods.


BIN_CODES = 8
_LEAST = 10


@dataclass(frozen=True)
class CodeResiduals:
    """Residuals in stops by code: what a patch's light is in one frame less what its other frames say."""

    codes: Doubles
    """(32,) middle of each bin of 8 codes."""
    mean_stops: Doubles
    """(3, 32): 0 for a right curve; NaN never: 0 where `count` is 0."""
    spread_stops: Doubles
    """(3, 32) robust standard deviation of one patch."""
    count: npt.NDArray[np.int64]
    """(3, 32) patches."""


def residuals_by_code(samples: Samples, curve: ResponseCurve, log2_times: Doubles | None = None) -> CodeResiduals:
    """Return the residuals of samples under a curve; ``log2_times`` if they are not those given with the samples."""
    times = samples.log2_times if log2_times is None else log2_times
    n_bins = 256 // BIN_CODES
    mean, spread = np.zeros((3, n_bins)), np.zeros((3, n_bins))
    count = np.zeros((3, n_bins), dtype=np.int64)
    for c, data in enumerate(samples.channels):
        if data.n_samples == 0:
            continue
        found = weigh(data, FineCurve.of(curve.log2_exposure[c]), times, PatchNoise())
        used = found.weight > 0
        bins = np.minimum(found.predicted[used] / BIN_CODES, n_bins - 1).astype(np.int64)
        residual = found.residual[used]
        count[c] = np.bincount(bins, minlength=n_bins)
        for b in np.flatnonzero(count[c]):
            mine = residual[bins == b]
            mean[c, b] = np.median(mine)
            spread[c, b] = 1.4826 * np.median(np.abs(mine - mean[c, b]))
    middle = (np.arange(n_bins, dtype=np.float64) + 0.5) * BIN_CODES
    return CodeResiduals(middle, mean, spread, count)


def sigma_from_residuals(residuals: CodeResiduals) -> Doubles:
    """Return the standard uncertainty (3, 256) that residuals show: bias and standard error, smooth over codes."""
    error = residuals.spread_stops / np.sqrt(np.maximum(residuals.count, 1))
    sigma = np.hypot(residuals.mean_stops, error)
    out = np.empty((3, 256))
    for c in range(3):
        good = residuals.count[c] >= _LEAST
        middle = residuals.codes[good]
        if middle.size == 0:
            out[c] = 1.0
            continue
        beyond = np.maximum(np.maximum(middle[0] - np.arange(256), np.arange(256) - middle[-1]), 0.0)
        out[c] = np.interp(np.arange(256), middle, sigma[c, good]) + 0.02 * beyond
    return out


# What a curve is relative to, and how to change it.
#
# A bracket tells a curve of each channel but for a factor. We choose 1 at code 255, where the curve is continued by a
# few codes: cameras balance their channels so that a saturated sensor comes out white. Of the gauges measured on
# simulated cameras whose channels have tone curves of their own it keeps colours best (docs/calibration.md).


WHITE_CODE, MIDDLE_CODE = 255, 128
LEAST_HIGH = 235
"""Code that the frames must reach in all channels for the white gauge."""


def regauge(curve: ResponseCurve, factors: Sequence[float]) -> ResponseCurve:
    """Return the curve with each channel's exposure multiplied by a factor: from a neutral reference (board, chart).

    The uncertainty stays relative to the same code.

    Raises
    ------
    ParameterError
        Factors that are not three positive numbers.
    """
    return replace(curve, log2_exposure=curve.log2_exposure + np.log2(_three(factors))[:, None])


def regauge_noise(noise: NoiseModel, factors: Sequence[float]) -> NoiseModel:
    """Return the noise model that belongs to `regauge`'s curve."""
    by = _three(factors)
    photon, read = by * noise.photon, by * noise.read
    return replace(
        noise,
        photon=(float(photon[0]), float(photon[1]), float(photon[2])),
        read=(float(read[0]), float(read[1]), float(read[2])),
    )


def neutral_factors(seen_rgb: Sequence[float]) -> tuple[float, float, float]:
    """Return the factors that make a linear RGB value neutral and leave its green as it is."""
    rgb = _three(seen_rgb)
    return float(rgb[1] / rgb[0]), 1.0, float(rgb[1] / rgb[2])


def _three(values: Sequence[float]) -> Doubles:
    found = np.asarray(values, dtype=np.float64)
    if found.shape != (3,) or not (np.isfinite(found).all() and (found > 0).all()):
        raise ParameterError(f"{tuple(values)} are not three factors above 0", where="response gauge")
    return found


FIRST, LAST = 20, 235
LEAST_DRIFT_STOPS = 0.02
"""A drift below is of no consequence: 1.4 % of light."""
_SIGNIFICANT = 3.0


@dataclass(frozen=True)
class ResponseCheck:
    """The difference of a session's own curve from the profile's over codes 20..235, free of its mean."""

    drift_stops: float
    """Root mean square difference of the channel that differs most."""
    sigma_stops: float
    """Root mean square of the uncertainty that both curves state."""
    drifted: bool
    channel_stops: tuple[float, float, float]
    worst_code: int
    noise_ratio: float
    """Relative noise of the session's pixels at middle codes over the profile's: settings or light may differ."""
    warnings: tuple[str, ...] = ()


def check_response(
    curve: ResponseCurve, noise: NoiseModel, bracket: Bracket8, *, estimate_times: bool = False, seed: int = 0
) -> ResponseCheck:
    """Compare; frames decoded at 1/8 of their size will do.

    The session's curve is fitted as a smooth change of the profile's, so that codes which the session does not show
    add nothing.

    Raises
    ------
    ResponseError
        Frames that cannot tell (too few patches or codes).
    BracketError
        Frames that are no bracket.
    """
    samples = take_samples([bracket], seed)
    fit = fit_daylit(samples, free_times=estimate_times, base=curve.log2_exposure)
    drifts, sigmas, codes, ratios = [], [], [], []
    for c, own in enumerate(fit.channels):
        seen = np.arange(max(FIRST, own.low, curve.low[c]), min(LAST, own.high, curve.high[c]) + 1)
        change = (own.log2 - curve.log2_exposure[c])[seen]
        change = change - change.mean()
        sigma = np.hypot(curve_sigma(own, int(seen[len(seen) // 2])), curve.sigma_log2[c])[seen]
        drifts.append(float(np.sqrt((change**2).mean())))
        sigmas.append(float(np.sqrt((sigma**2).mean())))
        codes.append(int(seen[np.argmax(np.abs(change))]))
        ratios.append(_noise_ratio(own.noise.pixel.code, own.noise.pixel.photon, noise, curve, c))
    worst = int(np.argmax([d / s for d, s in zip(drifts, sigmas, strict=True)]))
    drift, sigma_ = drifts[worst], sigmas[worst]
    drifted = drift > max(LEAST_DRIFT_STOPS, _SIGNIFICANT * sigma_)
    warnings = (f"the camera's response drifted by {drift:.3f} stops (uncertainty {sigma_:.3f})",) if drifted else ()
    return ResponseCheck(
        drift,
        sigma_,
        drifted,
        (drifts[0], drifts[1], drifts[2]),
        codes[worst],
        float(np.median(ratios)),
        warnings,
    )


def _noise_ratio(code: float, photon: float, noise: NoiseModel, curve: ResponseCurve, channel: int) -> float:
    """Return the ratio of relative standard deviations at code 128."""
    x = float(curve.exposure[channel, 128])
    slope = float(curve.log2_slope[channel, 128] * np.log(2.0))
    now = photon / x + code * slope**2
    then = noise.photon[channel] / x + noise.code_variance[channel] * slope**2
    return float(np.sqrt(now / max(then, 1e-12)))

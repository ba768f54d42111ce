"""Does a session's bracket agree with the curve of the camera's profile?"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TypeAlias

import numpy as np
import numpy.typing as npt

from processing.calibration.noise import NoiseModel
from processing.calibration.response_curve import ResponseCurve
from processing.calibration.response_daylit import fit_daylit
from processing.calibration.response_samples import Bracket8, take_samples
from processing.calibration.response_uncertainty import curve_sigma


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

"""A camera's response curve and noise from one bracket or several."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from processing.calibration.response.curve import NoiseModel, ResponseCurve
from processing.calibration.response.daylit_method import (
    ChannelFit,
    DaylitFit,
    check_enough,
    check_order,
    fit_daylit,
    monotone,
    support,
)
from processing.calibration.response.fit import CodeNoise, FineCurve
from processing.calibration.response.noise_fit import fit_noise
from processing.calibration.response.quality import (
    LEAST_HIGH,
    MIDDLE_CODE,
    WHITE_CODE,
    ResponseCheck,
    check_response,
    curve_sigma,
    regauge,
    regauge_noise,
    residuals_by_code,
    sigma_from_residuals,
)
from processing.calibration.response.response_debevec import debevec_malik
from processing.calibration.response.response_mitsunaga import mitsunaga_nayar
from processing.calibration.response.response_robertson import robertson
from processing.calibration.response.samples import CHANNELS, Bracket8, ChannelSamples, Samples, take_samples
from processing.calibration.response.shutter import ShutterRule
from processing.errors import ParameterError, ResponseError
from processing.ground.arrays import Doubles

__all__ = [
    "METHODS",
    "Bracket8",
    "ResponseCheck",
    "ResponseFit",
    "check_response",
    "estimate_noise",
    "recover_response",
    "regauge",
    "regauge_noise",
]


_NAMED: dict[str, Callable[[ChannelSamples, Doubles], Doubles]] = {
    "debevec-malik": debevec_malik,
    "mitsunaga-nayar": mitsunaga_nayar,
    "robertson": robertson,
}
METHODS = ("daylit", *_NAMED)
_PIXELS = 9
_DEEPEST_STOPS, _WORST_STOPS = 24.0, 0.3
_ROUNDING = 1 / 12


@dataclass(frozen=True)
class ResponseFit:
    """What a bracket tells of its camera."""

    curve: ResponseCurve
    noise: NoiseModel
    """Of single pixels, in the curve's gauge."""
    times_s: tuple[float, ...]
    """Of all frames of all brackets, in order: as given, or estimated."""
    time_sigma: tuple[float, ...]
    """Relative standard uncertainty of each time; 0 where it was taken as given."""
    rejected: dict[str, float] = field(default_factory=dict)
    """Shares of the patches left out, by reason."""
    warnings: tuple[str, ...] = ()
    wrong_times: dict[int, float] = field(default_factory=dict)
    """Frame: stops by which the time given for it is off."""
    shutter_rule: ShutterRule | None = None
    """The rule that the frames fit best, where they tell the rules apart."""


def recover_response(
    brackets: Sequence[Bracket8], method: str = "daylit", *, estimate_times: bool = False, seed: int = 0
) -> ResponseFit:
    """Return curve and noise of the camera that took ``brackets``.

    ``method`` is one of `METHODS`. ``estimate_times`` (daylit only): times are nominal; the rule behind them is chosen
    by what the frames say. A frame whose time contradicts all others gets the time that they imply, with a warning.

    Raises
    ------
    ResponseError
        Frames from which no curve can be told.
    BracketError
        Frames that are no bracket.
    ParameterError
        A method that is not known, or that cannot estimate times.
    """
    if method not in METHODS:
        raise ParameterError(f"no response method {method!r}", advice=f"one of {', '.join(METHODS)}")
    if estimate_times and method != "daylit":
        raise ParameterError(f"{method} does not estimate shutter times", advice="use the method daylit")
    samples = take_samples(brackets, seed)
    if method == "daylit":
        return _daylit(samples, free_times=estimate_times)
    return _named(samples, method)


def estimate_noise(brackets: Sequence[Bracket8], curve: ResponseCurve, *, seed: int = 0) -> NoiseModel:
    """Return photon, read and code noise (of coding too: JPEG) of single pixels under a known curve.

    Raises
    ------
    ResponseError
        Too few patches.
    BracketError
        Frames that are no bracket.
    """
    samples = take_samples(brackets, seed)
    for data, name in zip(samples.channels, CHANNELS, strict=True):
        check_enough(data, name)
    found = [
        fit_noise(data, FineCurve.of(log2), samples.log2_times, least_code_variance=_ROUNDING, pixels=_PIXELS)
        for data, log2 in zip(samples.channels, curve.log2_exposure, strict=True)
    ]
    return _noise_model([one or CodeNoise(0.0, 0.0, 1.0) for one in found])


def _noise_model(found: Sequence[CodeNoise]) -> NoiseModel:
    red, green, blue = found
    return NoiseModel(
        (red.photon, green.photon, blue.photon),
        (red.read2**0.5, green.read2**0.5, blue.read2**0.5),
        (red.code, green.code, blue.code),
    )


def _daylit(samples: Samples, *, free_times: bool) -> ResponseFit:
    fit = fit_daylit(samples, free_times=free_times)
    channels = fit.channels
    low, high = _limits([(one.low, one.high) for one in channels])
    gauge = WHITE_CODE if min(high) >= LEAST_HIGH else MIDDLE_CODE
    curve = ResponseCurve(
        np.stack([one.log2 - one.log2[gauge] for one in channels]),
        np.stack([curve_sigma(one, MIDDLE_CODE) for one in channels]),
        low,
        high,
        gauge_code=gauge,
        sigma_code=MIDDLE_CODE,
        balance_sigma=_three([float(curve_sigma(one, MIDDLE_CODE)[gauge]) for one in channels]),
        method="daylit",
        n_samples=sum(data.n_samples for data in samples.channels),
        residual_stops=_residual_stops(channels),
    )
    # The channels' own scale is 1 at code 255.
    noise = _noise_model([one.noise.pixel for one in channels])
    red, green, blue = (float(np.exp2(-one.log2[gauge])) for one in channels)
    times = tuple(float(t) for t in np.exp2(fit.log2_times))
    estimate = fit.estimate
    return ResponseFit(
        curve,
        regauge_noise(noise, (red, green, blue)),
        times,
        estimate.sigma if free_times else tuple(0.0 for _ in times),
        {"moved": _moved_share(samples, channels)},
        _warnings(samples, fit, gauge, free_times=free_times),
        fit.wrong_times,
        estimate.rule if estimate.decided else None,
    )


def _named(samples: Samples, method: str) -> ResponseFit:
    log2, limits = [], []
    check_order(samples)
    for data, name in zip(samples.channels, CHANNELS, strict=True):
        check_enough(data, name)
        limits.append(support(data.mean, name))
        found = _NAMED[method](data, samples.log2_times)
        found = np.maximum(found, found[255] - _DEEPEST_STOPS)
        log2.append(monotone(found, found, 0, 255))
    low, high = _limits(limits)
    bare = ResponseCurve(np.stack(log2), np.zeros((3, 256)), low, high, WHITE_CODE, method=method)
    residuals = residuals_by_code(samples, bare)
    misfit = float(np.median(residuals.spread_stops[residuals.count > 0])) if residuals.count.any() else np.inf
    if misfit > _WORST_STOPS:
        raise ResponseError(
            f"{method} finds no curve: frames differ from it by {misfit:.2g} stops",
            where="response",
            likely="few or moving frames, or wrong times",
            advice="use the method daylit, which says what is wrong",
        )
    curve = replace(
        bare,
        sigma_log2=sigma_from_residuals(residuals),
        n_samples=sum(data.n_samples for data in samples.channels),
        residual_stops=misfit,
    )
    noise = [
        fit_noise(data, FineCurve.of(g), samples.log2_times, least_code_variance=_ROUNDING, pixels=_PIXELS)
        for data, g in zip(samples.channels, log2, strict=True)
    ]
    times = tuple(float(t) for t in np.exp2(samples.log2_times))
    return ResponseFit(
        curve,
        _noise_model([one or CodeNoise(0.0, 0.0, 1.0) for one in noise]),
        times,
        tuple(0.0 for _ in times),
        {},
        _duplicate_warnings(samples),
    )


def _limits(limits: Sequence[tuple[int, int]]) -> tuple[tuple[int, int, int], tuple[int, int, int]]:
    red, green, blue = limits
    return (red[0], green[0], blue[0]), (red[1], green[1], blue[1])


def _three(values: Sequence[float]) -> tuple[float, float, float]:
    red, green, blue = values
    return red, green, blue


def _moved_share(samples: Samples, channels: Sequence[ChannelFit]) -> float:
    shares = []
    for data, fit in zip(samples.channels, channels, strict=True):
        seen = np.add.reduceat((fit.weighed.weight > 0).astype(np.float64), data.starts) > 0
        kept = np.add.reduceat(fit.kept.astype(np.float64), data.starts) > 0
        shares.append(1 - kept.sum() / max(seen.sum(), 1))
    return float(np.mean(shares))


def _residual_stops(channels: Sequence[ChannelFit]) -> float:
    sizes = np.concatenate([np.abs(fit.weighed.residual[fit.kept]) for fit in channels])
    return 1.4826 * float(np.median(sizes)) if sizes.size else 0.0


def _duplicate_warnings(samples: Samples) -> tuple[str, ...]:
    return tuple(f"frame {j} is the same picture as an earlier one: left out" for j in samples.duplicates)


def _warnings(samples: Samples, fit: DaylitFit, gauge: int, *, free_times: bool) -> tuple[str, ...]:
    """Say what is odd about the frames."""
    found = list(_duplicate_warnings(samples))
    for j, stops in fit.wrong_times.items():
        given, implied = np.exp2(samples.log2_times[j]), np.exp2(fit.log2_times[j])
        found.append(
            f"frame {j}: its time {given:.6g} s contradicts the other frames by {stops:+.2f} stops; "
            f"{implied:.6g} s is used"
        )
    estimate = fit.estimate
    if not free_times and estimate.decided and estimate.rule is not ShutterRule.NOMINAL:
        chi2 = estimate.chi2[ShutterRule.NOMINAL]
        found.append(f"the frames fit the shutter rule '{estimate.rule}' better than the times given (chi2 {chi2:.0f})")
    if gauge != WHITE_CODE:
        found.append("no frame comes near white: the channels are balanced at code 128, and colours are less sure")
    return tuple(found)

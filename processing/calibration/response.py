"""A camera's response curve from one bracket or several."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import TypeAlias

import numpy as np
import numpy.typing as npt

from processing.calibration.noise import NoiseModel
from processing.calibration.response_basis import spline_basis
from processing.calibration.response_curve import ResponseCurve
from processing.calibration.response_daylit import ChannelFit, DaylitFit, fit_daylit
from processing.calibration.response_samples import Bracket8, Samples, take_samples
from processing.calibration.shutter import ShutterRule

__all__ = ["Bracket8", "ResponseFit", "recover_response"]

Reals: TypeAlias = npt.NDArray[np.float64]
GAUGE_CODE = 128


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


def recover_response(
    brackets: Sequence[Bracket8], method: str = "daylit", *, estimate_times: bool = False, seed: int = 0
) -> ResponseFit:
    """Return curve and noise of the camera that took ``brackets``.

    Raises
    ------
    ResponseError
        Frames from which no curve can be told.
    BracketError
        Frames that are no bracket.
    """
    samples = take_samples(brackets, seed)
    fit = fit_daylit(samples, free_times=estimate_times)
    channels = fit.channels
    curve = ResponseCurve(
        np.stack([one.log2 - one.log2[GAUGE_CODE] for one in channels]),
        np.stack([_sigma(one) for one in channels]),
        (channels[0].low, channels[1].low, channels[2].low),
        (channels[0].high, channels[1].high, channels[2].high),
        GAUGE_CODE,
        "daylit",
        sum(data.n_samples for data in samples.channels),
        residual_stops(channels),
    )
    photon, read, codes = zip(*(_noise(one) for one in channels), strict=True)
    times = tuple(float(t) for t in np.exp2(fit.log2_times))
    return ResponseFit(
        curve,
        NoiseModel(photon, read, codes),
        times,
        fit.estimate.sigma if estimate_times else tuple(0.0 for _ in times),
        {"moved": _moved_share(samples, channels)},
        _warnings(samples, fit, times_free=estimate_times),
    )


def _moved_share(samples: Samples, channels: Sequence[ChannelFit]) -> float:
    shares = []
    for data, fit in zip(samples.channels, channels, strict=True):
        seen = np.add.reduceat((fit.weighed.weight > 0).astype(np.float64), data.starts) > 0
        kept = np.add.reduceat(fit.kept.astype(np.float64), data.starts) > 0
        shares.append(1 - kept.sum() / max(seen.sum(), 1))
    return float(np.mean(shares))


def residual_stops(channels: Sequence[ChannelFit]) -> float:
    """Return the robust rms residual of the patches."""
    sizes = np.concatenate([np.abs(fit.weighed.residual[fit.kept]) for fit in channels])
    return 1.4826 * float(np.median(sizes)) if sizes.size else 0.0


def _warnings(samples: Samples, fit: DaylitFit, *, times_free: bool) -> tuple[str, ...]:
    """Say what is odd about the frames."""
    found = [f"frame {j} is the same picture as an earlier one: left out" for j in samples.duplicates]
    for j, stops in fit.wrong_times.items():
        given, implied = np.exp2(samples.log2_times[j]), np.exp2(fit.log2_times[j])
        found.append(
            f"frame {j}: its time {given:.6g} s contradicts the other frames by {stops:+.2f} stops; "
            f"{implied:.6g} s is used"
        )
    best = fit.estimate.rule
    if not times_free and best is not ShutterRule.NOMINAL:
        chi2 = fit.estimate.chi2[ShutterRule.NOMINAL]
        found.append(f"the frames fit the shutter rule '{best}' better than the times given (chi2 {chi2:.0f} lower)")
    return tuple(found)


def _noise(fit: ChannelFit) -> tuple[float, float, float]:
    factor = float(np.exp2(-fit.log2[GAUGE_CODE]))
    pixel = fit.noise.pixel
    return pixel.photon * factor, float(np.sqrt(pixel.read2)) * factor, pixel.code


def _sigma(fit: ChannelFit) -> Reals:
    """Return the standard uncertainty (256,) relative to the gauge code; beyond the data it grows."""
    rows = spline_basis().codes
    rows = rows - rows[GAUGE_CODE]
    variance = np.einsum("zi,ij,zj->z", rows, fit.solution.covariance, rows)
    sigma = np.sqrt(np.maximum(variance, 0.0) * max(fit.solution.scale2, 1.0))
    codes = np.arange(256)
    beyond = np.maximum(np.maximum(fit.low - codes, codes - fit.high), 0)
    return np.asarray(sigma + 0.02 * beyond)

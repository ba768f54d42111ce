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
from processing.calibration.response_daylit import ChannelFit, fit_channel
from processing.calibration.response_samples import Bracket8, take_samples

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
    fits = [
        fit_channel(data, samples.log2_times, name=f"response, {name}")
        for data, name in zip(samples.channels, ("red", "green", "blue"), strict=True)
    ]
    curve = ResponseCurve(
        np.stack([fit.log2 - fit.log2[GAUGE_CODE] for fit in fits]),
        np.stack([_sigma(fit) for fit in fits]),
        (fits[0].low, fits[1].low, fits[2].low),
        (fits[0].high, fits[1].high, fits[2].high),
        GAUGE_CODE,
        "daylit",
        sum(fit.n_samples for fit in fits),
    )
    photon, read, codes = zip(*(_noise(fit) for fit in fits), strict=True)
    times = tuple(float(t) for bracket in brackets for t in bracket.times_s)
    rejected = {"moved": float(np.mean([fit.moved_share for fit in fits]))}
    return ResponseFit(curve, NoiseModel(photon, read, codes), times, tuple(0.0 for _ in times), rejected)


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

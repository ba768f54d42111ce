"""Brackets for the tests of response curves: small, of training seeds, each made once."""

from __future__ import annotations

from dataclasses import replace
from functools import lru_cache

import numpy as np
import numpy.typing as npt

from benchmarks.photometry.synthetic_bracket import PAPER_TIMES_S, REFERENCE_SENSOR, SyntheticBracket, synthetic_bracket
from mocks.optics.sensor import ToneCurve, TrueShutter
from processing.calibration.response.curve import ResponseCurve
from processing.calibration.response.response import ResponseFit, recover_response
from processing.calibration.response.samples import Bracket8
from tests.conftest import LONG

SIZE = (1200, 600) if LONG else (960, 480)
TIMES_S = PAPER_TIMES_S


@lru_cache(maxsize=8)
def made(seed: int = 31, shutter: TrueShutter = TrueShutter.NOMINAL, noise: float = 1.0) -> SyntheticBracket:
    sensor = replace(
        REFERENCE_SENSOR,
        true_shutter=shutter,
        full_well_e=REFERENCE_SENSOR.full_well_e / noise**2,
        read_noise_e=REFERENCE_SENSOR.read_noise_e / noise,
    )
    return synthetic_bracket(SIZE, seed, sensor=sensor)


def bracket(seed: int = 31, frames: tuple[int, ...] = tuple(range(9))) -> Bracket8:
    source = made(seed)
    return Bracket8([source.frames[j] for j in frames], [source.true_s[j] for j in frames])


@lru_cache(maxsize=4)
def fitted(seed: int = 31) -> ResponseFit:
    return recover_response([bracket(seed)])


def truth(tone: tuple[ToneCurve, ToneCurve, ToneCurve] = REFERENCE_SENSOR.tone) -> npt.NDArray[np.float64]:
    codes = np.clip(np.arange(256), 0.25, 255) / 255
    return np.stack([np.log2(curve.decode(codes)) for curve in tone])


def errors(curve: ResponseCurve, first: int = 5, last: int = 250) -> npt.NDArray[np.float64]:
    """Stops (3, codes), free of each channel's mean."""
    difference = (curve.log2_exposure - truth())[:, first : last + 1]
    return np.asarray(difference - difference.mean(axis=1, keepdims=True))


def rms(curve: ResponseCurve, first: int = 5, last: int = 250) -> float:
    return float(np.sqrt((errors(curve, first, last) ** 2).mean()))


def is_sound(fit: ResponseFit) -> bool:
    """Whether all is finite, curves rise, and uncertainties are not negative."""
    curve, noise = fit.curve, fit.noise
    return bool(
        np.isfinite(curve.log2_exposure).all()
        and (np.diff(curve.log2_exposure, axis=1) > 0).all()
        and np.isfinite(curve.sigma_log2).all()
        and (curve.sigma_log2 >= 0).all()
        and np.isfinite([*noise.photon, *noise.read, *noise.code_variance]).all()
        and min(*noise.photon, *noise.read) >= 0
        and min(noise.code_variance) > 0
        and np.isfinite(fit.times_s).all()
    )

"""Rivals of our response curve: OpenCV's Debevec and Robertson, colour-hdri, and Mitsunaga and Nayar's polynomial."""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt

from benchmarks.photometry.synthetic_bracket import SyntheticBracket
from processing.calibration.response.samples import Bracket8, ChannelSamples, take_samples
from processing.ground.arrays import Doubles

COLOUR_HDRI_SIZE = 105
"""Rows given to colour-hdri."""
MITSUNAGA_ORDERS = range(3, 9)
_LOW, _HIGH = 4.0, 251.0
_GAIN = 0.97
"""A higher order must lower the error on pairs that were not fitted by so much."""


def opencv_debevec(bracket: SyntheticBracket) -> Doubles:
    """OpenCV's defaults: 70 samples, lambda 10."""
    import cv2

    times = np.array(bracket.true_s, dtype=np.float32)
    return _log2(cv2.createCalibrateDebevec(70, 10.0).process(list(bracket.frames), times))


def opencv_robertson(bracket: SyntheticBracket) -> Doubles:
    """OpenCV's on every 8th pixel each way: on all it takes minutes."""
    import cv2

    frames = [np.ascontiguousarray(frame[::8, ::8]) for frame in bracket.frames]
    return _log2(cv2.createCalibrateRobertson().process(frames, np.array(bracket.true_s, dtype=np.float32)))


def colour_hdri(bracket: SyntheticBracket, samples: int) -> Doubles:
    """colour-hdri's Grossberg samples and Debevec's solution, on a reduced picture."""
    from colour_hdri import Image, ImageStack, camera_response_functions_Debevec1997

    step = max(bracket.frames[0].shape[0] // COLOUR_HDRI_SIZE, 1)
    stack = ImageStack()
    for frame, time_s in zip(bracket.frames, bracket.true_s, strict=True):
        image = Image(data=frame[::step, ::step] / 255.0)
        image.metadata = _colour_metadata(time_s)
        stack.append(image)
    curves = camera_response_functions_Debevec1997(stack, sampling_function_kwargs={"samples": samples})
    return _log2(np.asarray(curves))


def _colour_metadata(time_s: float) -> Any:
    from colour_hdri import Metadata

    return Metadata(
        f_number=5.6, exposure_time=time_s, iso=100, black_level=None, white_level=None, white_balance_multipliers=None
    )


def _log2(response: npt.ArrayLike) -> Doubles:
    curves = np.asarray(response, dtype=np.float64).reshape(256, 3).T
    return np.asarray(np.log2(np.maximum(curves, 1e-9)))


def mitsunaga_nayar(bracket: SyntheticBracket) -> Doubles:
    """Mitsunaga, Nayar: Radiometric self calibration (CVPR 1999): a polynomial, from ratios of neighbouring exposures.

    On the patches that our own method uses.
    """
    samples = take_samples([Bracket8(bracket.frames, bracket.true_s)])
    return np.stack([_polynomial(data, samples.log2_times) for data in samples.channels])


def _polynomial(data: ChannelSamples, log2_times: Doubles) -> Doubles:
    """Return log2 exposure (256,) of a channel, 0 at code 255: f(1) = 1 is their gauge.

    The polynomial is solved over Chebyshev polynomials in float64 (powers of the code are ill-conditioned); its order
    is the one that predicts held-out pairs best. Where it falls to 0 or below it is continued in a straight line.
    """
    first, second = _neighbours(data, log2_times)
    longer, shorter = data.mean[first] / 255, data.mean[second] / 255
    ratio = np.exp2(log2_times[data.frame[first]] - log2_times[data.frame[second]])
    held = np.arange(len(ratio)) % 2 == 0
    chosen, best = MITSUNAGA_ORDERS[0], np.inf
    for order in MITSUNAGA_ORDERS:
        answer = _solve(longer[held], shorter[held], ratio[held], order)
        error = float(np.mean((_value(answer, longer[~held]) - ratio[~held] * _value(answer, shorter[~held])) ** 2))
        if error < _GAIN * best:
            chosen, best = order, error
    answer = _solve(longer, shorter, ratio, chosen)
    linear = _value(answer, np.arange(256) / 255)
    rising = np.flatnonzero((linear[:-1] <= 0) | (np.diff(linear) <= 0))
    # From the last code of the lower half that does not rise, straight down to half a code's light at code 0.
    start = int(rising[rising < 128].max(initial=-1)) + 1
    toe = linear[start] * (np.arange(start) + 0.5) / (start + 0.5)
    linear = np.concatenate([toe, linear[start:]])
    return np.asarray(np.log2(np.maximum(linear, 1e-9)), dtype=np.float64)


def _neighbours(data: ChannelSamples, log2_times: Doubles) -> tuple[npt.NDArray[np.int64], npt.NDArray[np.int64]]:
    order = np.lexsort((-log2_times[data.frame], data.sample))
    usable = (data.mean >= _LOW) & (data.mean <= _HIGH)
    first, second = order[:-1], order[1:]
    same = (data.sample[first] == data.sample[second]) & usable[first] & usable[second]
    return first[same], second[same]


def _terms(x: Doubles, order: int) -> Doubles:
    """Return (n, order): T_n - 1 for n = 1..order, so that every sum of them added to 1 is 1 at x = 1."""
    return np.asarray(np.polynomial.chebyshev.chebvander(2 * x - 1, order)[:, 1:] - 1)


def _value(answer: Doubles, x: Doubles) -> Doubles:
    return np.asarray(1 + _terms(x, len(answer)) @ answer)


def _solve(longer: Doubles, shorter: Doubles, ratio: Doubles, order: int) -> Doubles:
    rows = _terms(longer, order) - ratio[:, None] * _terms(shorter, order)
    return np.asarray(np.linalg.lstsq(rows, ratio - 1, rcond=None)[0], dtype=np.float64)

"""What a response curve and a camera's noise are, and the noise as the frames of a bracket show it.

A response curve leads from picture codes to relative exposure, per channel. Two frames of one still patch differ by
noise alone, whatever its texture: the longer exposure predicts the shorter one's code, and the variance about that
prediction is a known linear function of the photon, read and coding terms of both (EMVA 1288's noise equation, carried
through the response).
"""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, TypeVar

import numpy as np

from processing.calibration.response.samples import ChannelSamples
from processing.errors import ParameterError
from processing.ground.arrays import Doubles, Flags, Rgb

T = TypeVar("T", int, float)
MOST_BLACK = 0.5  # of full scale; chosen: sensors have below 0.1, and noise may take it a little below 0


def three(values: Sequence[T]) -> tuple[T, T, T]:
    """Return what the channels have as a tuple."""
    red, green, blue = values
    return red, green, blue


@dataclass(frozen=True)
class ResponseCurve:
    """Exposure that gives each code: ``log2_exposure[channel, code]`` in stops, strictly increasing in the code.

    Gauge: the exposure is relative; ``log2_exposure[c, gauge_code]`` is fixed by the method. ``sigma_log2`` is the
    standard uncertainty of the shape, relative to the point ``sigma_code`` (0 there); ``balance_sigma`` that of each
    channel as a whole, which matters for colour only. The radiance of code z in a frame of t seconds is
    ``2 ** log2_exposure[c, z] / t``. Codes outside ``low[c]..high[c]`` are extrapolated: not for merging.
    """

    log2_exposure: Doubles
    """(3, N): N = 256 for 8-bit frames; 16-bit and raw frames are linear and have no table (``linear``)."""
    sigma_log2: Doubles
    """(3, N)."""
    low: tuple[int, int, int]
    high: tuple[int, int, int]
    gauge_code: int = 128
    sigma_code: int = 128
    balance_sigma: Rgb = (0.0, 0.0, 0.0)
    """Stops between ``sigma_code`` and the gauge."""
    method: str = "daylit"
    """Which method gave it: "daylit", or that of an older profile or of another program."""
    n_samples: int = 0
    """Pixel samples that the fit used."""
    residual_stops: float = 0.0
    """Robust rms residual of the fit."""
    modes: Doubles | None = None
    """(M, 3, 256) stops: independent errors of the curves, one standard deviation each; None: only `sigma_log2`."""
    clip_together: bool = False
    """Whether codes say nothing where another channel is clipped: see `response.clip_together`."""
    held_out: tuple[float, ...] = ()
    """Of each channel: chi-squared a degree of freedom of patches that the curve was not fitted to."""
    prior_strength: tuple[tuple[float, float], ...] = ()
    """Of each channel: amplitude of the principal curves, log10 of the rest's stiffness, as chosen by the data."""

    @property
    def exposure(self) -> Doubles:
        """Return linear exposure, > 0, of shape (3, N)."""
        return np.asarray(np.exp2(self.log2_exposure))

    @property
    def log2_slope(self) -> Doubles:
        """Return stops per code, > 0, of shape (3, N), by central differences."""
        return np.asarray(np.gradient(self.log2_exposure, axis=1))


def fit_text(curve: Mapping[str, Any]) -> str:
    """Return how far off patches left out of a recorded curve's fit are, and its prior, by channel."""
    if not curve.get("held_out"):
        return "no patches left out to judge it by"
    off = "/".join(f"{math.sqrt(chi2):.2f}" for chi2 in curve["held_out"])
    chosen = "/".join(f"{amplitude:g} and 10^{log10:g}" for amplitude, log10 in curve["prior_strength"])
    return f"patches left out: {off} standard deviations; prior (amplitude and stiffness): {chosen}"


# The camera's noise as the merge needs it: how uncertain is the exposure behind each code.


@dataclass(frozen=True)
class NoiseModel:
    """Variance of the linear exposure x (in the response curve's gauge), per channel.

    ``var(x) = photon[c] * x + read[c] ** 2`` before the codes, plus quantisation and coding noise of
    ``code_variance[c]`` squared codes through the response's slope. Photon noise: EMVA 1288; of rounding: 1/12.
    """

    photon: Rgb
    read: Rgb
    code_variance: Rgb = (1 / 12, 1 / 12, 1 / 12)
    black: Rgb = (0.0, 0.0, 0.0)
    """Of full scale, within half of it: what linear frames show of no light."""

    def __post_init__(self) -> None:
        every = [float(value) for part in (self.photon, self.read, self.code_variance) for value in part]
        if not all(math.isfinite(value) and value >= 0 for value in every):
            raise ParameterError(f"noise is finite and not negative, not {every}", likely="a damaged profile")
        if not all(abs(value) < MOST_BLACK for value in self.black):
            raise ParameterError(f"a black level is a share of full scale below {MOST_BLACK}, not {self.black}")

    def relative_variance(self, curve: ResponseCurve) -> Doubles:
        """Return var(x) / x2 for each code, of shape (3, N): what the merge weighs by."""
        x = curve.exposure
        slope = curve.log2_slope * np.log(2.0)  # d ln x / d code
        photon, read, codes = (np.array(v)[:, None] for v in (self.photon, self.read, self.code_variance))
        return np.asarray(photon / x + (read / x) ** 2 + codes * slope**2)


SLOPE_SMOOTHING = 8.0
"""Of 256 steps over the root of the code; chosen on published curves: 0 raises their 90th percentile to .02."""
FINE_STEPS = 16  # table entries a code; between them tables are interpolated


@dataclass(frozen=True)
class FineCurve:
    """A curve of 256 codes between them too: tables at steps of 1/16 code."""

    log2: Doubles
    slope: Doubles
    """Stops a code."""
    bend: Doubles
    """Stops a squared code."""

    @staticmethod
    def of(log2_exposure: Doubles) -> "FineCurve":
        """Interpolate; in linear exposure, in which the toe of a curve is straight.

        ``log2_exposure``: shape (256,), stops, strictly rising.
        """
        from scipy.interpolate import PchipInterpolator
        from scipy.ndimage import gaussian_filter1d

        codes = np.linspace(0, 255, 255 * FINE_STEPS + 1)
        log2 = np.asarray(np.log2(PchipInterpolator(np.arange(256), np.exp2(log2_exposure))(codes)), dtype=np.float64)
        # Stops a code (256,), smooth over the root of the code. Weights and noise hang on it: with the slope of a
        # curve that ripples they would reward its ripples, round by round.
        root = np.sqrt(np.arange(256) + 2.0)
        even = np.linspace(root[0], root[-1], 256)
        slope = np.log(np.maximum(np.gradient(log2_exposure) * root, 1e-6))
        smooth = gaussian_filter1d(np.interp(even, root, slope), SLOPE_SMOOTHING)
        smooth = np.asarray(np.exp(np.interp(root, even, smooth)) / root)
        slope = np.interp(codes, np.arange(256), smooth)
        return FineCurve(log2, slope, np.interp(codes, np.arange(256), np.gradient(smooth)))

    def at(self, codes: Doubles) -> tuple[Doubles, Doubles, Doubles]:
        """Return log2 exposure, slope and bend at codes (clipped to 0..255).

        All of the shape of ``codes``: stops, stops a code, stops a squared code.
        """
        place = np.clip(codes, 0, 255) * FINE_STEPS
        first = np.minimum(place.astype(np.int64), len(self.log2) - 2)
        share = place - first
        nearest = np.rint(place).astype(np.int64)
        log2 = np.asarray(self.log2[first] + share * (self.log2[first + 1] - self.log2[first]), dtype=np.float64)
        return log2, self.slope[nearest], self.bend[nearest]

    def code(self, log2_exposure: Doubles) -> Doubles:
        """Return the code of an exposure, 0..255. Of the shape of ``log2_exposure``."""
        return np.asarray(np.interp(log2_exposure, self.log2, np.linspace(0, 255, len(self.log2))), dtype=np.float64)


@dataclass(frozen=True)
class CodeNoise:
    """Variance of a code (or of a mean of codes): photon x + read2 in exposure, and ``code`` in squared codes."""

    photon: float
    read2: float
    code: float

    def variance(self, log2_exposure: Doubles, slope: Doubles) -> Doubles:
        """Return squared codes at exposures where the curve has a slope (stops a code). All of one shape."""
        x = np.exp2(log2_exposure)
        return np.asarray((self.photon * x + self.read2) / (x * np.log(2.0) * slope) ** 2 + self.code)


FIRST_GUESS = CodeNoise(0.0, 0.0, 0.25)


@dataclass(frozen=True)
class PatchNoise:
    """Noise of the patches' means, by which they are weighed, and of single pixels."""

    mean: CodeNoise = FIRST_GUESS
    pixel: CodeNoise = CodeNoise(0.0, 0.0, 1.0)


_LOW, _HIGH = 5.0, 250.0  # predicted codes that are used; chosen: clear of cut-off noise
_LEAST_LONG_CODE = 8.0  # codes of the longer exposure that predict
_BINS = 40  # over the code; chosen
_LEAST = 20  # differences that a bin must hold
_TRIM = 4.0  # robust standard deviations; chosen: what moved does not count
_ROUNDS = 4  # of reweighting; chosen


def fit_noise(
    data: ChannelSamples, fine: FineCurve, log2_times: Doubles, *, least_code_variance: float, pixels: int = 0
) -> CodeNoise | None:
    """Return the noise of ``pixels`` single pixels of each patch, or with 0 of the patches' means.

    None where too few patches are usable. ``log2_times``: (F,) log2 of seconds.
    """
    # Observations of the same patch in neighbouring exposures: the longer, and the next shorter one
    order = np.lexsort((-log2_times[data.frame], data.sample))
    same = data.sample[order[1:]] == data.sample[order[:-1]]
    longer, shorter = order[:-1][same], order[1:][same]
    step = log2_times[data.frame[shorter]] - log2_times[data.frame[longer]]
    if pixels == 0:
        short_codes = data.mean[shorter]
        predicted, use, terms = _predicted(data.mean[longer], step, fine)
    else:
        # Whole codes and few steps of time: what they predict is computed once for each code of each step
        places = [4, 0, 8, 2, 6, 1, 3, 5, 7][:pixels]
        steps, which = np.unique(step, return_inverse=True)
        table = _predicted(np.tile(np.arange(256.0), len(steps)), np.repeat(steps, 256), fine)
        entry = (which[:, None] * 256 + data.pixels[longer][:, places]).T.ravel()
        short_codes = data.pixels[shorter][:, places].T.ravel().astype(np.float64)
        predicted, use, terms = (part[entry] for part in table)
    if use.sum() < _LEAST:
        return None
    return _solve_noise((short_codes - predicted)[use], terms[use], predicted[use], least_code_variance)


def _predicted(long_codes: Doubles, step: Doubles, fine: FineCurve) -> tuple[Doubles, Flags, Doubles]:
    """Return the codes (n,) that a frame ``step`` stops shorter has, whether both are of use, and terms (n, 3).

    Terms: variance of the difference, in squared codes, for a unit of photon, read2 and code variance."""
    at_long, slope_long, _ = fine.at(long_codes)
    predicted = fine.code(at_long + step)
    use = (long_codes < _HIGH) & (long_codes > _LEAST_LONG_CODE) & (predicted > _LOW) & (predicted < _HIGH)
    at_short, slope_short, _ = fine.at(predicted)
    x_long, x_short = np.exp2(at_long), np.exp2(at_short)
    codes_per_log = 1 / (np.log(2.0) * slope_short)  # d code / d ln x in the shorter frame
    ratio = slope_long / slope_short  # a code there is so many here
    photon = codes_per_log**2 * (1 / x_short + 1 / x_long)
    read = codes_per_log**2 * (1 / x_short**2 + 1 / x_long**2)
    return predicted, use, np.stack([photon, read, 1 + ratio**2], axis=1)


def _solve_noise(difference: Doubles, terms: Doubles, predicted: Doubles, least: float) -> CodeNoise | None:
    """Fit mean squares over bins of the code, each weighed by its own variance, terms not below 0."""
    from scipy.optimize import nnls

    root = np.minimum((np.sqrt(predicted / 256) * _BINS).astype(np.int64), _BINS - 1)
    centre = np.zeros(_BINS)
    limit = np.zeros(_BINS)
    count = np.bincount(root, minlength=_BINS)
    for b in np.flatnonzero(count >= _LEAST):
        mine = difference[root == b]
        centre[b] = np.median(mine)
        limit[b] = _TRIM * max(1.4826 * float(np.median(np.abs(mine - centre[b]))), 0.3)
    kept = np.abs(difference - centre[root]) < limit[root]
    count = np.bincount(root[kept], minlength=_BINS)
    full = count >= _LEAST
    if full.sum() < 4:
        return None
    square = np.bincount(root[kept], (difference - centre[root])[kept] ** 2, _BINS)[full] / count[full]
    columns = np.stack([np.bincount(root[kept], t[kept], _BINS)[full] / count[full] for t in terms.T], axis=1)
    offset = least * columns[:, 2]
    answer = np.array([0.0, 0.0, 1.0])
    for _ in range(_ROUNDS):
        expected = np.maximum(columns @ answer + (offset if _ else 0), 1e-9)
        weight = np.sqrt(count[full] / 2) / expected
        size = np.maximum((columns * weight[:, None]).max(axis=0), 1e-300)
        answer = nnls(columns * weight[:, None] / size, np.maximum(square - offset, 0) * weight)[0] / size
    return CodeNoise(float(answer[0]), float(answer[1]), float(answer[2] + least))

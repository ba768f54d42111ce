"""The merge of linear 16-bit frames (TIFF, PNG, developed raw): no tables, the noise model itself for every sample.

Weights come from the estimate, not from the sample: a first look finds the radiance, a second one weighs each sample
by the variance that the noise model expects at that radiance. So noise does not choose its own weight.
"""

# mypy: disable-error-code="no-untyped-def,attr-defined"
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
from numba import carray

from processing.calibration.merge.kernel import bytes_at, chi2_limit, compiled, inner
from processing.calibration.response.curve import NoiseModel
from processing.ground.arrays import Doubles, Floats, Int64s
from processing.pictures.mosaic import FULL

CLIP_CODE = 64224  # 98 % of full scale: from here on a sample counts as clipped
_DARK_UNCERTAINTY = 0.5  # as in the 8-bit loops


@dataclass(frozen=True)
class LinearSamples:
    """What a code of 16 bits says; exposure 1 is full scale; frames from the longest time to the shortest."""

    times_s: Doubles
    time_sigma: Doubles
    noise: Doubles
    """(3, 4): of each channel photon, read squared, squared coding noise, all of exposure; and black, of full scale."""

    @property
    def saturation(self) -> Floats:
        """(F, 3): radiance at which each frame clips."""
        return np.asarray((CLIP_CODE / FULL - self.noise[:, 3]) / self.times_s[:, None], dtype=np.float32)

    @property
    def every(self) -> Int64s:
        """Codes over the whole range, (n, 3), rising. Of shape (512, 3) or fewer, int64."""
        return np.repeat(np.unique(np.geomspace(1, FULL, 512).astype(np.int64))[:, None], 3, axis=1)

    def sample(self, place: int, codes: npt.NDArray[np.generic]) -> tuple[Floats, Floats]:
        """Return radiance and weight of codes (..., 3) of frame ``place``; weight 0: clipped, the value is a bound.

        ``codes``: any shape (..., 3); radiance in exposures a second.
        """
        code = np.asarray(codes, dtype=np.float64)
        x = np.minimum(code, CLIP_CODE) / FULL - self.noise[:, 3]
        photon, read2, code2, _ = self.noise.T
        variance = photon * np.maximum(x, 0) + read2 + code2 + (self.time_sigma[place] * x) ** 2
        weight = np.where(code >= CLIP_CODE, 0.0, self.times_s[place] ** 2 / variance)
        return (x / self.times_s[place]).astype(np.float32), weight.astype(np.float32)


def linear_samples(noise: NoiseModel, times_s: Doubles, time_sigma: Doubles) -> LinearSamples:
    """Return the model of frames with ``times_s`` (falling); noise in exposure, 1 at full scale; codes in codes.

    ``times_s``: (F,) s; ``time_sigma``: (F,) relative.
    """
    rows = np.stack(
        [noise.photon, np.square(noise.read), np.maximum(noise.code_variance, 1 / 12) / FULL**2, noise.black], axis=1
    ).astype(np.float64)
    return LinearSamples(times_s, time_sigma, rows)


@inner
def _expected_variance(noise, c, x, time_sigma):
    return noise[c, 0] * max(x, 0.0) + noise[c, 1] + noise[c, 2] + (time_sigma * x) ** 2


@inner
def _channel(addresses, pixel, c, times, sigma, noise):
    """Return mean radiance, its variance, chi-squared and its degrees of freedom, and whether only a bound is known."""
    mean, variance, chi2, used, bound = 0.0, np.inf, 0.0, 0, 0.0
    for look in range(3):
        total = sum_v = sum_vv = 0.0
        used = 0
        for f in range(addresses.shape[0]):
            at = 2 * (3 * pixel + c)
            pair = carray(bytes_at(addresses[f] + np.uint64(at)), 2)
            code = pair[0] + 256 * pair[1]
            if code >= CLIP_CODE:
                bound = max(bound, (CLIP_CODE / FULL - noise[c, 3]) / times[f])
                continue
            x = code / FULL - noise[c, 3]
            w = times[f] ** 2 / _expected_variance(noise, c, x if look == 0 else mean * times[f], sigma[f])
            v = x / times[f]
            total, sum_v, sum_vv = total + w, sum_v + w * v, sum_vv + w * v * v
            used += 1
        if used == 0:
            return bound, np.inf, 0.0, 0, True
        mean, variance = sum_v / total, 1.0 / total
        chi2 = sum_vv - sum_v * mean
    excess = 0.97 * bound - mean
    if excess > 0.0:
        chi2 += excess * excess * min(1.0 / variance, 1e4 / max(mean * mean, 1e-30))
        used += 1
    return mean, variance, max(chi2, 0.0), used - 1, False


@compiled
def merge_linear(addresses, pixels, times, sigma, noise, shared, weights, out):
    """Merge pixels ``pixels[0]..pixels[1]-1`` of little-endian uint16 frames into ``out`` (`FlatPlanes`).

    ``addresses``: (F,) uint64 of the frames' codes (N, 3); ``times``: (F,) s; ``sigma``: (F,) their relative
    uncertainty; ``noise``: (3, 4) as in `LinearSamples`; ``shared``: correlation of the channels' noise; ``weights``:
    (3,) luminance of the channels.
    """
    rgb, uncertainty, validity, suspect = out
    for p in range(pixels[0], pixels[1]):
        r, var_r, chi2_r, free_r, bound_r = _channel(addresses, p, 0, times, sigma, noise)
        g, var_g, chi2_g, free_g, bound_g = _channel(addresses, p, 1, times, sigma, noise)
        b, var_b, chi2_b, free_b, bound_b = _channel(addresses, p, 2, times, sigma, noise)
        rgb[p, 0], rgb[p, 1], rgb[p, 2] = r, g, b
        y = weights[0] * r + weights[1] * g + weights[2] * b
        together = weights[0] * np.sqrt(var_r) + weights[1] * np.sqrt(var_g) + weights[2] * np.sqrt(var_b)
        apart = weights[0] ** 2 * var_r + weights[1] ** 2 * var_g + weights[2] ** 2 * var_b
        u = np.sqrt((1.0 - shared) * apart + shared * together * together) / max(y, 1e-30)
        freedom, chi2 = free_r + free_g + free_b, chi2_r + chi2_g + chi2_b
        limit = chi2_limit(freedom, shared)
        suspect[p] = 0
        if freedom > 0 and chi2 > limit:
            suspect[p] = 2 if chi2 > 4.0 * limit else 1
            u *= np.sqrt(chi2 / freedom)
        uncertainty[p] = u
        clipped = bound_r or bound_g or bound_b
        validity[p] = 1 if clipped else (2 if u > _DARK_UNCERTAINTY else 0)

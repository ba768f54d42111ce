"""Small brackets with known truth for the tests of the merge; the curve is the simulated camera's own."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import lru_cache
from typing import Any

import numpy as np
import numpy.typing as npt

from benchmarks.photometry.synthetic_bracket import REFERENCE_SENSOR, SyntheticBracket, synthetic_bracket
from mocks.optics.sensor import ToneCurve
from processing.calibration.merge.merge import Merged, MergeOptions, merge
from processing.calibration.response.curve import NoiseModel, ResponseCurve
from processing.pictures.frames import array_frame
from processing.pictures.images import luminance_cd_m2
from processing.sphere import Equirectangular

SIZE = (360, 180)
SCALE = 120 * 5.6**2 / 100
"""cd/m2 of exposure 1 in one second at f/5.6 and ISO 100 (ISO 12232)."""
NOISE = NoiseModel((1 / 15000,) * 3, (4 / 15000,) * 3)


def true_curve(tones: Sequence[ToneCurve] = REFERENCE_SENSOR.tone) -> ResponseCurve:
    """Return the exact inverse of a camera's tone curves."""
    x = np.stack([tone.decode(np.arange(256) / 255) for tone in tones])
    x[:, 0] = x[:, 1] / 4
    return ResponseCurve(np.log2(x), np.zeros((3, 256)), (3,) * 3, (252,) * 3, method="truth")


@lru_cache(maxsize=8)
def bracket(
    seed: int = 900_001, quality: int | None = None, noise: float = 1.0, size: tuple[int, int] = SIZE
) -> SyntheticBracket:
    """Return a small bracket; ``noise`` times the camera's."""
    full_well = REFERENCE_SENSOR.full_well_e / noise**2
    # Read noise in electrons of the smaller well: the same part of it times the factor.
    read = REFERENCE_SENSOR.read_noise_e * full_well / REFERENCE_SENSOR.full_well_e * noise
    sensor = replace(REFERENCE_SENSOR, full_well_e=full_well, read_noise_e=read)
    return synthetic_bracket(size, seed, sensor=sensor, jpeg_quality=quality)


def merged(
    frames: Sequence[npt.NDArray[Any]],
    times_s: Sequence[float],
    curve: ResponseCurve | None = None,
    noise: NoiseModel = NOISE,
    time_sigma: Sequence[float] | None = None,
    **options: Any,
) -> Merged:
    """Merge arrays named frame 0, frame 1, ..."""
    sources = [array_frame(frame, f"frame {i}") for i, frame in enumerate(frames)]
    height, width = frames[0].shape[:2]
    if curve is None and frames[0].dtype == np.uint8:
        curve = true_curve()
    options_, shape = MergeOptions(**options), Equirectangular(width, height)
    return merge(sources, times_s, curve, noise, geometry=shape, options=options_, time_sigma=time_sigma)


@dataclass(frozen=True)
class Errors:
    """Stops from the truth where the picture says it is valid, with the known scale, and sigmas."""

    stops: npt.NDArray[np.float64]
    sigmas: npt.NDArray[np.float64]

    def covered(self, sigmas: float) -> float:
        return float(np.mean(np.abs(self.sigmas) <= sigmas))


def errors(result: Merged, truth: npt.NDArray[np.float32], where: npt.NDArray[np.bool_] | None = None) -> Errors:
    """Compare with true luminance."""
    image = result.image
    shown = luminance_cd_m2(image.rgb).astype(np.float64) * SCALE
    good = (image.validity == 0) & (truth > 0.13) & (truth < 2e5)
    if where is not None:
        good &= where
    ratio = np.log(shown[good] / truth[good])
    return Errors(ratio / np.log(2), ratio / image.uncertainty[good])

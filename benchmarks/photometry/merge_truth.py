"""Brackets with known truth for the merge: what counts as well exposed, and the errors of a merged picture."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from benchmarks.photometry.synthetic_bracket import SyntheticBracket
from mocks.optics.sensor import Exposure
from mocks.worlds.light import luminance_cd_m2
from processing.calibration.response.curve import NoiseModel, ResponseCurve

RANGE_CD_M2 = (0.13, 2e5)
SCALE_AT_CD_M2 = (50.0, 200.0)
ROWS = 256


@dataclass(frozen=True)
class Summary:
    """Errors in stops, log2 of estimated over true luminance after one scale fixed at 50..200 cd/m2."""

    median: float
    p95: float
    decade_bias: float
    """The largest median error of any decade."""
    coverage68: float = float("nan")
    coverage95: float = float("nan")
    """Parts of the pixels within 1 and 1.96 stated standard uncertainties."""


def well_exposed(shot: SyntheticBracket) -> npt.NDArray[np.bool_]:
    """Return where all channels' codes without noise are 20..235 in some frame, and luminance is in the range."""
    height, width = shot.radiance.shape[:2]
    good = np.zeros((height, width), dtype=bool)
    for top in range(0, height, ROWS):
        rows = shot.radiance[top : top + ROWS]
        for nominal_s in shot.nominal_s:
            exposure = Exposure(nominal_s, 100, 5.6)
            gain = np.float32(shot.sensor.exposure_gain(exposure))
            codes = shot.sensor.develop(np.minimum(rows * gain, 1), exposure)
            good[top : top + ROWS] |= ((codes >= 20) & (codes <= 235)).all(axis=-1)
    truth = shot.luminance
    return np.asarray(good & (truth > RANGE_CD_M2[0]) & (truth < RANGE_CD_M2[1]))


def summary(
    rgb: npt.NDArray[np.float32],
    shot: SyntheticBracket,
    good: npt.NDArray[np.bool_],
    uncertainty: npt.NDArray[np.float32] | None = None,
) -> Summary:
    """Return the errors of a merged picture (H, W, 3) where ``good``; values that are no numbers count as 0."""
    truth = shot.luminance[good].astype(np.float64)
    shown = np.nan_to_num(luminance_cd_m2(rgb)[good].astype(np.float64), nan=0.0, posinf=0.0)
    stops = np.log2(np.maximum(shown, 1e-12) / truth)
    stops -= np.median(stops[(truth > SCALE_AT_CD_M2[0]) & (truth < SCALE_AT_CD_M2[1])])
    decades = [(truth > 10.0**d) & (truth < 10.0 ** (d + 1)) for d in range(-1, 6)]
    bias = max(abs(float(np.median(stops[there]))) for there in decades if there.sum() > 100)
    found = (float(np.median(np.abs(stops))), float(np.quantile(np.abs(stops), 0.95)), bias)
    if uncertainty is None:
        return Summary(*found)
    sigmas = np.abs(stops) * np.log(2) / uncertainty[good]
    return Summary(*found, float(np.mean(sigmas <= 1)), float(np.mean(sigmas <= 1.96)))


def true_curve(shot: SyntheticBracket) -> ResponseCurve:
    """Return the exact inverse of the camera's tone curves."""
    x = np.stack([tone.decode(np.arange(256) / 255) for tone in shot.sensor.tone])
    x[:, 0] = x[:, 1] / 4
    return ResponseCurve(np.log2(x), np.zeros((3, 256)), (3,) * 3, (252,) * 3, method="truth")


def true_noise(shot: SyntheticBracket) -> NoiseModel:
    """Return the simulated sensor's noise."""
    wells = shot.sensor.full_well_e
    return NoiseModel((1 / wells,) * 3, (shot.sensor.read_noise_e / wells,) * 3)

"""Our response fit on published curves that its prior has not seen: the other half of them.

Three curves in a row are the channels of one bracket of nine lossless frames of 840 x 420, with the reference sensor's
noise. The prior is fitted to every second bracket (and digital curves), the others are judged; then the reverse. The
same frames as JPEG 4:2:0 of quality 95 are judged beside them.
"""

from __future__ import annotations

import numpy as np

from benchmarks.photometry.synthetic_bracket import PAPER_TIMES_S, REFERENCE_SENSOR, jpeg_coded, reference_radiance
from benchmarks.shared_data import DATA
from processing.calibration.response.response import recover_response
from processing.calibration.response.samples import Bracket8
from processing.ground.arrays import Bytes, Doubles, Floats
from training.response_prior import digital_curves, log2_exposure, principal_curves, published_curves

FOLDER = DATA / "curves"
SIZE = (840, 420)
SATURATION_CD_M2_S = 120 * 5.6**2 / 100
FIRST, LAST, MIDDLE = 5, 250, 128
JPEG_QUALITY = 95
MOST = 1000
"""Brackets at most: all of them (34), but for a trial."""


def dorf_figures(seed: int, *, quick: bool) -> dict[str, float]:
    """Return median and 90th percentile of the brackets' rms errors in stops, and the codes within 2 sigmas in %.

    Nothing where the shared curves are not there. Quick: one half is judged.
    """
    if not FOLDER.is_dir():
        return {}
    _, irradiance, brightness = published_curves(FOLDER)
    whole = min(len(brightness) // 3, MOST)
    truth = [log2_exposure(irradiance, one) for one in brightness]
    errors, right, coded = [], [], []
    for half in (1,) if quick else (1, 0):
        seen = [truth[3 * k + c] for k in range(whole) if k % 2 != half for c in range(3)]
        prior = principal_curves([*seen, *digital_curves()]).prior()
        for k in range(half, whole, 2):
            rows = slice(3 * k, 3 * k + 3)
            frames = _exposed(irradiance, brightness[rows], 900_000 + 1000 * seed + k)
            curve = recover_response([Bracket8(frames, PAPER_TIMES_S)], prior=prior).curve
            off = curve.log2_exposure - np.stack(truth[rows])
            errors.append(_rms(off))
            sigmas = np.abs(off - off[:, MIDDLE : MIDDLE + 1]) / np.maximum(curve.sigma_log2, 1e-12)
            right.append(float((sigmas[:, FIRST : LAST + 1] < 2).mean()))
            jpegs = [jpeg_coded(frame, JPEG_QUALITY) for frame in frames]
            curve = recover_response([Bracket8(jpegs, PAPER_TIMES_S)], prior=prior).curve
            coded.append(_rms(curve.log2_exposure - np.stack(truth[rows])))
    return {
        "dorf_median_stops": round(float(np.median(errors)), 5),
        "dorf_p90_stops": round(float(np.quantile(errors, 0.9)), 5),
        "dorf_jpeg_median_stops": round(float(np.median(coded)), 5),
        "dorf_jpeg_p90_stops": round(float(np.quantile(coded, 0.9)), 5),
        "dorf_cover2_pct": round(100 * float(np.mean(right)), 1),
    }


def _rms(off: Doubles) -> float:
    """Return the rms (3, 256) in stops over codes 5 to 250, each channel free of its mean."""
    codes = off[:, FIRST : LAST + 1]
    return float(np.sqrt(np.mean((codes - codes.mean(axis=1, keepdims=True)) ** 2)))


def _exposed(irradiance: Doubles, brightness: Doubles, seed: int) -> list[Bytes]:
    radiance = reference_radiance(SIZE, seed)
    rng = np.random.default_rng(seed)
    return [_frame(radiance * np.float32(t / SATURATION_CD_M2_S), irradiance, brightness, rng) for t in PAPER_TIMES_S]


def _frame(light: Floats, irradiance: Doubles, brightness: Doubles, rng: np.random.Generator) -> Bytes:
    full, read = REFERENCE_SENSOR.full_well_e, REFERENCE_SENSOR.read_noise_e / REFERENCE_SENSOR.full_well_e
    light = np.minimum(light, 4)
    light = light + rng.standard_normal(light.shape, dtype=np.float32) * np.sqrt(light / full + read**2)
    out = np.empty(light.shape, np.uint8)
    for c, one in enumerate(brightness):
        rising = np.maximum.accumulate(one)
        shown = (rising - rising[0]) / (rising[-1] - rising[0])
        out[..., c] = np.rint(255 * np.interp(np.clip(light[..., c], 0, 1), irradiance, shown))
    return out

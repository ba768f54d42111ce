"""A light that is clipped in every frame, beside something that moved, keeps the bound of the shortest frame."""

from __future__ import annotations

import numpy as np

from benchmarks.photometry.synthetic_bracket import PAPER_TIMES_S, REFERENCE_SENSOR
from mocks.optics.sensor import Exposure
from processing.calibration.merge.merge import merge
from processing.pictures.frames import array_frame
from processing.pictures.images import Validity, luminance_cd_m2
from processing.sphere import Equirectangular
from tests.processing.calibration.merge.merge_cases import NOISE, true_curve


def test_a_clipped_sun_among_ghosts_keeps_its_bound() -> None:
    rng = np.random.default_rng(5)
    frames = []
    for number, shutter_s in enumerate(PAPER_TIMES_S):
        radiance = np.full((96, 192, 3), 300.0, dtype=np.float32)
        left = 60 + 4 * (number % 3)
        radiance[30:60, left : left + 40] = 9000.0  # a cloud that moves behind the sun
        radiance[40:46, 80:86] = 5e6
        exposure = Exposure(shutter_s, 100, 5.6)
        frames.append(REFERENCE_SENSOR.develop(REFERENCE_SENSOR.mosaic_signal(radiance, exposure, rng), exposure))
    found = merge(
        [array_frame(f, str(i)) for i, f in enumerate(frames)],
        PAPER_TIMES_S,
        true_curve(),
        NOISE,
        geometry=Equirectangular(192, 96),
    ).image
    sun = (slice(41, 45), slice(81, 85))
    assert found.ghost is not None
    assert (found.ghost[30:60, 58:110] > 0).any(), "the cloud moved"
    assert (found.validity[sun] == Validity.CLIPPED).all()
    brightest = float(luminance_cd_m2(found.rgb).max())
    assert luminance_cd_m2(found.rgb[sun]).min() > 0.9 * brightest, "the shortest frame's bound"

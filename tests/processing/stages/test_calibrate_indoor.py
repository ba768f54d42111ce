"""What the indoor half of the stage calibrate says of pictures that are no whole panorama."""

from __future__ import annotations

import numpy as np
import pytest

from processing.pictures.images import LuminanceImage
from processing.sphere import Equirectangular
from processing.stages.calibrate import not_a_panorama


@pytest.mark.parametrize(("width", "height", "result"), [(40, 20, 0), (6720, 3360, 0), (60, 40, 1), (20, 20, 1)])
def test_a_picture_that_is_not_twice_as_wide_as_high_is_reported(width: int, height: int, result: int) -> None:
    shape = (height // 20, width // 20) if width > 1000 else (height, width)
    image = LuminanceImage(
        rgb=np.ones((*shape, 3), np.float32),
        uncertainty=np.full(shape, 0.01, np.float32),
        validity=np.zeros(shape, np.uint8),
        geometry=Equirectangular(shape[1], shape[0]),
        scale_uncertainty=0.01,
    )
    assert len(not_a_panorama(image)) == result

"""A draft works in half or quarter size: means of blocks, masks that lose nothing; measure and room are standard's."""

from __future__ import annotations

import numpy as np
import pytest

from processing.pictures.images import LuminanceImage, Validity
from processing.pipeline import stage_named
from processing.running.requests import RunRequest, quality_of
from processing.sphere import Equirectangular
from processing.stages.contract import Quality
from processing.stages.upright import draft_width_px, in_size, mask_in_size


@pytest.mark.parametrize(("width_px", "draft_px"), [(6720, 1680), (3360, 1680), (1680, 1680), (840, 840), (6722, 6722)])
def test_a_draft_is_a_screen_wide(width_px: int, draft_px: int) -> None:
    assert draft_width_px(width_px) == draft_px


def test_blocks_keep_the_light_and_the_worst_of_their_pixels() -> None:
    rng = np.random.default_rng(3)
    rgb = rng.random((8, 16, 3), np.float32)
    validity = np.zeros((8, 16), np.uint8)
    validity[5, 9] = Validity.CLIPPED
    image = LuminanceImage(rgb, np.full((8, 16), 0.1, np.float32), validity, Equirectangular(16, 8), 0.02)
    small = in_size(image, 4)
    assert small.rgb == pytest.approx(rgb.reshape(2, 4, 4, 4, 3).mean(axis=(1, 3)), rel=1e-5)
    assert np.argwhere(small.validity).tolist() == [[1, 2]]
    assert small.geometry == Equirectangular(4, 2)
    assert in_size(image, 16) is image
    assert np.argwhere(mask_in_size(validity == Validity.CLIPPED, 4)).tolist() == [[1, 2]]


def test_what_a_draft_shares_with_standard_is_the_same_work() -> None:
    draft = RunRequest(quality=Quality.DRAFT)
    same = {
        name
        for name in ("merge", "calibrate", "room", "detect", "remove", "materials", "render")
        if quality_of(stage_named(name), draft) is Quality.STANDARD
    }
    assert same == {"merge", "room", "detect"}
    assert quality_of(stage_named("room"), RunRequest(quality=Quality.REFERENCE)) is Quality.REFERENCE

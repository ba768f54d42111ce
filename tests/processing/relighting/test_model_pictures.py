"""Pictures of furniture models show the model, whole, in even light."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from processing.layout.models.catalogue import Catalogue
from processing.relighting import model_pictures
from processing.relighting.model_pictures import FROM_THE_RIGHT_RAD, MARGIN, model_sheet, preview, two_sides
from tests.conftest import LONG

SIZE_PX = 96


@pytest.fixture(scope="module", autouse=True)
def few_rays() -> Iterator[None]:
    """Shapes and sides are looked for, not how smooth the light is."""
    with pytest.MonkeyPatch.context() as patch:
        if not LONG:
            patch.setattr(model_pictures, "EFFORT", replace(model_pictures.EFFORT, rows=96, pixel_samples=8))
        yield


@cache
def seen(model_id: str, azimuth_rad: float = FROM_THE_RIGHT_RAD) -> np.ndarray:
    """A model's picture as floats (H, W, 3), 0 to 1."""
    return np.asarray(preview(Catalogue.builtin().mesh(model_id), SIZE_PX, azimuth_rad), np.float64) / 255


@pytest.mark.parametrize("model_id", ["sofa/industrial", "books/scandinavian"])
def test_a_model_is_whole_in_the_middle_of_a_pale_studio(model_id: str) -> None:
    picture = seen(model_id)
    border = np.concatenate([picture[0], picture[-1], picture[:, 0], picture[:, -1]])
    assert border.min() > 0.6, "nothing of it reaches the border"
    assert np.ptp(border, axis=1).max() < 0.1, "the studio is white"
    rows, columns = np.nonzero(np.abs(picture - np.median(border, axis=0)).max(axis=2) > 0.3)
    wide = max(np.ptp(rows), np.ptp(columns)) / SIZE_PX
    assert MARGIN - 0.25 < wide < MARGIN + 0.03, wide


def test_the_window_is_on_the_left_whatever_the_camera_looks_at() -> None:
    for azimuth_rad in (FROM_THE_RIGHT_RAD, 2.0):
        ground = seen("plant/classic", azimuth_rad)[-6:].mean(axis=(0, 2))
        assert ground[: SIZE_PX // 4].mean() > ground[-SIZE_PX // 4 :].mean()


def test_both_sides_differ_and_a_sheet_holds_every_model() -> None:
    models = [Catalogue.builtin().mesh(one) for one in ("tv/classic", "bowl/classic")]
    front, back = np.split(np.asarray(two_sides(models[0], 64), int), 2, axis=1)
    assert np.abs(front - back).max() > 60
    assert model_sheet(models, 64).size == (128, 74)

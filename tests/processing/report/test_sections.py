"""Sections of the laboratory's page: what was done to the emptied picture is shown and named."""

from __future__ import annotations

import io
import math

import numpy as np
from PIL import Image

from processing.report.sections import MOST_SHOWN, remove_section
from tests.processing.report.made_up import SIZE_PX, picture


def test_lifted_shade_is_shown_red_where_brighter_and_its_size_is_stated() -> None:
    size = SIZE_PX[::-1]
    empty, filled, lift = picture((0.5, 0.7, 1.4), 2), np.zeros(size, bool), np.zeros(size, np.float32)
    half = SIZE_PX[0] // 2
    lift[:, :half], lift[:, half:] = math.log1p(MOST_SHOWN), math.log1p(-MOST_SHOWN)
    found = remove_section(empty, filled, {"lifted_median_pct": 12.5}, lift)
    [shown] = [one for one in found.pictures if one.title == "Shading removed"]
    colours = np.asarray(Image.open(io.BytesIO(shown.data)).convert("RGB")).astype(int)
    left, right = colours[:, 4 : half // 2].mean(axis=(0, 1)), colours[:, -half // 4 : -4].mean(axis=(0, 1))
    assert left[0] > left[2] + 100
    assert right[2] > right[0] + 100
    assert {one.name: one.value for one in found.quantities}["Median pixel brightened by"] == 12.5
    assert "without the furniture's shading" in found.text

    kept = remove_section(empty, filled, {}, None)
    assert [one.title for one in kept.pictures] == ["Filled areas"]
    assert "as captured." in kept.text

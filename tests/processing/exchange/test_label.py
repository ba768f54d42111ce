"""The visible label: where it is, that it can be read, that the rest is untouched."""

from __future__ import annotations

import numpy as np
import pytest

from processing.errors import ParameterError
from processing.exchange.jpeg_files import labelled


@pytest.mark.parametrize("level", [0, 128, 255])
def test_every_third_of_a_panorama_has_one(level: int) -> None:
    plain = np.full((512, 1024, 3), level, np.uint8)
    changed = (labelled(plain) != plain).any(axis=2)
    thirds = np.split(changed[:, : 3 * (1024 // 3)], 3, axis=1)
    assert all(third.any() for third in thirds)
    rows = np.flatnonzero(changed.any(axis=1))
    assert rows.min() > 256, "below the horizon"
    assert rows.max() < 400, "but not far"
    assert changed.mean() < 0.03, "the rest is as it was"


def test_letters_stand_out_and_grow_with_the_picture() -> None:
    heights = []
    for height in (512, 2048):
        out = labelled(np.full((height, 2 * height, 3), 200, np.uint8))
        assert out.min() < 80
        assert out.max() == 255
        white = (out.min(axis=2) > 250).any(axis=1)
        heights.append(white.sum())
    assert heights[1] > 3 * heights[0]
    assert heights[0] >= 0.02 * 512


def test_a_flat_picture_has_one_in_the_lower_left_corner() -> None:
    plain = np.full((300, 400, 3), 90, np.uint8)
    rows, columns = np.nonzero((labelled(plain, "Virtually staged, relative units") != plain).any(axis=2))
    assert rows.min() > 250
    assert columns.min() < 20


@pytest.mark.parametrize("shape", [(1, 2, 3), (2, 4, 3), (16, 32, 3), (40, 9, 3), (5, 400, 3)])
def test_tiny_pictures_keep_their_size(shape: tuple[int, ...]) -> None:
    plain = np.full(shape, 255, np.uint8)
    out = labelled(plain)
    assert out.shape == shape
    assert (out != plain).any()


@pytest.mark.parametrize("text", ["", "  ", "x" * 61, "a\nb"])
def test_texts_that_are_no_label_are_refused(text: str) -> None:
    with pytest.raises(ParameterError):
        labelled(np.zeros((64, 128, 3), np.uint8), text)

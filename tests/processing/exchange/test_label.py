"""The visible label: where it is, that it can be read, that the rest is untouched."""

from __future__ import annotations

import cv2
import numpy as np
import pytest

from processing.errors import ParameterError
from processing.exchange.jpeg_files import labelled
from processing.sphere import Perspective
from processing.sphere.views import cut_view


@pytest.mark.parametrize("level", [0, 128, 255])
def test_a_panorama_has_one_at_nadir_and_zenith_and_none_across_furniture(level: int) -> None:
    plain = np.full((512, 1024, 3), level, np.uint8)
    changed = (labelled(plain) != plain).any(axis=2)
    rows = np.flatnonzero(changed.any(axis=1))
    away = np.minimum(rows, 511 - rows) / 512 * 180
    assert away.max() < 28, "within 28 degrees of the poles"
    assert changed[:256].any()
    assert changed[256:].any()
    area = (
        changed * np.cos(np.radians(90 - np.minimum(np.arange(512), 511 - np.arange(512)) / 512 * 180))[:, None]
    ).mean()
    assert area < 0.02


def test_who_looks_down_or_up_reads_it_upright() -> None:
    """A view of the nadir shows the plate as it is, darker ink on no side: not mirrored, not upside down."""
    plain = np.full((1024, 2048, 3), 110, np.uint8)
    flat = labelled(np.full((1600, 1600, 3), 110, np.uint8), panorama=False)
    rows, columns = np.nonzero((flat != 110).any(axis=2))
    plate = flat[rows.min() : rows.max(), columns.min() : columns.max()].astype(float).mean(axis=2)
    for pitch in (-89.9, 89.9):
        view = cut_view(labelled(plain), Perspective(600, 600, np.radians(50), pitch_rad=np.radians(pitch)))
        r, c = np.nonzero((np.abs(view.astype(int) - 110) > 6).any(axis=2))
        seen = view[r.min() : r.max(), c.min() : c.max()].astype(float).mean(axis=2)
        seen = cv2.resize(seen, plate.shape[::-1], interpolation=cv2.INTER_AREA)
        alike = [np.corrcoef(seen.ravel(), turned.ravel())[0, 1] for turned in (plate, plate[:, ::-1], plate[::-1])]
        assert alike[0] > 0.5, alike
        assert alike[0] > max(alike[1:]) + 0.15, alike


def test_letters_stand_out_and_grow_with_the_picture() -> None:
    heights = []
    for height in (600, 2400):
        out = labelled(np.full((height, height, 3), 200, np.uint8), panorama=False)
        assert out.min() < 110
        assert out.max() > 230
        heights.append((out.max(axis=2) > 230).any(axis=1).sum())
    assert heights[1] > 3 * heights[0]


def test_a_link_is_a_code_that_a_reader_reads() -> None:
    link = "https://example.org/rooms/7/original"
    out = labelled(np.full((1280, 1920, 3), 120, np.uint8), link=link)
    corner = out[-400:, :500]
    assert cv2.QRCodeDetector().detectAndDecode(np.ascontiguousarray(corner))[0] == link


def test_a_panoramas_code_is_read_by_who_looks_down() -> None:
    link = "https://example.org/rooms/7/original"
    out = labelled(np.full((1680, 3360, 3), 120, np.uint8), link=link)
    view = cut_view(out, Perspective(1000, 1000, np.radians(50), pitch_rad=np.radians(-89.9)))
    assert cv2.QRCodeDetector().detectAndDecode(np.ascontiguousarray(view))[0] == link


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

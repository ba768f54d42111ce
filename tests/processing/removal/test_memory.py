"""Memory of the emptied room by the picture's pixels: what does not grow with the picture is left out."""

from __future__ import annotations

import tracemalloc
import weakref
from typing import Any

import numpy as np
import pytest

from processing.pictures.images import LuminanceImage
from processing.removal import lift
from processing.removal.fill import Emptied, Quick, empty_room
from processing.removal.lift import Shade, lifted
from processing.sphere import Equirectangular
from tests.processing.removal.painted_room import box_room

MOST = 38.0  # bytes a pixel beside the picture and its masks (measured: 33; 43 before places of a median were let go)


def grey_room(rows: int) -> tuple[LuminanceImage, np.ndarray, Shade]:
    """Return a grey room's picture, what is to be removed, and what that takes from its light."""
    shape = (rows, 2 * rows)
    rgb, doubt = np.full((*shape, 3), 50, np.float32), np.full(shape, 0.02, np.float32)
    image = LuminanceImage(rgb, doubt, np.zeros(shape, np.uint8), Equirectangular(2 * rows, rows), 0.01)
    target = np.zeros(shape, bool)
    target[rows * 5 // 8 : rows * 3 // 4, rows // 2 : rows] = True
    small = (32, 64)
    shade = Shade(np.full((*small, 3), 0.1, np.float32), np.full((*small, 3), 100, np.float32), np.ones(small, bool))
    return image, target, shade


def peak_bytes(rows: int) -> int:
    """Return the peak of what is allocated while a grey room of so many rows is emptied, its textures small."""
    image, target, shade = grey_room(rows)
    tracemalloc.start()
    try:
        lifted(image, target, box_room(), shade, quality=Quick())
        return tracemalloc.get_traced_memory()[1]
    finally:
        tracemalloc.stop()


def test_an_emptied_room_takes_little_memory_a_pixel() -> None:
    small, large = 256, 512
    peak_bytes(16)  # what is loaded on first use
    more = peak_bytes(large) - peak_bytes(small)
    assert 10.0 < more / (2 * (large**2 - small**2)) < MOST


def test_the_photograph_is_let_go_while_planes_are_filled(monkeypatch: pytest.MonkeyPatch) -> None:
    image, target, shade = grey_room(64)
    before, given = weakref.ref(image.rgb), [image]
    del image
    held = []

    def looked(*args: Any, **more: Any) -> Emptied:
        held.append(before() is not None)
        return empty_room(*args, **more)

    monkeypatch.setattr(lift, "empty_room", looked)
    found, _ = lifted(given.pop(), target, box_room(), shade, quality=Quick())
    assert held == [False]
    assert (found.image.rgb > 0).all()

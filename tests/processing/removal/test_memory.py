"""Memory of the emptied room by the picture's pixels: what does not grow with it is left out; and its threads."""

from __future__ import annotations

import threading
import tracemalloc
import weakref
from typing import Any

import numpy as np
import pytest

from processing.ground.threads import ASKED, threads
from processing.pictures.images import LuminanceImage
from processing.removal import fill, lift
from processing.removal.fill import Emptied, Others, Quick, empty_room
from processing.removal.lift import Shade, lifted
from processing.sphere import Equirectangular
from processing.surfaces.maps import FLOOR, plane_map
from tests.processing.removal.painted_room import box_room

# Bytes a pixel beside picture and masks on one thread (measured: 27.3). By two threads, whose peaks may meet or not,
# some ten more.
MOST = 29.0


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


def test_an_emptied_room_takes_little_memory_a_pixel(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv(ASKED, "1")
    small, large = 192, 384
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


def test_planes_are_filled_side_by_side_with_most_hidden_first(monkeypatch: pytest.MonkeyPatch) -> None:
    """The floor, too, though it alone takes nothing from what is foreign; by however many threads, it is the same."""
    image, target, _ = grey_room(64)
    foreign = np.zeros(target.shape, bool)
    foreign[50:, 100:] = True
    began, order, plane_of = threading.Barrier(2, timeout=30), list[int](), fill._plane

    def noted(seen: Any, plane: Any, *more: Any) -> Any:
        order.append(plane.index)
        if threads() > 1 and len(order) <= 2:
            began.wait()
        return plane_of(seen, plane, *more)

    monkeypatch.setattr(fill, "_plane", noted)
    made = []
    for count in ("1", "2"):
        order.clear()
        monkeypatch.setenv(ASKED, count)
        made.append(empty_room(image, target, box_room(), others=Others(foreign), quality=Quick()))
        shown = plane_map(box_room(), image.geometry)
        hidden = {index: np.count_nonzero(target & (shown == index)) for index in order}
        assert FLOOR in hidden
        assert len(hidden) > 1
        if count == "1":
            assert order == sorted(order, key=lambda index: -hidden[index])
    np.testing.assert_array_equal(made[0].image.rgb, made[1].image.rgb)
    assert made[0].notes == made[1].notes

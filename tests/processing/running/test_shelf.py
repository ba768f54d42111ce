"""Pictures between stages: as many as there is room for stay in memory, the others are read again."""

from __future__ import annotations

import numpy as np
import pytest

from processing.pictures.images import LuminanceImage
from processing.pipeline import STAGES
from processing.running import artifacts
from processing.running.artifacts import Shelf
from tests.processing.pictures.picture_strategies import luminance_image


def picture(level: float, width: int = 64) -> LuminanceImage:
    return luminance_image(np.full((width // 2, width, 3), level, np.float32))


def test_what_is_unused_longest_is_let_go_and_read_again(monkeypatch: pytest.MonkeyPatch) -> None:
    one = artifacts._bytes(picture(1.0))
    monkeypatch.setattr(artifacts, "HELD_BYTES", 2 * one)
    read: list[str] = []

    def from_disk(stage: str, name: str) -> LuminanceImage:
        read.append(f"{stage}/{name}")
        return picture(9.0)

    shelf = Shelf(from_disk)
    assert shelf.get("room", "panorama") is not None, "nothing is held that says how large a picture is"
    shelf.let_go()
    read.clear()
    shelf.put("merge", "indoor", picture(1.0))
    shelf.put("merge", "response", {"a": 1})
    shelf.put("calibrate", "indoor", picture(2.0))
    assert shelf.get("merge", "indoor") is not None
    shelf.put("remove", "empty", picture(3.0))
    assert shelf.held == ("merge/indoor", "merge/response", "remove/empty")
    found = shelf.get("calibrate", "indoor")
    assert isinstance(found, LuminanceImage)
    assert found.rgb[0, 0, 0] == 9.0
    assert read == ["calibrate/indoor"]
    assert shelf.held == ("calibrate/indoor", "merge/response", "remove/empty")
    shelf.drop_unneeded(tuple(stage for stage in STAGES if stage.name == "report"))
    assert "merge/response" in shelf.held
    shelf.let_go()
    assert not shelf.held
    assert shelf.get("remove", "empty") is not None
    assert read[-1] == "remove/empty"


def test_room_is_made_before_a_picture_is_read(monkeypatch: pytest.MonkeyPatch) -> None:
    one, held = artifacts._bytes(picture(1.0)), list[int]()
    monkeypatch.setattr(artifacts, "HELD_BYTES", 2 * one)

    def from_disk(_stage: str, _name: str) -> LuminanceImage:
        held.append(len(shelf.held))
        return picture(9.0)

    shelf = Shelf(from_disk)
    for name in ("staged-1", "staged-2", "staged-3", "staged-4"):
        shelf.get("render", name)
    assert held == [0, 1, 1, 1], "beside the one that is read"
    assert len(shelf.held) == 2


def test_what_is_no_picture_takes_no_picture_s_place(monkeypatch: pytest.MonkeyPatch) -> None:
    """Each stage asks for a levelled panorama, which is mostly left out: the photograph was read again for it."""
    one = artifacts._bytes(picture(1.0))
    monkeypatch.setattr(artifacts, "HELD_BYTES", 2 * one)
    shelf = Shelf(lambda _stage, _name: None, lambda _stage, name: name == "indoor")
    shelf.put("calibrate", "indoor", picture(1.0))
    shelf.put("calibrate", "outdoor", picture(2.0))
    assert shelf.get("room", "panorama") is None
    assert shelf.held == ("calibrate/indoor", "calibrate/outdoor")


def test_what_was_read_belongs_to_who_has_it_when_it_is_let_go() -> None:
    shelf = Shelf(lambda _stage, _name: picture(9.0))
    shelf.put("remove", "empty", picture(1.0))
    made, read, other = (shelf.get(*of) for of in (("remove", "empty"), ("remove", "read"), ("room", "panorama")))
    shelf.let_go("remove")
    assert shelf.held == ("room/panorama",)
    writeable = [one.rgb.flags.writeable for one in (made, read, other) if isinstance(one, LuminanceImage)]
    assert writeable == [False, True, False], "what was made may still be being written"


def test_a_picture_larger_than_all_room_is_still_handed_on(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(artifacts, "HELD_BYTES", 1)
    shelf = Shelf(lambda _stage, _name: None)
    shelf.put("merge", "indoor", picture(1.0))
    assert shelf.get("merge", "indoor") is not None

"""The truth on disk: what was written is read back, and damage is reported."""

from __future__ import annotations

import json
from dataclasses import fields
from pathlib import Path

import numpy as np
import pytest

from benchmarks.truth_files import load_truth
from mocks.rooms.room import make_room
from mocks.rooms.truth import (
    LIGHT,
    MASKS,
    NUMBERS,
    TRUTH_NAME,
    PointLight,
    TruthFileError,
    TruthPictures,
    save_truth,
)
from mocks.worlds.hdr_world import read_equirect

ROWS = 8
ROOM = make_room(3, "empty")
LIGHTS = [PointLight("camera, vertical, ahead", (0.0, 0.0, 1.6), (0.0, 1.0, 0.0), 123.456)]


def pictures() -> TruthPictures:
    rng = np.random.default_rng(5)
    shape = (ROWS, 2 * ROWS)

    def light(*more: int) -> np.ndarray:
        return rng.uniform(0, 1e4, (*shape, *more)).astype(np.float32)

    def numbers(low: int, high: int) -> np.ndarray:
        return rng.integers(low, high, shape, dtype=np.int16)

    depth_m = light()
    depth_m[0, 3] = np.inf
    return TruthPictures(
        luminance_rgb=light(3),
        empty_rgb=light(3),
        albedo=light(3),
        empty_albedo=light(3),
        depth_m=depth_m,
        normal=rng.normal(size=(*shape, 3)).astype(np.float32),
        ade=numbers(-1, 150),
        instance=numbers(0, 3000),
        wall=numbers(-1, 8),
        surface=numbers(-1, 3),
        surface_names=("floor", "wall", "sofa"),
        furniture=rng.random(shape) < 0.5,
        tripod=rng.random(shape) < 0.1,
        sunlit=light(),
        empty_sunlit=light(),
    )


@pytest.fixture
def saved(tmp_path: Path) -> Path:
    save_truth(tmp_path / "truth" / "one", ROOM, pictures(), LIGHTS)
    return tmp_path / "truth" / "one"


def test_every_picture_comes_back_bit_by_bit(saved: Path) -> None:
    truth, before = load_truth(saved), pictures()
    for name in (f.name for f in fields(TruthPictures)):
        ours, theirs = getattr(before, name), getattr(truth.pictures, name)
        assert type(ours) is type(theirs)
        assert np.array_equal(ours, theirs), name
        assert getattr(ours, "dtype", None) == getattr(theirs, "dtype", None), name
    assert truth.lights == tuple(LIGHTS)


def test_the_room_is_described_in_plain_json(saved: Path) -> None:
    facts = json.loads((saved / TRUTH_NAME).read_text("utf-8"))
    assert facts["name"] == "empty-3"
    assert facts["seed"] == 3
    assert facts["plan"]["height_m"] == ROOM.plan.height_m
    assert facts["moment"]["utc"] == ROOM.moment.utc.isoformat()
    assert set(facts["pictures"].values()) == {p.name for p in saved.iterdir()} - {TRUTH_NAME}
    assert set(facts["pictures"]) == {f.name for f in fields(TruthPictures)} - {"surface_names"}


def test_the_luminance_can_be_a_world_again(saved: Path) -> None:
    assert np.array_equal(read_equirect(saved / LIGHT["luminance_rgb"]), pictures().luminance_rgb)


def test_classes_are_stored_as_ade20k_has_them(saved: Path) -> None:
    import cv2

    stored = cv2.imread(str(saved / NUMBERS["ade"]), cv2.IMREAD_UNCHANGED)
    assert stored.dtype == np.uint16
    assert np.array_equal(stored, pictures().ade + 1)


@pytest.mark.parametrize("file", [TRUTH_NAME, LIGHT["depth_m"], NUMBERS["ade"], MASKS["tripod"]])
def test_damage_and_loss_are_reported(saved: Path, file: str) -> None:
    data = (saved / file).read_bytes()
    for kept in (len(data) // 3, 0):
        (saved / file).write_bytes(data[:kept])
        with pytest.raises(TruthFileError, match="cannot be read"):
            load_truth(saved)
    (saved / file).unlink()
    with pytest.raises(TruthFileError):
        load_truth(saved)


def test_facts_that_are_no_object_are_reported(saved: Path) -> None:
    (saved / TRUTH_NAME).write_text("3")
    with pytest.raises(TruthFileError, match="cannot be read"):
        load_truth(saved)


def test_nothing_is_written_over(saved: Path) -> None:
    with pytest.raises(TruthFileError, match="cannot be written"):
        save_truth(saved, ROOM, pictures(), LIGHTS)

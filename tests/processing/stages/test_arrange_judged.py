"""An arrangement that the user gives is held against the room that it is to stand in."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import pytest

from processing.errors import LayoutError
from processing.layout.arrange import arrange
from processing.layout.arrangement import Arrangements
from processing.layout.items import parse_items
from processing.layout.plan import from_room_model
from processing.stages.arrange import judged
from processing.stages.parameters import StageParameters
from tests.processing.stages.test_staging import ROOM, context


@pytest.fixture(scope="module")
def fitting() -> dict[str, Any]:
    plan = from_room_model(ROOM, keep_camera_free=True)
    found = arrange(plan, parse_items("bed, nightstand, wardrobe"), "standard", n=1, seed=0)
    return json.loads(found.model_dump_json())


def moved(value: dict[str, Any], **places: tuple[float, float]) -> dict[str, Any]:
    out = json.loads(json.dumps(value))
    for item in out["arrangements"][0]["items"]:
        if item["category"] in places:
            item["t_m"][:2] = places[item["category"]]
    return out


def in_room(folder: Path, value: object, room: object = ROOM) -> tuple[Any, ...]:
    artifacts = {} if room is None else {("room", "room"): ROOM}
    return judged(Arrangements.model_validate_json(json.dumps(value)), context(folder, StageParameters(), artifacts))


def test_what_fits_is_taken_without_a_word(tmp_path: Path, fitting) -> None:
    assert in_room(tmp_path, fitting) == ()
    assert in_room(tmp_path, fitting, room=None) == ()


def test_a_broken_rule_is_named_with_its_pieces(tmp_path: Path, fitting) -> None:
    bed = next(i for i in fitting["arrangements"][0]["items"] if i["category"] == "bed")
    (warning,) = in_room(tmp_path, moved(fitting, wardrobe=tuple(bed["t_m"][:2])))
    assert warning.code == "arrangement"
    assert "alternative 1" in warning.message
    assert "no overlap: bed" in warning.message
    # Before the door, whose leaf opens there.
    (warning,) = in_room(tmp_path, moved(fitting, wardrobe=(1.8, 1.6)))
    assert "door free: wardrobe" in warning.message


def test_an_arrangement_of_another_room_is_refused(tmp_path: Path, fitting) -> None:
    with pytest.raises(LayoutError, match="wardrobe would be outside"):
        in_room(tmp_path, moved(fitting, wardrobe=(7.0, 0.0)))
    strange = json.loads(json.dumps(fitting).replace('"category": "wardrobe"', '"category": "piano"'))
    with pytest.raises(LayoutError, match="piano"):
        in_room(tmp_path, strange)

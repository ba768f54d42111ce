"""A room by hand: what can stand, what is wrong with the rest, and the file that people edit."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import daylit
from processing.errors import RoomError
from processing.ground.room_model import (
    Opening,
    OpeningKind,
    RoomModel,
    check_room,
    geometry_problems,
    read_room,
    room_problems,
    room_text,
    starter_room,
    write_room,
)
from tests.station.session.sessions import complete_session

L_SHAPE = ((-2.0, -1.0), (3.0, -1.0), (3.0, 1.0), (1.0, 1.0), (1.0, 4.0), (-2.0, 4.0))


def l_room(**fields: Any) -> RoomModel:
    window = {"kind": "window", "wall": 4, "start_m": 0.5, "end_m": 2.5, "sill_m": 0.9, "head_m": 2.0}
    given_ = {
        "source": "given",
        "floor": L_SHAPE,
        "camera_height_m": 1.6,
        "ceiling_height_m": 2.5,
        "openings": [window],
        **fields,
    }
    return RoomModel.model_validate_json(json.dumps(given_))


def opening(**fields: Any) -> dict[str, Any]:
    return {"kind": "door", "wall": 0, "start_m": 1.0, "end_m": 2.0, "sill_m": 0.0, "head_m": 2.0, **fields}


def test_a_room_that_can_stand() -> None:
    room = l_room()
    assert geometry_problems(room) == []
    assert [room.wall_length_m(i) for i in range(6)] == [5, 2, 2, 3, 3, 5]


@pytest.mark.parametrize(
    ("fields", "words"),
    [
        ({"floor": L_SHAPE[::-1], "openings": []}, "clockwise"),
        ({"floor": [(-1, -1), (1, 1), (1, -1), (-1, 1)], "openings": []}, "floor: walls cross"),
        ({"floor": [(1, 1), (3, 1), (3, 3), (1, 3)], "openings": []}, r"the camera \(0, 0\) stands outside"),
        ({"floor": [(-0.01, -2), (3, -2), (3, 3), (-0.01, 3)], "openings": []}, "less than 0.05 m"),
        ({"floor": [(-0.1, -0.1), (0.1, -0.1), (0.1, 0.1), (-0.1, 0.1)], "openings": []}, "at least 1 m2"),
        ({"floor": [*L_SHAPE, (-2.0, 3.999)]}, "floor.5: wall 5 is 0.001 m long"),
        ({"ceiling_height_m": 1.6, "openings": []}, "ceiling_height_m: 1.6 m is not above the camera"),
        ({"openings": [opening(wall=6)]}, "openings.0.wall: there is no wall 6; walls are 0 to 5"),
        ({"openings": [opening(end_m=5.1)]}, r"openings.0.end_m: 5.1 m is beyond the end of wall 0 \(5.000 m\)"),
        ({"openings": [opening(), opening(start_m=2.0, end_m=2.0)]}, "openings.1.start_m"),
        ({"openings": [opening(sill_m=2.0)]}, "openings.0.sill_m"),
        ({"openings": [opening(head_m=2.6)]}, "openings.0.head_m: 2.6 m is above the ceiling"),
        ({"openings": [opening(), opening(start_m=1.9, end_m=2.5)]}, "openings.1: overlaps openings.0 on wall 0"),
    ],
)
def test_what_cannot_stand_is_reported_with_its_key(fields: dict[str, Any], words: str) -> None:
    room = l_room(**fields)
    with pytest.raises(RoomError, match=words):
        check_room(room.model_dump(mode="json"))


@pytest.mark.parametrize(("key", "value"), [("wall", True), ("wall", "0"), ("start_m", "0.5"), ("end_m", True)])
def test_numbers_are_numbers(tmp_path: Path, key: str, value: object) -> None:
    """`"wall": true` was wall 1."""
    data = l_room(openings=[opening()]).model_dump(mode="json")
    data["openings"][0][key] = value
    (tmp_path / "room.json").write_text(json.dumps(data))
    with pytest.raises(RoomError, match=rf"room\.json: openings\.0\.{key}: Input should be a valid"):
        read_room(tmp_path / "room.json")


def test_openings_side_by_side_and_above_each_other_are_fine() -> None:
    door, beside = opening(head_m=2.0), opening(start_m=2.0, end_m=3.0)
    above = opening(kind="window", sill_m=2.0, head_m=2.4)
    assert geometry_problems(l_room(openings=[door, beside, above])) == []


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"floor": [[0, 0], [1, 0]]}, "floor: "),
        ({"ceiling_height_m": "high"}, "ceiling_height_m: "),
        ({"camera_height_m": -1}, "camera_height_m: "),
        ({"colour": "white"}, "colour: Extra inputs"),
        ({"openings": [opening(kind="hole")]}, "openings.0.kind: "),
        ({"floor": [[0, 0], [1, 0], [1e9, 1]]}, "floor.2.0: "),
        ({"source": "starter"}, "not corrected yet"),
    ],
)
def test_wrong_keys_are_named(change: dict[str, Any], words: str) -> None:
    data = {**l_room().model_dump(mode="json"), **change}
    _, problems = room_problems(data)
    assert any(words in problem for problem in problems), problems


@pytest.mark.parametrize("text", ["", "[]", "{", '{"floor": [1, NaN]}', '{"a": 1, "a": 2}', "\x00"])
def test_what_is_no_room_is_refused(tmp_path: Path, text: str) -> None:
    (tmp_path / "room.json").write_text(text)
    with pytest.raises(RoomError):
        read_room(tmp_path / "room.json")


def test_a_corner_and_an_opening_a_line(tmp_path: Path) -> None:
    room = l_room()
    lines = room_text(room).splitlines()
    assert "    [-2.0, -1.0]," in lines
    assert sum('"kind": "window"' in line for line in lines) == 1
    write_room(tmp_path / "room.json", room)
    assert read_room(tmp_path / "room.json") == room
    write_room(tmp_path / "room.json", l_room(openings=[]))
    assert read_room(tmp_path / "room.json").openings == ()
    assert [p.name for p in tmp_path.iterdir()] == ["room.json"]


lengths = st.floats(0.3, 30, allow_nan=False)


@given(left=lengths, right=lengths, back=lengths, front=lengths, height=st.floats(0.5, 5), data=st.data())
@settings(max_examples=60, deadline=None)
def test_any_rectangle_around_the_camera_comes_back_as_it_was(
    left: float, right: float, back: float, front: float, height: float, data: st.DataObject
) -> None:
    wall = data.draw(st.integers(0, 3))
    length = (left + right) if wall % 2 == 0 else (back + front)
    start = data.draw(st.floats(0, 0.6)) * length
    room = RoomModel(
        source="given",
        floor=((-left, -back), (right, -back), (right, front), (-left, front)),
        camera_height_m=height,
        ceiling_height_m=height + 1,
        openings=(Opening(kind=OpeningKind.WINDOW, wall=wall, start_m=start, end_m=length, sill_m=0.2, head_m=height),),
    )
    small = (left + right) * (back + front) < 1.0
    assert (geometry_problems(room) == []) != small
    assert RoomModel.model_validate_json(room_text(room)) == room


@pytest.mark.parametrize("camera_height_m", [0.3, 1.6, 2.6, 15.0])
def test_the_starter_can_stand_but_is_no_answer(camera_height_m: float) -> None:
    room = starter_room(camera_height_m)
    assert geometry_problems(room) == []
    with pytest.raises(RoomError, match="not corrected yet"):
        check_room(room.model_dump(mode="json"))


def test_the_command_makes_checks_and_never_overwrites(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    session = complete_session(tmp_path)
    path = session / "room.json"
    assert daylit.main(["room", str(session), "--around"]) == 2
    assert "--edit" in capsys.readouterr().err
    assert daylit.main(["room", str(session), "--edit", "--json"]) == 1
    result = json.loads(capsys.readouterr().out)
    assert result["file"] == str(path)
    assert "not corrected yet" in result["problems"][0]
    mine = l_room()
    path.write_text(room_text(mine))
    assert daylit.main(["room", str(session), "--edit"]) == 0
    assert daylit.open_session(session).choices == {"room": session / "room.json"}
    assert "6 walls, 19.00 m2, openings: 1; valid" in capsys.readouterr().out
    assert read_room(path) == mine
    other = tmp_path / "other.json"
    write_room(other, l_room(openings=[]))
    assert daylit.main(["room", str(session), "--edit", "--from", str(other)]) == 2
    path.unlink()
    assert daylit.main(["room", str(session), "--edit", "--from", str(other)]) == 0
    assert read_room(path).openings == ()
    capsys.readouterr()
    other.write_text(room_text(l_room(ceiling_height_m=1.0)))
    assert daylit.main(["room", str(session), "--check", str(other)]) == 1
    assert "ceiling_height_m: 1 m is not above the camera" in capsys.readouterr().out
    for wrong in ([], ["--edit", "--check", str(other)], ["--check", str(other), "--from", str(other)]):
        assert daylit.main(["room", str(session), *wrong]) == 2
    assert daylit.main(["room", str(tmp_path / "none"), "--edit"]) == 4


def test_every_wrong_key_is_named() -> None:
    """What the model finds, not the first of it only."""
    room, problems = room_problems(
        {"floor": "here", "camera_height_m": -1.0, "ceiling_height_m": 2.5, "source": "given"}
    )
    assert room is None
    assert {problem.partition(":")[0] for problem in problems} >= {"floor", "camera_height_m"}

"""A room estimated again around what somebody has placed."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from processing.errors import NoRoomError
from processing.ground.room_model import Opening, OpeningKind, RoomModel, room_problems, room_text
from processing.room.estimate import estimate_room
from processing.room.held import Held
from processing.segmentation.evidence import SceneEvidence
from station.session import strict_json
from tests.processing.room.evidence import ELL, boundary_of, classes_of, painted, room_of
from tests.processing.room.test_estimate import iou

TRUTH = room_of(ELL)
FARTHER = room_of(tuple((4.4 if x == 3.2 else x, y) for x, y in ELL))
"""What a mirror on the wall at x = 3.2 shows."""
PICTURE = painted(TRUTH, 128)


def estimated(seen: RoomModel, held: Held | None = None, *, up_deg: float = 0.0) -> RoomModel:
    boundary = boundary_of(seen, noise_deg=0.4)
    boundary = replace(boundary, ceiling_rad=boundary.ceiling_rad + np.radians(up_deg))
    evidence = SceneEvidence(classes_of(seen), "", boundary)
    return estimate_room(PICTURE, evidence, manhattan_rad=0.0, quality="draft", held=held).room


def with_wall_at(room: RoomModel, x: float) -> RoomModel:
    far = max(corner[0] for corner in room.floor)
    floor = tuple((x if corner[0] > far - 0.2 else corner[0], corner[1]) for corner in room.floor)
    return room.model_copy(update={"floor": floor, "source": "given"})


def test_a_wall_that_is_placed_stays_and_the_rest_comes_right() -> None:
    """Its ends do not: the walls beside it go on where they were, and one that was seen through it goes."""
    wrong = estimated(FARTHER)
    assert iou(wrong.floor, ELL) < 0.9
    held = Held.of(with_wall_at(wrong, 3.2), wrong)
    assert (len(held.walls), held.corners, held.ceiling) == (1, (), False)
    found = estimated(FARTHER, held)
    assert iou(found.floor, ELL) > 0.97
    assert sum(x == 3.2 for x, _ in found.floor) == 2
    assert len(found.held) == 1
    again = Held.of(found.model_copy(update={"source": "given"}), wrong)
    assert iou(estimated(FARTHER, again).floor, found.floor) > 0.999, "what was estimated around it is not held"


def test_a_corner_that_is_placed_stays_and_its_walls_keep_their_directions() -> None:
    wrong = estimated(FARTHER)
    far = max(range(len(wrong.floor)), key=lambda k: wrong.floor[k][0] - wrong.floor[k][1])
    floor = tuple((3.2, -1.4) if k == far else place for k, place in enumerate(wrong.floor))
    held = Held.of(wrong.model_copy(update={"floor": floor}), wrong)
    assert (held.walls, held.corners) == ((), (far,))
    found = held.exact(
        TRUTH.model_copy(update={"floor": tuple((x + 0.1 * (x > 3), y + 0.1 * (y < 0)) for x, y in ELL)})
    )
    assert (3.2, -1.4) in found.floor
    assert iou(found.floor, ELL) > 0.999
    assert found.held == ("corner 1",)


def test_the_ceilings_height_is_held() -> None:
    wrong = estimated(TRUTH, up_deg=3)
    assert wrong.ceiling_height_m > 2.6
    held = Held.of(wrong.model_copy(update={"ceiling_height_m": 2.55}), wrong)
    assert (held.walls, held.corners, held.ceiling) == ((), (), True)
    found = estimated(TRUTH, held, up_deg=3)
    assert found.ceiling_height_m == 2.55
    assert found.held == ("ceiling",)
    assert iou(found.floor, ELL) > 0.93


def test_openings_that_were_placed_stay_and_those_taken_away_do_not_come_back() -> None:
    def door(wall: int, start: float, confidence: float) -> Opening:
        end = start + 0.8
        return Opening(
            kind=OpeningKind.DOOR, wall=wall, start_m=start, end_m=end, sill_m=0, head_m=2, confidence=confidence
        )

    before = TRUTH.model_copy(update={"openings": (door(0, 0.5, 0.6), door(3, 0.6, 0.7))})
    given = TRUTH.model_copy(update={"openings": (door(0, 2.5, 1.0), door(3, 0.6, 0.7))})
    found = (door(0, 0.45, 0.5), door(3, 0.55, 0.5), door(0, 2.6, 0.5))
    assert Held.of(given, before).openings(TRUTH, found) == (door(0, 2.5, 1.0), door(3, 0.55, 0.5))
    further = room_of(((-2.0, -1.4), *ELL[1:5], (-2.0, 3.4)))
    moved = Held.of(given, before).openings(further, ())[0]
    assert (moved.start_m, moved.end_m) == pytest.approx((3.0, 3.8)), "at its place, not at its distance"


def test_a_window_round_the_corner_from_one_that_was_placed_is_no_second_one_of_it() -> None:
    def window(wall: int, start: float, confidence: float) -> Opening:
        sizes = {"start_m": start, "end_m": start + 1.8, "sill_m": 0.9, "head_m": 2.1}
        return Opening(kind=OpeningKind.WINDOW, wall=wall, confidence=confidence, **sizes)

    given = TRUTH.model_copy(update={"openings": (window(0, 2.7, 1.0),)})
    found = (window(0, 2.6, 0.5), window(1, 0.2, 0.5))
    assert Held.of(given, TRUTH).openings(TRUTH, found) == (window(0, 2.7, 1.0), window(1, 0.2, 0.5))


def test_an_opening_stays_on_its_own_of_two_walls_on_one_line() -> None:
    """Two arms of a room, whose ends lie on one line: a window in the second is not lost in the first."""
    arms = ((-3.0, -2.0), (3.0, -2.0), (3.0, 2.0), (1.0, 2.0), (1.0, 1.0), (-1.0, 1.0), (-1.0, 2.0), (-3.0, 2.0))
    window = Opening(kind=OpeningKind.WINDOW, wall=6, start_m=0.4, end_m=1.6, sill_m=0.9, head_m=2.1)
    room = room_of(arms).model_copy(update={"openings": (window,)})
    assert Held.of(room, room_of(arms)).openings(room, ()) == (window,)
    assert Held(room, walls=(6,)).exact(room_of(arms)).held == ("wall 6",)


def test_where_no_room_fits_around_a_wall_that_is_said() -> None:
    with pytest.raises(NoRoomError, match="around wall"):
        Held(with_wall_at(TRUTH, 2.0), walls=(1,)).exact(TRUTH)


def test_what_is_held_is_in_the_rooms_file_and_only_there() -> None:
    assert "held" not in room_text(TRUTH)
    text = room_text(TRUTH.model_copy(update={"held": ("wall 1", "ceiling")}))
    found, problems = room_problems(strict_json.loads(text.encode()))
    assert (found and found.held, problems) == (("wall 1", "ceiling"), [])
    _, problems = room_problems({**strict_json.loads(text.encode()), "held": ["roof"]})
    assert problems

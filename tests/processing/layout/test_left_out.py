"""What a search left out gets a place where the judge passes one, and none where it does not."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import pytest
from shapely.geometry import box

from processing.layout.arrange import arrange
from processing.layout.items import parse_items
from processing.layout.plan import Door, make_plan
from processing.layout.rules import built_in_rules
from processing.layout.solver.field import Floor, make_field
from processing.layout.solver.left_out import with_last_places
from processing.layout.solver.poses import Stand, pieces
from processing.layout.verify import Judge

ROOM = make_plan([[0, 0], [4.0, 0], [4.0, 3.5], [0, 3.5]], doors=[Door(0, 0.2, 1.0)])
RULES = built_in_rules().named("tight")


def left_out(names: str, placed: Sequence[Stand] = (), *, least_door_m: float | None = None) -> list[Stand]:
    judge, bare = Judge(ROOM, RULES), make_field(Floor(ROOM), RULES)

    def passes(stands: Sequence[Stand]) -> bool:
        bodies = [box(*np.min(s.corners(), axis=0), *np.max(s.corners(), axis=0)) for s in stands]
        far = least_door_m is None or all(b.distance(box(0.2, 0, 1.0, 0)) > least_door_m for b in bodies)
        return far and judge.passes(pieces(stands))

    return with_last_places(placed, parse_items(names), bare, passes)


def test_what_fits_is_placed_what_is_worth_most_first_and_groups_as_groups() -> None:
    stood = left_out("wardrobe, tv stand, tv, desk, desk chair")
    assert {s.item.id for s in stood} == {"wardrobe", "tv-stand", "tv", "desk", "desk-chair"}
    assert next(s.item.id for s in stood) == "desk"
    assert Judge(ROOM, RULES).judge(pieces(stood)) == ()
    assert next(s for s in stood if s.item.id == "tv").group == "tv-stand"


def test_every_place_is_shown_to_the_judge_not_the_best_alone() -> None:
    near = left_out("wardrobe")
    far = left_out("wardrobe", least_door_m=2.2)
    assert len(near) == len(far) == 1
    assert (near[0].x_m, near[0].y_m) != (far[0].x_m, far[0].y_m)


@pytest.mark.parametrize("names", ["nightstand", "desk chair", "wardrobe"])
def test_nothing_is_placed_without_its_host_or_against_the_judge(names: str) -> None:
    assert left_out(names, least_door_m=50.0) == []
    if names != "wardrobe":
        assert left_out(names) == []


def test_pieces_that_stand_are_kept_and_nothing_overlaps() -> None:
    first = left_out("bed")
    both = left_out("chest, bookshelf", first)
    assert both[0] == first[0]
    assert len(both) == 3
    assert Judge(ROOM, RULES).judge(pieces(both)) == ()


def test_arrangements_with_something_left_out_name_all_and_break_nothing() -> None:
    room = make_plan([[0, 0], [3.2, 0], [3.2, 2.6], [0, 2.6]], doors=[Door(0, 0.2, 1.0)])
    result = arrange(room, parse_items("bed, 2 nightstand, wardrobe, chest, desk, desk chair, bookshelf"), "tight", n=2)
    assert len(result.arrangements) == 2
    for one in result.arrangements:
        assert one.not_placed
        assert {i.id for i in one.items} | {i.id for i in one.not_placed} == set(result.asked)
        assert not {i.id for i in one.items} & {i.id for i in one.not_placed}

"""Plans: what is repaired and said, and what is refused with the place named."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from processing.errors import PlanError
from processing.ground.room_model import starter_room
from processing.layout.plan import Door, Window, from_room_model, make_plan
from processing.layout.plan_files import plan_from_mapping, plan_to_mapping, read_plan

SQUARE = [[0, 0], [4, 0], [4, 3], [0, 3]]


def test_clockwise_is_turned_and_said_and_openings_stay_where_they_were() -> None:
    plan = make_plan(SQUARE[::-1], doors=[Door(0, 0.5, 1.3, "left")])  # edge 0 of the list given: (0, 3) to (4, 3)
    assert "clockwise" in plan.notes[0]
    corner, along, _ = plan.edge(plan.doors[0].edge)
    ends = sorted(tuple(np.round(corner + along * t, 9)) for t in (plan.doors[0].start_m, plan.doors[0].end_m))
    assert ends == [(0.5, 3.0), (1.3, 3.0)]


def test_repeated_and_closing_points_are_left_out_and_said() -> None:
    plan = make_plan([[0, 0], [4, 0], [4, 0], [4, 3], [0, 3], [0, 0]], doors=[Door(2, 1.0, 1.8)])
    assert len(plan.corners) == 4
    assert len(plan.notes) == 2
    assert plan.doors[0].edge == 1


@pytest.mark.parametrize(
    ("polygon", "result"),
    [
        ([[0, 0], [4, 3], [4, 0], [0, 3]], r"edge 0 crosses or touches edge 2 at \(2.000, 1.500\)"),
        ([[0, 0], [4, 0]], "do not make a polygon"),
        ([[0, 0], [4, 0], [8, 0]], "crosses or touches"),
        ([[0, 0], [0.001, 0], [0, 0.001]], "no area"),
        ([[0, 0], [4, 0], [4, float("nan")]], "finite"),
        ([[0, 0], [4, 0], [4, 3], [4, 1], [0, 3]], "crosses or touches"),
        ([[0, 0], [4, 0, 1]], "pairs"),
        ([[0, 0], [40000, 0], [4, 3]], "10 km away"),
        ([[20000, 0], [20004, 0], [20004, 3]], "10 km away"),
        ([[0, 0], [4000, 0], [4000, 3000], [0, 3000]], "over 200 m across"),
    ],
)
def test_polygons_that_cannot_be_repaired_are_refused(polygon: list[list[float]], result: str) -> None:
    with pytest.raises(PlanError, match=result):
        make_plan(polygon)


@pytest.mark.parametrize(
    "doors",
    [[Door(7, 0.1, 0.9)], [Door(0, 3.5, 4.5)], [Door(0, 1.0, 1.0)], [Door(0, float("nan"), 1.0)]],
)
def test_openings_off_their_edge_are_refused(doors: list[Door]) -> None:
    with pytest.raises(PlanError):
        make_plan(SQUARE, doors=doors)


def test_columns_outside_and_impossible_heights_are_refused() -> None:
    with pytest.raises(PlanError, match="outside the floor"):
        make_plan(SQUARE, holes=[[[3.5, 1], [4.5, 1], [4.5, 2]]])
    with pytest.raises(PlanError, match="ceiling"):
        make_plan(SQUARE, ceiling_height_m=0.5)
    with pytest.raises(PlanError, match="window"):
        make_plan(SQUARE, windows=[Window(0, 1, 2, 2.0, 1.0)])


def test_a_plan_is_the_same_after_json(tmp_path: Path) -> None:
    plan = make_plan(
        SQUARE,
        holes=[[[1, 1], [1.3, 1], [1.3, 1.3], [1, 1.3]]],
        doors=[Door(0, 0.2, 1.0, "right", "in")],
        windows=[Window(2, 1, 2, 0.5, 2)],
        keep_free=[(2.0, 2.0)],
    )
    path = tmp_path / "plan.json"
    path.write_text(json.dumps(plan_to_mapping(plan)))
    again = read_plan(path)
    assert np.array_equal(again.corners, plan.corners)
    assert (again.doors, again.windows, again.keep_free) == (plan.doors, plan.windows, plan.keep_free)
    assert np.array_equal(again.holes[0], plan.holes[0])


@pytest.mark.parametrize("text", ["", "[]", "{", '{"polygon": 3}', '{"polygon": [], "openings": [{"kind": "hatch"}]}'])
def test_files_that_are_no_plan_are_refused(tmp_path: Path, text: str) -> None:
    path = tmp_path / "plan.json"
    path.write_text(text)
    with pytest.raises(PlanError):
        read_plan(path)


def test_unknown_sills_are_said() -> None:
    openings = [{"kind": "window", "edge": 0, "t0": 1, "t1": 2, "to": "balcony"}]
    plan = plan_from_mapping({"polygon": SQUARE, "openings": openings}, where="x")
    assert plan.windows[0].sill_m == 0.0
    assert "sill not given" in plan.notes[0]


def test_a_room_model_is_a_plan() -> None:
    plan = from_room_model(starter_room(1.6), keep_camera_free=True)
    assert plan.area_m2 == pytest.approx(20)
    assert (len(plan.doors), len(plan.windows), plan.keep_free) == (1, 1, ((0.0, 0.0),))


@pytest.mark.parametrize("wrong", [{"kind": ["door"]}, {"hinge": ["left"]}, {"swing": {}}, {"kind": None}])
def test_an_opening_of_another_type_is_refused(wrong: dict[str, object]) -> None:
    opening = {"kind": "door", "edge": 0, "t0": 0.2, "t1": 1.0} | wrong
    with pytest.raises(PlanError, match=f"its '{next(iter(wrong))}'"):
        plan_from_mapping({"polygon": SQUARE, "openings": [opening]}, where="x")

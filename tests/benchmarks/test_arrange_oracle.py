"""The arrangement benchmark's second opinions: the oracle proves and finds, the raster sees faults and no others."""

from __future__ import annotations

import pytest

from benchmarks.layout.oracle import ask, first_solution_s
from benchmarks.layout.raster import Raster
from processing.layout.arrange import arrange
from processing.layout.arrangement import Arrangement
from processing.layout.items import parse_items
from processing.layout.plan import Door, FloorPlan, make_plan
from processing.layout.rules import built_in_rules
from tests.conftest import LONG

TIGHT = built_in_rules().named("tight")
DOOR = [Door(0, 0.1, 0.9)]


def room(width_m: float, depth_m: float) -> FloorPlan:
    return make_plan([[0, 0], [width_m, 0], [width_m, depth_m], [0, depth_m]], doors=DOOR)


@pytest.mark.sweep
@pytest.mark.skipif(not LONG, reason="a proof takes a minute: make torture")
def test_the_oracle_proves_that_nothing_fits() -> None:
    items = parse_items("king bed, wardrobe, desk, desk chair")
    assert ask(room(2.6, 2.6), items, TIGHT, 60.0).answer == "proved"
    assert not arrange(room(2.6, 2.6), items, "tight", n=1).arrangements[0].complete


def test_the_oracle_finds_what_the_judge_passes_and_so_does_the_solver() -> None:
    items = parse_items("single bed, nightstand, desk, desk chair")
    plan = room(3.2, 2.9)
    assert ask(plan, items, TIGHT, 60.0).answer == "found"
    assert first_solution_s(plan, items, TIGHT) is not None
    assert arrange(plan, items, "tight", n=1).arrangements[0].complete


def test_rooms_without_right_angles_are_not_the_oracles() -> None:
    plan = make_plan([[0, 0], [4, 0], [3.5, 3], [0, 3]], doors=DOOR)
    assert ask(plan, parse_items("desk"), TIGHT).answer == "not rectilinear"
    assert first_solution_s(plan, parse_items("desk"), TIGHT) is None


def moved(one: Arrangement, name: str, x_m: float, y_m: float) -> Arrangement:
    """Return an arrangement with one piece moved."""
    items = [
        i.model_copy(update={"t_m": (i.t_m[0] + x_m, i.t_m[1] + y_m, i.t_m[2])}) if i.id == name else i
        for i in one.items
    ]
    return one.model_copy(update={"items": tuple(items)})


@pytest.mark.parametrize(
    ("name", "x_m", "y_m", "result"),
    [
        ("chest", 0.0, 0.012, "outside"),
        ("chest", 0.112, 0.0, "wardrobe in chest"),
        ("chest", -1.7, -1.6, "in a door"),
        ("chest", 0.9, -0.7, "use of wardrobe blocked by chest"),
    ],
)
def test_the_raster_sees_what_is_moved_by_a_centimetre(name: str, x_m: float, y_m: float, result: str) -> None:
    plan = room(4.0, 2.5)
    pins = {"chest": (2.25, 2.275, 3.141592654), "wardrobe": (3.4, 2.2, 3.141592654)}
    one = arrange(plan, parse_items("chest, wardrobe"), "tight", n=1, pins=pins).arrangements[0]
    raster = Raster(plan, TIGHT)
    assert raster.faults(one) == []
    assert any(result in fault for fault in raster.faults(moved(one, name, x_m, y_m)))


def test_a_path_that_fits_exactly_is_no_fault_and_a_narrower_one_is() -> None:
    # two wardrobes leave 0.600 m between them, off the raster's cells
    plan = make_plan([[0.0037, 0], [1.8037, 0], [1.8037, 5], [0.0037, 5]], doors=[Door(0, 0.5, 1.3), Door(2, 0.5, 1.3)])
    items = parse_items("2 wardrobe")
    pins = {"wardrobe-1": (0.3037, 2.5, -1.570796327), "wardrobe-2": (1.5037, 2.5, 1.570796327)}
    one = arrange(plan, items, "tight", n=1, pins=pins).arrangements[0]
    raster = Raster(plan, TIGHT)
    assert raster.faults(one) == []
    assert any("no path" in fault for fault in raster.faults(moved(one, "wardrobe-2", -0.03, 0.0)))

"""The benchmark's search on a grid: it finds the last place that is left, and none where none is."""

from __future__ import annotations

import pytest

from processing.layout.items import Item, parse_items
from processing.layout.plan import Door, FloorPlan, make_plan
from processing.layout.rules import built_in_rules
from processing.layout.verify import Judge, Piece

pytest.importorskip("ortools", reason="the benchmarks' packages are not installed")
RULES = built_in_rules().named("tight")


def place_of(item: Item, placed: list[Piece], plan: FloorPlan) -> tuple[float, ...] | None:
    from benchmarks.layout import reasons as _layout_reasons

    return _layout_reasons.place_of(item, placed, plan, RULES)


def room() -> FloorPlan:
    ring = [[0.0, 0.0], [3.0, 0.0], [3.0, 3.0], [0.0, 3.0]]
    door = Door(0, 1.0, 1.8, "left", "in", "d")
    return make_plan(ring, doors=[door], windows=[], ceiling_height_m=2.4, name="room")


def wardrobe() -> Item:
    return parse_items("wardrobe")[0]


def piece(item: Item, x: float, y: float, theta: float) -> Piece:
    return Piece(item.id, item.spec, x, y, theta, item.id)


def test_a_place_is_found_that_the_judge_passes() -> None:
    plan = room()
    pose = place_of(wardrobe(), [], plan)
    assert pose is not None
    assert Judge(plan, RULES).passes([piece(wardrobe(), *pose)])


def test_none_is_found_where_none_is_left() -> None:
    bed = parse_items("king bed")[0]
    placed = [piece(bed, 1.5, 2.0, 3.141592653589793)]
    assert place_of(wardrobe(), placed, room()) is None
    chair = parse_items("desk, desk chair")[1]
    assert place_of(chair, [], room()) is None, "its desk is not there"

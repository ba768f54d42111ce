"""Furnished rooms: nothing in anything else, nothing in the way, and each check finds what it is for."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace
from functools import lru_cache

import numpy as np
import pytest

from mocks.rooms.finish import draw_finish
from mocks.rooms.furnish.check import check_items
from mocks.rooms.furnish.furnish import furnish
from mocks.rooms.furniture import item_parts
from mocks.rooms.model import Door, Finish, Item, Plan, Role, Use, Window
from mocks.rooms.room import draw_plan
from tests.conftest import LONG

USES = (Use.BEDROOM, Use.LIVING, Use.DINING, Use.OFFICE)
PLANS_EACH, FURNISHED_EACH = (10, 3) if LONG else (10, 1)
"""Per use: 120 rooms on 40 plans; in short, 40 on 40."""
pytestmark = pytest.mark.sweep
SQUARE = Plan(
    Use.BEDROOM,
    ((-2.0, -2.5), (3.0, -2.5), (3.0, 2.0), (-2.0, 2.0)),
    2.5,
    windows=(Window(wall=1, start_m=1.5, width_m=1.5, sill_m=0.9, height_m=1.3),),
    doors=(Door(wall=0, start_m=3.5, width_m=0.85, height_m=2.05),),
)


@lru_cache(maxsize=1)
def finish() -> Finish:
    return draw_finish(np.random.default_rng(5), Use.LIVING)


@lru_cache(maxsize=1)
def rooms() -> list[tuple[Plan, tuple[Item, ...]]]:
    found = []
    for number, use in enumerate(USES):
        for k in range(PLANS_EACH):
            plan = draw_plan(np.random.default_rng([k, number]), use)
            found += [
                (plan, furnish(plan, finish(), np.random.default_rng([k, number, n]))) for n in range(FURNISHED_EACH)
            ]
    return found


def test_rooms_are_furnished_without_a_problem() -> None:
    assert len(rooms()) == 4 * PLANS_EACH * FURNISHED_EACH
    for plan, items in rooms():
        assert check_items(plan, items) == []


def test_rooms_hold_what_they_are_for() -> None:
    needed = {Use.BEDROOM: "bed", Use.LIVING: "sofa", Use.DINING: "dining table", Use.OFFICE: "desk"}
    for use, kind in needed.items():
        having = [any(item.kind == kind for item in items) for plan, items in rooms() if plan.use is use]
        assert sum(having) >= 0.9 * len(having), use
    kinds = {item.kind for _, items in rooms() for item in items}
    assert len(kinds) >= 30


@pytest.mark.skipif(not LONG, reason="of 120 rooms: make torture")
def test_rooms_differ_in_how_full_they_are() -> None:
    counts = [sum(item.role is not Role.EQUIPMENT for item in items) for _, items in rooms()]
    assert min(counts) <= 8
    assert max(counts) >= 25
    assert 10 <= np.median(counts) <= 25


def test_the_same_generator_gives_the_same_furniture() -> None:
    plan = SQUARE
    first, again, other = (furnish(plan, finish(), np.random.default_rng(seed)) for seed in (1, 1, 2))
    assert first == again
    assert first != other


def test_an_empty_room_holds_the_equipment_only() -> None:
    items = furnish(replace(SQUARE, use=Use.EMPTY), finish(), np.random.default_rng(1))
    assert [item.kind for item in items] == ["tripod", "meter board"]
    assert all(item.role is Role.EQUIPMENT for item in items)
    assert check_items(SQUARE, items) == []


def test_no_rug_lies_on_carpet() -> None:
    carpeted = replace(finish(), floor=replace(finish().floor, name="grey carpet"))
    for seed in range(6):
        items = furnish(replace(SQUARE, use=Use.LIVING), carpeted, np.random.default_rng(seed))
        assert all(item.kind != "rug" for item in items)


def test_meshes_of_a_room_stay_inside_it() -> None:
    plan, items = rooms()[0]
    low, high = np.min(plan.polygon, axis=0), np.max(plan.polygon, axis=0)
    assert items
    for item in items:
        parts = item_parts(item, finish())
        assert parts, item.kind
        for part in parts:
            assert (part.mesh.vertices[:, :2] > low - 1e-3).all(), item.kind
            assert (part.mesh.vertices[:, :2] < high + 1e-3).all(), item.kind
            assert part.mesh.vertices[:, 2].max() < plan.height_m


@pytest.fixture(scope="module")
def equipment() -> tuple[Item, ...]:
    tripod = Item("tripod", Role.EQUIPMENT, 1, (0.0, 0.0, 0.0), (0.82, 0.82, 1.52))
    board = Item("meter board", Role.EQUIPMENT, 2, (0.0, 1.3, 0.0), (0.5, 0.4, 1.3))
    return (tripod, board)


def box(x: float, y: float, z: float = 0.0, size: tuple[float, float, float] = (0.4, 0.4, 0.4)) -> Item:
    return Item("box", Role.CLUTTER, 3, (x, y, z), size)


def problems(equipment: tuple[Item, ...], *more: Item) -> list[str]:
    return check_items(SQUARE, (*equipment, *(replace(item, instance=3 + k) for k, item in enumerate(more))))


def test_check_accepts_a_room_as_it_should_be(equipment: tuple[Item, ...]) -> None:
    assert problems(equipment) == []
    assert problems(equipment, box(-1.5, -1.5), box(-1.5, -1.5, 0.4)) == []


@pytest.mark.parametrize(
    ("items", "word"),
    [
        ((box(-1.9, 0.0),), "outside"),
        ((box(-1.5, -1.5), box(-1.3, -1.5)), "overlap"),
        ((box(1.8, -2.0),), "door"),
        ((box(2.75, -0.2, size=(0.4, 0.4, 1.2)),), "window"),
        ((box(0.8, 0.0),), "camera"),
        ((box(-1.5, -1.5, size=(0.4, 0.4, 2.6)),), "ceiling"),
        ((box(0.0, 0.95, size=(0.3, 0.1, 1.5)),), "hidden"),
    ],
)
def test_check_finds_what_is_wrong(equipment: tuple[Item, ...], items: tuple[Item, ...], word: str) -> None:
    found = problems(equipment, *items)
    assert found
    assert all(word in problem for problem in found), found


def test_a_low_thing_may_stand_before_a_window_and_below_the_sight_line(equipment: tuple[Item, ...]) -> None:
    assert problems(equipment, box(2.75, -0.2, size=(0.4, 0.4, 0.8))) == []
    assert problems(equipment, box(0.0, 0.95, size=(0.3, 0.1, 0.4))) == []


@pytest.mark.parametrize(
    ("change", "word"),
    [
        (lambda board: replace(board, position_m=(0.0, 0.9, 0.0)), "1 to 2 m"),
        (lambda board: replace(board, turn_rad=math.pi), "turned"),
        (lambda board: replace(board, kind="box"), "not one meter board"),
        (lambda board: replace(board, instance=5), "instances"),
    ],
)
def test_check_looks_at_the_meter_board(equipment: tuple[Item, ...], change: Callable[[Item], Item], word: str) -> None:
    found = check_items(SQUARE, (equipment[0], change(equipment[1])))
    assert any(word in problem for problem in found), found


def test_a_chair_goes_below_a_table_but_not_through_its_legs_or_with_its_back(equipment: tuple[Item, ...]) -> None:
    table = Item("dining table", Role.FURNITURE, 3, (1.4, -0.9, 0.0), (1.4, 0.8, 0.75), 0.0, 1)
    chair = Item("chair", Role.FURNITURE, 4, (1.4, -0.9 + 0.45, 0.0), (0.45, 0.5, 0.85), 0.0, 1)
    assert problems(equipment, table, chair) == []
    assert problems(equipment, table, replace(chair, position_m=(1.4, -0.7, 0.0)))
    assert problems(equipment, table, replace(chair, position_m=(1.9, -0.9 + 0.45, 0.0)))
    assert problems(equipment, table, replace(chair, turn_rad=math.pi))

"""The free parts of walls and the floor that doors need."""

from __future__ import annotations

import math

import pytest
from shapely.geometry import Point, Polygon

from mocks.rooms.model import Door, Fixture, Plan, Use, Window
from mocks.rooms.plan.forms import TRIM_M, WallSpan, door_swing, free_spans

SQUARE = ((-2.0, -2.0), (2.0, -2.0), (2.0, 2.0), (-2.0, 2.0))


def plan_with(*openings: Window | Door | Fixture) -> Plan:
    return Plan(
        Use.EMPTY,
        SQUARE,
        2.5,
        tuple(o for o in openings if isinstance(o, Window)),
        tuple(o for o in openings if isinstance(o, Door)),
        tuple(o for o in openings if isinstance(o, Fixture)),
    )


def test_an_empty_wall_is_one_span() -> None:
    assert free_spans(plan_with(), 0) == [WallSpan(0.0, 4.0, 0.0, 2.5)]


def test_below_and_beside_a_window_is_free() -> None:
    spans = free_spans(plan_with(Window(0, 1.0, 1.5, 0.9, 1.2)), 0)
    below = next(s for s in spans if s.width_m == 4.0 and s.bottom_m == 0.0)
    assert below.top_m == pytest.approx(0.86)
    beside = [s for s in spans if s.height_m == 2.5]
    assert [round(s.width_m, 2) for s in beside] == [1.46, 0.96]


def test_a_door_takes_its_trim_and_a_socket_takes_nothing_from_cupboards() -> None:
    plan = plan_with(Door(1, 0.5, 0.8, 2.0), Fixture("socket", 1, 3.0, 0.08, 0.3, 0.08, 0.01))
    tall = [s for s in free_spans(plan, 1) if s.height_m == 2.5]
    assert [(s.start_m, s.end_m) for s in tall] == [
        (pytest.approx(1.3 + TRIM_M), 4.0),
        (0.0, pytest.approx(0.5 - TRIM_M)),
    ]
    assert len([s for s in free_spans(plan, 1, flush_too=True) if s.height_m == 2.5]) == 3


def test_spans_meet_nothing_that_is_taken_and_cannot_grow() -> None:
    window, radiator = Window(2, 1.2, 1.4, 1.0, 1.2), Fixture("radiator", 2, 1.3, 1.2, 0.12, 0.6, 0.1)
    spans = free_spans(plan_with(window, radiator), 2)
    assert spans
    for span in spans:
        assert not span.overlaps(WallSpan(1.2, 2.6, 1.0, 2.2))
        assert not span.overlaps(WallSpan(1.3, 2.5, 0.12, 0.72))


@pytest.mark.parametrize("hinge", ["start", "end"])
@pytest.mark.parametrize("wall", [0, 1, 2, 3])
def test_a_door_swings_into_the_room(hinge: str, wall: int) -> None:
    swing = door_swing(Door(wall, 1.0, 0.8, 2.0, hinge, "in", 1.2), plan_with())  # type: ignore[arg-type]
    assert swing.area == pytest.approx(math.pi * 0.8**2 / 4, rel=0.01)
    assert Polygon(SQUARE).buffer(1e-6).contains(swing)
    hinge_at = plan_with().on_wall(wall, 1.0 if hinge == "start" else 1.8, 0.79)
    assert swing.distance(Point(hinge_at)) < 1e-6


def test_a_door_that_opens_outwards_needs_its_approach() -> None:
    assert door_swing(Door(3, 1.0, 0.8, 2.0, "start", "out"), plan_with()).area == pytest.approx(0.48)


def test_a_leaf_opened_far_takes_its_whole_sector() -> None:
    swing = door_swing(Door(0, 1.0, 0.8, 2.0, "start", "in", 1.6), plan_with())
    assert swing.area == pytest.approx(0.8**2 * 1.6 / 2, rel=0.01)

"""Free sets are exact: tight to a millimetre, never larger for one obstacle more, equal to brute force."""

from __future__ import annotations

import math

import numpy as np
import pytest
import shapely
from hypothesis import given, settings
from hypothesis import strategies as st
from shapely.geometry import Polygon

from processing.layout.given_places import free_region
from processing.layout.plan import FloorPlan, make_plan
from processing.layout.rules import built_in_rules
from processing.layout.solver.field import Floor, make_field, outlines
from processing.layout.solver.free_sets import BODY, add_forbidden, add_walls, complement, merged, rects_inside

L_ROOM = [[0, 0], [5, 0], [5, 2.5], [3, 2.5], [2.6, 4], [0, 4]]
LIMITS = {"max_examples": 30, "deadline": None}


def free(
    plan: FloorPlan, obstacles: list[np.ndarray], edge: int, size: tuple[float, float]
) -> list[tuple[float, float]]:
    """Return the free intervals of a box along an edge, checked to be in the room at their middles."""
    corner, u, length = plan.edge(edge)
    walls, line = Floor(plan).walls, np.array([*corner, *u, length, edge])
    rects, kinds = np.array([[0.0, size[0], 0.0, size[1], 0.0, 1.0]]), np.array([BODY])
    rows = outlines([(o, 0.0, 1.0, BODY) for o in obstacles])
    out, found = np.empty((400, 2)), 0
    found = add_walls(walls, line, rects, out, found)
    found = add_forbidden(rows, len(obstacles), line, rects, kinds, out, found)
    found = merged(out, found)
    left = np.empty((400, 2))
    count = complement(out, found, length - size[0], left)
    spans = [(float(a), float(b)) for a, b in left[:count]]
    return [(a, b) for a, b in spans if rects_inside(walls, line, (a + b) / 2, rects)]


def box_at(plan: FloorPlan, edge: int, s: float, size: tuple[float, float], inset: float = 0.0) -> Polygon:
    corner, u, _ = plan.edge(edge)
    n = np.array([-u[1], u[0]])
    rim = ((s, 0), (s + size[0], 0), (s + size[0], size[1]), (s, size[1]))
    return Polygon([corner + u * t + n * y for t, y in rim]).buffer(-inset)


def quad(x: float, y: float, w: float, d: float, turn: float) -> np.ndarray:
    c, s = math.cos(turn), math.sin(turn)
    return (
        np.array(
            [[x + a * w * c - b * d * s, y + a * w * s + b * d * c] for a, b in ((-1, -1), (1, -1), (1, 1), (-1, 1))]
        )
        * 1.0
    )


quads = st.builds(
    quad, st.floats(0.3, 4.5), st.floats(0.3, 3.5), st.floats(0.1, 0.5), st.floats(0.1, 0.5), st.floats(0, 3)
)
sizes = st.tuples(st.floats(0.3, 1.6), st.floats(0.3, 1.2))


@pytest.mark.long
@settings(**LIMITS)
@given(st.lists(quads, max_size=3), st.integers(0, 5), sizes)
def test_interval_ends_are_tight_to_a_millimetre(
    obstacles: list[np.ndarray], edge: int, size: tuple[float, float]
) -> None:
    plan = make_plan(L_ROOM)
    room, solid = Polygon(L_ROOM), shapely.union_all([Polygon(o) for o in obstacles])

    def legal(s: float, inset: float) -> bool:
        box = box_at(plan, edge, s, size, inset)
        return bool(room.buffer(1e-9).covers(box)) and box.intersection(solid).area < 1e-12

    spans = free(plan, obstacles, edge, size)
    for low, high in spans:
        assert legal(low, 1e-6)
        assert legal(high, 1e-6)
        assert legal((low + high) / 2, 1e-6)
    # 1 mm past an end is illegal, unless the next interval begins there or the edge ends
    length = plan.edge(edge)[2]
    for s in [low - 1e-3 for low, _ in spans] + [high + 1e-3 for _, high in spans]:
        if 0 <= s <= length - size[0] and not any(a - 1e-9 <= s <= b + 1e-9 for a, b in spans):
            assert not legal(s, 0.0)


def test_without_obstacles_an_edge_is_free_as_far_as_the_room_is_deep() -> None:
    plan = make_plan(L_ROOM)
    ends = [free(plan, [], edge, (0.6, 0.4)) for edge in (0, 1, 2, 4, 5)]
    assert ends == [[pytest.approx((0.0, end))] for end in (4.4, 1.9, 1.4, 2.0, 3.4)]


@settings(**LIMITS)
@given(st.lists(quads, max_size=3), quads, st.integers(0, 5), sizes)
def test_an_added_obstacle_never_enlarges_a_free_set(
    obstacles: list[np.ndarray], more: np.ndarray, edge: int, size: tuple[float, float]
) -> None:
    plan = make_plan(L_ROOM)
    before, after = free(plan, obstacles, edge, size), free(plan, [*obstacles, more], edge, size)
    for low, high in after:
        assert any(a - 1e-9 <= low and high <= b + 1e-9 for a, b in before)


@settings(**LIMITS)
@given(st.lists(quads, max_size=3), st.integers(0, 5), sizes, st.floats(0.5, 0.99))
def test_a_smaller_item_fits_wherever_a_larger_one_does(
    obstacles: list[np.ndarray], edge: int, size: tuple[float, float], share: float
) -> None:
    plan = make_plan(L_ROOM)
    large = free(plan, obstacles, edge, size)
    small = free(plan, obstacles, edge, (size[0] * share, size[1] * share))
    assert not large or small


def test_brute_force_at_5_mm_agrees() -> None:
    plan, size = make_plan(L_ROOM), (0.7, 0.5)
    obstacles = [quad(1.2, 0.3, 0.2, 0.2, 0.4), quad(4.0, 0.4, 0.15, 0.15, 0.0)]
    room, solid = Polygon(L_ROOM).buffer(1e-9), shapely.union_all([Polygon(o) for o in obstacles])
    spans = free(plan, obstacles, 0, size)
    for s in np.arange(0, 5 - size[0], 0.005):
        box = box_at(plan, 0, s, size, 1e-9)
        legal = room.covers(box) and box.intersection(solid).area < 1e-12
        assert legal == any(a - 1e-6 <= s <= b + 1e-6 for a, b in spans)


def test_a_gap_of_exactly_the_width_is_free() -> None:
    plan = make_plan([[0, 0], [4, 0], [4, 3], [0, 3]])
    obstacles = [np.array([[0, 0], [1, 0], [1, 1], [0, 1.0]]), np.array([[2.2, 0], [3, 0], [3, 1], [2.2, 1.0]])]
    spans = free(plan, obstacles, 0, (1.2, 0.5))
    assert [(round(a, 6), round(b, 6)) for a, b in spans] == [(1.0, 1.0)]


def test_the_region_of_a_free_piece_is_the_rooms_inner_fit() -> None:
    plan = make_plan([[0, 0], [4, 0], [4, 3], [0, 3]])
    rules = built_in_rules().named("tight")
    field = make_field(Floor(plan), rules)
    body = ((-0.5, 0.5, -0.25, 0.25, 0.0, 0.7), BODY)
    region = free_region(field, [body], 0.0)
    assert region.bounds == pytest.approx((0.5, 0.25, 3.5, 2.75))
    turned = free_region(field, [body], math.pi / 2)
    assert turned.area == pytest.approx((4 - 0.5) * (3 - 1.0))
    column = (np.array([[1.9, 1.4], [2.1, 1.4], [2.1, 1.6], [1.9, 1.6]]), 0.0, 2.0, BODY)
    beside = make_field(Floor(plan), rules, [column])
    assert free_region(beside, [body], 0.0).area == pytest.approx(region.area - 1.2 * 0.7)

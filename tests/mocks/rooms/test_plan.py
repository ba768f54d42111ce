"""Plans of rooms: always valid, of all the intended forms, and the checks that say so find what is wrong."""

from __future__ import annotations

import math
from collections import Counter
from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from shapely.geometry import Point as Spot
from shapely.geometry import Polygon

from mocks.rooms import room as plan_module
from mocks.rooms.model import Door, Fixture, Plan, Use, Window
from mocks.rooms.plan.forms import AREA_M2, floor_seen, inner_angle_rad, reveal_floor
from mocks.rooms.plan.openings import check_plan
from mocks.rooms.room import draw_plan
from tests.conftest import LONG

SEEDS = range(300 if LONG else 30)
pytestmark = pytest.mark.sweep
USES = tuple(Use)
SQUARE = ((-2.0, -2.0), (2.0, -2.0), (2.0, 2.0), (-2.0, 2.0))
CUT = ((-2.0, -2.0), (2.0, -2.0), (2.0, 0.2), (1.0, 2.0), (-2.0, 2.0))
GOOD = Plan(Use.EMPTY, SQUARE, 2.5, (Window(0, 1.0, 1.4, 0.9, 1.2),), (Door(2, 0.4, 0.8, 2.0),))


@cache
def plan_of(seed: int) -> Plan:
    return draw_plan(np.random.default_rng([seed, 77]), USES[seed % len(USES)])


def test_every_seed_gives_a_valid_plan() -> None:
    assert {seed: wrong for seed in SEEDS if (wrong := check_plan(plan_of(seed)))} == {}


def test_the_same_seed_gives_the_same_plan() -> None:
    for seed in range(10):
        assert draw_plan(np.random.default_rng([seed, 77]), USES[seed % len(USES)]) == plan_of(seed)


def test_sizes_suit_the_use() -> None:
    for seed in SEEDS:
        plan = plan_of(seed)
        low, high = AREA_M2[plan.use]
        assert low - 1.2 <= Polygon(plan.polygon).area <= high + 3.0  # A bay comes on top, a cut corner off.


def test_the_camera_stands_clear_and_sees_the_floor_but_not_always_from_the_middle() -> None:
    off = []
    for seed in SEEDS:
        room = Polygon(plan_of(seed).polygon)
        assert room.exterior.distance(Spot(0, 0)) >= 0.8
        assert floor_seen(plan_of(seed).polygon, (0.0, 0.0)) >= 0.83
        off.append(room.centroid.distance(Spot(0, 0)) / math.sqrt(room.area))
    assert np.quantile(off, 0.1) < 0.1 < 0.25 < np.quantile(off, 0.9)


@pytest.mark.skipif(not LONG, reason="of 300 plans: make torture")
def test_all_forms_turns_and_openings_occur() -> None:
    plans = [plan_of(seed) for seed in SEEDS]
    sides = Counter(len(p.polygon) for p in plans)
    assert set(sides) == {4, 5, 6, 8}
    assert 0.4 < sides[4] / len(plans) < 0.7
    assert any(_slanted(p) for p in plans if len(p.polygon) == 4)
    assert {len(p.windows) for p in plans} == {1, 2, 3, 4}
    assert {len(p.doors) for p in plans} == {1, 2}
    opened = [d.open_rad > 0 for p in plans for d in p.doors]
    assert 0.15 < np.mean(opened) < 0.35
    assert any(w.sill_m == 0 for p in plans for w in p.windows)
    skews = [_skew_deg(p) for p in plans]
    assert sum(s < 8 for s in skews) > 60
    assert sum(s > 20 for s in skews) > 60
    assert {f.kind for p in plans for f in p.fixtures} == {
        "column radiator",
        "curtain",
        "curtain rod",
        "disc lamp",
        "dome lamp",
        "panel radiator",
        "pendant lamp",
        "roller blind",
        "socket",
        "spot",
        "switch",
        "thermostat",
        "venetian blind",
    }


def _slanted(plan: Plan) -> bool:
    return any(abs(inner_angle_rad(plan.polygon, i) - math.pi / 2) > 0.02 for i in range(4))


def _skew_deg(plan: Plan) -> float:
    longest = max(range(len(plan.polygon)), key=plan.wall_length_m)
    (x, y), _ = plan.wall_axes(longest)
    return abs((math.degrees(math.atan2(y, x)) + 45) % 90 - 45)


def test_windows_look_outwards_past_the_room() -> None:
    for seed in SEEDS:
        plan = plan_of(seed)
        room = Polygon(plan.polygon)
        assert all(reveal_floor(w, plan, 4.0).intersection(room).area < 1e-4 for w in plan.windows)


@pytest.mark.parametrize("lamps_on", [True, False])
def test_lamps_are_lit_on_demand(lamps_on: bool) -> None:
    for seed in range(12):
        plan = draw_plan(np.random.default_rng([seed, 5]), USES[seed % len(USES)], lamps_on=lamps_on)
        lamps = [f.lit for f in plan.fixtures if f.wall < 0]
        assert set(lamps) <= {lamps_on}
        assert lamps or not lamps_on


@pytest.mark.parametrize("use", USES)
def test_the_fallback_is_a_valid_rectangle_and_always_the_same(use: Use, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(plan_module, "draw_camera", lambda *_: None)
    plans = [draw_plan(np.random.default_rng(seed), use) for seed in (1, 2)]
    assert plans[0] == plans[1]
    assert len(plans[0].polygon) == 4
    assert check_plan(plans[0]) == []


@pytest.mark.parametrize(
    ("plan", "words"),
    [
        (replace(GOOD, polygon=SQUARE[::-1]), "clockwise"),
        (replace(GOOD, polygon=(SQUARE[0], SQUARE[2], SQUARE[1], SQUARE[3])), "crosses itself"),
        (replace(GOOD, polygon=(*SQUARE, (-2.0, -1.9))), "too short"),
        (replace(GOOD, polygon=((-2.0, -2.0), (9.0, 2.0), (-2.0, 2.0))), "too narrow"),
        (replace(GOOD, height_m=2.0), "ceiling is at"),
        (replace(GOOD, polygon=tuple((x + 3.0, y) for x, y in SQUARE)), "camera is outside"),
        (replace(GOOD, polygon=tuple((x + 1.5, y) for x, y in SQUARE)), "near a wall"),
        (replace(GOOD, windows=(Window(0, 3.0, 1.4, 0.9, 1.2),)), "beyond the end"),
        (replace(GOOD, windows=(Window(0, 1.0, 1.4, 0.9, 1.6),)), "above the ceiling"),
        (replace(GOOD, windows=(Window(7, 1.0, 1.4, 0.9, 1.6),)), "no such wall"),
        (replace(GOOD, windows=(Window(0, 1.0, 0.1, 0.9, 1.2),)), "too small"),
        (replace(GOOD, windows=(Window(2, 1.2, 1.0, 0.9, 1.2),)), "too near another"),
        (
            replace(GOOD, polygon=CUT, windows=(Window(2, 0.06, 0.5, 0.9, 1.2),), doors=(Door(1, 1.32, 0.8, 2.0),)),
            "hides",
        ),
        (replace(GOOD, doors=(Door(2, 0.12, 0.8, 2.0, "end", "in"), Door(1, 3.1, 0.8, 2.0, "end"))), "each other"),
        (replace(GOOD, doors=(Door(2, 1.6, 0.9, 2.0),), polygon=tuple((x, y - 0.8) for x, y in SQUARE)), "camera"),
        (replace(GOOD, fixtures=(Fixture("socket", 2, 0.6, 0.08, 0.3, 0.08, 0.01),)), "over an opening"),
        (replace(GOOD, fixtures=(Fixture("radiator", 2, 1.3, 0.6, 0.1, 0.6, 0.1),) * 2), "radiator and radiator"),
        (replace(GOOD, fixtures=(Fixture("radiator", 3, 0.0, 0.6, 0.1, 0.6, 0.1),)), "beyond the end"),
        (replace(GOOD, fixtures=(Fixture("lamp", -1, 0, 0.4, 2.4, 0.1, 0.4, (3.0, 0.0)),)), "not under the ceiling"),
        (replace(GOOD, fixtures=(Fixture("lamp", -1, 0, 0.4, 1.5, 1.0, 0.4),)), "in the way"),
    ],
)
def test_the_check_finds_what_is_wrong(plan: Plan, words: str) -> None:
    assert any(words in text for text in check_plan(plan)), check_plan(plan)


def test_the_check_lets_a_good_plan_pass() -> None:
    assert check_plan(GOOD) == []

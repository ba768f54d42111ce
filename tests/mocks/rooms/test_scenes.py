"""Rooms by the name of a scene: the same at any time, under the sky of the moment."""

from __future__ import annotations

import math
from dataclasses import replace
from datetime import UTC, datetime

import pytest

from mocks.rooms.model import Plan, Use
from mocks.rooms.room import clouds_of, scene_room, seed_of, use_of
from mocks.rooms.sky.daylight import Moment, sun_of
from mocks.rooms.world import RoomWorld

NOON = Moment(40.44, -79.99, datetime(2023, 6, 22, 17, 0, tzinfo=UTC), math.radians(167))


def dark(plan: Plan) -> Plan:
    return replace(plan, fixtures=tuple(replace(f, lit=False) for f in plan.fixtures))


@pytest.mark.parametrize(
    ("scene", "use"),
    [
        ("2f_king_bed", Use.BEDROOM),
        ("essex_bed", Use.BEDROOM),
        ("1f_kitchen_p2", Use.DINING),
        ("2F_Living", Use.LIVING),
        ("coda_334", Use.OFFICE),
    ],
)
def test_the_name_says_what_a_room_is_for(scene: str, use: Use) -> None:
    assert use_of(scene) is use


def test_any_other_name_has_one_use_for_ever() -> None:
    assert [use_of(n) for n in ("colonnade", "ruth_garden")] == [use_of(n) for n in ("Colonnade", "RUTH_garden")]


def test_one_scene_is_one_room_at_any_time_and_in_any_light() -> None:
    evening = replace(NOON, utc=datetime(2023, 6, 22, 22, 30, tzinfo=UTC), heading_rad=1.0)
    one = scene_room("coda_334", NOON, illuminance_lux=1e5)
    other = scene_room("coda_334", evening, illuminance_lux=3e3, lamps_on=True)
    assert dark(one.plan) == dark(other.plan)
    assert (one.finish, one.items, one.glass_transmittance) == (other.finish, other.items, other.glass_transmittance)
    assert (one.sky.seed, one.sky.eye_height_m) == (other.sky.seed, other.sky.eye_height_m), "the street stays"
    assert other.lamps_on
    assert not one.lamps_on
    for room, moment in ((one, NOON), (other, evening)):
        assert (room.sky.sun_azimuth_rad, room.sky.sun_elevation_rad) == sun_of(moment)


def test_other_names_and_other_seeds_are_other_rooms() -> None:
    assert len({seed_of("coda_334"), seed_of("coda_320"), seed_of("coda_334", 1)}) == 3
    assert seed_of("Coda_334") == seed_of("coda_334")


def test_the_sky_is_the_one_nearest_to_what_was_measured() -> None:
    skies = {lux: scene_room("coda_334", NOON, illuminance_lux=lux).sky for lux in (1e3, 1.5e4, 7e4, 9e4, 2e5)}
    assert skies[1e3].kind == "overcast"
    assert skies[2e5].kind in ("clear", "intermediate")
    given = {kind: lux for lux, sky in skies.items() for kind in [sky.kind]}
    for lux, sky in skies.items():
        distance = abs(math.log(sum(sky.horizontal_illuminance_lx()) / lux))
        for other in given.values():
            assert distance <= abs(math.log(sum(skies[other].horizontal_illuminance_lx()) / lux)) + 1e-9


def test_clouds_move_where_the_sky_has_gaps_and_not_below_a_closed_cover() -> None:
    overcast = scene_room("coda_334", NOON, illuminance_lux=5e3)
    assert RoomWorld(overcast, "draft", clouds_of(overcast)).components == ("light",)
    sunny = scene_room("coda_334", NOON, illuminance_lux=1e5)
    world = RoomWorld(sunny, "draft", clouds_of(sunny))
    assert set(world.components) == {"sky", "sun"}
    assert {world.weights(t)[world.components.index("sun")] for t in range(0, 1200, 20)} != {1.0}

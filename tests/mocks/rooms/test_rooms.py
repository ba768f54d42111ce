"""Whole rooms by their seeds: always valid, always the same, of sound geometry, closed but for their windows."""

from __future__ import annotations

import hashlib
import subprocess
import sys
from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from benchmarks.light.truth import room_faults
from benchmarks.seeds import seeds
from mocks.rooms import room as room_module
from mocks.rooms.model import Part, Plan, Role, Use, Window
from mocks.rooms.room import MAIN_PIECE, Room, accent_wall, make_room
from tests.conftest import LONG
from tests.mocks.rooms.leaks import missed, rays_inside, through

COUNT = 36 if LONG else 8
pytestmark = pytest.mark.sweep
SOME = range(0, COUNT, 5)
ONCE_WITHOUT_A_TRIPOD = (800_050, 800_068, 800_102)
"""Their first plan has a door's way where the camera stands."""
LIVING_WITHOUT_PLACE_FOR_A_SOFA = 800_236
"""In its first plan."""
BOX = Plan(
    Use.BEDROOM,
    ((-2.0, -1.5), (2.0, -1.5), (2.0, 1.5), (-2.0, 1.5)),
    2.5,
    windows=(Window(0, 1.0, 1.4, 0.9, 1.2),),
    doors=(),
)


@cache
def rooms() -> tuple[Room, ...]:
    odd = [*ONCE_WITHOUT_A_TRIPOD, LIVING_WITHOUT_PLACE_FOR_A_SOFA]
    mixed = [*odd, *seeds("train", COUNT // 2, 5), *seeds("validation", COUNT // 2 - 4, 5)]
    return tuple(make_room(seed) for seed in mixed)


@cache
def parts_of(number: int) -> tuple[Part, ...]:
    return tuple(rooms()[number].parts())


def test_rooms_are_valid() -> None:
    assert len(rooms()) == COUNT
    assert {room.seed: found for room in rooms() if (found := room_faults(room))} == {}
    empty = [room for room in rooms() if room.plan.use is Use.EMPTY]
    assert all(item.role is Role.EQUIPMENT for room in empty for item in room.items)
    assert not LONG or {room.plan.use for room in rooms()} == set(Use)


def test_rooms_hold_the_equipment_and_what_they_are_for() -> None:
    for room in rooms():
        kinds = [item.kind for item in room.items]
        assert kinds.count("tripod") == kinds.count("meter board") == 1
        assert room.plan.use is Use.EMPTY or MAIN_PIECE[room.plan.use] in kinds, room.name


@pytest.mark.long
def test_the_same_seed_gives_the_same_room_in_any_process() -> None:
    few = rooms()[:2]
    assert repr(make_room(few[0].seed)) == repr(few[0])
    text = "import sys; from mocks.rooms.room import make_room; print(*(make_room(int(s)).key for s in sys.argv[1:]))"
    numbers = [str(room.seed) for room in few]
    printed = subprocess.run([sys.executable, "-c", text, *numbers], capture_output=True, text=True, check=True).stdout
    assert printed.split() == [room.key for room in few]
    assert len({hashlib.sha256(repr(room).encode()).hexdigest() for room in rooms()}) == COUNT


def test_meshes_are_finite_and_whole() -> None:
    for number in SOME:
        assert parts_of(number)
        for part in parts_of(number):
            mesh = part.mesh
            assert all(np.isfinite(values).all() for values in (mesh.vertices, mesh.normals, mesh.uv)), part.surface
            assert np.linalg.norm(mesh.normals, axis=1) == pytest.approx(1.0, abs=1e-5)
            assert 0 <= mesh.faces.min() <= mesh.faces.max() < len(mesh.vertices)
            assert all(0.0 < albedo <= 0.95 for albedo in part.material.colour)


def test_light_leaves_furnished_rooms_through_panes_and_nowhere_else() -> None:
    left = 0
    for number in SOME:
        room = rooms()[number]
        origins, ways = rays_inside(room.plan, room.seed, 4000)
        out = missed(parts_of(number), origins, ways)
        panes = np.any([through(pane, origins, ways) for pane in room.panes], axis=0)
        assert not np.any(out & ~panes), room.name
        left += int(out.sum())
    assert left > 0


def test_an_emptied_room_has_its_shell_and_fixtures_only() -> None:
    room = next(room for room in rooms() if len(room.items) > 10)
    assert {part.role for part in room.emptied().parts()} <= {Role.SHELL, Role.FIXTURE}
    assert room.emptied().key != room.key


def test_a_rooms_key_does_not_hang_on_a_numbers_last_digit() -> None:
    room = rooms()[0]
    red, *others = room.glass_transmittance
    last, more = float(np.nextafter(red, 1)), red + 1e-6
    assert replace(room, glass_transmittance=(last, *others)) != room
    assert replace(room, glass_transmittance=(last, *others)).key == room.key
    assert replace(room, glass_transmittance=(more, *others)).key != room.key


def test_accent_walls_are_walls_and_without_windows_where_some_are() -> None:
    accented = [room for room in rooms() if room.finish.accent_walls]
    assert accented
    for room in accented:
        (wall,) = room.finish.accent_walls
        with_windows = {window.wall for window in room.plan.windows}
        assert wall not in with_windows or len(with_windows) == len(room.plan.polygon)


def test_the_accent_wall_is_behind_the_bed_else_the_longest_without_windows() -> None:
    bed = replace(rooms()[0].items[0], kind="bed", position_m=(-0.9, 0.0, 0.0), size_m=(1.6, 2.1, 1.0))
    assert accent_wall(BOX, ()) == 2
    assert accent_wall(BOX, (replace(bed, turn_rad=np.pi / 2),)) == 3
    assert accent_wall(BOX, (replace(bed, position_m=(0.0, -0.4, 0.0), turn_rad=np.pi),)) == 2


def test_a_plan_without_place_for_the_tripod_is_drawn_again(monkeypatch: pytest.MonkeyPatch) -> None:
    plans, real = [], room_module.draw_plan

    def crowded_once(rng: np.random.Generator, use: Use, *, lamps_on: bool) -> Plan:
        plans.append(real(rng, use, lamps_on=lamps_on))
        return (
            replace(
                plans[-1],
                polygon=((-0.3, -0.3), (0.3, -0.3), (0.3, 0.3), (-0.3, 0.3)),
                windows=(),
                doors=(),
                fixtures=(),
            )
            if len(plans) == 1
            else plans[-1]
        )

    monkeypatch.setattr(room_module, "draw_plan", crowded_once)
    room = make_room(11, Use.EMPTY)
    assert len(plans) == 2
    assert room.plan == plans[1]
    assert room_faults(room) == []

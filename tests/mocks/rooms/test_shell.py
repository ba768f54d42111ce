"""The shell as meshes: light-tight but for its panes, of the plan's measures, and well formed."""

from __future__ import annotations

import math
from functools import cache

import numpy as np
import pytest
import shapely
from shapely.geometry import Polygon

from mocks.rooms.model import ADE20K, Door, Finish, Fixture, Material, Part, Plan, Role, Use, Window
from mocks.rooms.plan.forms import door_swing, openings_of
from mocks.rooms.room import draw_plan
from mocks.rooms.shell import shell_parts
from mocks.rooms.shell.openings import window_panes
from tests.conftest import LONG
from tests.mocks.rooms.leaks import missed, rays_inside, through

SQUARE = ((-2.0, -2.0), (2.0, -2.0), (2.0, 2.0), (-2.0, 2.0))
SURFACES = {
    "floor": {"floor"},
    "ceiling": {"ceiling"},
    "cornice": {"ceiling"},
    "wall": {"wall"},
    "skirting": {"wall"},
    "reveal": {"wall"},
    "window sill": {"wall"},
    "window frame": {"windowpane"},
    "door": {"door"},
    "door frame": {"door"},
    "hallway": {"wall", "floor", "ceiling"},
    "radiator": {"radiator"},
    "socket": {"wall"},
    "switch": {"wall"},
    "curtain": {"curtain"},
    "blind": {"blind"},
    "lamp": {"light"},
}
FIXTURES = {"skirting", "radiator", "socket", "switch", "curtain", "blind", "lamp"}
CLASSES = {number: name for name, number in ADE20K.items()}


def paint(name: str) -> Material:
    return Material(name, (0.5, 0.5, 0.5))


FINISH = Finish(
    floor=paint("floor"),
    wall=paint("wall"),
    accent_wall=paint("accent"),
    ceiling=paint("ceiling"),
    trim=paint("trim"),
    door=paint("door"),
    window_frame=paint("frame"),
    radiator=paint("radiator"),
    wood=paint("wood"),
    second_wood=paint("wood 2"),
    lacquer=paint("lacquer"),
    metal=paint("metal"),
    fabric=paint("fabric"),
    second_fabric=paint("fabric 2"),
    bedding=paint("bedding"),
    curtain=paint("curtain"),
    rug=paint("rug"),
    accent_walls=(1,),
)


@cache
def plan_of(seed: int) -> Plan:
    return draw_plan(np.random.default_rng([seed, 77]), tuple(Use)[seed % len(Use)], lamps_on=seed % 3 == 0)


@cache
def parts_of(seed: int) -> tuple[Part, ...]:
    return tuple(shell_parts(plan_of(seed), FINISH))


@pytest.mark.sweep
@pytest.mark.sweep
@pytest.mark.parametrize("first", [0, 10, 20, 30, 40] if LONG else [0, 20])
def test_light_leaves_through_panes_and_nowhere_else(first: int) -> None:
    left, count, rays = 0, 10 if LONG else 4, 6000 if LONG else 3000
    for seed in range(first, first + count):
        origins, ways = rays_inside(plan_of(seed), seed, rays)
        out = missed(parts_of(seed), origins, ways)
        panes = np.any([through(pane, origins, ways) for pane in window_panes(plan_of(seed))], axis=0)
        assert not np.any(out & ~panes), seed
        left += int(out.sum())
    assert left > count * rays * 0.005


@pytest.mark.long
def test_a_corner_and_the_edge_of_a_reveal_let_no_light_through() -> None:
    """Rays aimed at the lines where faces meet, where a crack would be."""
    for seed in range(12):
        plan = plan_of(seed)
        rng = np.random.default_rng([seed, 4])
        corners = [(*p, z) for p in plan.polygon for z in rng.uniform(0, plan.height_m, 60)]
        corners += [
            (*plan.on_wall(w, plan.wall_length_m(w) * s), z)
            for w in range(len(plan.polygon))
            for s in rng.uniform(0, 1, 60)
            for z in (0.0, plan.height_m)
        ]
        for o in openings_of(plan):
            corners += [
                (*plan.on_wall(o.wall, o.start_m + s, -o.depth_m * d), z)
                for s in (0.0, o.width_m)
                for d, z in zip(rng.uniform(0, 0.5, 60), rng.uniform(0.3, 1.8, 60), strict=True)
            ]
        ways = np.array(corners) - (0.0, 0.0, 1.6)
        out = missed(parts_of(seed), np.tile((0.0, 0.0, 1.6), (len(ways), 1)), ways)
        panes = np.any([through(p, np.tile((0.0, 0.0, 1.6), (len(ways), 1)), ways) for p in window_panes(plan)], axis=0)
        assert not np.any(out & ~panes), seed


def test_panes_are_clear_glass_in_the_outer_face_and_look_outside() -> None:
    window = Window(0, 1.0, 1.4, 0.9, 1.2, depth_m=0.3, panes_across=2, panes_up=2)
    plan = Plan(Use.EMPTY, SQUARE, 2.5, (window,), ())
    panes = window_panes(plan)
    assert [p.window for p in panes] == [0, 0, 0, 0]
    area = 0.0
    for pane in panes:
        outward = np.cross(pane.u, pane.v)
        area += float(np.linalg.norm(outward))
        assert outward / np.linalg.norm(outward) == pytest.approx((0.0, -1.0, 0.0))
        assert pane.corner[1] == pytest.approx(-2.3)
        middle = np.array(pane.corner) + np.array(pane.u) / 2 + np.array(pane.v) / 2
        way = middle - (0.0, 0.0, 1.6)
        assert missed(tuple(shell_parts(plan, FINISH)), np.array([[0.0, 0.0, 1.6]]), way[None])[0]
    assert 0.6 < area / (1.4 * 1.2) < 0.9


@pytest.mark.sweep
def test_meshes_are_well_formed() -> None:
    for seed in range(30 if LONG else 12):
        for part in parts_of(seed):
            mesh = part.mesh
            corners = mesh.vertices[mesh.faces]
            across = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
            assert mesh.vertices.shape == mesh.normals.shape == (len(mesh.uv), 3)
            assert np.all(np.isfinite(mesh.uv))
            assert np.linalg.norm(mesh.normals, axis=1) == pytest.approx(1.0, abs=1e-6)
            assert np.linalg.norm(across, axis=1).min() > 1e-14
            facing = np.einsum("nc,nc->n", across, mesh.normals[mesh.faces].sum(axis=1)) > 0
            assert facing.mean() > (0.97 if part.surface == "curtain" else 1.0 - 1e-9), part.surface


@pytest.mark.sweep
def test_parts_have_their_surface_class_and_role() -> None:
    found = set()
    for seed in range(30 if LONG else 12):
        for part in parts_of(seed):
            found.add(part.surface)
            assert CLASSES[part.ade] in SURFACES[part.surface]
            assert part.role is (Role.FIXTURE if part.surface in FIXTURES else Role.SHELL)
            assert part.instance == 0
            assert (part.wall >= 0) == (part.surface == "wall")
    assert found == set(SURFACES)


def area_of(part: Part) -> float:
    corners = part.mesh.vertices[part.mesh.faces]
    across = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    return float(np.linalg.norm(across, axis=1).sum() / 2)


@pytest.mark.sweep
def test_surfaces_have_the_plans_areas() -> None:
    for seed in range(30 if LONG else 12):
        plan = plan_of(seed)
        room = Polygon(plan.polygon)
        walls = [p for p in parts_of(seed) if p.surface == "wall"]
        assert [p.wall for p in walls] == list(range(len(plan.polygon)))
        for part in walls:
            holes = sum(o.width_m * o.height_m for o in openings_of(plan, part.wall))
            assert area_of(part) == pytest.approx(plan.wall_length_m(part.wall) * plan.height_m - holes, abs=1e-6)
            assert part.material is FINISH.wall_material(part.wall)
        floor = next(p for p in parts_of(seed) if p.surface == "floor")
        assert area_of(floor) == pytest.approx(room.area, abs=0.0025 * room.length)


def test_walls_look_into_the_room_and_their_texture_runs_from_their_start() -> None:
    for seed in range(10):
        plan = plan_of(seed)
        walls = [p for p in parts_of(seed) if p.surface == "wall"]
        assert {p.wall for p in walls} == set(range(len(plan.polygon)))
        for part in walls:
            _, inward = plan.wall_axes(part.wall)
            assert part.mesh.normals == pytest.approx(np.tile((*inward, 0.0), (len(part.mesh.normals), 1)))
            for (x, y, z), (u, v) in zip(part.mesh.vertices, part.mesh.uv, strict=True):
                assert (x, y) == pytest.approx(plan.on_wall(part.wall, u), abs=1e-6)
                assert z == pytest.approx(v)


def test_planks_lie_along_the_longest_wall() -> None:
    for seed in range(10):
        plan = plan_of(seed)
        along, _ = plan.wall_axes(max(range(len(plan.polygon)), key=plan.wall_length_m))
        level = [part for part in parts_of(seed) if part.surface in ("floor", "ceiling")]
        assert {part.surface for part in level} == {"floor", "ceiling"}
        for part in level:
            assert part.mesh.uv[:, 0] == pytest.approx(part.mesh.vertices[:, :2] @ along)
            assert np.linalg.norm(part.mesh.uv, axis=1) == pytest.approx(
                np.linalg.norm(part.mesh.vertices[:, :2], axis=1)
            )


@pytest.mark.parametrize("hinge", ["start", "end"])
@pytest.mark.parametrize("open_rad", [0.0, 0.8, 1.6])
def test_an_inward_leaf_stays_in_its_swing(hinge: str, open_rad: float) -> None:
    door = Door(1, 1.0, 0.8, 2.0, hinge, "in", open_rad)  # type: ignore[arg-type]
    plan = Plan(Use.EMPTY, SQUARE, 2.5, (), (door,))
    leaf = next(p for p in shell_parts(plan, FINISH) if p.surface == "door").mesh.vertices
    assert np.ptp(leaf[:, 2]) == pytest.approx(1.99, abs=1e-6)
    # The leaf is 4 cm thick and turns about an axis a little before the wall.
    assert shapely.distance(door_swing(door, plan), shapely.points(leaf[:, :2])).max() < 0.061
    free_edge = 2.0 - leaf[:, 0].min()
    assert free_edge == pytest.approx(0.8 * math.sin(open_rad), abs=0.06)


@pytest.mark.parametrize("hinge", ["start", "end"])
def test_an_outward_leaf_stands_in_the_hallway(hinge: str) -> None:
    door = Door(1, 1.0, 0.8, 2.0, hinge, "out", 1.5)  # type: ignore[arg-type]
    parts = shell_parts(Plan(Use.EMPTY, SQUARE, 2.5, (), (door,)), FINISH)
    leaf = next(p for p in parts if p.surface == "door").mesh.vertices
    hall = np.concatenate([p.mesh.vertices for p in parts if p.surface == "hallway"])
    assert leaf[:, 0].min() > 2.0 + door.depth_m
    assert np.all(leaf[:, :2] > hall[:, :2].min(axis=0))
    assert np.all(leaf[:, :2] < hall[:, :2].max(axis=0))


@pytest.mark.sweep
def test_fixtures_stay_in_the_room_and_skirting_leaves_doors_free() -> None:
    for seed in range(30 if LONG else 12):
        plan = plan_of(seed)
        room = Polygon(plan.polygon).buffer(0.004)
        ways = [
            Polygon(
                [
                    plan.on_wall(d.wall, d.start_m + s, y)
                    for s, y in ((0.01, -0.1), (d.width_m - 0.01, -0.1), (d.width_m - 0.01, 0.1), (0.01, 0.1))
                ]
            )
            for d in plan.doors
        ]
        fixtures = [p for p in parts_of(seed) if p.role is Role.FIXTURE]
        assert "skirting" in {p.surface for p in fixtures}
        for part in fixtures:
            x, y, z = part.mesh.vertices.T
            assert z.min() > -0.01
            assert z.max() < plan.height_m + 0.01
            if part.surface != "blind":
                assert np.all(shapely.contains_xy(room, x, y)), (seed, part.surface)
            if part.surface == "skirting":
                assert not any(np.any(shapely.contains_xy(way, x, y)) for way in ways)


@pytest.mark.parametrize("kind", ["dome lamp", "disc lamp", "pendant lamp", "spot"])
def test_a_lit_lamp_gives_light(kind: str) -> None:
    for seed in range(8):
        width, height = (0.08, 0.012) if kind == "spot" else (0.4, 0.6 if kind == "pendant lamp" else 0.1)
        lamps = [Fixture(kind, -1, 0.0, width, 2.5 - height, height, width, (1.0, 0.5), lit, seed) for lit in (0, 1)]
        dark, lit = (shell_parts(Plan(Use.EMPTY, SQUARE, 2.5, (), (), (lamp,)), FINISH) for lamp in lamps)
        assert not any(any(p.material.emission_cd_m2) for p in dark)
        shining = [p for p in lit if any(p.material.emission_cd_m2)]
        assert shining
        for part in shining:
            luminance = float(np.dot((0.2127, 0.7151, 0.0722), part.material.emission_cd_m2))
            assert 1900 < luminance < 30100
            assert part.mesh.vertices[:, :2].mean(axis=0) == pytest.approx((1.0, 0.5), abs=0.02)


def test_the_same_plan_gives_the_same_meshes() -> None:
    assert parts_of(7)
    for a, b in zip(parts_of(7), shell_parts(plan_of(7), FINISH), strict=True):
        assert np.array_equal(a.mesh.vertices, b.mesh.vertices)
        assert np.array_equal(a.mesh.faces, b.mesh.faces)

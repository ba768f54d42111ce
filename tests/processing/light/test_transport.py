"""Light against calculation, through our own scene code: furnace, integrating cube, form factors, sky in a window."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from benchmarks.light.analytic import overcast_behind_facade_lux, parallel_form_factor, perpendicular_form_factor
from processing.errors import EngineError, NoBalanceError
from processing.ground.mitsuba_variants import LLVM, SCALAR, usable_library
from processing.light.scene import tracer as tracers
from processing.light.scene.patches import patches_of
from processing.light.scene.scene import Scene, Sun, plain
from processing.light.scene.tracer import EmbreeTracer, MitsubaTracer, tracer_of
from processing.light.solver.sky import skylight
from processing.light.solver.stage import Stage
from processing.light.solver.sun import sunlight
from processing.light.solver.transport import light_map, links_of, patch_points
from tests.processing.light.rooms import box, box_room, overcast, scene_of, uniform_sky


def surface_of_patch(stage: Stage) -> np.ndarray:
    out = np.empty(stage.patches.count, int)
    for number, (columns, rows, first) in enumerate(stage.patches.grids):
        out[first : first + columns * rows] = number
    return out


@pytest.mark.parametrize("albedo", [0.2, 0.8])
def test_integrating_cube(albedo: float) -> None:
    """A cube of 4 m whose ceiling gives 10 klm: reflected light is 104.167 albedo / (1 - albedo) lx on average."""
    scene = scene_of(box_room(4, 4, 4, window=None), uniform_sky(), albedo)
    ceiling = replace(scene.surfaces[1], emission_cd_m2=plain(10_000 / 16 / math.pi))
    stage = Stage.of(replace(scene, surfaces=(scene.surfaces[0], ceiling, *scene.surfaces[2:])), 0.4)
    light = light_map(stage, 64)
    area = stage.patches.area_m2
    mean = (light.total[:, 1] * area).sum() / area.sum()
    assert area.sum() == pytest.approx(96)
    assert mean - 10_000 / 96 == pytest.approx(104.1667 * albedo / (1 - albedo), rel=0.01)


def test_white_furnace() -> None:
    """In a closed room that emits e and reflects a everywhere, radiance is e / (1 - a) everywhere, furniture too."""
    scene = scene_of(box_room(window=None), uniform_sky(), 0.6)
    glowing = tuple(replace(s, emission_cd_m2=plain(10.0)) for s in scene.surfaces)
    part = box((1, 0.5, 0.5), (0.8, 0.6, 1.0), (0.6, 0.6, 0.6), emission_cd_m2=(10.0, 10.0, 10.0))
    stage = Stage.of(Scene(glowing, (), scene.outdoors, (part,)), 0.4)
    light = light_map(stage, 32)
    there = stage.patches.area_m2 > 0
    radiance = (0.6 * light.total[there] / math.pi) + 10
    assert radiance.mean() == pytest.approx(25, rel=0.005)
    # Under the box, which stands on the floor, nothing is dark either: it glows too.
    assert np.median(np.abs(radiance / 25 - 1)) < 0.05


def test_form_factors() -> None:
    """Of a room of 5 x 4 x 2.7 m: each row sums to 1, floor to ceiling and floor to walls as the closed forms say."""
    stage = Stage.of(scene_of(box_room(window=None), uniform_sky()), 0.25)
    links = links_of(stage, patch_points(stage, 256, (1, 0)), stage.patches.normal, 256, (1, 1))
    surface = surface_of_patch(stage)
    seen = surface[links.patch[surface == 0]]
    assert (links.patch >= 0).mean() > 0.9999
    assert (seen == 1).mean() == pytest.approx(parallel_form_factor(5, 4, 2.7), rel=0.01)
    assert (seen == 2).mean() == pytest.approx(perpendicular_form_factor(4, 2.7, 5), rel=0.01)
    assert (seen == 3).mean() == pytest.approx(perpendicular_form_factor(5, 2.7, 4), rel=0.01)


def test_overcast_sky_through_an_opening() -> None:
    """Floor points before an unglazed window under the CIE overcast sky, against Walsh's closed form."""
    stage = Stage.of(scene_of(box_room(), overcast(), 0.0), 0.5)
    places = np.array([(0.0, y, 0.0) for y in (-1.5, 0.0, 1.5)], np.float32)
    points = np.repeat(places, 100, axis=0)[:, None, :]
    up = np.tile(np.float32([0, 0, 1]), (len(points), 1))
    found = skylight(stage, points, up, 16, (3,)).reshape(3, 100, 3).mean(axis=(1, 2))
    for (_, y, _), lux in zip(places, found, strict=True):
        facade = overcast_behind_facade_lux
        expected = 2 * (facade(y + 2, 1.0, 2.3) - facade(y + 2, 1.0, 0.8))
        assert lux == pytest.approx(expected, rel=0.005)


def test_sun_patch_has_the_energy_that_enters_the_window() -> None:
    direction = np.array([0.1, -0.8, 0.5])
    direction /= np.linalg.norm(direction)
    sun = Sun(tuple(direction), (80_000.0, 70_000.0, 60_000.0))
    stage = Stage.of(scene_of(box_room(), uniform_sky(0.0, sun, ground=0.0), transmittance={0: (0.8, 0.8, 0.8)}), 0.1)
    points = patch_points(stage, 16, (5,))
    light = sunlight(stage, points, stage.patches.normal, 16, (6,))
    entering = 2.0 * 1.5 * -direction[1] * 0.8 * np.array([80_000, 70_000, 60_000])
    assert (light * stage.patches.area_m2[:, None]).sum(axis=0) == pytest.approx(entering, rel=0.01)
    # One place each, with rays to the rim, gives the same for places well within and well outside.
    single = sunlight(stage, points[:, :1], stage.patches.normal, 8, (6,))
    assert np.median(np.abs(single - light)) == 0


def test_another_sky_over_the_same_links_is_what_a_fresh_map_gives() -> None:
    room = box_room()
    one, other = (Stage.of(scene_of(room, sky), 0.3) for sky in (uniform_sky(10.0), overcast(3.0, rows=64)))
    light = light_map(one, 32, seed=4)
    assert np.array_equal(light_map(other, 32, seed=4, links=light.links).total, light_map(other, 32, seed=4).total)
    assert np.array_equal(light_map(one, 32, seed=4).total, light.total)
    assert not np.array_equal(light_map(one, 32, seed=5).total, light.total)


def test_furniture_changes_no_chance_on_the_rooms_own_patches() -> None:
    scene = scene_of(box_room(), uniform_sky())
    bare, full = patches_of(scene, 0.3), patches_of(scene.furnished((box((1, 1, 0.4), (0.5, 0.5, 0.8)),)), 0.3)
    which = np.arange(bare.count)
    assert np.allclose(bare.places(which, (1,)), full.places(np.arange(full.count), (1,))[: bare.count], atol=1e-5)


def test_light_that_nothing_absorbs_is_refused() -> None:
    scene = scene_of(box_room(window=None), uniform_sky(), 1.0)
    glowing = replace(scene.surfaces[1], emission_cd_m2=plain(1.0))
    stage = Stage.of(replace(scene, surfaces=(scene.surfaces[0], glowing, *scene.surfaces[2:])), 1.0)
    with pytest.raises(NoBalanceError, match="never absorbed"):
        light_map(stage, 16)


def test_white_walls_with_a_window_settle() -> None:
    stage = Stage.of(scene_of(box_room(window=(0.1, 4.9, 0.1, 2.6)), uniform_sky(1.0), 1.0), 0.5)
    light = light_map(stage, 64).total
    assert np.isfinite(light).all()
    assert 1 < light.mean() < 10


@pytest.mark.parametrize("variant", [SCALAR, LLVM])
def test_tracers_agree(variant: str) -> None:
    if variant == LLVM and usable_library() is None:
        pytest.skip("no LLVM library of version 16 or newer is installed (Debian: libllvm19)")
    rng = np.random.default_rng(2)
    triangles = patches_of(
        scene_of(box_room(), uniform_sky()).furnished((box((1, 1, 0.4), (0.5, 0.5, 0.8)),)), 1.0
    ).triangles
    rays = rng.normal(size=(500, 3)).astype(np.float32)
    rays /= np.linalg.norm(rays, axis=1, keepdims=True)
    origins = np.tile(np.float32([0.1, 0.2, 1.5]), (500, 1))
    embree, mitsuba = EmbreeTracer(triangles), MitsubaTracer(triangles, variant)
    one, other = embree.cast(origins, rays), mitsuba.cast(origins, rays)
    assert np.allclose(one.distance_m, other.distance_m, rtol=1e-4)
    same = one.triangle == other.triangle
    assert same.mean() > 0.99
    corner, first, second = (triangles[one.triangle, k] for k in range(3))
    met = corner + one.u[:, None] * (first - corner) + one.v[:, None] * (second - corner)
    assert np.allclose(met, origins + one.distance_m[:, None] * rays, atol=1e-5), "shares and distance say one place"
    assert np.allclose(one.u[same], other.u[same], atol=1e-3)
    assert np.allclose(one.v[same], other.v[same], atol=1e-3)
    ways = rays * rng.uniform(0.5, 4.0, (500, 1)).astype(np.float32)
    free = embree.free(origins, ways)
    assert 0.1 < free.mean() < 0.9
    assert (free == mitsuba.free(origins, ways)).mean() > 0.99


def test_a_triangle_without_area_is_no_hit_and_a_ray_that_leaves_has_no_place() -> None:
    flat = np.array([[[0, 0, 1], [1, 0, 1], [2, 0, 1]], [[-1, -1, 2], [1, -1, 2], [0, 1, 2]]], np.float32)
    found = EmbreeTracer(flat).cast(np.zeros((2, 3), np.float32), np.array([[0, 0, 1], [0, 0, -1]], np.float32))
    assert found.triangle.tolist() == [1, -1]
    assert found.distance_m.tolist() == [2.0, np.inf]
    assert np.isfinite([found.u, found.v]).all()


def test_without_embree_and_llvm_the_error_says_what_to_do(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(tracers, "find_spec", lambda name: None)
    monkeypatch.setattr(tracers, "usable_variant", lambda: SCALAR)
    monkeypatch.setattr(tracers, "usable_library", lambda: None)
    triangles = np.eye(3, dtype=np.float32)[None]
    with pytest.raises(EngineError, match="no ray tracer works here"):
        tracer_of(triangles)
    monkeypatch.setenv("DAYLIT_RENDERER", "llvm")
    with pytest.raises(EngineError, match="no LLVM library works here") as caught:
        tracer_of(triangles)
    assert "DAYLIT_RENDERER=scalar" in caught.value.advice
    monkeypatch.setenv("DAYLIT_RENDERER", "scalar")
    assert isinstance(tracer_of(triangles), MitsubaTracer)

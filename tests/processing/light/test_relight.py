"""Stored rays: another light gives what a direct render gives; the ends; what is kept on disk."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from processing.errors import ParameterError, RelightError
from processing.light.picture.relight_photo import relit_photograph, veil_gains
from processing.light.picture.render import render
from processing.light.scene.scene import Outdoors, Sun, plain
from processing.light.solver.basis import basis_of, read_basis, write_basis
from processing.light.solver.irradiance import Effort
from processing.light.solver.relight import RelightView
from processing.light.solver.sight import GLASS, sight_of
from processing.light.solver.sky import SKY_CELLS, sky_cell, sky_values
from processing.light.solver.stage import Stage
from processing.light.solver.transport import settle
from processing.sphere import Equirectangular, Perspective
from processing.sphere.views import cut_view
from processing.surfaces.maps import FIRST_WALL, planes_of
from tests.processing.light.rooms import EYE, box, box_room, scene_of, uniform_sky
from tests.processing.surfaces.rooms import ELL, model, window

ROWS = 40
SMALL = Effort(texel_m=0.25, rows=ROWS, pixel_samples=64, patch_samples=64, sun_samples=32)
LONG = Effort(texel_m=0.25, patch_samples=128, rows=ROWS, pixel_samples=96, sun_samples=32, clean=False)
TABLE = box((1.2, 0.8, 0.4), (0.8, 0.8, 0.8))
DARK = Outdoors(np.zeros((16, 32, 3), np.float32))


def sun_at(x: float, y: float, z: float, lux: float = 7e4) -> Sun:
    direction = np.array([x, y, z]) / np.linalg.norm([x, y, z])
    return Sun(tuple(float(v) for v in direction), (lux, lux, lux))


@pytest.fixture(scope="module")
def view() -> RelightView:
    stage = Stage.of(scene_of(box_room(), DARK, 0.5, reveal_m=0.2).furnished((TABLE,)), SMALL.texel_m)
    return RelightView(stage, basis_of(stage, EYE, effort=SMALL), ROWS)


@pytest.mark.parametrize(
    "light",
    [uniform_sky(4000.0), uniform_sky(1500.0, sun_at(0.2, -0.8, 0.6))],
    ids=["even sky", "sun"],
)
def test_another_light_is_what_a_render_shows(view, light) -> None:
    found = view.relit(light)
    truth = render(view.stage.scene.under(light), Equirectangular(2 * ROWS, ROWS), EYE, effort=LONG, seed=4).rgb
    solid = view.full.solid.reshape(ROWS, 2 * ROWS)
    ratio = found.rgb[solid].sum(axis=1) / truth[solid].sum(axis=1)
    assert np.median(np.abs(ratio - 1)) < 0.06
    assert found.rgb[solid].sum() == pytest.approx(truth[solid].sum(), rel=0.015)
    assert 0 < found.error < 0.1
    glass = (view.full.label == GLASS).reshape(ROWS, 2 * ROWS)
    assert np.array_equal(found.rgb[glass], truth[glass])


def test_light_is_linear_and_the_same_light_gives_the_same_picture(view) -> None:
    one = view.relit(uniform_sky(1000.0)).rgb
    three = view.relit(uniform_sky(3000.0)).rgb
    assert three == pytest.approx(3 * one, rel=1e-3)
    assert np.array_equal(one, view.relit(uniform_sky(1000.0)).rgb)


def test_no_light_is_black_and_a_fierce_sun_is_finite(view) -> None:
    assert not view.relit(DARK).rgb.any()
    fierce = view.relit(Outdoors(np.full((8, 16, 3), 1e9, np.float32), sun_at(0, -0.7, 0.7, 1e9))).rgb
    assert np.isfinite(fierce).all()
    assert (fierce >= 0).all()


def test_the_sun_lies_where_geometry_says(view) -> None:
    # The window is at y = -2.2, 0.8 to 2.3 m high, x from -1 to 1; the sun 45 degrees high behind it.
    found = view.relit(uniform_sky(100.0, sun_at(0, -1, 1)))
    lit = (found.sun.sum(axis=2) > 0).ravel()
    point = view.full.point[lit]
    floor = point[np.abs(point[:, 2]) < 0.01]
    assert len(floor) > 20
    assert floor[:, 1].min() > -1.4 - 0.05
    assert floor[:, 1].max() < 0.1 + 0.05
    assert np.abs(floor[:, 0]).max() < 1.05
    assert not view.relit(uniform_sky(100.0, sun_at(0, 1, 1))).sun.any()


def test_larger_pictures_show_the_same_light(view) -> None:
    large = RelightView(view.stage, view.basis, 2 * ROWS)
    light = uniform_sky(2000.0)
    small, full = view.relit(light).rgb, large.relit(light).rgb
    assert full.shape == (2 * ROWS, 4 * ROWS, 3)
    assert np.median(full) == pytest.approx(np.median(small), rel=0.03)


def test_a_view_shows_what_the_panorama_shows_there(view) -> None:
    frame = Perspective(96, 64, np.radians(80), yaw_rad=np.radians(170), pitch_rad=-0.2)  # across the seam
    light = uniform_sky(1500.0, sun_at(0.2, -0.8, 0.6))
    found = RelightView(view.stage, view.basis, frame).relit(light)
    assert found.rgb.shape == (64, 96, 3)
    whole = RelightView(view.stage, view.basis, 4 * ROWS).relit(light)
    cut = cut_view(whole.rgb, frame)
    apart = np.abs(found.rgb - cut).sum(axis=2) / cut.sum(axis=2)
    assert np.median(apart) < 0.02
    assert np.quantile(apart, 0.9) < 0.1


def test_lamps_stay_in_every_light(view) -> None:
    bare = scene_of(box_room(), DARK, 0.5)
    ceiling = replace(bare.surfaces[1], emission_cd_m2=plain(200.0))
    stage = Stage.of(replace(bare, surfaces=(bare.surfaces[0], ceiling, *bare.surfaces[2:])), SMALL.texel_m)
    few = replace(SMALL, rows=16, clean=False)
    at_night = RelightView(stage, basis_of(stage, EYE, effort=few), 16).relit(DARK)
    solid = at_night.irradiance.sum(axis=2) > 0
    # A luminous ceiling of 200 cd/m2: the floor under it has at most pi times that, and with bounces about half.
    assert 200 < np.median(at_night.irradiance[solid]) < 700


def test_basis_on_disk(view, tmp_path) -> None:
    path = tmp_path / "basis.npz"
    write_basis(path, view.basis)
    again = RelightView(view.stage, read_basis(path), ROWS)
    light = uniform_sky(1000.0, sun_at(0, -1, 1))
    assert np.array_equal(again.relit(light).rgb, view.relit(light).rgb)
    rays = (view.basis.pixel_sky, view.basis.patch_sky, view.basis.pixel_links, view.basis.patch_links)
    assert path.stat().st_size < 2 * sum(array.nbytes for part in rays for array in part)
    path.write_bytes(path.read_bytes()[:1000])
    with pytest.raises(RelightError, match="not a light basis"):
        read_basis(path)
    other = Stage.of(scene_of(box_room(), DARK, 0.4), SMALL.texel_m)
    with pytest.raises(RelightError, match="another scene"):
        RelightView(other, view.basis, ROWS)
    with pytest.raises(ParameterError):
        basis_of(other, EYE, effort=Effort(rows=1))
    with pytest.raises(ParameterError, match="one round"):
        basis_of(other, EYE, effort=replace(SMALL, max_error=0.1))


def test_a_room_without_windows_and_too_large_a_basis() -> None:
    few = replace(SMALL, rows=16, pixel_samples=8)
    stage = Stage.of(scene_of(box_room(window=None), DARK, 0.5), 0.5)
    assert (
        not RelightView(stage, basis_of(stage, EYE, effort=few), 16).relit(uniform_sky(5e3, sun_at(0, -1, 1))).rgb.any()
    )
    with pytest.raises(RelightError, match="GiB"):
        basis_of(stage, EYE, effort=Effort(rows=2048))


def test_cells_of_the_sky(view) -> None:
    rays = np.array([[0, 1, 0], [0, -1, 1e-3], [0, 0, 1], [0, 0, -1], [1, 0, 0]], np.float32)
    cells = sky_cell(rays)
    assert cells.max() < SKY_CELLS
    grid = np.zeros((128, 256, 3), np.float32)
    grid[:64] = 7.0
    values = sky_values(Outdoors(grid), view.stage.scene.panes)
    assert values[cells[2], 0] == 7
    assert values[cells[3], 0] == 0


def test_photograph_keeps_its_detail_and_loses_a_sun_that_was_removed(view) -> None:
    lights = uniform_sky(1000.0, sun_at(0, -1, 1)), uniform_sky(500.0)
    before, after = (view.relit(light) for light in lights)
    sunless = before.rgb - view.albedo.reshape(before.sun.shape) * before.sun / np.float32(np.pi)
    grain = np.where(np.indices(sunless.shape[:2]).sum(axis=0) % 2, 1.1, 0.9)[..., None].astype(np.float32)
    glass = (view.full.label == GLASS).reshape(ROWS, 2 * ROWS)
    photograph = np.where(glass[..., None], before.rgb, sunless * grain).astype(np.float32)
    found = relit_photograph(photograph, view, before, after, lights)
    assert found.rgb[~glass] == pytest.approx((after.rgb * grain)[~glass], rel=1e-4)
    # Within a cell of the coarse sky the horizon is sky and ground in one.
    away = glass & (np.abs(view.full.rays[:, 2]).reshape(glass.shape) > 0.1)
    assert away.sum() > 50
    assert found.rgb[away] == pytest.approx(after.rgb[away], rel=1e-3)
    assert (found.detail == 1).all()
    # A thing that the scene does not have keeps no detail: the scene shows there.
    strange = photograph.copy()
    strange[25, 8] *= 20
    assert relit_photograph(strange, view, before, after, lights).rgb[25, 8] == pytest.approx(after.rgb[25, 8])


def test_what_is_finer_than_the_scene_keeps_its_look(view) -> None:
    large = RelightView(view.stage, view.basis, 3 * ROWS)
    lights = (uniform_sky(1000.0), uniform_sky(3000.0))
    before, after = (large.relit(light) for light in lights)
    photograph = before.rgb.copy()
    photograph[60, 10:20] *= 4
    photograph[30:39, 30:39] *= 4
    found = relit_photograph(photograph, large, before, after, lights).rgb / after.rgb
    assert (found[60, 11:19] > 2.5).all()  # a sill, a cord
    assert found[34, 34] == pytest.approx(1)  # a thing as large as what the scene would have
    assert found[80, 10:20] == pytest.approx(1, rel=1e-4)


def test_what_covers_windows_follows_the_light_on_them(view) -> None:
    gains = veil_gains(view.stage.scene, uniform_sky(1000.0), uniform_sky(3000.0))
    assert gains == pytest.approx([3.0], rel=1e-4)
    before = uniform_sky(1000.0, ground=0.0)
    south, north = (
        veil_gains(view.stage.scene, before, uniform_sky(1000.0, sun_at(0, y, 1), ground=0.0)) for y in (-1, 1)
    )
    assert south[0] > 10
    assert north[0] == pytest.approx(1.0)


@pytest.mark.parametrize("wall", range(6))
def test_curtains_follow_the_light_outside_their_own_wall_in_a_room_with_a_corner(wall: int) -> None:
    room = model(ELL, openings=[window(wall, 0.3, 0.9)])
    scene, dark = scene_of(room, DARK, reveal_m=0.1), uniform_sky(1000.0, ground=0.0)
    outwards = -planes_of(room)[FIRST_WALL + wall].normal
    for side, least, most in ((1, 10.0, 1e3), (-1, 0.99, 1.01)):
        (gain,) = veil_gains(scene, dark, replace(dark, sun=sun_at(*(side * outwards[:2]), 0.5)))
        assert least < gain < most


def test_light_settles_as_bounce_by_bounce(view) -> None:
    met, albedo = view.basis.patch_links.patch, view.stage.albedo
    first = np.random.default_rng(3).uniform(0, 100, (len(albedo), 3))
    found = first.copy()
    assert settle(met, albedo, first, found, 200, 1e-6)
    wanted, more = first.copy(), first
    for _ in range(200):
        more = np.where((met >= 0)[..., None], (albedo * more)[met], 0).mean(axis=1)
        wanted += more
    assert found == pytest.approx(wanted, rel=1e-4)
    assert not settle(met, np.ones_like(albedo), first, first.copy(), 1, 1e-6)


def test_a_way_is_free_where_a_ray_goes_as_far(view) -> None:
    stage, rng = view.stage, np.random.default_rng(4)
    from_, to = (rng.uniform((-2.4, -1.9, 0.1), (2.4, 1.9, 2.6), (400, 3)).astype(np.float32) for _ in range(2))
    way = to - from_
    far = np.linalg.norm(way, axis=1)
    wanted = stage.tracer.cast(from_, way / far[:, None]).distance_m > far
    found = stage.tracer.free(from_, way)
    assert (found == wanted).mean() > 0.99
    assert 0.5 < found.mean() < 1
    assert not len(stage.tracer.free(way[:0], way[:0]))


def test_glass_that_lets_through_less_at_an_angle() -> None:
    scene = scene_of(box_room(), DARK, 0.5, reveal_m=0.2)
    glazed = replace(scene, panes=tuple(replace(p, transmittance=(0.8, 0.8, 0.8), sheets=2) for p in scene.panes))
    light = uniform_sky(1500.0, sun_at(0.5, -0.5, 0.7))
    stage = Stage.of(glazed, SMALL.texel_m)
    found = RelightView(stage, basis_of(stage, EYE, effort=SMALL), ROWS).relit(light)
    truth = render(glazed.under(light), Equirectangular(2 * ROWS, ROWS), EYE, effort=LONG, seed=4).rgb
    solid = sight_of(stage, Equirectangular(2 * ROWS, ROWS), EYE).solid.reshape(ROWS, 2 * ROWS)
    ratio = found.rgb[solid].sum(axis=1) / truth[solid].sum(axis=1)
    assert np.median(np.abs(ratio - 1)) < 0.05
    assert found.rgb[solid].sum() == pytest.approx(truth[solid].sum(), rel=0.03)

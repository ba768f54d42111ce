"""Irradiance from a small picture to a large one, sizes of textures, windows found in pictures."""

from __future__ import annotations

import subprocess
import sys
from dataclasses import replace

import cv2
import numpy as np
import pytest

from benchmarks.light.render_scenes import sky_outdoors
from processing.layout.furniture.model import Material
from processing.layout.furniture.soft import hanging
from processing.layout.furniture.solids import part_of
from processing.light.picture.render import finer, small_geometry
from processing.light.scene.outdoor import without_sun
from processing.light.scene.room_light import gloss_factor
from processing.light.scene.scene import Sun
from processing.light.solver.irradiance import (
    Effort,
    Irradiance,
    Leanings,
    Lights,
    denoiser_available,
    evened,
    gathered,
    irradiance_of,
)
from processing.light.solver.sight import FIRST_PART, sight_of
from processing.light.solver.stage import Stage, area_means
from processing.light.solver.upsample import Places, Steps, upsampled
from processing.sphere import Equirectangular, directions, solid_angles
from processing.stages.furnishing import scene_parts
from tests.processing.light.rooms import EYE, box, box_room, scene_of, uniform_sky


def test_each_surface_keeps_its_own_light_however_near_the_edge() -> None:
    stage = Stage.of(scene_of(box_room(), uniform_sky()), 1.0)
    small, large = (sight_of(stage, Equirectangular(2 * rows, rows), EYE) for rows in (24, 100))
    values = np.repeat(small.label.reshape(*small.shape, 1), 3, axis=2).astype(np.float32)
    found, missed = upsampled(values, small, large, wraps=True)
    right = large.solid & ~missed
    assert missed[large.solid].mean() < 0.01
    assert found[right, 0] == pytest.approx(large.label[right])


def test_a_bevel_has_no_light_of_its_face_unless_any_will_do() -> None:
    """A bevel of 45 degrees took turns in its own light and its face's, and was in dashes."""
    stage = Stage.of(scene_of(box_room(), uniform_sky(), 0.5).furnished((box((0, 1.5, 1.4), (1, 1, 1)),)), 1.0)
    small = sight_of(stage, Equirectangular(64, 32), EYE)
    face = np.flatnonzero((small.label == FIRST_PART) & (small.normal[:, 1] < -0.99))
    turned = small.normal.copy()
    turned[face] = np.float32([0, -1, 1]) / np.sqrt(np.float32(2))
    bevel, values = replace(small, normal=turned), np.ones((*small.shape, 3), np.float32)
    wanted = np.isin(np.arange(len(small.label)), face)
    assert upsampled(values, small, bevel, wraps=True, among=wanted)[1][face].all()
    assert not upsampled(values, small, small, wraps=True, among=wanted)[1].any()
    steps = Steps.of(small, bevel, wanted, Places.whole(small.shape), wraps=True, any_solid=True)
    assert (steps.apply(values)[face] > 0.99).all()


def test_a_change_of_light_is_evened_out_along_surfaces_and_keeps_its_edges() -> None:
    geometry, rng = Equirectangular(256, 128), np.random.default_rng(0)
    sight = sight_of(Stage.of(scene_of(box_room(), uniform_sky()), 0.5), geometry, EYE)
    label, known = sight.label.reshape(sight.shape), sight.solid.reshape(sight.shape)
    before = rng.uniform(50, 500, (*sight.shape, 3)).astype(np.float32)
    # Each surface has a change of its own, and behind the camera, across the seam, half of the light is gone.
    shade = np.abs(np.arange(256) - 127.5) > 100
    true = np.exp(0.1 * label - np.where(shade, 1.5, 0))[..., None]
    noisy = (before * true * np.exp(rng.normal(0, 0.05, before.shape))).astype(np.float32)
    even = evened(noisy, before, sight, known)
    off = np.abs(np.log(even / (before * true)))[known]
    assert np.sqrt(np.mean(off**2)) < 0.02
    assert np.quantile(off, 0.999) < 0.1, "neither edges of surfaces nor of shade are washed out"
    assert np.array_equal(even[~known], noisy[~known])
    assert np.array_equal(evened(before, before, sight, known), before), "what is equal stays equal"


def test_a_surface_s_ends_have_the_change_of_light_that_is_further_in_but_beside_furniture() -> None:
    """The denoiser carries light over ends of surfaces, to one of two pictures more than to the other."""
    geometry = Equirectangular(256, 128)
    sight = sight_of(Stage.of(scene_of(box_room(), uniform_sky()), 0.5), geometry, EYE)
    label = sight.label.reshape(sight.shape).copy()
    label[60:75, 100:120] = FIRST_PART
    sight = replace(sight, label=label.ravel())
    room = np.where(label < FIRST_PART, label, -9)
    ends, beside = np.zeros((2, *label.shape), bool)
    for axis, shift in (
        (0, 1),
        (0, -1),
        (1, 1),
        (1, -1),
        (0, 2),
        (0, -2),
    ):  # of one row, dots were left where rows cross it
        near = np.roll(label, shift, axis)
        ends |= (label < FIRST_PART) & (near < FIRST_PART) & (near != label)
        beside |= (label < FIRST_PART) & (near == FIRST_PART)
    ends[[0, 1, -2, -1]] = False
    before = np.full((*sight.shape, 3), 100, np.float32)
    after = before * np.where(ends | beside, 0.3, 1.2)[..., None].astype(np.float32)
    ratio = evened(after, before, sight, (label >= 0))[..., 0] / 100
    assert np.abs(ratio[ends & (room >= 0) & ~beside] - 1.2).max() < 0.05
    assert np.median(ratio[beside & ~ends]) < 0.6


def test_the_shade_beside_furniture_stays_as_deep_as_it_was_gathered() -> None:
    """It is narrower than what blotches are evened out over: a third of it was gone."""
    sight = sight_of(Stage.of(scene_of(box_room(), uniform_sky()), 0.5), Equirectangular(256, 128), EYE)
    label = sight.label.reshape(sight.shape).copy()
    floor = label == label[100, 100]
    label[90:100, 100:120] = FIRST_PART
    near = cv2.dilate((label == FIRST_PART).astype(np.uint8), np.ones((5, 5), np.uint8)) > 0
    shade, plain = (
        near & floor & (label < FIRST_PART),
        floor & ~(cv2.dilate(near.astype(np.uint8), np.ones((9, 9))) > 0),
    )
    rng = np.random.default_rng(0)
    before = np.full((*sight.shape, 3), 100, np.float32)
    noisy = np.exp(rng.normal(0, 0.05, sight.shape))[..., None]
    after = (before * np.where(shade, 0.8, 1)[..., None] * noisy).astype(np.float32)
    ratio = evened(after, before, replace(sight, label=label.ravel()), (label >= 0))[..., 0] / 100
    assert ratio[shade].mean() == pytest.approx(0.8, abs=0.03)
    assert np.std(ratio[plain]) < 0.015, "while noise further off still goes"


def test_light_on_furniture_keeps_what_is_narrower_than_a_pixel_of_the_room() -> None:
    shelf = [box((1.5, 1.0, 0.2 + 0.25 * k), (0.6, 0.8, 0.04)) for k in range(6)]
    room = scene_of(box_room(), uniform_sky(), 0.5, reveal_m=0.2).furnished(tuple(shelf))
    stage, effort, size = Stage.of(room, 0.2), Effort(texel_m=0.2, rows=48, pixel_samples=16), Equirectangular(512, 256)
    small, large = (sight_of(stage, one, EYE) for one in (small_geometry(size, effort.rows), size))
    furniture, places = np.flatnonzero(large.label >= FIRST_PART), Places.whole(large.shape)
    lights: Lights = {}
    coarse = irradiance_of(stage, small, effort, 2, wraps=True, lights=lights)
    found = irradiance_of(stage, small, effort, 2, wraps=True, lights=lights, fine=finer(stage, size, EYE, effort))
    where = large.point[furniture], large.normal[furniture]
    truth = gathered(stage, next(iter(lights.values())), *where, 256, 9)[:, 1]

    def error(of: Irradiance) -> float:
        light, missed = of.enlarged(small, large, places, wraps=True)
        shown = ~missed[furniture]
        return float(np.percentile(np.abs(light[furniture, 1] / truth - 1)[shown], 95))

    assert error(found) < 0.6 * error(coarse)
    solid = large.solid & (large.label < FIRST_PART)
    light = [of.enlarged(small, large, places, wraps=True)[0][solid] for of in (found, coarse)]
    assert np.array_equal(*light), "the room's light is the same"
    assert finer(stage, size, EYE, replace(effort, clean=False)) is None


def test_light_on_creased_cloth_keeps_its_creases(monkeypatch: pytest.MonkeyPatch) -> None:
    """Creases narrower than a pixel or what its light is smoothed over were lost: cloth looked moulded."""
    made = hanging(1.4, 1.4, 0.2, 0.05, foot_drop_m=0.2).moved(0.0, 0.8, 0.6)
    cloth = scene_parts((part_of(made, Material("cloth", (0.6, 0.6, 0.6))),), "bed")
    room = scene_of(box_room(), uniform_sky(), 0.5, reveal_m=0.2).furnished(cloth)
    stage, effort, size = Stage.of(room, 0.2), Effort(texel_m=0.2, rows=48, pixel_samples=16), Equirectangular(768, 384)
    small, large = (sight_of(stage, one, EYE) for one in (small_geometry(size, effort.rows), size))
    cloths, places = np.flatnonzero(large.label >= FIRST_PART), Places.whole(large.shape)

    def error() -> tuple[float, float]:
        lights: Lights = {}
        fine = finer(stage, size, EYE, effort)
        found = irradiance_of(stage, small, effort, 2, wraps=True, lights=lights, fine=fine)
        where = large.point[cloths], large.normal[cloths]
        truth = gathered(stage, next(iter(lights.values())), *where, 256, 9)[:, 1]
        light, missed = found.enlarged(small, large, places, wraps=True)
        shown = ~missed[cloths]
        ratio = (light[cloths, 1] / truth)[shown]
        return float(np.std(np.log(ratio))), float(light[cloths, 1][shown].mean() / truth[shown].mean())

    spread, level = error()
    monkeypatch.setattr(Leanings, "fitted", lambda *_: Leanings({}))
    assert spread < 0.9 * error()[0]
    assert level == pytest.approx(1, abs=0.02)


def test_area_means_keep_the_mean() -> None:
    texture = np.random.default_rng(3).random((7, 11, 3)).astype(np.float32)
    for rows, columns in ((1, 1), (3, 4), (20, 30)):
        assert area_means(texture, rows, columns).mean(axis=(0, 1)) == pytest.approx(
            texture.mean(axis=(0, 1)), rel=1e-6
        )


def test_the_sun_is_taken_out_of_the_sky_with_all_its_energy() -> None:
    geometry = Equirectangular(256, 128)
    rays, _ = directions(geometry)
    area = solid_angles(geometry)
    rgb = np.full((128, 256, 3), 5000.0)
    rgb[30, 40] += np.array([9e4, 8e4, 7e4]) / area[30, 40]
    rest, sun = without_sun(rgb, rays, area)
    assert sun is not None
    assert sun.normal_illuminance_lx == pytest.approx((9e4, 8e4, 7e4), rel=1e-6)
    assert np.array(sun.direction) == pytest.approx(rays[30, 40], abs=1e-6)
    assert rest == pytest.approx(5000)
    assert without_sun(rest, rays, area)[1] is None


def test_an_overexposed_disc_is_a_sun_however_little_it_shows() -> None:
    geometry = Equirectangular(256, 128)
    rays, area = directions(geometry)[0], solid_angles(geometry)
    rgb, clipped = np.full((128, 256, 3), 500.0), np.zeros((128, 256), bool)
    rgb[30, 40], clipped[30, 40] = 2e5, True
    assert without_sun(rgb, rays, area)[1] is None, "of what is measured, 100 lx are no sun"
    sun = without_sun(rgb, rays, area, clipped)[1]
    assert sun is not None
    assert sun.clipped
    # Its colour is cut as well: it gets the sun's.
    assert np.dot(sun.normal_illuminance_lx, (0.2127, 0.7151, 0.0722)) == pytest.approx(2e5 * area[30, 40], rel=0.01)
    rgb[30, 40] = 2e8
    known = without_sun(rgb, rays, area, np.zeros_like(clipped))[1]
    assert known is not None
    assert not known.clipped


def test_a_sun_of_one_filter_s_colour_keeps_its_light_and_gets_the_sun_s_colour() -> None:
    """As through a mosaic of colour filters: nothing of it is blue; low suns are redder."""
    geometry = Equirectangular(256, 128)
    rays, area = directions(geometry)[0], solid_angles(geometry)
    redness = []
    for row in (30, 58):
        rgb = np.full((128, 256, 3), 500.0)
        rgb[row, 40] += np.array([9e4, 8e4, 0]) / area[row, 40]
        sun = without_sun(rgb, rays, area)[1]
        assert sun is not None
        red, green, blue = sun.normal_illuminance_lx
        assert 0.2127 * red + 0.7151 * green + 0.0722 * blue == pytest.approx(0.2127 * 9e4 + 0.7151 * 8e4, rel=0.01)
        assert red > green > blue > 0.3 * green
        redness.append(red / blue)
    assert redness[1] > 1.3 * redness[0]


def test_ground_below_the_horizon_reflects_sky_and_sun() -> None:
    sun = Sun((0.0, 0.0, 1.0), (3e4, 3e4, 3e4))
    found = sky_outdoors(lambda rays: np.full(rays.shape, 1000.0), rows=64, ground_albedo=0.3, sun=sun)
    assert found.rgb[:32] == pytest.approx(1000)
    assert found.rgb[32:] == pytest.approx(0.3 / np.pi * (np.pi * 1000 + 3e4), rel=1e-3)


def test_gloss_is_detected_where_it_is_and_not_where_it_is_not() -> None:
    rng = np.random.default_rng(5)
    mirror = np.repeat(rng.uniform(0.03, 0.4, (3000, 1)), 3, axis=1)
    pattern = np.repeat(rng.choice([0.2, 0.3], (3000, 1)), 3, axis=1)
    every = np.ones(3000, bool)
    assert gloss_factor(pattern + 0.6 * mirror, mirror, every) == pytest.approx(0.6, abs=0.15)
    assert gloss_factor(pattern, mirror, every) == 0
    assert gloss_factor(pattern[:50], mirror[:50], every[:50]) == 0


DENOISED = """
import os
from pathlib import Path
import numpy as np
from processing.ground.threads import give_back
from processing.light.solver.irradiance import denoised
def resident_bytes():
    return int(Path("/proc/self/statm").read_text().split()[1]) * os.sysconf("SC_PAGE_SIZE")
noisy = np.random.default_rng(2).uniform(0.5, 1.5, (256, 512, 3)).astype(np.float32)
normal, near = np.zeros_like(noisy) + np.float32([0, 0, 1]), np.full(noisy.shape[:2], 0.5, np.float32)
denoised(noisy[:32, :64], normal[:32, :64], near[:32, :64], wraps=True)  # what is loaded on first use
give_back()
before = resident_bytes()
clean = denoised(noisy, normal, near, wraps=True)
give_back()
print(resident_bytes() - before, clean.std() / noisy.std(), clean.mean() / noisy.mean())
"""


@pytest.mark.skipif(not denoiser_available(), reason="no denoiser is installed here")
def test_the_denoiser_keeps_no_memory_for_its_next_use() -> None:
    """In a process of its own: other tests' freed memory is taken and given back meanwhile."""
    done = subprocess.run([sys.executable, "-c", DENOISED], capture_output=True, text=True, timeout=120, check=True)
    kept_bytes, noise, mean = map(float, done.stdout.split())
    assert kept_bytes < 40e6, "its working memory is 130 MB at this size"
    assert noise < 0.3
    assert mean == pytest.approx(1, rel=1e-3)

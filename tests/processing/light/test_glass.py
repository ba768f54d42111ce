"""Clear glass at an angle: Fresnel's limits, the table, and daylight through a glazed opening against quadrature."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from benchmarks.light.analytic import through_opening_lux, uniform
from processing.errors import MaterialError
from processing.light.scene.scene import INDEX, TABLE, Sun, transmittance_at, transmittance_table
from processing.light.scene.scene_file import read_scene, write_scene
from processing.light.solver.sight import GLASS, seen_outdoors, sight_of
from processing.light.solver.sky import skylight
from processing.light.solver.stage import Stage
from processing.light.solver.sun import sunlight
from processing.sphere import Equirectangular
from tests.processing.light.rooms import EYE, box_room, scene_of, uniform_sky

HEAD_ON = (0.75, 0.8, 0.7)


def glazed(sheets: int, sky=None):
    sky = uniform_sky(ground=0.0) if sky is None else sky
    return scene_of(box_room(), sky, transmittance={0: HEAD_ON}, sheets=sheets)


def test_head_on_is_what_was_given_and_along_the_glass_nothing_passes() -> None:
    for sheets in (1, 2, 3):
        found = transmittance_at(np.array([1.0, 0.0]), HEAD_ON, sheets)
        assert found[0] == pytest.approx(HEAD_ON)
        assert found[1] == pytest.approx((0, 0, 0), abs=1e-12)
        falling = transmittance_at(np.linspace(1, 0, 50), HEAD_ON, sheets)
        assert (np.diff(falling, axis=0) < 1e-12).all()


def test_one_face_reflects_as_fresnel_says() -> None:
    # Without absorption one sheet passes (1 - r) / (1 + r); at Brewster's angle one polarisation passes whole.
    most = 2 * INDEX / (INDEX**2 + 1)
    brewster = math.cos(math.atan(INDEX))
    cos_in = math.sqrt(1 - (1 - brewster**2) / INDEX**2)
    r = ((brewster - INDEX * cos_in) / (brewster + INDEX * cos_in)) ** 2
    found = transmittance_at(np.array([brewster]), (most, most, most), 1)
    assert found[0, 0] == pytest.approx((1 + (1 - r) / (1 + r)) / 2, rel=1e-9)


def test_the_table_is_the_formula() -> None:
    cosine = np.linspace(0, 1, 1000)
    table = transmittance_table(HEAD_ON, 2)
    assert table.shape == (TABLE, 3)
    between = np.interp(cosine, np.linspace(0, 1, TABLE), table[:, 0])
    assert between == pytest.approx(transmittance_at(cosine, HEAD_ON, 2)[:, 0], abs=5e-4)
    assert transmittance_table(HEAD_ON, 0) == pytest.approx(np.array([HEAD_ON]))


@pytest.mark.parametrize("sheets", [0, 1, 2])
def test_daylight_through_glass_is_that_of_quadrature(sheets: int) -> None:
    stage = Stage.of(glazed(sheets), 0.5)
    opening = ((-1.0, -2.0, 0.8), (2.0, 0.0, 0.0), (0.0, 0.0, 1.5))

    def glass(cosine: np.ndarray) -> np.ndarray:
        if not sheets:
            return np.full(cosine.shape, HEAD_ON[1])
        return transmittance_at(cosine.ravel(), HEAD_ON, sheets)[:, 1].reshape(cosine.shape)

    def sky(sine: np.ndarray) -> np.ndarray:
        return np.where(sine > 0, 1000 * uniform(sine), 0)

    up = np.tile(np.float32([0, 0, 1]), (100, 1))
    for place in ((0.0, -1.5, 0.0), (2.0, -1.8, 0.0), (0.0, 1.5, 0.0)):
        many = np.tile(np.float32([[place]]), (100, 1, 1))
        wanted = through_opening_lux(place, (0, 0, 1), opening, sky, glass)
        assert skylight(stage, many, up, 128, (0, 1))[:, 1].mean() == pytest.approx(wanted, rel=0.01)


def test_the_sun_and_the_eye_look_through_the_same_glass() -> None:
    sun = Sun((0.0, -0.6, 0.8), (1e5, 1e5, 1e5))
    stage = Stage.of(glazed(1, uniform_sky(sun=sun, ground=0.2)), 0.5)
    place, up = np.float32([[[0.0, -1.2, 0.0]]]), np.float32([[0, 0, 1]])
    passed = transmittance_at(np.array([0.6]), HEAD_ON, 1)[0]
    assert sunlight(stage, place, up, 16, (0, 2))[0] == pytest.approx(8e4 * passed, rel=2e-3)
    sight = sight_of(stage, Equirectangular(64, 32), EYE)
    there = (sight.label == GLASS) & (sight.rays[:, 2] > 0.15)
    seen = transmittance_at(-sight.rays[there, 1].astype(float), HEAD_ON, 1) * 1000
    assert seen_outdoors(stage, sight)[there] == pytest.approx(seen, rel=2e-3)


def test_a_scene_file_keeps_glass_and_nonsense_is_refused(tmp_path) -> None:
    scene = glazed(2)
    write_scene(tmp_path / "scene.npz", scene)
    assert read_scene(tmp_path / "scene.npz").panes[0].sheets == 2
    with pytest.raises(MaterialError):
        replace(scene.panes[0], sheets=9)

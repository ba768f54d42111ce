"""Finishes are the same for the same seed, physical, and as frequent as said; colours are the means of patterns."""

from __future__ import annotations

from dataclasses import fields

import numpy as np
import pytest

from mocks.rooms import finish as finish_module
from mocks.rooms.finish import STYLES, draw_finish, draw_floor, linear, plain, scaled, turned, veneer
from mocks.rooms.model import Finish, Material, Use
from mocks.rooms.textures.catalogue import tile
from tests.conftest import LONG

pytestmark = pytest.mark.sweep


def finish_of(seed: int, use: Use = Use.LIVING) -> Finish:
    return draw_finish(np.random.default_rng([seed, 9]), use)


def materials_of(finish: Finish) -> list[Material]:
    return [m for m in (getattr(finish, f.name) for f in fields(finish)) if isinstance(m, Material)]


def reflectance(material: Material) -> float:
    return float(np.dot(material.colour, (0.2127, 0.7151, 0.0722)))


@pytest.fixture(scope="module")
def finishes() -> list[Finish]:
    return [finish_of(seed, list(Use)[seed % 5]) for seed in range(35 if LONG else 20)]


@pytest.fixture(scope="module")
def floors() -> list[Material]:
    rng = np.random.default_rng(11)
    with pytest.MonkeyPatch.context() as patch:
        # Their kinds and gloss are counted: no tile is painted for its mean.
        patch.setattr(finish_module, "mean_albedo", lambda texture: texture.colours[0])
        return [draw_floor(rng, STYLES[0], Use.LIVING) for _ in range(150 if LONG else 80)]


@pytest.mark.parametrize("use", list(Use))
def test_the_same_seed_gives_the_same_finish(use):
    assert finish_of(5, use) == finish_of(5, use)
    assert finish_of(5, use) != finish_of(6, use)


@pytest.mark.long
def test_the_colour_of_a_textured_material_is_its_mean():
    textured = [material for material in materials_of(finish_of(2)) if material.texture is not None]
    assert textured
    for material in textured:
        mean = tile(material.texture).albedo.mean(axis=(0, 1), dtype=np.float64)
        assert material.colour == pytest.approx(mean, abs=1e-3), material.name


def test_albedos_are_physical(finishes):
    materials = [m for finish in finishes for m in materials_of(finish)]
    assert len(materials) > len(finishes)
    for material in materials:
        assert min(material.colour) > 0.019, material
        assert max(material.colour) <= 0.92, material
        assert material.roughness is None or 0.05 <= material.roughness <= 0.5
        assert material.emission_cd_m2 == (0.0, 0.0, 0.0)


def test_ceilings_are_white_and_walls_mostly_light(finishes):
    assert all(0.74 < reflectance(f.ceiling) < 0.89 for f in finishes)
    walls = np.array([reflectance(f.wall) for f in finishes])
    assert walls.min() > 0.25
    assert np.mean((walls > 0.55) & (walls < 0.86)) > 0.75
    assert all(f.wall.roughness is None for f in finishes)


def test_a_quarter_of_the_rooms_has_an_accent_wall(finishes):
    assert 0.1 < np.mean([bool(f.accent_walls) for f in finishes]) < 0.42


def test_an_accent_wall_differs_and_the_others_do_not(finishes):
    accented = next(f for f in finishes if f.accent_walls)
    wall = accented.accent_walls[0]
    assert accented.wall_material(wall) == accented.accent_wall != accented.wall
    assert accented.wall_material(wall + 1) == accented.wall


@pytest.mark.long
def test_floors_are_as_frequent_as_in_homes(floors):
    kinds = [f.texture.kind for f in floors]
    share = {k: kinds.count(k) / len(kinds) for k in set(kinds)}
    assert share["planks"] == pytest.approx(0.40, abs=0.12)
    assert share["laminate"] == pytest.approx(0.15, abs=0.09)
    assert share["herringbone"] + share["blocks"] == pytest.approx(0.15, abs=0.09)
    assert share["carpet loop"] + share["carpet pile"] == pytest.approx(0.15, abs=0.09)


def test_hard_floors_are_glossy_in_about_half_of_the_rooms_and_carpets_never(floors):
    hard = [f for f in floors if not f.texture.kind.startswith("carpet")]
    glossy = [f.roughness for f in hard if f.roughness is not None]
    assert len(glossy) / len(hard) == pytest.approx(0.45, abs=0.13)
    assert all(0.12 <= r <= 0.35 for r in glossy)
    assert all(f.roughness is None for f in floors if f.texture.kind.startswith("carpet"))


def test_srgb_is_decoded():
    assert linear("#808080") == pytest.approx((0.21586,) * 3, abs=1e-4)
    assert linear("#000000") == (0.02, 0.02, 0.02)
    assert plain("sofa", (0.3, 0.2, 0.1)).colour == (0.3, 0.2, 0.1)
    assert scaled((0.3, 0.2, 0.1), 4.0) == pytest.approx((0.9, 0.8, 0.4))


def test_turning_twice_gives_the_pattern_back():
    wood = veneer(np.random.default_rng(1), "oak")
    assert np.array_equal(tile(turned(turned(wood)).texture).albedo, tile(wood.texture).albedo)
    assert not np.array_equal(tile(turned(wood).texture).albedo, tile(wood.texture).albedo)
    flat = plain("white", "#ffffff")
    assert turned(flat) is flat

"""Every kind of pattern repeats without a seam, keeps its colour, and has the period that it says or none."""

from __future__ import annotations

import math
from collections.abc import Iterator
from functools import lru_cache

import numpy as np
import pytest

from mocks.rooms.model import Texture
from mocks.rooms.textures import catalogue
from mocks.rooms.textures.catalogue import KINDS, Tile, mean_albedo, pattern
from tests.conftest import LONG

tile = lru_cache(maxsize=4)(catalogue.tile)

OAK = (0.38, 0.245, 0.135)
COLOURS = {
    "planks": (OAK, (0.05, 0.035, 0.025)),
    "laminate": (OAK, (0.05, 0.035, 0.025)),
    "herringbone": (OAK, (0.05, 0.035, 0.025)),
    "blocks": (OAK, (0.05, 0.035, 0.025)),
    "tiles": ((0.6, 0.55, 0.5), (0.3, 0.29, 0.28)),
    "hexagons": ((0.6, 0.55, 0.5), (0.3, 0.29, 0.28)),
    "terrazzo": ((0.6, 0.58, 0.54), (0.2, 0.15, 0.1), (0.07, 0.07, 0.07)),
    "striped": ((0.7, 0.68, 0.6), (0.1, 0.2, 0.4), (0.5, 0.3, 0.1)),
}
GAPPED = {"planks", "laminate", "blocks", "tiles", "hexagons"}
FOUR_COLOURS = ((0.6, 0.55, 0.45), (0.3, 0.05, 0.04), (0.05, 0.08, 0.15), (0.5, 0.3, 0.1))


@pytest.fixture(scope="module", autouse=True)
def one_tile_each() -> Iterator[None]:
    """Means and coarser levels are made of the tiles that tests look at, not of their like."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(catalogue, "tile", tile)
        yield
    tile.cache_clear()


def sample(kind: str, seed: int = 3, **options: float) -> Texture:
    colours = COLOURS.get(
        kind, FOUR_COLOURS if kind.startswith(("rug", "picture", "wallpaper")) else FOUR_COLOURS[:1] * 2
    )
    return Texture(kind, seed, colours, tuple(options.items()))


def correlation(made: Tile) -> np.ndarray:
    """Correlation of a pattern with itself, by how many rows and columns it is moved."""
    value = made.albedo.mean(axis=2)
    spectrum = np.abs(np.fft.rfft2(value - value.mean())) ** 2
    moved = np.fft.irfft2(spectrum, s=value.shape)
    return moved / moved[0, 0]


def at(moved: np.ndarray, made: Tile, u_m: float, v_m: float) -> float:
    rows, columns = moved.shape
    return float(moved[round(v_m / made.size_m[1] * rows) % rows, round(u_m / made.size_m[0] * columns) % columns])


@pytest.fixture(scope="module", params=KINDS if LONG else KINDS[::3])
def texture(request) -> Texture:
    return sample(request.param)


@pytest.fixture(scope="module")
def made(texture) -> Tile:
    return tile(texture)


def test_a_tile_is_square_of_a_power_of_two_and_physical(made):
    side = made.albedo.shape[0]
    assert made.albedo.shape == (side, side, 3)
    assert side in (512, 1024, 2048)
    assert made.albedo.dtype == np.float32
    assert made.albedo.min() >= 0.02
    assert made.albedo.max() <= 0.92
    assert 0.4 < made.size_m[0] < 6
    assert 0.4 < made.size_m[1] < 6


def test_a_tile_repeats_without_a_seam(texture, made):
    value = made.albedo.mean(axis=2)
    for picture in (value, value.T):
        inside = np.abs(np.diff(picture, axis=0)).mean(axis=1)
        across = np.abs(picture[0] - picture[-1]).mean()
        # Where boards or tiles end at the seam, the two halves of the gap differ as they do elsewhere.
        usual = 0.5 * inside.max() if texture.kind in GAPPED else 1.5 * np.quantile(inside, 0.9)
        assert across <= usual + 1e-4


@pytest.mark.sweep
def test_the_same_parameters_give_the_same_tile_and_another_seed_another(texture, made):
    if LONG or KINDS.index(texture.kind) % 4 == 0:
        assert np.array_equal(tile.__wrapped__(texture).albedo, made.albedo)
        assert not np.array_equal(tile(sample(texture.kind, 4)).albedo, made.albedo)


def test_the_mean_is_that_of_the_tile(texture, made):
    assert mean_albedo(texture) == pytest.approx(made.albedo.mean(axis=(0, 1), dtype=np.float64), abs=1e-3)


def test_coarser_levels_keep_the_mean():
    texture = sample("tiles")
    coarsest = pattern(texture)[0].levels[-1][1:-1, 1:-1]
    assert coarsest.mean(axis=(0, 1)) == pytest.approx(mean_albedo(texture), abs=1e-3)
    assert pattern(texture) is pattern(texture)


def test_a_turned_tile_has_u_and_v_swapped():
    upright, turned = tile(sample("planks")), tile(sample("planks", turned=1.0))
    assert np.array_equal(turned.albedo, upright.albedo.transpose(1, 0, 2))
    assert turned.size_m == upright.size_m[::-1]


def test_boards_lie_along_v():
    value = tile(sample("planks")).albedo.mean(axis=2)
    assert np.abs(np.diff(value, axis=0)).mean() < 0.5 * np.abs(np.diff(value, axis=1)).mean()


@pytest.mark.parametrize(
    ("pattern", "period_m"),
    [
        (sample("planks", board_m=0.16), (0.16, 0.0)),
        (sample("laminate", board_m=0.2, length_m=1.2), (0.2, 1.2 / 3 * 2)),
        (sample("laminate", board_m=0.2, length_m=1.2), (0.0, 1.2)),
        (sample("herringbone", block_m=0.07, ratio=5), (math.sqrt(2) * 0.07, 0.0)),
        (sample("herringbone", block_m=0.07, ratio=5), (0.0, math.sqrt(2) * 0.35)),
        pytest.param(sample("blocks", block_m=0.2), (0.4, 0.0), marks=pytest.mark.long),
        (sample("tiles", tile_u_m=0.3, tile_v_m=0.3), (0.3, 0.0)),
        (sample("tiles", tile_u_m=0.6, tile_v_m=0.3, offset=0.5), (0.3, 0.3)),
        pytest.param(sample("hexagons", side_m=0.12), (math.sqrt(3) * 0.12, 0.0), marks=pytest.mark.long),
        pytest.param(sample("striped", period_m=0.2), (0.2, 0.0), marks=pytest.mark.long),
        (sample("rug medallions", period_m=0.4), (0.4, 0.4)),
        pytest.param(sample("wallpaper motifs", period_m=0.2), (0.2, 0.0), marks=pytest.mark.long),
    ],
    ids=lambda p: p.kind if isinstance(p, Texture) else None,
)
def test_laid_floors_and_prints_are_nearly_periodic(pattern, period_m):
    u_m, v_m = period_m
    laid = tile(pattern)
    moved = correlation(laid)
    there = at(moved, laid, u_m, v_m)
    beside = [at(moved, laid, f * u_m, f * v_m) for f in (0.72, 0.85, 1.15, 1.28)]
    assert there > max(beside) + 0.02
    assert there > 0.08


@pytest.mark.sweep
@pytest.mark.parametrize("kind", ["planks", "herringbone", "tiles", "blocks"] if LONG else ["herringbone", "tiles"])
def test_no_two_tiles_of_a_floor_are_the_same(kind):
    laid = tile(sample(kind))
    assert at(correlation(laid), laid, laid.size_m[0] / 2, laid.size_m[1] / 2) < 0.95


@pytest.mark.parametrize("kind", ["carpet loop", "carpet pile", "concrete", "plaster"])
def test_what_is_not_laid_has_no_period(kind):
    moved = correlation(tile(sample(kind)))
    quarter = len(moved) // 4
    assert np.abs(moved[quarter:-quarter, quarter:-quarter]).max() < 0.3


@pytest.mark.parametrize("gap_m", [0.0005, 0.001, 0.004])
def test_a_gap_thinner_than_a_pixel_keeps_its_weight(gap_m):
    still = sample("tiles", tile_u_m=0.4, tile_v_m=0.3, variation=0.0, clouding=0.0, gap_m=gap_m)
    gap_share = 1 - (1 - gap_m / 0.4) * (1 - gap_m / 0.3)
    red = 0.6 + (0.3 - 0.6) * gap_share
    assert 0.6 - tile(still).albedo[..., 0].mean(dtype=np.float64) == pytest.approx(0.6 - red, rel=0.06)


def test_wood_is_redder_where_it_is_darker():
    albedo = tile(sample("veneer")).albedo
    tone = albedo[..., 1]
    dark, light = tone < np.quantile(tone, 0.1), tone > np.quantile(tone, 0.9)
    assert (albedo[dark, 0] / albedo[dark, 2]).mean() > 1.03 * (albedo[light, 0] / albedo[light, 2]).mean()

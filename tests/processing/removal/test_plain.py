"""Plain surfaces: their level is kept however little of them is seen, and the light that furniture takes from the wall
beside it does not stay missing where the furniture was."""

from __future__ import annotations

import cv2
import numpy as np
import pytest

from processing.removal.plain import MOST_RISE, MOST_RISE_FLOOR, away_from, fill_plain, rising_light, seamless

PX_PER_M = 40.0
SHAPE = (110, 200)


@pytest.mark.parametrize("shape", [(4, 4), (120, 2), (2, 160), (60, 80)])
def test_little_that_is_seen_gives_the_level(shape: tuple[int, int]) -> None:
    values = np.zeros((120, 160, 3), np.float32)
    known = np.zeros((120, 160), bool)
    known[: shape[0], : shape[1]] = True
    values[known] = [99.0, 90.0, 80.0]
    filled = fill_plain(values, known, ~known, level_rows=True)
    np.testing.assert_allclose(np.median(filled.values[~known], axis=0), [99.0, 90.0, 80.0], rtol=0.1)
    np.testing.assert_array_equal(filled.values[known], values[known])


def _painted_wall(*, skirting: bool) -> tuple[np.ndarray, np.ndarray]:
    """An orange wall with a large pale picture; what hangs low before it is the hole that touches the picture."""
    rng = np.random.default_rng(5)
    wall = np.full((120, 200, 3), (60.0, 25.0, 4.0)) * (1 + 0.003 * rng.standard_normal((120, 200, 1)))
    wall[20:70, 110:170] = (55.0, 60.0, 58.0)
    if skirting:
        wall[116:] = (70.0, 68.0, 66.0)
    hole = np.zeros((120, 200), bool)
    hole[68:120, 100:180] = True
    return wall.astype(np.float32), hole


@pytest.mark.parametrize("skirting", [False, True])
def test_a_picture_of_another_colour_does_not_run_into_the_wall_below_it(skirting: bool) -> None:
    wall, hole = _painted_wall(skirting=skirting)
    given = np.where(hole[..., None], 0, wall).astype(np.float32)
    done = fill_plain(given, ~hole, hole, level_rows=True, beside=~hole).values
    inside = done[76:106, 105:175].reshape(-1, 3)
    assert np.allclose(np.median(inside, axis=0), (60.0, 25.0, 4.0), rtol=0.15)
    assert np.percentile(inside[:, 2] / inside[:, 0], 99) < 0.12
    assert np.array_equal(done[~hole], given[~hole])
    if skirting:
        low = done[117:120, 105:175].reshape(-1, 3)
        assert np.median(low[:, 2]) > 3 * 4.0, "skirting goes on, if not in its full colour on so low a picture"


def test_a_wall_of_two_colours_keeps_both() -> None:
    wall = np.full((100, 160, 3), (50.0, 50.0, 50.0), np.float32)
    wall[50:] = (20.0, 40.0, 60.0)
    hole = np.zeros((100, 160), bool)
    hole[30:80, 60:90] = True
    done = fill_plain(np.where(hole[..., None], 0, wall), ~hole, hole, level_rows=True, beside=~hole).values
    assert np.allclose(done[33:44, 62:88].reshape(-1, 3), (50, 50, 50), rtol=0.2)
    assert np.allclose(done[58:78, 62:88].reshape(-1, 3), (20, 40, 60), rtol=0.2)


def wall(depth: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return a wall of 5 m without and with what a cupboard takes from its light, and the cupboard's place."""
    rng = np.random.default_rng(3)
    hole = np.zeros(SHAPE, bool)
    hole[40:, 70:130] = True
    away_m = cv2.distanceTransform((~hole).astype(np.uint8), cv2.DIST_L2, 5) / PX_PER_M
    slope = np.linspace(90, 110, SHAPE[1]) * (1 + 0.004 * rng.standard_normal(SHAPE))
    whole = np.repeat(slope[..., None], 3, axis=-1).astype(np.float32)
    return whole, (whole * np.exp(-depth * np.exp(-away_m / 0.3))[..., None]).astype(np.float32), hole


def middle_error(depth: float, px_per_m: float | None) -> float:
    whole, dark, hole = wall(depth)
    given = np.where(hole[..., None], 0, dark).astype(np.float32)
    done = fill_plain(given, ~hole, hole, level_rows=True, beside=~hole, px_per_m=px_per_m).values
    np.testing.assert_array_equal(done[~hole], given[~hole])
    inner = (slice(60, 105), slice(85, 115))
    return float(np.median(done[inner] / whole[inner])) - 1


def test_the_middle_of_a_hole_is_as_bright_as_the_wall_further_away() -> None:
    assert middle_error(0.3, None) < -0.08, "continued, the shadow fills the hole"
    assert abs(middle_error(0.3, PX_PER_M)) < 0.07


def test_a_wall_without_shadows_stays_as_it_is() -> None:
    assert abs(middle_error(0.0, PX_PER_M)) < 0.02


def test_there_is_no_seam() -> None:
    _, dark, hole = wall(0.3)
    given = np.where(hole[..., None], 0, dark).astype(np.float32)
    done = fill_plain(given, ~hole, hole, level_rows=True, beside=~hole, px_per_m=PX_PER_M).values
    done = seamless(done, ~hole, hole, PX_PER_M, 0.0)
    inside, outside = done[60:105, 70].mean(), done[60:105, 69].mean()
    assert abs(inside / outside - 1) < 0.06


@pytest.mark.parametrize("bright", [False, True])
def test_light_only_rises(bright: bool) -> None:
    _, dark, hole = wall(-0.3 if bright else 0.3)
    rise = rising_light(np.log(dark), ~hole, ~hole, hole, PX_PER_M, MOST_RISE)
    assert np.isfinite(rise).all()
    assert (rise >= 0).all()
    assert not rise[~hole].any()


def test_nothing_rises_where_nothing_is_known_or_missing() -> None:
    none, every = np.zeros((20, 30), bool), np.ones((20, 30), bool)
    light = np.zeros((20, 30, 3), np.float32)
    assert not rising_light(light, none, none, every, 10.0, MOST_RISE).any()
    assert not rising_light(light, every, every, none, 10.0, MOST_RISE).any()
    np.testing.assert_array_equal(away_from(every, none, 10.0), every)
    hole = none.copy()
    hole[:, 10:] = True
    np.testing.assert_array_equal(away_from(~hole, hole, 1000.0), ~hole, err_msg="too little is far away")


@pytest.mark.parametrize("tone", [0.4, -0.3])
def test_glow_and_shade_go_on_beyond_the_rim_and_run_out(tone: float) -> None:
    hole = np.zeros((120, 160), bool)
    hole[60:, :] = True
    filled = np.full((120, 160, 3), 100.0, np.float32)
    filled[~hole] *= np.exp(np.float32(tone))
    done = seamless(filled, ~hole, hole, 40.0, 0.0)
    np.testing.assert_array_equal(done[~hole], filled[~hole])
    assert abs(float(np.log(done[61] / filled[59]).mean())) < 0.05, "one tone at the rim"
    away = np.log(done[100] / 100).mean() / tone
    assert abs(away - np.exp(-1 / (0.5 if tone > 0 else 0.2))) < 0.05, "glow runs out on half a metre, shade sooner"


def test_another_thing_beside_the_rim_does_not_run_into_the_hole() -> None:
    hole = np.zeros((120, 160), bool)
    hole[60:, :] = True
    for thing in ((300.0, 100.0, 100.0), (10.0, 10.0, 10.0)):
        filled = np.full((120, 160, 3), 100.0, np.float32)
        filled[40:60] = thing
        np.testing.assert_allclose(seamless(filled, ~hole, hole, 40.0, 0.0), filled, rtol=1e-6)


def test_a_floor_is_as_bright_in_a_hole_as_further_away() -> None:
    _, dark, hole = wall(0.1)
    before = float(np.median(dark[60:105, 85:115]))
    done = seamless(dark, ~hole, hole, PX_PER_M, MOST_RISE_FLOOR)
    assert before * 1.05 < float(np.median(done[60:105, 85:115])) < before * np.exp(MOST_RISE_FLOOR) * 1.02

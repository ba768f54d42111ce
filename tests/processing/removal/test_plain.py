"""Plain surfaces: their level is kept however little of them is seen."""

from __future__ import annotations

import numpy as np
import pytest

from processing.removal.plain import fill_plain


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

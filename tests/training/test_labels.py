"""The truth of training pictures, against rooms whose truth can be written down."""

from __future__ import annotations

import numpy as np
import pytest

from training.labels import boundary_latitudes, column_longitudes, corner_likelihood, wall_ranges

BOX = np.array([(-2.0, -3.0), (1.0, -3.0), (1.0, 2.0), (-2.0, 2.0)])


def box_range(longitude: float, eye: tuple[float, float]) -> float:
    """Return how far a box's wall is: the nearest of the two it can meet."""
    s, c = np.sin(longitude), np.cos(longitude)
    (x0, y0), (x1, y1) = BOX.min(axis=0) - eye, BOX.max(axis=0) - eye
    return min((x1 if s > 0 else x0) / s if abs(s) > 1e-12 else np.inf, (y1 if c > 0 else y0) / c)


def test_boundaries_of_a_box_room_are_analytic() -> None:
    eye = (0.3, -0.4)
    up, down = boundary_latitudes(BOX, eye, 1.5, 2.5, 256)
    far = np.array([box_range(t, eye) for t in column_longitudes(256)])
    np.testing.assert_allclose(down, np.arctan2(-1.5, far), atol=1e-6)
    np.testing.assert_allclose(up, np.arctan2(1.0, far), atol=1e-6)


def test_the_nearest_wall_hides_what_is_behind_a_corner() -> None:
    ell = np.array([(-1.0, -1.0), (4.0, -1.0), (4.0, 1.0), (1.0, 1.0), (1.0, 4.0), (-1.0, 4.0)])
    # Along 50 degrees from +y the inner corner's walls are met, not the far ones.
    far = wall_ranges(ell, (0.0, 0.0), np.radians([0.0, 20.0, 50.0, 90.0]))
    np.testing.assert_allclose(far, [4.0, 1.0 / np.sin(np.radians(20.0)), 1.0 / np.cos(np.radians(50.0)), 4.0])


def test_corners_lie_where_the_walls_meet() -> None:
    eye = (0.0, 0.0)
    corner = corner_likelihood(BOX, eye, 256)
    for x, y in BOX:
        column = int((np.arctan2(x, y) / (2 * np.pi) + 0.5) * 256)
        assert corner[column] > 0.9
    assert corner[128 + 64] < 0.05, "no corner straight to the right"


def test_a_hidden_corner_is_none() -> None:
    ell = np.array([(-1.0, -1.0), (6.0, -1.0), (6.0, 0.5), (1.0, 0.5), (1.0, 4.0), (-1.0, 4.0)])
    azimuth = np.arctan2(6.0, 0.5) - np.arctan2(-0.5, -0.5)
    assert azimuth != 0
    corner = corner_likelihood(ell, (-0.5, 3.0), 256)
    column = int((np.arctan2(6.0 + 0.5, 0.5 - 3.0) / (2 * np.pi) + 0.5) * 256)
    assert corner[column] < 0.2


@pytest.mark.parametrize("count", [16, 256])
def test_turning_the_room_rolls_the_columns(count: int) -> None:
    steps = 3
    turn = steps * 2 * np.pi / count
    c, s = np.cos(turn), np.sin(turn)
    # Longitudes grow from +y to +x: clockwise.
    turned = np.stack([c * BOX[:, 0] + s * BOX[:, 1], -s * BOX[:, 0] + c * BOX[:, 1]], axis=1)
    up, down = boundary_latitudes(BOX, (0.0, 0.0), 1.5, 2.5, count)
    up_turned, down_turned = boundary_latitudes(turned, (0.0, 0.0), 1.5, 2.5, count)
    np.testing.assert_allclose(up_turned, np.roll(up, steps), atol=1e-6)
    np.testing.assert_allclose(down_turned, np.roll(down, steps), atol=1e-6)

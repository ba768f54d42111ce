"""Points in polygons, and triangles that fill them."""

from __future__ import annotations

import numpy as np
import pytest

from processing.errors import SceneError
from processing.ground.polygons import inside, triangles

CROSS = np.array(
    [(0, 1), (1, 1), (1, 0), (2, 0), (2, 1), (3, 1), (3, 2), (2, 2), (2, 3), (1, 3), (1, 2), (0, 2)], float
)


@pytest.mark.parametrize("outline", [CROSS, CROSS[::-1], np.insert(CROSS, 1, (0.5, 1), axis=0)])
def test_outlines_of_any_form_are_covered_once(outline: np.ndarray) -> None:
    corners = triangles(outline)
    assert corners.shape == (len(outline) - 2, 3, 2)
    a, b = corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]
    assert np.abs(a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0]).sum() / 2 == pytest.approx(5)
    assert inside(outline, corners.mean(axis=1)).all()


def test_points_in_the_arms_are_inside_and_those_between_them_are_not() -> None:
    places = np.array([(1.5, 1.5), (0.5, 1.5), (1.5, 2.9), (0.5, 0.5), (2.5, 2.5), (-1, 1.5), (4, 4)])
    assert inside(CROSS, places).tolist() == [True, True, True, False, False, False, False]


@pytest.mark.parametrize("outline", [[(0, 0), (1, 1), (1, 0), (0, 1)], [(0, 0), (1, 0), (2, 0)]])
def test_an_outline_that_crosses_itself_or_has_no_area_is_refused(outline: list[tuple[float, float]]) -> None:
    with pytest.raises(SceneError, match="crosses itself"):
        triangles(np.array(outline, float))

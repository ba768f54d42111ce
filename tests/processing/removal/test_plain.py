"""Plain surfaces: their level is kept however little of them is seen."""

from __future__ import annotations

import numpy as np
import pytest

from processing.removal.plain import fill_plain


@pytest.mark.parametrize("shape", [(4, 4), (120, 2), (2, 160), (60, 80)])
def test_little_that_is_seen_tells_the_level(shape: tuple[int, int]) -> None:
    values = np.zeros((120, 160, 3), np.float32)
    known = np.zeros((120, 160), bool)
    known[: shape[0], : shape[1]] = True
    values[known] = [99.0, 90.0, 80.0]
    filled = fill_plain(values, known, ~known, level_rows=True)
    np.testing.assert_allclose(np.median(filled.values[~known], axis=0), [99.0, 90.0, 80.0], rtol=0.1)
    np.testing.assert_array_equal(filled.values[known], values[known])

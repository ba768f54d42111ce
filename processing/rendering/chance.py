"""Random numbers that stay with their row: more rows, or other draws before, change none of the rows there were.

So two scenes that share their first patches or pixels meet the same chance there, and their difference is quiet.
"""

from __future__ import annotations

from typing import TypeAlias

import numpy as np
import numpy.typing as npt

Key: TypeAlias = tuple[int, ...]
"""The seed, then what the numbers are for."""
_DOMAIN = 811


def random(key: Key, rows: int, columns: int) -> npt.NDArray[np.float64]:
    """Return numbers (rows, columns) in [0, 1) that depend on key, row and column alone."""
    return np.random.default_rng([_DOMAIN, *key]).random((rows, columns))

"""Floor polygons without what is no wall: corners on top of each other or on a straight line."""

from __future__ import annotations

from processing.ground.arrays import Doubles

import math

import numpy as np
import numpy.typing as npt


SHORTEST_M = 0.06
STRAIGHT_RAD = math.radians(2.0)


def tidied(floor_m: Doubles) -> Doubles | None:
    """Return a polygon (n, 2) without walls shorter than 6 cm and corners of less than 2 degrees; None if none is left.

    A short wall's two corners become the one in their middle.
    """
    corners = [np.asarray(c, dtype=np.float64) for c in floor_m]
    changed = True
    while changed and len(corners) > 3:
        changed = False
        for i in range(len(corners)):
            following = (i + 1) % len(corners)
            if math.dist(corners[i], corners[following]) < SHORTEST_M:
                corners[i] = (corners[i] + corners[following]) / 2
                del corners[following]
                changed = True
                break
            if _straight(corners[i - 1], corners[i], corners[following]):
                del corners[i]
                changed = True
                break
    return np.array(corners) if len(corners) >= 3 else None


def _straight(before: Doubles, corner: Doubles, after: Doubles) -> bool:
    one, other = corner - before, after - corner
    turn = math.atan2(one[0] * other[1] - one[1] * other[0], float(one @ other))
    return abs(turn) < STRAIGHT_RAD

"""Openings given by two places of the plan: which wall they are in, and where along it."""

from __future__ import annotations

from processing.ground.arrays import Doubles

import numpy as np
import numpy.typing as npt

from processing.room.model import Opening, OpeningKind


OFF_WALL_M = 0.15
SHORTEST_M = 0.05


def opening_on_wall(
    floor: Doubles, ends: Doubles, heights_m: Doubles, kind: OpeningKind, ceiling_m: float
) -> list[Opening]:
    """Return the opening between two places (2, 2) of the plan on the wall they lie on; nothing where that is none.

    ``floor`` (n, 2) counter-clockwise; ``heights_m`` (2,) of its lower and upper edge, held within the wall.
    """
    start, following = floor, np.roll(floor, -1, axis=0)
    length = np.hypot(*(following - start).T)
    along = (following - start) / np.maximum(length, 1e-9)[:, None]
    offset = ends[:, None] - start
    off = np.abs(offset[..., 0] * along[:, 1] - offset[..., 1] * along[:, 0]).max(axis=0)
    place = (offset * along).sum(axis=-1)
    beyond = np.maximum(np.maximum(-place, place - length), 0).max(axis=0)
    wall = int(np.argmin(off + beyond))
    if off[wall] + beyond[wall] > OFF_WALL_M:
        return []
    low, high = np.clip(np.sort(place[:, wall]), 0, length[wall])
    sill, head = np.clip(np.sort(heights_m), 0, ceiling_m)
    if kind is not OpeningKind.WINDOW and sill < SHORTEST_M:
        sill = 0.0
    if high - low < SHORTEST_M or head - sill < SHORTEST_M:
        return []
    return [
        Opening(
            kind=kind,
            wall=wall,
            start_m=round(float(low), 5),
            end_m=round(float(high), 5),
            sill_m=round(float(sill), 5),
            head_m=round(float(head), 5),
        )
    ]

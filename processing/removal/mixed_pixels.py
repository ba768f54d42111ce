"""Pixels on the edges of floor and ceiling show two planes: filled ones are mixed as a camera would, not in steps."""

from __future__ import annotations

from processing.ground.arrays import Flags, Floats

import numpy as np
import numpy.typing as npt

from processing.room.model import RoomModel
from processing.sphere import Equirectangular
from processing.surfaces.maps import boundary_rows



def soften_edges(out: Floats, target: Flags, room: RoomModel, geometry: Equirectangular) -> None:
    """Mix, in place, the target's pixels of a panorama (H, W, 3) that lie on an edge of floor or ceiling.

    Of the row in which a column's edge lies, the share beyond the edge is what the next row shows. Nothing outside the
    target changes. Edges between walls are upright in the picture, and have no steps.
    """
    before = out.copy()
    for edge in boundary_rows(room, geometry):
        row = np.floor(edge).astype(np.intp)
        columns = np.flatnonzero((row >= 1) & (row < len(out) - 1))
        row = row[columns]
        lower = (row + 1 - edge[columns])[:, None]
        # The pixel's middle tells which side it was drawn for.
        above, below = before[row - 1, columns], before[row + 1, columns]
        mixed = np.where(lower > 0.5, lower * before[row, columns] + (1 - lower) * above, 0)
        mixed = np.where(lower > 0.5, mixed, (1 - lower) * before[row, columns] + lower * below)
        chosen = target[row, columns]
        out[row[chosen], columns[chosen]] = mixed[chosen]

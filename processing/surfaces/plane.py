"""A flat surface of a room with its own axes."""

from __future__ import annotations

from processing.ground.arrays import Doubles

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt


FLOOR, CEILING, FIRST_WALL = 0, 1, 2
"""Indices of planes; wall i of the room is plane FIRST_WALL + i."""


@dataclass(frozen=True)
class Plane:
    """Floor, ceiling or a wall. A texture's column and row grow along ``u_axis`` and ``v_axis`` from ``origin_m``.

    Walls are seen from inside, upright: u to the right, v down. The floor is seen from above with +y up the texture
    (u = +x, v = -y); the ceiling from below (u = +x, v = +y). World axes as in docs/coordinates.md.
    """

    index: int
    name: str
    """floor, ceiling, wall-0 .. wall-n."""
    origin_m: Doubles
    """(3,)."""
    u_axis: Doubles
    """(3,), unit."""
    v_axis: Doubles
    normal: Doubles
    """(3,), unit, into the room."""
    width_m: float
    height_m: float
    outline_m: Doubles
    """(n, 2): the plane's polygon in (u, v)."""

    def world(self, u_m: npt.ArrayLike, v_m: npt.ArrayLike) -> Doubles:
        """Return world positions (..., 3) of places on the plane."""
        u, v = np.asarray(u_m, np.float64)[..., None], np.asarray(v_m, np.float64)[..., None]
        return np.asarray(self.origin_m + u * self.u_axis + v * self.v_axis)

    def coordinates(self, points_m: npt.ArrayLike) -> Doubles:
        """Return (..., 2) the (u, v) of world positions, dropped onto the plane."""
        offset = np.asarray(points_m, np.float64) - self.origin_m
        return np.stack([offset @ self.u_axis, offset @ self.v_axis], axis=-1)

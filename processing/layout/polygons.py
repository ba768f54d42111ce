"""Polygons as arrays: what can be repaired is repaired and said, what cannot is refused with the place named.

Corners are float64 (n, 2) metres. Nothing here knows of rooms, doors or furniture.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from processing.errors import PlanError
from processing.ground.arrays import Doubles

SAME_POINT_M = 1e-4
"""Corners nearer than this are one corner."""


@dataclass(frozen=True)
class Repaired:
    """A ring as it should be, and what was done to it."""

    ring: Doubles
    """(n, 2), counter-clockwise (or clockwise where asked), not closed."""
    edge_from: tuple[int, ...]
    """For each edge, the edge of the ring that was given."""
    turned: bool
    """The ring was given the other way round, so that edges run backwards now."""
    notes: tuple[str, ...]


def signed_area(ring: Doubles) -> float:
    """Return the area in m2, positive where the ring runs counter-clockwise."""
    x, y = ring[:, 0], ring[:, 1]
    return float(0.5 * np.sum(x * np.roll(y, -1) - np.roll(x, -1) * y))


def repaired_ring(points: Doubles, *, where: str, clockwise: bool = False) -> Repaired:
    """Return the ring without repeated corners and the right way round.

    Raises `PlanError` for fewer than three corners, values that are no numbers, no area, and a ring that crosses or
    touches itself (the two edges and the place are named).
    """
    ring = np.asarray(points, dtype=np.float64)
    if ring.ndim != 2 or ring.shape[1:] != (2,) or not np.isfinite(ring).all():
        raise PlanError("the corners are not pairs of finite numbers", where=where)
    if len(ring) and np.abs(ring).max() > 1e4:
        raise PlanError("a corner lies more than 10 km away", where=where, likely="units that are not metres")
    kept, notes = _without_repeats(ring)
    edge_from = tuple(kept)
    ring = ring[kept]
    if len(ring) < 3:
        raise PlanError(f"{len(ring)} different corners are no polygon", where=where)
    _refuse_crossings(ring, where)
    if abs(signed_area(ring)) < 1e-6:
        raise PlanError("the polygon has no area", where=where)
    turned = (signed_area(ring) < 0) != clockwise
    if turned:
        ring = ring[::-1].copy()
        edge_from = (*edge_from[-2::-1], edge_from[-1])
        notes.append(f"the corners ran {'counter-' if clockwise else ''}clockwise: turned round")
    return Repaired(np.ascontiguousarray(ring), edge_from, turned, tuple(notes))


def _without_repeats(ring: Doubles) -> tuple[list[int], list[str]]:
    notes: list[str] = []
    kept: list[int] = []
    for i in range(len(ring)):
        if kept and np.hypot(*(ring[i] - ring[kept[-1]])) < SAME_POINT_M:
            kept[-1] = i  # the edge that goes on from here is the later one's
            notes.append(f"corner {i} repeats the one before: left out")
        else:
            kept.append(i)
    if len(kept) > 1 and np.hypot(*(ring[kept[-1]] - ring[kept[0]])) < SAME_POINT_M:
        kept.pop()
        notes.append("the last corner repeats the first: left out")
    return kept, notes


def _refuse_crossings(ring: Doubles, where: str) -> None:
    count = len(ring)
    ends = np.roll(ring, -1, axis=0)
    for i in range(count):
        for j in range(i + 1, count):
            adjacent = j == i + 1 or (i == 0 and j == count - 1)
            place = _fold(ring, i, j) if adjacent else _meeting(ring[i], ends[i], ring[j], ends[j])
            if place is not None:
                raise PlanError(
                    f"edge {i} crosses or touches edge {j} at ({place[0]:.3f}, {place[1]:.3f})",
                    where=where,
                    likely="corners in the wrong order",
                    edges=[i, j],
                    at_m=[round(place[0], 4), round(place[1], 4)],
                )


def _fold(ring: Doubles, i: int, j: int) -> tuple[float, float] | None:
    """Return the corner where two neighbouring edges run back over each other, or None."""
    count = len(ring)
    corner = j if j == i + 1 else i
    back = ring[corner - 1] - ring[corner]
    ahead = ring[(corner + 1) % count] - ring[corner]
    cross = back[0] * ahead[1] - back[1] * ahead[0]
    lengths = float(np.hypot(*back) * np.hypot(*ahead))
    if abs(cross) < 1e-9 * lengths and float(back @ ahead) > 0:
        return float(ring[corner][0]), float(ring[corner][1])
    return None


def _meeting(a: Doubles, b: Doubles, c: Doubles, d: Doubles) -> tuple[float, float] | None:
    """Return a common point of two closed segments, or None."""
    r, s = b - a, d - c
    cross = float(r[0] * s[1] - r[1] * s[0])
    ac = c - a
    if abs(cross) < 1e-12:
        if abs(ac[0] * r[1] - ac[1] * r[0]) > 1e-9 * np.hypot(*r):
            return None
        along = np.sort(np.array([ac @ r, (d - a) @ r]) / float(r @ r))
        if along[0] > 1 or along[1] < 0:
            return None
        at = a + max(0.0, float(along[0])) * r
        return float(at[0]), float(at[1])
    t = float(ac[0] * s[1] - ac[1] * s[0]) / cross
    u = float(ac[0] * r[1] - ac[1] * r[0]) / cross
    slack = 1e-12
    if -slack <= t <= 1 + slack and -slack <= u <= 1 + slack:
        at = a + t * r
        return float(at[0]), float(at[1])
    return None

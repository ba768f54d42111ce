"""Truth of the columns: latitudes of floor and ceiling edge, and where the room's vertical corners are.

Column i of n looks at longitude ((i + 0.5) / n - 0.5) * 2 pi, longitude 0 along +y and growing towards +x.
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from processing.ground.arrays import Doubles, Floats
from processing.segmentation.evidence import SceneClass

CORNER_SPREAD_RAD = np.radians(2.2)
SKIRTING = len(SceneClass)
"""A class of training pictures only: what is shipped counts it as wall."""


def column_longitudes(count: int) -> Doubles:
    """Return the longitudes (N,), radians, of the columns' middles."""
    return np.asarray(((np.arange(count) + 0.5) / count - 0.5) * (2 * np.pi), dtype=np.float64)


def wall_ranges(outline: npt.ArrayLike, eye: tuple[float, float], longitudes: Doubles) -> Doubles:
    """Return how far the first wall is (N,), horizontally, along each longitude; inf where none is met."""
    a = np.asarray(outline, dtype=np.float64) - np.asarray(eye)
    edge = np.roll(a, -1, axis=0) - a
    ray = np.stack([np.sin(longitudes), np.cos(longitudes)], axis=-1)
    cross = ray[:, None, 0] * edge[None, :, 1] - ray[:, None, 1] * edge[None, :, 0]
    with np.errstate(divide="ignore", invalid="ignore"):
        far = (a[None, :, 0] * edge[None, :, 1] - a[None, :, 1] * edge[None, :, 0]) / cross
        along = (a[None, :, 0] * ray[:, None, 1] - a[None, :, 1] * ray[:, None, 0]) / cross
    met = (far > 1e-9) & (along >= -1e-9) & (along <= 1 + 1e-9) & np.isfinite(far)
    return np.asarray(np.where(met, far, np.inf).min(axis=1), dtype=np.float64)


def boundary_latitudes(
    outline: npt.ArrayLike, eye: tuple[float, float], eye_m: float, ceiling_m: float, count: int
) -> tuple[Floats, Floats]:
    """Return the latitudes (N,), radians, of ceiling and floor edge of the visible wall, per column."""
    far = wall_ranges(outline, eye, column_longitudes(count))
    return np.arctan2(ceiling_m - eye_m, far).astype(np.float32), np.arctan2(-eye_m, far).astype(np.float32)


def corner_likelihood(outline: npt.ArrayLike, eye: tuple[float, float], count: int) -> Floats:
    """Return (N,): 1 in columns that look at a corner in straight sight, falling off beside it."""
    points = np.asarray(outline, dtype=np.float64) - np.asarray(eye)
    azimuth, far = np.arctan2(points[:, 0], points[:, 1]), np.hypot(points[:, 0], points[:, 1])
    seen = wall_ranges(outline, eye, azimuth) > far - 0.02
    away = np.abs((column_longitudes(count)[:, None] - azimuth[None, seen] + np.pi) % (2 * np.pi) - np.pi)
    if not seen.any():
        return np.zeros(count, np.float32)
    return np.asarray(np.exp(-0.5 * (away.min(axis=1) / CORNER_SPREAD_RAD) ** 2), dtype=np.float32)


def wall_direction_rad(floor_rad: npt.ArrayLike) -> float:
    """Return the azimuth (0 to pi/2) of most of a room's walls, parallel or at right angles, from its boundary (N,)."""
    down = np.minimum(np.asarray(floor_rad, np.float64), -0.03)
    longitude = column_longitudes(len(down))
    reach = 1 / np.tan(-down)
    place = reach * np.exp(1j * longitude)
    step = np.roll(place, -1) - place
    # Leaps from a near wall to a far one behind it run along the line of sight, not along a wall.
    step[np.abs(np.roll(reach, -1) - reach) > 0.35 * reach] = 0
    length = np.abs(step)
    four = (length * np.exp(4j * np.angle(step))).sum()
    return float(np.angle(four) / 4 % (np.pi / 2))

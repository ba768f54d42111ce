"""Direct sunlight in a room: which points see the sun's disc through a pane, and how much of it."""

from __future__ import annotations

from processing.ground.arrays import Doubles, Flags, Floats

import math
from collections.abc import Iterator, Sequence

import numpy as np
import numpy.typing as npt

from mocks.light import BrightDisc
from mocks.rooms.geometry import Geometry
from mocks.rooms.shell import Pane

_RIM, _FILL = 6, 32
_LIFT_M = 1e-3


def sun_share(geometry: Geometry, panes: Sequence[Pane], sun: BrightDisc, points: Floats, normals: Floats) -> Floats:
    """Return how much of the sun's disc each point (n, 3) on a surface sees, 0..1; 0 where it faces away.

    Points whose rays to the disc's rim and middle agree are done; only those in a penumbra get 32 rays.
    """
    share = np.zeros(len(points), np.float32)
    direction = np.array(sun.direction, np.float32)
    rays = _disc_rays(sun, _RIM)
    facing = np.flatnonzero(normals @ direction > 1e-4)
    near = facing[_may_see(panes, sun, points[facing])]
    if near.size == 0:
        return share
    start = points[near] + normals[near] * np.float32(_LIFT_M)
    coarse = _visible(geometry, start, rays)
    share[near] = coarse
    edge = np.flatnonzero((coarse > 0) & (coarse < 1))
    if edge.size:
        share[near[edge]] = _visible(geometry, start[edge], _disc_rays(sun, _FILL))
    return share


def enters(panes: Sequence[Pane], sun: BrightDisc | None) -> bool:
    """Return whether the sun shines on any pane from outside."""
    if sun is None:
        return False
    return any(float(np.dot(outward(pane), sun.direction)) > 1e-3 for pane in panes)


def outward(pane: Pane) -> npt.NDArray[np.float64]:
    """Return the unit normal of a pane that looks outside."""
    normal = np.cross(np.array(pane.u), np.array(pane.v))
    return np.asarray(normal / np.linalg.norm(normal))


def _may_see(panes: Sequence[Pane], sun: BrightDisc, points: Floats) -> Flags:
    """Return which points' rays to the sun pass near a window: cheap, and true for all that see the sun."""
    direction = np.array(sun.direction)
    out = np.zeros(len(points), bool)
    for corner, u, v in windows_of(panes):
        width, height = np.linalg.norm(u), np.linalg.norm(v)
        normal = np.cross(u, v) / (width * height)
        steep = float(direction @ normal)
        if abs(steep) < 1e-6:
            continue
        to_pane = (points @ (-normal / steep).astype(np.float32)) + np.float32(corner @ normal / steep)
        # Along u and v, where the ray from a point meets the window's plane: linear in the point.
        ahead = to_pane > 0
        margin = np.float32(2.0 * sun.radius_rad / abs(steep)) * to_pane + np.float32(0.01)
        for side, length in ((u / width, width), (v / height, height)):
            place = (
                points @ side.astype(np.float32) + to_pane * np.float32(direction @ side) - np.float32(corner @ side)
            )
            ahead &= (place > -margin) & (place < np.float32(length) + margin)
        out |= ahead
    return out


def windows_of(panes: Sequence[Pane]) -> Iterator[tuple[Doubles, Doubles, Doubles]]:
    """Yield corner and sides of the rectangle around each window's panes; u x v looks outside."""
    groups: dict[int, list[Pane]] = {}
    for pane in panes:
        groups.setdefault(pane.window, []).append(pane)
    for group in groups.values():
        first = np.array(group[0].corner, np.float64)
        u, v = (np.array(side, np.float64) for side in (group[0].u, group[0].v))
        u, v = u / np.linalg.norm(u), v / np.linalg.norm(v)
        corners = np.array(
            [np.array(p.corner) + a * np.array(p.u) + b * np.array(p.v) for p in group for a in (0, 1) for b in (0, 1)]
        )
        along, up = (corners - first) @ u, (corners - first) @ v
        yield first + along.min() * u + up.min() * v, np.ptp(along) * u, np.ptp(up) * v


def _visible(geometry: Geometry, points: Floats, rays: Floats) -> Floats:
    seen = np.zeros(len(points), np.float32)
    for ray in rays:
        seen += ~geometry.blocked(points, np.broadcast_to(ray, points.shape))
    return seen / np.float32(len(rays))


def _disc_rays(sun: BrightDisc, count: int) -> Floats:
    """Return directions spread evenly over the disc; few lie on its rim and in its middle."""
    middle = np.array(sun.direction)
    aside = np.cross(middle, (0.0, 0.0, 1.0) if abs(middle[2]) < 0.9 else (1.0, 0.0, 0.0))
    aside /= np.linalg.norm(aside)
    above = np.cross(middle, aside)
    index = np.arange(count)
    if count == _RIM:
        radius = np.where(index == 0, 0.0, sun.radius_rad * 0.98)
        turn = index * (2 * math.pi / (count - 1))
    else:
        radius = sun.radius_rad * np.sqrt((index + 0.5) / count)
        turn = index * (math.pi * (3 - math.sqrt(5)))
    rays = middle + np.tan(radius)[:, None] * (np.cos(turn)[:, None] * aside + np.sin(turn)[:, None] * above)
    return np.asarray(rays / np.linalg.norm(rays, axis=1, keepdims=True), dtype=np.float32)

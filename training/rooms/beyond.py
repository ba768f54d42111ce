"""What is seen through windows and portals: outdoors by direction, another room as a painted box."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from processing.ground.arrays import Doubles, Flags, Floats, Indices
from training.rooms.house import Portal


def outdoors(rng: np.random.Generator, rays: Floats) -> Floats:
    """Return relative radiance of sky, land and what stands on it (N, 3), about 1 for the sky."""
    azimuth = np.arctan2(rays[:, 0], rays[:, 1])
    up = rays[:, 2]
    grey = rng.random() < 0.4
    zenith = np.array([0.8, 0.9, 1.0]) if grey else np.array([0.35, 0.6, 1.2])
    horizon = np.array([1.0, 1.0, 1.0]) * rng.uniform(0.8, 1.4)
    share = np.clip(up, 0, 1)[:, None] ** 0.5
    out = horizon * (1 - share) + zenith * share
    ground = rng.uniform(0.05, 0.45) * (1 + 0.25 * rng.normal(size=3))
    out = np.where(up[:, None] < 0, np.abs(ground), out)
    phase, height = rng.uniform(0, 6.28, 6), rng.uniform(0.0, 0.45)
    edge = sum(np.sin(azimuth * k * 2 + phase[k - 1]) / k for k in range(1, 7))
    line = height * (0.5 + 0.3 * edge) + rng.uniform(-0.1, 0.1)
    low = rng.uniform(-0.35, -0.03)
    leaf = rng.uniform(0.04, 0.35) * np.array(
        [(0.5, 0.8, 0.3), (0.8, 0.75, 0.7), (0.7, 0.4, 0.3)][int(rng.integers(3))]
    )
    speckle = 1 + 0.5 * np.sin(azimuth * 61 + phase[0]) * np.sin(up * 73 + phase[1])
    things = (up < line) & (up > low)
    return np.asarray(np.where(things[:, None], leaf * speckle[:, None], out), dtype=np.float32)


@dataclass(frozen=True)
class Home:
    """What rooms of one home have in common: homes are often of one floor and one paint throughout."""

    wall: Floats
    """(3,) albedo."""
    ceiling: Floats
    floor: Callable[[Floats], Floats]
    """Albedo (N, 3) at places (N, 2) of the floor, metres."""


def other_room(portal: Portal, eye: Doubles, rays: Floats, home: Home | None = None) -> Floats:
    """Return relative radiance (N, 3), about 0.3, of the room behind a portal, for rays from ``eye``."""
    rng = np.random.default_rng([portal.seed, 3])
    ax, ay = portal.frame.along
    ox, oy = portal.frame.origin
    local = np.stack([rays[:, 0] * ax + rays[:, 1] * ay, rays[:, 0] * ay - rays[:, 1] * ax, rays[:, 2]], axis=-1)
    dx, dy = eye[0] - ox, eye[1] - oy
    start = np.array([dx * ax + dy * ay, dx * ay - dy * ax, eye[2]])
    x0, _, x1, z1 = portal.rect
    low = np.array([x0 - rng.uniform(0.05, 3.0), 0.05, 0.0])
    high = np.array([x1 + rng.uniform(0.05, 3.0), rng.uniform(1.0, 6.0), max(z1 + 0.02, rng.uniform(2.2, 3.0))])
    if rng.random() < 0.3:
        low[0], high[0] = x0 - rng.uniform(0.02, 0.4), x1 + rng.uniform(0.02, 0.4)
    local = np.where(np.abs(local) < 1e-6, 1e-6, local)
    far = np.where(local > 0, (high - start) / local, (low - start) / local)
    far[:, 1] = np.where(local[:, 1] > 0, far[:, 1], np.inf)
    axis = far.argmin(axis=1)
    point = start + local * far.min(axis=1)[:, None]
    out = _surfaces(rng, portal, point, axis, local[:, 2] < 0, home)
    _fittings(rng, out, point, axis, low, high)
    light = rng.uniform(low, high)
    near = np.linalg.norm(point - light, axis=1)
    shade = rng.uniform(0.25, 0.8) + 1.6 / (1 + near**2)
    return np.asarray(out * shade[:, None] * 0.4, dtype=np.float32)


def _surfaces(
    rng: np.random.Generator,
    portal: Portal,
    point: Doubles,
    axis: Indices,
    down: Flags,
    home: Home | None,
) -> Doubles:
    """Return albedos (N, 3) of the other room's walls, ceiling and floor."""
    below = (axis == 2) & down
    if home is not None:
        bends = 1 + 0.06 * rng.normal(size=(2, 1))
        tones = np.concatenate([home.wall * bends, home.ceiling[None]])
        out = np.asarray(tones[axis], np.float64)
        out[below] = home.floor(portal.frame.world(point[below])[:, :2].astype(np.float32))
        return out
    tones = np.abs(rng.normal([0.75, 0.72, 0.68], 0.12, (4, 3))) * rng.uniform(0.5, 1.0)
    floor = np.abs(rng.uniform(0.05, 0.5) * (1 + 0.25 * rng.normal(size=3)))
    boards = 1 + 0.15 * np.sign(np.sin(point[:, 0] * rng.uniform(10, 40)))[:, None]
    out = tones[np.clip(axis, 0, 2)]
    return np.asarray(np.where(below[:, None], floor * boards, out))


def _fittings(
    rng: np.random.Generator, out: Doubles, point: Doubles, axis: Indices, low: Doubles, high: Doubles
) -> None:
    """Paint doors, windows and cupboards on the walls of the other room, in place."""
    for _ in range(int(rng.integers(0, 5))):
        side = int(rng.integers(2))
        along = 1 - side
        a = rng.uniform(low[along], high[along])
        b, z0 = a + rng.uniform(0.5, 1.8), rng.choice([0.0, 0.0, 0.9])
        z1 = rng.uniform(z0 + 0.6, 2.1)
        inside = (axis == side) & (point[:, along] > a) & (point[:, along] < b)
        inside &= (point[:, 2] > z0) & (point[:, 2] < z1)
        bright = rng.random() < 0.35
        out[inside] = (
            rng.uniform(2.0, 9.0) if bright else np.abs(rng.uniform(0.03, 0.6) * (1 + 0.3 * rng.normal(size=3)))
        )

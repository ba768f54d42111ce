"""Flat things on walls: framed pictures and the wall clock. Their backs are at +y, where the wall is."""

from __future__ import annotations

import math

import numpy as np

from mocks.rooms.furniture.build import BLACK_PLASTIC, WHITE_PLASTIC, Build
from mocks.rooms.model import Material
from mocks.worlds.light import Vector
from processing.ground.mesh import Mesh, box, moved, turned
from processing.ground.shapes import beam, disc, tube

MOUNT = Material("passe-partout", (0.80, 0.79, 0.76))
PAINTS: tuple[tuple[Vector, ...], ...] = (
    ((0.62, 0.60, 0.52), (0.20, 0.30, 0.36), (0.55, 0.33, 0.18), (0.10, 0.13, 0.16)),
    ((0.72, 0.66, 0.55), (0.50, 0.20, 0.12), (0.64, 0.45, 0.16), (0.12, 0.20, 0.18)),
    ((0.70, 0.72, 0.70), (0.30, 0.42, 0.46), (0.16, 0.28, 0.20), (0.66, 0.62, 0.44)),
)
"""Colours that go together: ground first."""


def picture(b: Build) -> None:
    """Build a framed picture: hills, discs or blocks of colour, some behind a mount."""
    w, d, h = b.size
    frame = b.pick(b.finish.wood, BLACK_PLASTIC, WHITE_PLASTIC, b.finish.second_wood)
    bar, x, back = 0.02 + 0.01 * (b.item.seed % 2), w / 2, d / 2
    for side in (-1, 1):
        low, high = sorted((side * x, side * (x - bar)))
        b.block((low, -d / 2, 0.0), (high, back, h), frame, 0.002)
        bottom = 0.0 if side < 0 else h - bar
        b.block((-x + bar, -d / 2, bottom), (x - bar, back, bottom + bar), frame, 0.002)
    border = 0.0 if b.item.seed % 3 == 0 else 0.16 * min(w, h)
    paints = [Material("paint", c) for c in PAINTS[int(b.rng.integers(len(PAINTS)))]]
    b.add(box((-x + bar, 0.0, bar), (x - bar, back, h - bar)), MOUNT if border else paints[0])
    left_low, right_high = (-x + bar + border, bar + border), (x - bar - border, h - bar - border)
    b.add(box((left_low[0], -0.001, left_low[1]), (right_high[0], 0.0, right_high[1])), paints[0])
    (_hills, _discs, _blocks)[int(b.rng.integers(3))](b, left_low, right_high, paints)


def _hills(b: Build, low: tuple[float, float], high: tuple[float, float], paints: list[Material]) -> None:
    """Paint three ranges of hills, the nearest last and darkest."""
    wide, tall = high[0] - low[0], high[1] - low[1]
    for k, paint in enumerate(paints[1:]):
        crest = (0.62 - 0.2 * k) * tall
        phase, waves = b.rng.uniform(0, 2 * math.pi), b.rng.uniform(0.6, 1.6)
        t = np.linspace(0.0, 1.0, 25)
        z = crest + 0.09 * tall * np.sin(2 * math.pi * waves * t + phase) + 0.03 * tall * np.sin(11 * t + 2 * phase)
        x = low[0] + wide * t
        y = -0.0015 - 0.0005 * k
        for a in range(24):
            corners = np.array(
                [(x[a], y, low[1]), (x[a + 1], y, low[1]), (x[a + 1], y, low[1] + z[a + 1]), (x[a], y, low[1] + z[a])]
            )
            b.add(disc(corners, np.array([0.0, -1.0, 0.0])), paint)


def _discs(b: Build, low: tuple[float, float], high: tuple[float, float], paints: list[Material]) -> None:
    wide, tall = high[0] - low[0], high[1] - low[1]
    for k, paint in enumerate(paints[1:]):
        r = float(b.rng.uniform(0.12, 0.26)) * min(wide, tall)
        x = float(b.rng.uniform(low[0] + r, high[0] - r))
        z = float(b.rng.uniform(low[1] + r, high[1] - r))
        b.add(_dot(x, -0.0015 - 0.0005 * k, z, r), paint)


def _dot(x: float, y: float, z: float, radius: float) -> Mesh:
    """Return a flat disc that looks towards -y."""
    a = np.linspace(0.0, 2 * math.pi, 41)[:-1]
    rim = np.stack([x + radius * np.cos(a), np.full(40, y), z + radius * np.sin(a)], axis=1)
    return disc(rim, np.array([0.0, -1.0, 0.0]))


def _blocks(b: Build, low: tuple[float, float], high: tuple[float, float], paints: list[Material]) -> None:
    wide, tall = high[0] - low[0], high[1] - low[1]
    for k, paint in enumerate(paints[1:]):
        x0 = low[0] + wide * float(b.rng.uniform(0.05, 0.45))
        z0 = low[1] + tall * (0.08 + 0.28 * k)
        x1, z1 = x0 + wide * float(b.rng.uniform(0.25, 0.5)), z0 + tall * float(b.rng.uniform(0.18, 0.3))
        y = -0.0015 - 0.0005 * k
        b.add(box((x0, y, z0), (x1, y + 0.0005, z1)), paint)


def wall_clock(b: Build) -> None:
    """Build a round clock; its hands show a time drawn by chance."""
    w, d, h = b.size
    r, z = w / 2, h / 2
    rim = b.pick(BLACK_PLASTIC, b.finish.wood, b.finish.metal)
    b.add(tube([(0, d / 2, z), (0, -d / 2 + 0.008, z)], r, 40), rim)
    face = -d / 2 + 0.006
    b.add(tube([(0, -d / 2 + 0.009, z), (0, face, z)], 0.93 * r, 40), WHITE_PLASTIC)
    for k in range(12):
        mark = beam((0, face - 0.001, 0.76 * r), (0, face - 0.001, 0.87 * r), 0.03 * r, 0.001, 0.0002)
        b.add(moved(turned(mark, (0, 1, 0), 2 * math.pi * k / 12), (0, 0, z)), BLACK_PLASTIC)
    minutes = float(b.rng.uniform(0, 720))
    for long, thick, angle, y in (
        (0.5, 0.05, 2 * math.pi * minutes / 720, face - 0.002),
        (0.72, 0.035, 2 * math.pi * minutes / 60, face - 0.004),
    ):
        hand = beam((0, y, -0.12 * r), (0, y, long * r), thick * r, 0.001, 0.0002)
        b.add(moved(turned(hand, (0, 1, 0), angle), (0, 0, z)), BLACK_PLASTIC)

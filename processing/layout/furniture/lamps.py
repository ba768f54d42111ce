"""The floor lamp."""

from __future__ import annotations

import math

import numpy as np

from processing.layout.furniture.bench import Bench
from processing.layout.furniture.model import Material
from processing.layout.furniture.solids import circle, leg, loft, rounded_rectangle, turned_piece
from processing.layout.furniture.surface import Solid, solid

SHADE = Material("lampshade", (0.78, 0.74, 0.65), 0.9)
BULB = Material("bulb", (0.85, 0.84, 0.80), 0.3)


def floor_lamp(b: Bench) -> None:
    """Build a floor lamp: a foot and a pole, or three wooden legs, below a shade of cloth."""
    w, d, h = b.size
    r = min(w, d) / 2
    stretch = (w / (2 * r), d / (2 * r), 1.0)
    shade = min(0.28, 0.22 * h)
    low = h - shade
    if b.style.legs == "round":
        for k in range(3):
            a = math.radians(90 + 120 * k)
            foot = (0.86 * r * math.cos(a), 0.86 * r * math.sin(a), 0.0)
            b.add(leg(foot, (0.022 * math.cos(a), 0.022 * math.sin(a), low - 0.06), 0.010, 0.014), b.style.timber)
        b.add(
            turned_piece(
                [(0, low - 0.10), (0.035, low - 0.10), (0.042, low - 0.08), (0.035, low - 0.05), (0, low - 0.05)]
            ),
            b.style.metal,
        )
        start = low - 0.06
    else:
        foot_r = 0.80 * r
        b.add(turned_piece([(0, 0), (foot_r - 0.004, 0), (foot_r, 0.004), (foot_r, 0.016), (foot_r - 0.006, 0.022),
                            (0.03, 0.026), (0.016, 0.05), (0, 0.05)], 48), b.style.metal)  # fmt: skip
        start = 0.03
    b.rod([(0, 0, start), (0, 0, low + 0.02)], 0.0105, b.style.metal)
    b.rod([(0, 0, low + 0.01), (0, 0, low + 0.07)], 0.017, b.style.metal, 16)
    _bulb(b, low, h)
    top, wall = (0.72 if b.style.legs != "metal" else 1.0) * r, 0.003
    cone = [(r - wall, low), (r, low), (top, h), (top - wall, h)]
    b.add(_band(cone).scaled(*stretch), SHADE)
    for k in range(3):
        a = math.radians(30 + 120 * k)
        end = ((top - wall) * math.cos(a) * stretch[0], (top - wall) * math.sin(a) * stretch[1], h - 0.030)
        b.rod([(0, 0, h - 0.030), end], 0.0022, b.style.metal, 6)


def _bulb(b: Bench, low: float, h: float) -> None:
    """Add a bulb above a height, and the rod that carries the shade."""
    b.rod([(0, 0, low + 0.06), (0, 0, h - 0.028)], 0.004, b.style.metal, 8)
    bulb = [
        (0, 0.07),
        (0.014, 0.07),
        (0.016, 0.09),
        (0.032, 0.125),
        (0.034, 0.145),
        (0.026, 0.17),
        (0.012, 0.182),
        (0, 0.184),
    ]
    b.add(turned_piece([(q, z + low - 0.005) for q, z in bulb], 20), BULB)


def _band(profile: list[tuple[float, float]], sides: int = 48) -> Solid:
    """Return the ring of a closed profile of (radius, height), given counter-clockwise with the axis to its left."""
    rings = np.stack([circle(r, sides, z) for r, z in profile])
    m, n = rings.shape[:2]
    i, j = np.meshgrid(np.arange(m), np.arange(n), indexing="ij")
    a, c = i * n + j, i * n + (j + 1) % n
    b, d = (i + 1) % m * n + j, (i + 1) % m * n + (j + 1) % n
    faces = np.concatenate([np.stack([a, c, d], -1).reshape(-1, 3), np.stack([a, d, b], -1).reshape(-1, 3)])
    return solid(rings.reshape(-1, 3), faces)


# The television.


BEZEL = Material("black housing", (0.018, 0.018, 0.019), 0.4)
SCREEN = Material("screen", (0.008, 0.008, 0.009), 0.08)


def television(b: Bench) -> None:
    """Build a flat screen on two feet."""
    w, d, h = b.size
    low = min(0.055, 0.1 * h)
    thin = min(0.022, 0.4 * d)
    b.block((-w / 2, -thin / 2, low), (w / 2, thin / 2, h), BEZEL, bevel_m=0.005, steps=2)
    rim = 0.008
    b.block(
        (-w / 2 + rim, thin / 2 - 0.004, low + 2 * rim),
        (w / 2 - rim, thin / 2 + 0.0006, h - rim),
        SCREEN,
        bevel_m=0.0005,
    )
    b.block((-0.32 * w, -0.46 * d, low + 0.08 * h), (0.32 * w, 0, low + 0.55 * h), BEZEL, bevel_m=0.012, steps=2)
    for side in (-1, 1):
        x = side * 0.36 * w
        rows = []
        for y, z in ((-d / 2, 0.005), (-d / 4, 0.012), (0.0, low + 0.004), (d / 4, 0.012), (d / 2, 0.005)):
            ring = rounded_rectangle(0.026, 0.010, 0.003, steps=1)
            rows.append(np.column_stack([ring[:, 0] + x, np.full(len(ring), y), ring[:, 1] + z])[::-1])
        b.add(loft(np.stack(rows)), BEZEL)

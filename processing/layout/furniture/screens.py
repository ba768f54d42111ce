"""The television."""

from __future__ import annotations

import numpy as np

from processing.layout.furniture.bench import Bench
from processing.layout.furniture.model import Material
from processing.layout.furniture.solids import loft, rounded_rectangle

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

"""Cloth by itself: rugs, cushions, blankets."""

from __future__ import annotations

import math

from mocks.rooms.furniture.build import Build
from mocks.rooms.shapes import cylinder, moved, rounded_box, turned
from mocks.rooms.soft_shapes import pillow


def rug(b: Build) -> None:
    """Build a rug, round with the option ``round``."""
    w, d, h = b.size
    if b.option("round", 0.0):
        b.add(cylinder((0, 0, 0), w / 2, h, 0.004, 64), b.finish.rug)
    else:
        b.add(rounded_box((-w / 2, -d / 2, 0.0), (w / 2, d / 2, h), 0.004), b.finish.rug)


def cushion(b: Build) -> None:
    """Build a cushion that leans back towards +y by the option ``lean`` (radians from upright, pi/2 lying)."""
    w, _, h = b.size
    lean = b.option("lean", 0.35)
    side = min(w, (h - 0.10 * math.sin(lean)) / max(math.cos(lean), 0.25))
    thick = 0.15
    mesh = turned(pillow((w, side, thick)), (1, 0, 0), math.pi / 2 - lean)
    low = float(mesh.vertices[:, 2].min())
    middle = (mesh.vertices[:, 1].min() + mesh.vertices[:, 1].max()) / 2
    cloth = b.pick(b.finish.second_fabric, b.finish.rug, b.finish.curtain, b.finish.bedding)
    b.add(moved(mesh, (0.0, -float(middle), -low)), cloth)


def blanket(b: Build) -> None:
    """Build a blanket folded in three."""
    w, d, h = b.size
    cloth = b.pick(b.finish.second_fabric, b.finish.curtain, b.finish.rug)
    for k in range(3):
        z, inset = h * k / 3, 0.006 * float(b.rng.random())
        low, high = (-w / 2 + inset, -d / 2 + inset, z), (w / 2 - inset, d / 2, z + h / 3)
        b.add(rounded_box(low, high, 0.45 * h / 3, 2), cloth)

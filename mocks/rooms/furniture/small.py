"""Vessels, boxes, baskets, toys: the things that stand about."""

from __future__ import annotations

import math

import numpy as np

from mocks.rooms.furniture.build import CERAMIC, PAPER, Build
from mocks.rooms.model import Material
from mocks.worlds.light import Vector
from processing.ground.mesh import Mesh, moved, turned
from processing.ground.shapes import ball, cylinder, lathe, rounded_box, tube


def _vessel(outside: list[tuple[float, float]], wall: float) -> Mesh:
    """Return an open vessel from its outer profile (foot to rim) and the thickness of its wall."""
    inside = [(max(r - wall, 0.001), max(z, wall)) for r, z in reversed(outside)]
    return lathe([(0.0, 0.0), *outside, *inside, (0.0, wall)], 28)


def vase(b: Build) -> None:
    """Build a vase, some with dry stalks."""
    w, _, h = b.size
    r = w / 2
    stalks = h > 0.4
    tall = 0.5 * h if stalks else h
    shapes: tuple[tuple[float, ...], ...] = (
        (0.55, 0.8, 0.97, 1.0, 0.9, 0.65, 0.42, 0.40, 0.48),
        (0.6, 0.7, 0.8, 0.88, 0.94, 0.98, 1.0, 1.0, 0.98),
        (0.75, 0.95, 1.0, 0.9, 0.65, 0.42, 0.34, 0.34, 0.40),
    )
    shape = shapes[b.item.seed % 3]
    radius = r if not stalks else min(r, 0.09)
    outline = [(radius * s, tall * k / (len(shape) - 1)) for k, s in enumerate(shape)]
    b.add(_vessel(outline, 0.005), b.plain("ceramic", CERAMIC, None if b.item.seed % 2 else 0.2))
    if stalks:
        straw = Material("dry grass", (0.46, 0.35, 0.20))
        for _ in range(11):
            a, reach = b.rng.uniform(0, 2 * math.pi), b.rng.uniform(0.2, 0.9) * (r - 0.015)
            top = h * float(b.rng.uniform(0.8, 0.97))
            x, y = float(reach * math.cos(a)), float(reach * math.sin(a))
            neck = 0.25 * radius / max(reach, 1e-3)
            b.add(tube([(0, 0, 0.02), (x * neck, y * neck, tall), (x, y, top)], 0.0015, 5), straw)
            b.add(
                tube(
                    [(x * 0.93, y * 0.93, top * 0.88), (x * 0.97, y * 0.97, top * 0.94), (x, y, top)],
                    (0.003, 0.009, 0.001),
                    7,
                ),
                straw,
            )


def bottle(b: Build) -> None:
    """Build a bottle."""
    w, _, h = b.size
    r = w / 2
    outline = [(0.0, 0.0), (0.95 * r, 0.0), (r, 0.05 * h), (r, 0.58 * h), (0.85 * r, 0.66 * h), (0.42 * r, 0.76 * h)]
    glass = b.plain("bottle glass", ((0.03, 0.06, 0.03), (0.05, 0.03, 0.02), (0.35, 0.42, 0.42)), 0.08)
    b.add(lathe([*outline, (0.36 * r, 0.80 * h), (0.36 * r, h), (0.0, h)], 24), glass)
    b.add(
        lathe([(r + 0.0005, 0.18 * h), (r + 0.001, 0.19 * h), (r + 0.001, 0.45 * h), (r + 0.0005, 0.46 * h)], 24),
        b.plain("label", PAPER),
    )


def bowl(b: Build) -> None:
    """Build a bowl, on tables with fruit."""
    w, _, h = b.size
    r = w / 2
    outline = [(0.35 * r, 0.0), (0.40 * r, 0.03 * h), (0.7 * r, 0.22 * h), (0.9 * r, 0.55 * h), (r, h)]
    b.add(_vessel(outline, 0.006), b.plain("ceramic", CERAMIC, 0.2))
    if w > 0.2 and b.item.seed % 2:
        peel = b.plain("fruit", ((0.55, 0.22, 0.04), (0.42, 0.48, 0.08), (0.50, 0.08, 0.05)), 0.4)
        for k in range(4):
            a = math.pi / 2 * k
            b.add(ball((0.4 * r * math.cos(a), 0.4 * r * math.sin(a), 0.22 * h + 0.036), 0.036, 16), peel)


def mug(b: Build) -> None:
    """Build a mug with its handle."""
    w, _, h = b.size
    r = 0.38 * w
    clay = b.plain("ceramic", CERAMIC, 0.2)
    b.add(moved(_vessel([(0.9 * r, 0.0), (r, 0.06 * h), (r, h)], 0.004), (-0.1 * w, 0, 0)), clay)
    arc: list[Vector] = [
        (r - 0.1 * w + 0.2 * w * math.sin(t), 0.0, h * (0.5 - 0.32 * math.cos(t)))
        for t in np.linspace(0.1, math.pi - 0.1, 8)
    ]
    b.add(tube(arc, 0.005, 8), clay)


def box(b: Build) -> None:
    """Build a box: cardboard with a taped lid, or a lidded storage box."""
    w, d, h = b.size
    if b.item.seed % 2:
        card = Material("cardboard", (0.42, 0.30, 0.19))
        b.block((-w / 2, -d / 2, 0.0), (w / 2, d / 2, h - 0.001), card, 0.003)
        b.block(
            (-0.025, -d / 2 - 0.0005, h * 0.7),
            (0.025, d / 2 + 0.0005, h),
            Material("tape", (0.55, 0.42, 0.26), roughness=0.2),
            0.0004,
        )
        return
    skin = b.plain("box", PAPER)
    b.block((-w / 2 + 0.004, -d / 2 + 0.004, 0.0), (w / 2 - 0.004, d / 2 - 0.004, h - 0.01), skin, 0.003)
    b.block((-w / 2, -d / 2, h - 0.07), (w / 2, d / 2, h), skin, 0.003)


def basket(b: Build) -> None:
    """Build a wicker basket of stacked strands, open above."""
    w, _, h = b.size
    wicker = b.plain("wicker", ((0.42, 0.29, 0.16), (0.55, 0.44, 0.28), (0.20, 0.15, 0.11)))
    r, rings = w / 2, max(6, round(h / 0.028))
    outside: list[tuple[float, float]] = []
    for k in range(rings):
        base = r * (0.80 + 0.20 * math.sin(math.pi / 2 * (k + 0.5) / rings))
        z0, z1 = h * k / rings, h * (k + 1) / rings
        outside += [(base - 0.004, z0 + 1e-4), (base, z0 + 0.25 * (z1 - z0)), (base, z0 + 0.75 * (z1 - z0))]
    outside.append((0.99 * r, h))
    b.add(_vessel(outside, 0.012), wicker)
    b.add(cylinder((0, 0, 0.02), 0.8 * r - 0.02, 0.55 * h, 0.03, 20), b.finish.second_fabric)


def toy_blocks(b: Build) -> None:
    """Build a scatter of toy blocks with a small tower."""
    w, d, _ = b.size
    side = 0.04
    cells = [
        (x, y)
        for x in np.arange(-w / 2 + side, w / 2 - side, 0.065)
        for y in np.arange(-d / 2 + side, d / 2 - side, 0.065)
    ]
    chosen = b.rng.permutation(len(cells))[: max(4, len(cells) // 3)]
    for n, k in enumerate(chosen):
        levels = 2 if n == 0 else 1
        for level in range(levels):
            cube = rounded_box((-side / 2, -side / 2, 0), (side / 2, side / 2, side), 0.003)
            spot = (float(cells[k][0]), float(cells[k][1]), level * side)
            b.add(moved(turned(cube, (0, 0, 1), float(b.rng.uniform(0, 1.57))), spot), b.plain("toy", PAPER, 0.35))


def toy_ball(b: Build) -> None:
    """Build a ball."""
    r = b.size[0] / 2
    b.add(ball((0, 0, r), r, 24), b.plain("toy", PAPER, 0.3))

"""Lamps, electronics, vessels, boxes, toys: the things that stand about."""

from __future__ import annotations

import math

import numpy as np

from mocks.light import Vector
from mocks.rooms.furniture.build import BLACK_PLASTIC, CERAMIC, PAPER, SCREEN, SHADE, WHITE_PLASTIC, Build
from mocks.rooms.mesh import Mesh
from mocks.rooms.model import Material
from mocks.rooms.shapes import ball, cylinder, lathe, moved, rounded_box, tube, turned


def _shade(b: Build, low: float, high: float, radius: float) -> None:
    """Add a lampshade, a truncated cone of cloth open above and below, and its bulb.

    Lamps that go with the furniture are never lit: the emptied room is to be seen under the same light.
    """
    top = radius * (0.62, 0.85, 1.0)[b.item.seed % 3]
    wall = 0.003
    outline = [(radius - wall, low), (radius, low), (top, high), (top - wall, high), (radius - wall, low)]
    b.add(lathe(outline, 32), SHADE)
    b.add(ball((0, 0, (low + high) / 2), 0.03, 14), WHITE_PLASTIC)
    b.add(tube([(0, 0, low - 0.03), (0, 0, (low + high) / 2 - 0.02)], 0.008, 10), b.finish.metal)
    for k in range(3):
        a = 2 * math.pi * k / 3
        end = (top * 0.97 * math.cos(a), top * 0.97 * math.sin(a), high - 0.012)
        b.add(tube([(0, 0, high - 0.03), end], 0.0018, 6), b.finish.metal)
    b.add(tube([(0, 0, (low + high) / 2), (0, 0, high - 0.025)], 0.004, 8), b.finish.metal)


def floor_lamp(b: Build) -> None:
    """Build a floor lamp: a foot and a pole, or a wooden tripod, below a shade."""
    w, _, h = b.size
    shade = 0.30
    if b.item.seed % 2:
        b.add(cylinder((0, 0, 0), 0.14, 0.022, 0.006, 32), b.finish.metal)
        b.add(tube([(0, 0, 0.02), (0, 0, h - shade)], 0.011, 12), b.finish.metal)
    else:
        reach = min(0.24, w / 2 - 0.01)
        for k in range(3):
            a = 2 * math.pi * k / 3 + 0.5
            foot = (reach * math.cos(a), reach * math.sin(a), 0.0)
            b.add(tube([foot, (-0.02 * math.cos(a), -0.02 * math.sin(a), h - shade - 0.05)], 0.013, 10), b.finish.wood)
        b.add(cylinder((0, 0, h - shade - 0.09), 0.03, 0.07, 0.006), b.finish.metal)
    _shade(b, h - shade, h, w / 2)


def table_lamp(b: Build) -> None:
    """Build a table lamp with a turned ceramic or wooden body."""
    w, _, h = b.size
    shade, stem = 0.42 * h, 0.62 * h
    body = b.plain("ceramic", CERAMIC, 0.25) if b.item.seed % 3 else b.finish.wood
    r = 0.24 * w
    if b.item.seed % 2:
        bulge = [
            (r * (0.55 + 0.6 * math.sin(math.pi * (0.12 + 0.82 * t))), t * (stem - 0.05)) for t in np.linspace(0, 1, 10)
        ]
        b.add(lathe([(0.0, 0.0), *bulge, (0.0, stem - 0.05)], 28), body)
        b.add(tube([(0, 0, stem - 0.06), (0, 0, stem)], 0.008, 10), b.finish.metal)
    else:
        b.add(cylinder((0, 0, 0), 1.1 * r, 0.018, 0.004, 28), b.finish.metal)
        b.add(tube([(0, 0, 0.015), (0, 0, stem)], 0.009, 10), b.finish.metal)
    _shade(b, h - shade, h, w / 2)


def television(b: Build) -> None:
    """Build a flat television on two feet."""
    w, d, h = b.size
    low = 0.06
    b.block((-w / 2, -0.012, low), (w / 2, 0.018, h), BLACK_PLASTIC, 0.004)
    b.block((-w / 2 + 0.008, -0.0135, low + 0.014), (w / 2 - 0.008, -0.008, h - 0.008), SCREEN, 0.001)
    b.block((-w * 0.3, 0.015, low + 0.05), (w * 0.3, 0.045, h - 0.25), BLACK_PLASTIC, 0.01)
    for side in (-1, 1):
        for end in (-1, 1):
            foot = (side * w * 0.36, end * (d / 2 - 0.01), 0.004)
            b.bar(foot, (side * w * 0.35, 0.003, low + 0.01), 0.02, 0.008, BLACK_PLASTIC)


def monitor(b: Build) -> None:
    """Build a screen on a foot."""
    w, d, h = b.size
    low, tilt = 0.12, -0.06
    case = turned(rounded_box((-w / 2, -0.012, low), (w / 2, 0.02, h - 0.002), 0.004), (1, 0, 0), tilt, (0, 0, low))
    pane = turned(
        rounded_box((-w / 2 + 0.008, -0.014, low + 0.012), (w / 2 - 0.008, -0.01, h - 0.012), 0.0005),
        (1, 0, 0),
        tilt,
        (0, 0, low),
    )
    b.add(case, BLACK_PLASTIC)
    b.add(pane, SCREEN)
    metal = b.pick(b.finish.metal, BLACK_PLASTIC)
    b.block((-0.12, -d / 2, 0.0), (0.12, d / 2, 0.012), metal, 0.004)
    b.bar((0, 0.05, 0.008), (0, 0.032, h * 0.62), 0.05, 0.018, metal)


def laptop(b: Build) -> None:
    """Build an open laptop: the lid leans back from the rear edge."""
    w, d, h = b.size
    case = b.pick(Material("aluminium", (0.55, 0.55, 0.56), roughness=0.3), BLACK_PLASTIC)
    rear = d / 2 - 0.09
    b.block((-w / 2, -d / 2, 0.0), (w / 2, rear, 0.016), case, 0.004)
    b.block((-w / 2 + 0.02, -d / 2 + 0.11, 0.0155), (w / 2 - 0.02, rear - 0.02, 0.018), BLACK_PLASTIC, 0.001)
    tall = (h - 0.012) / math.cos(0.36)
    for low, high, front, back, material in (
        (0.0, tall, -0.003, 0.004, case),
        (0.008, tall - 0.008, -0.0045, -0.0025, SCREEN),
    ):
        lid = rounded_box((-w / 2 + 0.006, front, low), (w / 2 - 0.006, back, high), 0.001)
        b.add(moved(turned(lid, (1, 0, 0), -0.36), (0, rear - 0.006, 0.014)), material)


def keyboard(b: Build) -> None:
    """Build a keyboard with a mouse to its right."""
    w, d, h = b.size
    case = b.pick(BLACK_PLASTIC, WHITE_PLASTIC)
    right = w / 2 - 0.12
    b.block((-w / 2, -d / 2, 0.0), (right, d / 2, h * 0.5), case, 0.004)
    pitch = (d - 0.02) / 5
    for row in range(5):
        y = -d / 2 + 0.01 + row * pitch
        b.block((-w / 2 + 0.01, y + 0.002, h * 0.4), (right - 0.01, y + pitch - 0.002, h * 0.72), case, 0.002)
    b.add(rounded_box((w / 2 - 0.075, -0.05, 0.0), (w / 2 - 0.012, 0.05, h), 0.014, 3), case)


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

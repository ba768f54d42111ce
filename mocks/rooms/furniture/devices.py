"""Lamps, screens and keyboards; the photographer's tripod, and the white board that the meter looks at."""

import math

import numpy as np

from mocks.rooms.furniture.build import BLACK_PLASTIC, CERAMIC, CORNERS, SCREEN, SHADE, WHITE_PLASTIC, Build
from mocks.rooms.model import Material
from processing.ground.mesh import moved, turned
from processing.ground.shapes import ball, cylinder, lathe, rounded_box, tube

BOARD_SIDE_M = 0.5  # chosen: a white board as rigs carry them
BOARD_WHITE = Material("meter board", (0.90, 0.90, 0.90))
"""Matte white of albedo 0.90."""
ALLOY = Material("grey alloy", (0.22, 0.22, 0.23), roughness=0.35)


def tripod(b: Build) -> None:
    """Build a tripod: three splayed legs of two sections, a centre column, a small head; its top is the size's height.

    The feet stand on the circle of the size's width.
    """
    reach, top = b.size[0] / 2 - 0.012, b.size[2]
    shoulder = 1.12
    for k in range(3):
        a = math.pi / 2 + 2 * math.pi * k / 3
        x, y = math.cos(a), math.sin(a)
        hip, foot = (0.045 * x, 0.045 * y, shoulder), (reach * x, reach * y, 0.03)
        knee = (0.5 * (hip[0] + foot[0]), 0.5 * (hip[1] + foot[1]), 0.5 * (hip[2] + foot[2]))
        b.add(tube([hip, knee], 0.0145, 12), BLACK_PLASTIC)
        b.add(tube([knee, foot], 0.011, 12), ALLOY)
        b.add(tube([(reach * x, reach * y, 0.0), foot], (0.010, 0.014), 12), BLACK_PLASTIC)
    b.add(cylinder((0, 0, shoulder - 0.05), 0.036, 0.09, 0.008), BLACK_PLASTIC)
    b.add(cylinder((0, 0, shoulder - 0.30), 0.012, top - shoulder + 0.24), ALLOY)
    b.add(cylinder((0, 0, top - 0.065), 0.022, 0.05, 0.006), BLACK_PLASTIC)
    b.add(cylinder((0, 0, top - 0.015), 0.026, 0.015, 0.002), ALLOY)


def meter_board(b: Build) -> None:
    """Build the white board: 0.5 m square, upright, its face towards -y, its upper edge at the size's height."""
    _, depth, top = b.size
    half, front, low = BOARD_SIDE_M / 2, -0.012, top - BOARD_SIDE_M
    b.add(rounded_box((-half, front, low), (half, front + 0.006, top), 0.0015), BOARD_WHITE)
    b.add(tube([(0, 0.006, 0.05), (0, 0.006, top - 0.12)], 0.010, 12), ALLOY)
    b.block((-0.06, -0.006, top - 0.32), (0.06, 0.012, top - 0.26), BLACK_PLASTIC)
    reach = depth / 2 - 0.01
    for k in range(3):
        a = -math.pi / 2 + 2 * math.pi * k / 3
        foot = (reach * math.cos(a), reach * math.sin(a), 0.0)
        b.leg(foot, (0.0, 0.006, 0.26), 0.008, 0.008, BLACK_PLASTIC)


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
        heights = np.linspace(0, 1, 10)
        bulge = [(r * (0.55 + 0.6 * math.sin(math.pi * (0.12 + 0.82 * t))), t * (stem - 0.05)) for t in heights]
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
    for side, end in CORNERS:
        foot = (side * w * 0.36, end * (d / 2 - 0.01), 0.004)
        b.bar(foot, (side * w * 0.35, 0.003, low + 0.01), 0.02, 0.008, BLACK_PLASTIC)


def monitor(b: Build) -> None:
    """Build a screen on a foot."""
    w, d, h = b.size
    low = 0.12
    case = rounded_box((-w / 2, -0.012, low), (w / 2, 0.02, h - 0.002), 0.004)
    pane = rounded_box((-w / 2 + 0.008, -0.014, low + 0.012), (w / 2 - 0.008, -0.01, h - 0.012), 0.0005)
    for mesh, material in ((case, BLACK_PLASTIC), (pane, SCREEN)):
        b.add(turned(mesh, (1, 0, 0), -0.06, (0, 0, low)), material)
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

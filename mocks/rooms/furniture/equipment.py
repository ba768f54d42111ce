"""The photographer's own things: the tripod below the camera and the white board that the meter looks at."""

from __future__ import annotations

import math

from mocks.rooms.furniture.build import BLACK_PLASTIC, Build
from mocks.rooms.model import Material
from mocks.rooms.shapes import cylinder, rounded_box, tube

BOARD_SIDE_M = 0.5
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

"""Beds: frame, headboard in the style's manner, mattress, duvet, pillows, a throw."""

from __future__ import annotations

import math

import numpy as np

from processing.layout.furniture.bench import Bench
from processing.layout.furniture.model import Material
from processing.layout.furniture.soft import hanging, pad, pillow
from processing.layout.furniture.surface import Solid

RAIL_TOP_M = 0.33
BOARD_M = 0.045
PADDED_M = 0.095


def bed(b: Bench) -> None:
    """Build a bed of any width; the head is at -y, the height is the headboard's."""
    w, d, h = b.size
    head = PADDED_M if b.style.head == "padded" else BOARD_M
    rail_top = min(RAIL_TOP_M, 0.45 * h)
    _frame(b, rail_top)
    {"slats": _slats, "padded": _padded, "panel": _panel}[b.style.head](b)
    inner, start = w - 0.10, -d / 2 + head + 0.005
    long = d / 2 - 0.035 - start
    low, high = rail_top - 0.05, rail_top + 0.15
    b.add(pad((-inner / 2, start, low), (inner / 2, start + long, high), 0.05, (0.006, 0.006, 0.008)), b.style.bedding)
    _bedding(b, inner, start, long, high)


def _frame(b: Bench, top: float) -> None:
    w, d, _ = b.size
    x, y, low = w / 2, d / 2, top - 0.13
    timber = b.style.timber
    for side in (-1, 1):
        lo, hi = sorted((side * x, side * (x - 0.028)))
        b.block((lo, -y + 0.03, low), (hi, y - 0.02, top), timber, bevel_m=0.008)
    b.block((-x, y - 0.032, low), (x, y, top), timber, bevel_m=0.008)
    b.block((-x + 0.02, -y + 0.03, low + 0.03), (x - 0.02, y - 0.025, low + 0.05), b.style.second_timber)
    b.legs((x - 0.06, y - 0.06), low + 0.01, thick_m=0.06)


def _slats(b: Bench) -> None:
    """Build a headboard of upright bars between two posts and a shaped rail."""
    w, d, h = b.size
    x, back = w / 2, -d / 2
    timber = b.style.timber
    for side in (-1, 1):
        lo, hi = sorted((side * x, side * (x - 0.05)))
        b.block((lo, back, 0), (hi, back + BOARD_M, h - 0.005), timber, bevel_m=0.014, steps=2)
    b.block((-x + 0.02, back + 0.002, h - 0.09), (x - 0.02, back + BOARD_M - 0.002, h), timber, bevel_m=0.014, steps=2)
    b.block((-x + 0.03, back + 0.008, 0.36), (x - 0.03, back + BOARD_M - 0.008, 0.42), timber, bevel_m=0.008)
    count = max(5, round((w - 0.1) / 0.105))
    for s in np.linspace(-x + 0.05, x - 0.05, count + 2)[1:-1]:
        b.rod([(float(s), back + BOARD_M / 2, 0.39), (float(s), back + BOARD_M / 2, h - 0.05)], 0.011, timber)


def _padded(b: Bench) -> None:
    """Build a headboard of upright cushions on a board."""
    w, d, h = b.size
    x, back = w / 2, -d / 2
    b.block((-x, back, 0.06), (x, back + 0.025, h - 0.006), b.style.fabric, bevel_m=0.008)
    count = max(3, round(w / 0.20))
    wide = w / count
    for k in range(count):
        x0 = -x + k * wide
        low, high = (x0 + 0.0005, back + 0.012, 0.20), (x0 + wide - 0.0005, back + PADDED_M, h)
        b.add(pad(low, high, 0.03, (0.003, 0.012, 0.003), inner=2, steps=2), b.style.fabric)


def _panel(b: Bench) -> None:
    """Build a framed headboard with sunk fields."""
    w, d, h = b.size
    x, back, front = w / 2, -d / 2, -d / 2 + BOARD_M
    timber = b.style.timber
    b.block((-x + 0.03, back + 0.012, 0.22), (x - 0.03, front - 0.014, h - 0.04), timber)
    for side in (-1, 1):
        lo, hi = sorted((side * x, side * (x - 0.07)))
        b.block((lo, back, 0), (hi, front, h - 0.02), timber, bevel_m=0.005)
    b.block((-x - 0.0, back, h - 0.025), (x, front + 0.012, h), timber, bevel_m=0.008, steps=2)
    b.block((-x + 0.03, back + 0.003, h - 0.12), (x - 0.03, front - 0.001, h - 0.02), timber, bevel_m=0.004)
    b.block((-x + 0.03, back + 0.003, 0.22), (x - 0.03, front - 0.001, 0.32), timber, bevel_m=0.004)
    count = 1 if w < 1.0 else 2 if w < 1.6 else 3
    for k in range(1, count):
        at = -x + k * w / count
        b.block((at - 0.035, back + 0.003, 0.24), (at + 0.035, front - 0.001, h - 0.06), timber, bevel_m=0.004)


def _bedding(b: Bench, inner: float, start: float, long: float, top: float) -> None:
    """Add the duvet with its turned-down end, pillows and a throw over the foot."""
    over = inner + 0.085
    begin = start + 0.30 * long
    duvet = hanging(over, start + long + 0.022 - begin, 0.21, 0.045, seed=4, foot_drop_m=0.16)
    b.add(duvet.moved(0, begin, top + 0.055), b.style.bedding, grain=1)
    fold = hanging(over + 0.014, 0.26, 0.20, 0.022, seed=4, begin_m=-0.015, cells=(40, 12))
    b.add(fold.moved(0, begin - 0.015, top + 0.070), b.style.second_fabric, grain=1)
    at = 0.40 * long
    throw = hanging(over + 0.016, min(0.42, 0.24 * long), 0.225, 0.014, seed=4, begin_m=at, cells=(40, 14))
    b.add(throw.moved(0, begin + at, top + 0.071), b.style.accent, grain=1)
    count = 1 if inner < 1.1 else 2
    wide = min(0.70, (inner - 0.06) / count)
    for k in range(count):
        middle = (k - (count - 1) / 2) * (inner / count)
        _lean(b, pillow(wide - 0.02, 0.46, 0.19, seed=k), middle, start, top, 52, b.style.bedding)
        _lean(b, pillow(wide - 0.10, 0.40, 0.17, seed=6 + k), middle, start + 0.15, top, 46, b.style.second_fabric)
    _lean(b, pillow(min(0.52, 0.6 * inner), 0.30, 0.14, seed=21), 0, start + 0.30, top, 50, b.style.accent)


def _lean(b: Bench, one: Solid, x: float, y: float, z: float, degrees: float, material: Material) -> None:
    turned = one.turned("x", math.radians(degrees))
    low = turned.vertices.min(axis=0)
    b.add(turned.moved(x, y - low[1], z - 0.01 - low[2]), material)

"""Upholstered seats: the sofa, and the armchair with a wooden frame."""

from __future__ import annotations

from processing.ground.arrays import Doubles

import math

import numpy as np

from processing.layout.furniture.bench import Bench
from processing.layout.furniture.soft import cushion, pad, pillow, wrinkled
from processing.layout.furniture.solids import box, loft, rounded_rectangle
from processing.layout.furniture.surface import Solid

LEG_M = 0.13
SEAT_M = 0.43


def sofa(b: Bench) -> None:
    """Build a sofa: base, arms, back, a seat and a back cushion a place, two scatter cushions."""
    w, d, h = b.size
    arm = float(np.clip(0.09 * w, 0.11, 0.18))
    arm_top = min(0.60, 0.76 * h)
    leg = min(LEG_M, 0.18 * h)
    base_top = min(SEAT_M, 0.55 * h) - 0.15
    x, y = w / 2, d / 2
    cloth = b.style.fabric
    b.add(pad((-x + 0.02, -y + 0.03, leg), (x - 0.02, y - 0.03, base_top), 0.02, 0.004, inner=4), cloth)
    for side in (-1, 1):
        lo, hi = sorted((side * x, side * (x - arm)))
        one = pad((lo, -y + 0.01, leg - 0.01), (hi, y, arm_top), 0.045, (0.008, 0.008, 0.012), inner=8)
        b.add(wrinkled(one, 0.0015, 0.4, 3 + side), cloth)
    back = pad((-x + 0.5 * arm, -y, leg), (x - 0.5 * arm, -y + 0.16, h - 0.06), 0.05, (0.004, 0.008, 0.010), inner=8)
    b.add(wrinkled(back, 0.002, 0.4, 9), cloth)
    _places(b, x - arm, base_top)
    _scatter(b, x - arm, base_top + 0.14)
    b.legs((x - 0.09, y - 0.12), leg + 0.01, thick_m=0.045, splay=0.015 if b.style.legs != "square" else 0.0)


def _places(b: Bench, half: float, base: float) -> None:
    """Add the seat and back cushions between the arms."""
    _, d, h = b.size
    count = max(1, round(2 * half / 0.72))
    wide = (2 * half - 0.01) / count
    cells = 8 if count < 3 else 5
    deep, thick = d - 0.16 - 0.03, 0.16
    for k in range(count):
        middle = -half + 0.005 + (k + 0.5) * wide
        seat = cushion(wide - 0.004, deep, thick, crown_m=0.028, seed=k, inner=cells).moved(
            middle, -d / 2 + 0.155 + deep / 2, base
        )
        b.add(seat, b.style.fabric)
        tall = h - base - thick + 0.045
        rest = cushion(wide - 0.012, tall, 0.19, crown_m=0.05, seed=20 + k, piping_m=0.0045, inner=cells)
        rest = rest.moved(0, tall / 2, -0.095).turned("x", math.radians(90 + 12))
        low = rest.vertices[:, 2].min()
        b.add(rest.moved(middle, -d / 2 + 0.285, base + thick - 0.035 - low), b.style.fabric)


def _scatter(b: Bench, half: float, seat: float) -> None:
    _, d, _ = b.size
    side = min(0.44, 0.62 * half)
    for k, (sign, material) in enumerate(((-1, b.style.accent), (1, b.style.second_fabric))):
        one = pillow(side, side, 0.16, seed=5 + k).turned("x", math.radians(68)).turned("z", math.radians(-sign * 24))
        low = one.vertices[:, 2].min()
        b.add(one.moved(sign * (half - 0.46 * side), -d / 2 + 0.46, seat + 0.005 - low), material)


def armchair(b: Bench) -> None:
    """Build an easy chair: a wooden frame with shaped arms, a leaning back of bars, loose cushions."""
    w, d, h = b.size
    x, y = w / 2, d / 2
    timber, thick = b.style.timber, 0.042
    arm_top = min(0.60, 0.72 * h)
    lean = math.radians(17)
    for side in (-1, 1):
        at = side * (x - 0.04)
        front, rear = (at, y - 0.10, 0.0), (at, -y + 0.10, 0.0)
        b.add(_leg_between(front, (at, y - 0.13, arm_top - 0.01), thick), timber)
        b.add(_leg_between(rear, (at, -y + 0.14, arm_top - 0.01), thick), timber)
        b.add(_arm(at, -y + 0.04, y, arm_top), timber, grain=1)
        b.block((at - 0.014, -y + 0.13, 0.23), (at + 0.014, y - 0.12, 0.285), timber, bevel_m=0.006)
    for yy, z in ((y - 0.125, 0.235), (-y + 0.16, 0.20)):
        b.block((-x + 0.03, yy - 0.014, z), (x - 0.03, yy + 0.014, z + 0.055), timber, bevel_m=0.006)
    back_low, back_y = 0.24, -y + 0.24
    tall = (h - back_low) / math.cos(lean)
    for s in np.linspace(-0.78, 0.78, 7):
        bar = box((s * (x - 0.1) - 0.011, -0.009, 0), (s * (x - 0.1) + 0.011, 0.009, tall - 0.03), 0.004)
        b.add(bar.turned("x", lean).moved(0, back_y - 0.02, back_low), timber)
    rail = box((-x + 0.075, -0.014, tall - 0.06), (x - 0.075, 0.014, tall), 0.008, 2)
    b.add(rail.turned("x", lean).moved(0, back_y - 0.02, back_low), timber, grain=0)
    wide = w - 0.17
    deep = d - 0.26
    seat = cushion(wide, deep, 0.13, crown_m=0.03, seed=2).turned("x", math.radians(4))
    b.add(seat.moved(0, y - 0.02 - deep / 2, 0.275), b.style.second_fabric)
    rest = cushion(wide - 0.02, tall - 0.20, 0.13, crown_m=0.045, seed=8)
    rest = rest.moved(0, (tall - 0.20) / 2, 0).turned("x", math.pi / 2 + lean)
    b.add(rest.moved(0, back_y + 0.135, back_low + 0.155), b.style.second_fabric)


def _leg_between(foot: tuple[float, float, float], hip: tuple[float, float, float], thick: float) -> Solid:
    f, t = np.array(foot), np.array(hip)
    rows = [f + (t - f) * s + rounded_rectangle(thick * q * 0.8, thick * q, 0.012, steps=3)
            for s, q in ((0, 0.62), (0.012, 0.68), (0.75, 1.0), (1, 0.9))]  # fmt: skip
    return loft(np.stack(rows))


def _arm(x: float, y0: float, y1: float, top: float) -> Solid:
    """Return an arm rest: a board that widens to the front and rises a little."""
    steps = np.linspace(0, 1, 11)
    rows: list[Doubles] = []
    for t in steps:
        wide = 0.052 + 0.026 * math.sin(math.pi * min(t, 0.75) / 1.5)
        ends = min(1.0, math.sin(math.pi * min(max(min(t, 1 - t), 0.0) * 6 + 0.12, 0.5)) + 0.0)
        ring = rounded_rectangle(wide * ends, 0.030 * (0.6 + 0.4 * ends), 0.010, steps=3)
        z = top - 0.015 + 0.02 * (t - 1) + 0.012 * math.sin(math.pi * t)
        rows.append(np.column_stack([ring[:, 0] + x, np.full(len(ring), y0 + (y1 - y0) * t), ring[:, 1] + z])[::-1])
    return loft(np.stack(rows))

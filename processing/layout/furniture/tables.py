"""Tables: coffee table, dining table, desk."""

from __future__ import annotations

import numpy as np

from processing.layout.furniture.bench import Bench
from processing.layout.furniture.solids import box, curve, loft, rounded_rectangle, slab, square_leg, tube
from processing.layout.furniture.storage import drawer
from processing.layout.furniture.surface import Solid


def coffee_table(b: Bench) -> None:
    """Build a coffee table: a rounded top over a shelf, with two books and a bowl below."""
    w, d, h = b.size
    thick = 0.026
    top = slab(w, d, h - thick, h, corner_m=0.10 if b.style.legs == "round" else 0.02, edge_m=0.008)
    b.add(top, b.style.timber, grain=0)
    shelf_z = 0.36 * h
    shelf = slab(w - 0.14, d - 0.12, shelf_z, shelf_z + 0.018, corner_m=0.05, edge_m=0.004)
    b.add(shelf, b.style.second_timber, grain=0)
    x, y = w / 2 - 0.08, d / 2 - 0.07
    if b.style.legs == "metal":
        for side in (-1, 1):
            _sled(b, side * x, y, h - thick)
    else:
        b.legs((x, y), h - thick + 0.002, thick_m=0.045, splay=0.02 if b.style.legs == "round" else 0.0)
    if h - shelf_z > 0.15:
        for k, (wide, deep, z) in enumerate(((0.27, 0.20, 0.0), (0.23, 0.17, 0.028))):
            book = box((-wide / 2, -deep / 2, 0), (wide / 2, deep / 2, 0.026), 0.002).turned("z", 0.25 - 0.3 * k)
            b.add(book.moved(-0.18 * w, 0, shelf_z + 0.018 + z), (b.style.accent, b.style.second_fabric)[k])


def _sled(b: Bench, x: float, y: float, top: float) -> None:
    """Add a bent bar from the top to the floor, along it, and up again."""
    r = 0.008
    line = [
        (x, -y, top + 0.004),
        (x, -y, 0.06),
        (x, -y + 0.045, r),
        (x, y - 0.045, r),
        (x, y, 0.06),
        (x, y, top + 0.004),
    ]
    b.add(tube(curve(line, 6), r, 10), b.style.metal)


def dining_table(b: Bench) -> None:
    """Build a dining table: an edged top, an apron, legs in the style's manner (black: a pair of trestles)."""
    w, d, h = b.size
    thick = 0.032
    rounded = b.style.legs == "round"
    b.add(slab(w, d, h - thick, h, corner_m=0.09 if rounded else 0.012, edge_m=0.010), b.style.timber, grain=0)
    x, y = w / 2 - 0.10, d / 2 - 0.10
    if b.style.legs == "metal":
        for side in (-1, 1):
            _frame_leg(b, side * (x - 0.06), y + 0.02, h - thick)
        b.block((-x + 0.05, -0.04, h - thick - 0.045), (x - 0.05, 0.04, h - thick), b.style.metal, bevel_m=0.004)
        return
    for side in (-1, 1):
        b.block(
            (-x, side * y - 0.011, h - thick - 0.085), (x, side * y + 0.011, h - thick), b.style.second_timber, grain=0
        )
        b.block(
            (side * x - 0.011, -y, h - thick - 0.085), (side * x + 0.011, y, h - thick), b.style.second_timber, grain=1
        )
    if rounded:
        b.legs((x, y), h - thick + 0.001, thick_m=0.075, splay=0.025)
        return
    for sx in (-1, 1):
        for sy in (-1, 1):
            foot, hip = (sx * x, sy * y, 0.0), (sx * x, sy * y, h - thick)
            b.add(square_leg(foot, hip, 0.045, 0.075, 0.004), b.style.timber)


def _frame_leg(b: Bench, x: float, y: float, top: float) -> None:
    """Add a trapezoid of flat steel."""
    wide, flat = 0.07, 0.014
    for side in (-1, 1):
        hip, foot = (x, side * y * 0.55, top), (x, side * y, 0.0)
        b.add(_flat_bar(foot, hip, flat, wide), b.style.metal)
    b.block((x - wide / 2, -y * 0.58, top - flat), (x + wide / 2, y * 0.58, top), b.style.metal, bevel_m=0.003)
    b.block((x - wide / 2, -y, 0.0), (x + wide / 2, y, flat), b.style.metal, bevel_m=0.003)


def _flat_bar(foot: tuple[float, float, float], hip: tuple[float, float, float], flat: float, wide: float) -> Solid:
    f, t = np.array(foot), np.array(hip)
    ring = rounded_rectangle(wide, flat, 0.003, steps=1)
    return loft(np.stack([f + ring, t + ring]))


def desk(b: Bench) -> None:
    """Build a desk: a top, a drawer unit to one side where there is room, legs or a panel at the other.

    The sitter's side is the front.
    """
    w, d, h = b.size
    thick = 0.026
    b.add(slab(w, d, h - thick, h, corner_m=0.012, edge_m=0.005, steps=2), b.style.timber, grain=0)
    under = h - thick
    unit = 0.36 if w >= 1.05 else 0.0
    x, y = w / 2 - 0.05, d / 2 - 0.05
    if unit:
        _unit(b, w / 2 - 0.03 - unit, w / 2 - 0.03, under)
    else:
        b.block((-x, -y - 0.01, under - 0.09), (x, -y + 0.012, under), b.style.second_timber, grain=0)
    sides = (-1,) if unit else (-1, 1)
    for side in sides:
        if b.style.legs == "metal":
            _sled(b, side * x, y, under)
            continue
        for sy in (-1, 1):
            hip, foot = (side * (x - 0.03), sy * (y - 0.02), under), (side * x, sy * y, 0.0)
            leg = square_leg(foot, hip, 0.032, 0.05, 0.008 if b.style.legs == "round" else 0.003)
            b.add(leg, b.style.second_timber)
    b.block((-x + 0.02, -d / 2 + 0.03, 0.48 * h), (w / 2 - 0.06 - unit, -d / 2 + 0.046, under), b.style.timber, grain=0)


def _unit(b: Bench, x0: float, x1: float, top: float) -> None:
    """Add a case of three drawers below the top, on short feet; its fronts stay behind the top's edge."""
    d = b.size[1]
    low, t = 0.10, 0.016
    front = d / 2 - 0.026 - 0.022
    for lo, hi in ((x0, x0 + t), (x1 - t, x1)):
        b.block((lo, -d / 2 + 0.03, low), (hi, front, top), b.style.timber, grain=2)
    b.block((x0 + t - 0.002, -d / 2 + 0.03, low), (x1 - t + 0.002, front, low + t), b.style.timber)
    b.block((x0 + t - 0.002, -d / 2 + 0.032, low), (x1 - t + 0.002, -d / 2 + 0.042, top), b.style.timber, grain=2)
    z = top - 0.004
    for share in (0.26, 0.30, 0.44):
        tall = share * (top - 0.004 - low)
        drawer(b, x0, x1, z - tall, z, back_m=0.05)
        z -= tall
    for px in (x0 + 0.04, x1 - 0.04):
        for py in (-d / 2 + 0.08, front - 0.05):
            b.add(square_leg((px, py, 0), (px, py, low + 0.002), 0.025, 0.035), b.style.second_timber)

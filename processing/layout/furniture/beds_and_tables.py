"""Beds, desks and tables."""

from __future__ import annotations

import math

import numpy as np

from processing.layout.furniture.bench import Bench
from processing.layout.furniture.model import Material
from processing.layout.furniture.soft import hanging, pad, pillow
from processing.layout.furniture.solids import Solid, box, curve, loft, rounded_rectangle, slab, square_leg, tube
from processing.layout.furniture.storage import drawer

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

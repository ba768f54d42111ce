"""Tables: dining tables, coffee tables, desks, side tables, each in several designs."""

from __future__ import annotations

from mocks.rooms.furniture.build import Build
from mocks.rooms.model import Material
from processing.ground.mesh import moved
from processing.ground.shapes import cylinder, lathe, rounded_box, tube

TOP_M = 0.03


def dining_table(b: Build) -> None:
    """Build a dining table: a plank top on square legs with an apron, trestles, or (``round``) a column."""
    timber = b.timber()
    if b.option("round", 0.0):
        _column(b, timber)
    elif b.item.seed % 3 == 0:
        _trestles(b, timber)
    else:
        _framed(b, timber)


def _framed(b: Build, timber: Material) -> None:
    w, d, h = b.size
    b.block((-w / 2, -d / 2, h - TOP_M), (w / 2, d / 2, h), timber, 0.004)
    b.legs(0.06, h - TOP_M, 0.065, timber)
    for side in (-1, 1):
        y, x = side * (d / 2 - 0.05), side * (w / 2 - 0.05)
        b.block((-w / 2 + 0.09, y - 0.011, h - TOP_M - 0.09), (w / 2 - 0.09, y + 0.011, h - TOP_M), timber)
        b.block((x - 0.011, -d / 2 + 0.09, h - TOP_M - 0.09), (x + 0.011, d / 2 - 0.09, h - TOP_M), timber)


def _trestles(b: Build, timber: Material) -> None:
    w, d, h = b.size
    steel = b.finish.metal
    b.block((-w / 2, -d / 2, h - 0.04), (w / 2, d / 2, h), timber, 0.006)
    for side in (-1, 1):
        x = side * (w / 2 - 0.18)
        for end in (-1, 1):
            b.bar((x, end * (d / 2 - 0.05), 0.0), (x, end * (d / 2 - 0.20), h - 0.04), 0.06, 0.03, steel)
        b.bar((x, -d / 2 + 0.12, h - 0.055), (x, d / 2 - 0.12, h - 0.055), 0.06, 0.03, steel)
        b.bar((x, -d / 2 + 0.05, 0.016), (x, d / 2 - 0.05, 0.016), 0.06, 0.03, steel)


def _column(b: Build, timber: Material) -> None:
    w, _, h = b.size
    b.add(cylinder((0, 0, h - TOP_M), w / 2, TOP_M, 0.006, 56), timber)
    foot = 0.30 * w
    profile = [(0.0, 0.0), (foot, 0.0), (foot, 0.012), (0.9 * foot, 0.022), (0.22 * foot, 0.05), (0.045, 0.12)]
    b.add(lathe([*profile, (0.045, h - 0.10), (0.12, h - TOP_M), (0.0, h - TOP_M)], 40), b.pick(timber, b.finish.metal))


def coffee_table(b: Build) -> None:
    """Build a low table: with a shelf, round on three legs, or on a steel frame."""
    design = b.item.seed % 3
    if b.option("round", 0.0):
        _tripod_table(b)
    elif design == 0:
        _with_shelf(b)
    else:
        _steel_frame(b)


def _with_shelf(b: Build) -> None:
    w, d, h = b.size
    timber = b.timber()
    b.block((-w / 2, -d / 2, h - TOP_M), (w / 2, d / 2, h), timber, 0.005)
    b.legs(0.035, h - TOP_M, 0.05, timber)
    b.block((-w / 2 + 0.03, -d / 2 + 0.03, 0.14), (w / 2 - 0.03, d / 2 - 0.03, 0.158), timber)


def _steel_frame(b: Build) -> None:
    w, d, h = b.size
    b.block((-w / 2, -d / 2, h - 0.025), (w / 2, d / 2, h), b.timber(), 0.004)
    for side in (-1, 1):
        x = side * (w / 2 - 0.06)
        corners = [(x, -d / 2 + 0.03, 0.01), (x, d / 2 - 0.03, 0.01)]
        b.bar(corners[0], corners[1], 0.02, 0.02, b.finish.metal)
        for y in (-d / 2 + 0.03, d / 2 - 0.03):
            b.bar((x, y, 0.0), (x, y, h - 0.024), 0.02, 0.02, b.finish.metal)


def _tripod_table(b: Build) -> None:
    w, _, h = b.size
    b.add(cylinder((0, 0, h - 0.024), w / 2, 0.024, 0.006, 48), b.timber())
    leg = b.pick(b.finish.wood, b.finish.metal)
    for dx, dy in ((0.0, -1.0), (0.866, 0.5), (-0.866, 0.5)):
        foot, top = w / 2 - 0.03, 0.26 * w
        b.leg((dx * foot, dy * foot, 0.0), (dx * top, dy * top, h - 0.02), 0.011, 0.018, leg)


def desk(b: Build) -> None:
    """Build a desk: a top on steel frames or legs, with a drawer unit at one side in most."""
    w, d, h = b.size
    timber, design = b.timber(), b.item.seed % 3
    b.block((-w / 2, -d / 2, h - 0.028), (w / 2, d / 2, h), timber, 0.004)
    if design == 0:
        b.legs(0.045, h - 0.028, 0.05, b.finish.metal)
    else:
        for side in (-1, 1):
            low, high = sorted((side * w / 2, side * (w / 2 - 0.028)))
            b.block((low, -d / 2 + 0.02, 0.0), (high, d / 2, h - 0.028), timber)
        b.block((-w / 2 + 0.03, d / 2 - 0.06, h - 0.35), (w / 2 - 0.03, d / 2 - 0.042, h - 0.03), timber)
    if design != 1:
        _drawers(b, 0.40 if design else 0.36)


def _drawers(b: Build, wide: float) -> None:
    w, d, h = b.size
    side = 1 if b.item.seed % 2 else -1
    x0 = side * (w / 2 - wide / 2 - 0.08) - wide / 2
    low, high = 0.06, h - 0.03 if b.item.seed % 3 else h - 0.12
    b.block((x0, -d / 2 + 0.05, low), (x0 + wide, d / 2 - 0.08, high), b.finish.lacquer)
    b.block((x0 + 0.03, -d / 2 + 0.09, 0.0), (x0 + wide - 0.03, d / 2 - 0.12, low), b.finish.metal)
    tall = (high - low) / 3
    for k in range(3):
        z = low + k * tall
        front = rounded_box(
            (x0 + 0.004, -d / 2 + 0.032, z + 0.004), (x0 + wide - 0.004, -d / 2 + 0.05, z + tall - 0.004), 0.003
        )
        b.add(front, b.finish.lacquer)
        bar = tube([(x0 + wide / 2 - 0.06, 0, 0), (x0 + wide / 2 + 0.06, 0, 0)], 0.006, 8)
        b.add(moved(bar, (0, -d / 2 + 0.022, z + tall * 0.7)), b.finish.metal)

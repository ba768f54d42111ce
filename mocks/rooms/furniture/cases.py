"""Tables, cabinets and shelves: what is made of boards; and the books on them."""

import numpy as np

from mocks.rooms.furniture.build import CERAMIC, CORNERS, PAGES, PAPER, Build
from mocks.rooms.model import Material
from processing.ground.mesh import Mesh, box, merge, moved, turned
from processing.ground.shapes import ball, cylinder, lathe, rounded_box, tube


def volume(wide_m: float, deep_m: float, thick_m: float) -> tuple[Mesh, Mesh]:
    """Return cover and pages of a book lying on its back cover, its spine at -y, the middle of its base at the origin.

    The cover is 2.5 mm thick and stands 3 mm over the pages.
    """
    w, d, t, c = wide_m / 2, deep_m / 2, thick_m, 0.0025
    cover = merge([box((-w, -d, 0), (w, d, c)), box((-w, -d, t - c), (w, d, t)), box((-w, -d, c), (w, -d + c, t - c))])
    return cover, box((-w + 0.003, -d + c, c), (w - 0.003, d - 0.003, t - c))


def book_row(b: Build, x: tuple[float, float], front: float, z: float, limits: tuple[float, float]) -> None:
    """Add upright books between two places along x, spines at ``front``; limits are height and depth."""
    at, tallest, deepest = x[0], limits[0], limits[1]
    usual = float(b.rng.uniform(0.18, 0.26))
    while at < x[1] - 0.012:
        thick = min(float(b.rng.gamma(4.0, 0.007)) + 0.009, x[1] - at)
        tall = float(np.clip(b.rng.normal(usual, 0.025), 0.15, tallest))
        deep = float(np.clip(0.7 * tall, 0.10, deepest))
        cover, pages = volume(tall, deep, thick - 0.001)
        place = (at + thick - 0.0005, front + deep / 2 + float(b.rng.uniform(0.0, 0.01)), z + tall / 2)
        last = at + thick > x[1] - 0.015
        tilt = float(b.rng.uniform(0.0, 0.05)) if last else 0.0
        for mesh, material in ((cover, b.plain("book", PAPER, 0.4)), (pages, PAGES)):
            upright = moved(turned(mesh, (0, 1, 0), -np.pi / 2 - tilt), place)
            b.add(upright, material, "book")
        at += thick


def books(b: Build) -> None:
    """Build a pile of books, the larger below, none quite straight."""
    w, d, h = b.size
    count = max(1, round(h / 0.025))
    thick = h / count
    for k in range(count):
        shrink = 1.0 - 0.28 * k / max(1, count)
        cover, pages = volume(w * 0.9 * shrink, d * 0.86 * shrink, thick)
        angle = float(b.rng.normal(0.0, 0.08))
        colour = b.plain("book", PAPER, 0.4)
        for mesh, material in ((cover, colour), (pages, PAGES)):
            b.add(moved(turned(mesh, (0, 0, 1), float(np.clip(angle, -0.12, 0.12))), (0, 0, k * thick)), material)


BOARD_M = 0.018  # usual chipboard
GAP_M = 0.004  # chosen: between fronts
FRONT_M = 0.019  # usual MDF
HANDLE_M = 0.025  # how far handles stand out; the size of a piece includes them


def _carcass(b: Build, low: float, timber: Material) -> None:
    """Add the closed body behind the fronts, from a height up; a plinth or legs stand below."""
    w, d, h = b.size
    front = -d / 2 + HANDLE_M
    b.block((-w / 2, front + FRONT_M + 0.002, low), (w / 2, d / 2, h - BOARD_M), timber, 0.002)
    b.block((-w / 2, front - 0.003, h - BOARD_M), (w / 2, d / 2, h), timber, 0.003)


def _front(b: Build, x0: float, x1: float, z0: float, z1: float, material: Material) -> None:
    """Add a door or drawer front within the gaps around it; on request with a sunk field, as framed doors have."""
    y = -b.size[1] / 2 + HANDLE_M
    x0, x1, z0, z1 = x0 + GAP_M / 2, x1 - GAP_M / 2, z0 + GAP_M / 2, z1 - GAP_M / 2
    if b.item.seed % 4 != 2 or z1 - z0 < 0.35:
        b.block((x0, y, z0), (x1, y + FRONT_M, z1), material, 0.002)
        return
    rail = 0.07
    b.block(
        (x0 + rail - 0.002, y + 0.008, z0 + rail - 0.002), (x1 - rail + 0.002, y + FRONT_M, z1 - rail + 0.002), material
    )
    for low, high in ((x0, x0 + rail), (x1 - rail, x1)):
        b.block((low, y, z0), (high, y + FRONT_M, z1), material, 0.002)
    for low, high in ((z0, z0 + rail), (z1 - rail, z1)):
        b.block((x0 + rail, y, low), (x1 - rail, y + FRONT_M, high), material, 0.002)


def _handle(b: Build, x: float, z: float, upright: bool, length: float = 0.14) -> None:
    """Add a bar handle or, by the seed, a knob."""
    y = -b.size[1] / 2 + HANDLE_M
    if b.item.seed % 3 == 1:
        b.add(ball((x, y - 0.008, z), 0.014, 14), b.finish.metal)
        b.add(tube([(x, y - 0.004, z), (x, y + 0.006, z)], 0.006, 8), b.finish.metal)
        return
    ends = [(x, y - 0.018, z + s * length / 2) if upright else (x + s * length / 2, y - 0.018, z) for s in (-1, 1)]
    b.add(tube(ends, 0.005, 10), b.finish.metal)
    for s in (-0.38, 0.38):
        px, pz = (x, z + s * length) if upright else (x + s * length, z)
        b.add(tube([(px, y - 0.018, pz), (px, y + 0.006, pz)], 0.004, 8), b.finish.metal)


def _stand(b: Build, height: float) -> None:
    """Add the plinth (low) or slim legs (high) that the body stands on."""
    w, d, _ = b.size
    if height < 0.1:
        b.block((-w / 2 + 0.01, -d / 2 + 0.05, 0.0), (w / 2 - 0.01, d / 2 - 0.01, height), b.finish.lacquer)
        return
    leg = b.pick(b.finish.wood, b.finish.metal)
    for sx, sy in CORNERS:
        x, y = sx * (w / 2 - 0.06), sy * (d / 2 - 0.06)
        b.leg((x + sx * 0.02, y + sy * 0.02, 0.0), (x, y, height + 0.005), 0.010, 0.017, leg)


def _fronts_material(b: Build, body: Material) -> Material:
    return b.finish.lacquer if b.item.seed % 5 in (0, 3) else body


def wardrobe(b: Build) -> None:
    """Build a wardrobe with hinged doors, some with a drawer below."""
    w, _, h = b.size
    body = b.timber()
    front = _fronts_material(b, body)
    _stand(b, 0.07)
    _carcass(b, 0.07, body)
    doors = max(2, round(w / 0.5))
    low = 0.33 if b.item.seed % 4 == 1 else 0.075
    wide = (w - 0.006) / doors
    for k in range(doors):
        x = -w / 2 + 0.003 + k * wide
        _front(b, x, x + wide, low, h - BOARD_M - 0.002, front)
        _handle(b, x + (wide - 0.045 if k % 2 == 0 else 0.045), 1.05, True, 0.22)
        if low > 0.1:
            _front(b, x, x + wide, 0.075, low, front)
            _handle(b, x + wide / 2, 0.2, False)


def chest_of_drawers(b: Build) -> None:
    """Build a chest of drawers, in one column or two."""
    w, _, h = b.size
    body, base = b.timber(), 0.13 if b.item.seed % 2 else 0.06
    front = _fronts_material(b, body)
    _stand(b, base)
    _carcass(b, base, body)
    rows, columns = max(2, round((h - base) / 0.21)), 2 if w > 1.05 else 1
    tall, wide = (h - base - BOARD_M - 0.006) / rows, (w - 0.006) / columns
    for row in range(rows):
        for column in range(columns):
            x, z = -w / 2 + 0.003 + column * wide, base + 0.003 + row * tall
            _front(b, x, x + wide, z, z + tall, front)
            for place in (0.5,) if wide < 0.7 else (0.22, 0.78):
                _handle(b, x + place * wide, z + tall * 0.55, False)


def nightstand(b: Build) -> None:
    """Build a nightstand: two drawers, or a drawer above an open shelf."""
    w, d, h = b.size
    body = b.timber()
    if b.item.seed % 2:
        _stand(b, 0.14)
        _carcass(b, 0.14, body)
        tall = (h - BOARD_M - 0.15) / 2
        for k in range(2):
            z = 0.145 + k * tall
            _front(b, -w / 2 + 0.003, w / 2 - 0.003, z, 0.145 + (k + 1) * tall, _fronts_material(b, body))
            _handle(b, 0.0, 0.145 + (k + 0.55) * tall, False, 0.10)
        return
    b.legs(0.04, h - 0.02, 0.034, body)
    b.block((-w / 2, -d / 2 + 0.015, h - 0.02), (w / 2, d / 2, h), body)
    b.block((-w / 2 + 0.01, -d / 2 + HANDLE_M + FRONT_M, h - 0.19), (w / 2 - 0.01, d / 2 - 0.01, h - 0.018), body)
    _front(b, -w / 2 + 0.04, w / 2 - 0.04, h - 0.185, h - 0.025, _fronts_material(b, body))
    _handle(b, 0.0, h - 0.10, False, 0.10)
    b.block((-w / 2 + 0.01, -d / 2 + 0.02, 0.14), (w / 2 - 0.01, d / 2 - 0.01, 0.155), body)


def cabinet(b: Build) -> None:
    """Build a sideboard or TV stand: doors, and drawers or an open bay in the middle."""
    w, d, h = b.size
    body, base = b.timber(), 0.15 if b.item.seed % 3 else 0.06
    front = _fronts_material(b, body)
    bays = max(2, round(w / 0.55))
    wide = w / bays
    opened = bays // 2 if bays > 2 and b.item.seed % 2 else -1
    _stand(b, base)
    inner = -d / 2 + HANDLE_M + FRONT_M + 0.002
    b.block((-w / 2, -d / 2 + HANDLE_M - 0.003, h - BOARD_M), (w / 2, d / 2, h), body)
    b.block((-w / 2, inner, base), (w / 2, d / 2, base + BOARD_M), body)
    b.block((-w / 2, d / 2 - 0.01, base), (w / 2, d / 2, h - BOARD_M), body)
    for k in range(bays + 1):
        x = min(max(-w / 2 + k * wide - BOARD_M / 2, -w / 2), w / 2 - BOARD_M)
        b.block((x, inner, base), (x + BOARD_M, d / 2, h - BOARD_M), body, 0.002)
    for k in range(bays):
        x = -w / 2 + k * wide
        if k == opened:
            middle = (base + h) / 2
            b.block((x, inner + 0.01, middle), (x + wide, d / 2 - 0.005, middle + 0.015), body)
            continue
        _front(b, x, x + wide, base, h - BOARD_M, front)
        _handle(b, x + (wide - 0.05 if k % 2 == 0 else 0.05), (base + h) / 2 + 0.05, True, 0.12)


def bookcase(b: Build) -> None:
    """Build an open bookcase with books, gaps and a few things on its shelves."""
    w, d, h = b.size
    body = b.timber()
    board = 0.022
    for side in (-1, 1):
        low, high = sorted((side * w / 2, side * (w / 2 - board)))
        b.block((low, -d / 2, 0.0), (high, d / 2, h), body)
    b.block((-w / 2 + board, d / 2 - 0.008, 0.05), (w / 2 - board, d / 2, h), body, 0.002)
    shelves = max(2, round(h / 0.36))
    pitch = (h - 0.06 - board) / shelves
    for k in range(shelves + 1):
        z = 0.06 + k * pitch
        b.block((-w / 2 + board, -d / 2 + 0.004, z), (w / 2 - board, d / 2 - 0.008, z + board), body)
        if k < shelves:
            _fill(b, -w / 2 + board + 0.004, w / 2 - board - 0.004, z + board, pitch - board)
    b.block((-w / 2 + board, -d / 2 + 0.03, 0.0), (w / 2 - board, -d / 2 + 0.048, 0.06), body)


def _fill(b: Build, x0: float, x1: float, z: float, tall: float) -> None:
    """Fill one shelf: mostly books from one side, then a box, a vase or nothing."""
    depth = b.size[1]
    fullness = float(b.rng.uniform(0.25, 1.0)) * b.option("fullness", 0.85)
    if fullness < 0.22:
        return
    end = x0 + fullness * (x1 - x0)
    book_row(b, (x0, end), -depth / 2 + 0.03, z, (tall - 0.03, depth - 0.05))
    room = x1 - end
    if room > 0.26 and b.rng.random() < 0.5:
        side = min(0.26, room - 0.05)
        box = rounded_box(
            (x1 - side - 0.01, -depth / 2 + 0.02, z), (x1 - 0.01, depth / 2 - 0.03, z + 0.6 * tall), 0.006
        )
        b.add(box, b.plain("box", ((0.55, 0.50, 0.42), (0.30, 0.32, 0.34), (0.70, 0.68, 0.64))), "box")
    elif room > 0.16:
        b.add(cylinder((x1 - 0.08, 0.0, z), 0.05, min(0.18, tall - 0.05), 0.012), b.plain("pot", CERAMIC, 0.3), "vase")


def wall_shelf(b: Build) -> None:
    """Build a board on the wall with a row of books and a pot."""
    w, d, h = b.size
    b.block((-w / 2, -d / 2, 0.0), (w / 2, d / 2, 0.025), b.timber())
    for side in (-1, 1):
        x = side * (w / 2 - 0.12)
        b.bar((x, d / 2 - 0.004, 0.001), (x, -d / 2 + 0.04, 0.001), 0.02, 0.002, b.finish.metal)
    start = -w / 2 + float(b.rng.uniform(0.03, 0.2))
    book_row(b, (start, start + w * float(b.rng.uniform(0.3, 0.6))), -d / 2 + 0.02, 0.025, (h - 0.03, d - 0.03))
    b.add(cylinder((w / 2 - 0.09, 0.0, 0.025), 0.045, min(0.12, h - 0.03), 0.012), b.plain("pot", CERAMIC, 0.3), "vase")


TOP_M = 0.03  # chosen: thickness of table tops


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

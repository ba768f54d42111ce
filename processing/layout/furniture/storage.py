"""Cases with doors and drawers: nightstand, chest, wardrobe, TV stand; the bookshelf and what stands in it."""

from __future__ import annotations

import math

import numpy as np

from processing.layout.furniture.bench import Bench
from processing.layout.furniture.model import Material
from processing.layout.furniture.solids import Solid, box, curve, joined, tube, turned_piece, vessel

BOARD_M = 0.019
GAP_M = 0.004
OUT_M = 0.026
"""How far handles stand out; a piece's depth includes them."""
SLAT_OUT_M = 0.008
DARK = Material("shadow gap", (0.02, 0.018, 0.016), 0.9)


def nightstand(b: Bench) -> None:
    """Build a nightstand: a drawer over an open compartment, on legs."""
    w, _, h = b.size
    low = 0.30 * h
    _case(b, low)
    split = low + 0.50 * (h - low)
    fields = [(-w / 2, w / 2, split, h - BOARD_M)]
    for x0, x1, z0, z1 in fields:
        drawer(b, x0, x1, z0, z1)
    _open(b, -w / 2, w / 2, low, split)
    b.legs((w / 2 - 0.04, b.size[1] / 2 - 0.055), low + 0.005, thick_m=0.035, splay=0.01)


def chest(b: Bench) -> None:
    """Build a chest of drawers: rows that grow towards the floor, the first divided, on legs."""
    w, d, h = b.size
    low = min(0.16, 0.22 * h)
    _case(b, low)
    rows = max(2, min(5, round((h - low) / 0.22)))
    columns = 2 if w > 1.25 else 1
    weights = [0.78 + 0.42 * k / max(rows - 1, 1) for k in range(rows)]
    z = h - BOARD_M
    for k, share in enumerate(weights):
        tall = share / sum(weights) * (h - BOARD_M - low)
        across = max(columns, 2 if k == 0 and w > 0.6 else 1)
        for c in range(across):
            drawer(b, -w / 2 + c * w / across, -w / 2 + (c + 1) * w / across, z - tall, z)
        z -= tall
    b.legs((w / 2 - 0.05, d / 2 - 0.06), low + 0.005, thick_m=0.045, splay=0.012)


def wardrobe(b: Bench) -> None:
    """Build a wardrobe: doors about half a metre wide over a drawer a pair, on a plinth, under a cornice."""
    w, d, h = b.size
    plinth = min(0.08, 0.05 * h + 0.005)
    front = d / 2 - OUT_M
    b.block((-w / 2 + 0.015, -d / 2 + 0.01, 0), (w / 2 - 0.015, front - 0.035, plinth), b.style.timber)
    _case(b, plinth, cornice_m=0.012)
    doors = max(1, round(w / 0.5))
    wide = w / doors
    split = plinth + min(0.30, 0.16 * h)
    pairs = max(1, doors // 2)
    for k in range(pairs):
        drawer(b, -w / 2 + k * w / pairs, -w / 2 + (k + 1) * w / pairs, plinth, split)
    for k in range(doors):
        hinge_left = k % 2 == 0 if doors > 1 else True
        door(b, -w / 2 + k * wide, -w / 2 + (k + 1) * wide, split, h - BOARD_M - 0.012, handle_right=hinge_left)


def tv_stand(b: Bench) -> None:
    """Build a low board: a slatted sliding front either side of an open compartment with a shelf."""
    w, d, h = b.size
    low = min(0.15, 0.32 * h)
    _case(b, low, out_m=SLAT_OUT_M)
    side = max(0.30 * w, 0.28)
    middle = w / 2 - side
    if middle < 0.12:
        side, middle = w / 2, 0.0
    for s in (-1, 1):
        x0, x1 = sorted((s * w / 2, s * middle))
        _slatted(b, x0, x1, low, h - BOARD_M)
    if middle > 0:
        _open(b, -middle, middle, low, h - BOARD_M, SLAT_OUT_M)
        z = (low + h) / 2
        b.block((-middle, -d / 2 + 0.02, z - 0.008), (middle, d / 2 - 0.05, z + 0.008), b.style.second_timber)
    b.legs((w / 2 - 0.10, d / 2 - 0.07), low + 0.005, thick_m=0.042, splay=0.015)


def _case(b: Bench, low: float, cornice_m: float = 0.0, out_m: float = OUT_M) -> None:
    """Add top, bottom, sides and back around an open front."""
    w, d, h = b.size
    t, x, back, front = b.style.timber, w / 2, -d / 2, d / 2 - out_m
    over = cornice_m
    b.block((-x, back, h - BOARD_M - over), (x, front + 0.004 + over, h), t, bevel_m=0.004 + 0.3 * over, grain=0)
    inset = 0.002 + 0.4 * over
    b.block((-x + inset, back + 0.002, low), (x - inset, front - 0.022, low + BOARD_M), t, grain=0)
    for side in (-1, 1):
        lo, hi = sorted((side * (x - inset), side * (x - inset - BOARD_M)))
        b.block((lo, back + 0.002, low), (hi, front - 0.022, h - BOARD_M), t, grain=2)
    b.block((-x + 0.01, back + 0.004, low + 0.004), (x - 0.01, back + 0.012, h - BOARD_M), b.style.second_timber)


def _open(b: Bench, x0: float, x1: float, z0: float, z1: float, out_m: float = OUT_M) -> None:
    """Add the boards round an open compartment."""
    d = b.size[1]
    t, front = b.style.timber, d / 2 - out_m - 0.002
    half = BOARD_M / 2
    b.block((x0 + 0.003, -d / 2 + 0.0125, z1 - half), (x1 - 0.003, front, z1 + half), t, grain=0)
    b.block((x0 + 0.003, -d / 2 + 0.0125, z0), (x1 - 0.003, front, z0 + BOARD_M), t, grain=0)
    for lo, hi in ((x0 + 0.002, x0 + 0.002 + BOARD_M), (x1 - 0.002 - BOARD_M, x1 - 0.002)):
        b.block((lo, -d / 2 + 0.0125, z0), (hi, front, z1), t, grain=2)


def _field(b: Bench, x0: float, x1: float, z0: float, z1: float, grain: int) -> None:
    """Add a front within the gaps around it; framed where the style's doors are."""
    y0, y1 = b.size[1] / 2 - OUT_M - 0.020, b.size[1] / 2 - OUT_M
    g = GAP_M / 2
    x0, x1, z0, z1 = x0 + g, x1 - g, z0 + g, z1 - g
    m = b.style.front
    rail = 0.062
    if b.style.head != "panel" or z1 - z0 < 0.26 or x1 - x0 < 0.26:
        b.block((x0, y0, z0), (x1, y1, z1), m, bevel_m=0.0025, grain=grain)
        return
    b.block(
        (x0 + rail - 0.004, y0, z0 + rail - 0.004), (x1 - rail + 0.004, y1 - 0.010, z1 - rail + 0.004), m, grain=grain
    )
    for lo, hi in ((x0, x0 + rail), (x1 - rail, x1)):
        b.block((lo, y0, z0), (hi, y1, z1), m, bevel_m=0.003, grain=2)
    for lo, hi in ((z0, z0 + rail), (z1 - rail, z1)):
        b.block((x0 + rail, y0, lo), (x1 - rail, y1 - 0.0005, hi), m, bevel_m=0.003, grain=0)


def drawer(b: Bench, x0: float, x1: float, z0: float, z1: float, *, back_m: float = 0.03) -> None:
    """Add a drawer's front with its body behind and its handle, or two on a wide one."""
    _field(b, x0, x1, z0, z1, 0)
    y = b.size[1] / 2 - OUT_M
    b.block((x0 + 0.02, -b.size[1] / 2 + back_m, z0 + 0.012), (x1 - 0.02, y - 0.019, z1 - 0.012), DARK)
    middle, height = (x0 + x1) / 2, (z0 + z1) / 2
    places = [middle] if x1 - x0 < 0.75 else [x0 + 0.25 * (x1 - x0), x0 + 0.75 * (x1 - x0)]
    for place in places:
        handle(b, place, height, z1, upright=False)


def door(b: Bench, x0: float, x1: float, z0: float, z1: float, *, handle_right: bool) -> None:
    """Add a door's front, what is dark behind it, and its handle."""
    _field(b, x0, x1, z0, z1, 2)
    y = b.size[1] / 2 - OUT_M
    b.block((x0 + 0.006, y - 0.03, z0 + 0.006), (x1 - 0.006, y - 0.0205, z1 - 0.006), DARK)
    at = x1 - 0.035 if handle_right else x0 + 0.035
    handle(b, at, min(max(1.0, z0 + 0.15), z0 + 0.55 * (z1 - z0)), z1, upright=True)


def handle(b: Bench, x: float, z: float, top: float, *, upright: bool) -> None:
    """Add a knob, a bow or a folded grip."""
    y = b.size[1] / 2 - OUT_M
    kind = b.style.handles
    if kind == "knob":
        knob = turned_piece([(0, -0.002), (0.007, -0.002), (0.006, 0.010), (0.013, 0.016), (0.0155, 0.021),
                             (0.013, OUT_M - 0.001), (0, OUT_M)], 16)  # fmt: skip
        material = b.style.second_timber if b.style.legs == "round" else b.style.metal
        b.add(knob.turned("x", -1.5707963).moved(x, y, z), material)
        return
    half = 0.16 if upright else 0.075
    if kind == "bar":
        r = 0.0055
        line = [(0, -0.002, -half), (0, OUT_M - r - 0.006, -half), (0, OUT_M - r, -half + 0.008),
                (0, OUT_M - r, half - 0.008), (0, OUT_M - r - 0.006, half), (0, -0.002, half)]  # fmt: skip
        bow = tube(curve(line, 4), r, 8)
        b.add((bow if upright else bow.turned("y", 1.5707963)).moved(x, y, z), b.style.metal)
        return
    if upright:
        grip = box((-0.004, -0.001, -half), (0.004, OUT_M, half), 0.0015)
        b.add(grip.moved(x, y, z), b.style.metal)
    else:
        lip = box((-half, -0.018, -0.003), (half, OUT_M, 0.002), 0.0012)
        b.add(lip.moved(x, y, top - GAP_M / 2), b.style.metal)


def _slatted(b: Bench, x0: float, x1: float, z0: float, z1: float) -> None:
    """Add a front of upright slats on a dark ground."""
    y = b.size[1] / 2 - SLAT_OUT_M
    b.block((x0 + 0.004, y - 0.014, z0 + 0.003), (x1 - 0.004, y - 0.006, z1 - 0.003), DARK)
    count = max(4, round((x1 - x0) / 0.027))
    pitch = (x1 - x0 - 0.006) / count
    for k in range(count):
        at = x0 + 0.003 + (k + 0.5) * pitch
        b.block(
            (at - 0.36 * pitch, y - 0.010, z0 + 0.003),
            (at + 0.36 * pitch, y + SLAT_OUT_M, z1 - 0.003),
            b.style.front,
            grain=2,
        )


SHELF_BOARD_M = 0.022
COVERS = tuple(
    Material(f"book {k}", colour, 0.65)
    for k, colour in enumerate((
        (0.62, 0.56, 0.46), (0.13, 0.20, 0.26), (0.42, 0.14, 0.09), (0.70, 0.66, 0.58), (0.20, 0.25, 0.17),
        (0.50, 0.34, 0.13), (0.07, 0.07, 0.075), (0.30, 0.36, 0.40), (0.55, 0.42, 0.36),
    ))
)  # fmt: skip
PLAIN_M2 = 1.8
"""Larger fronts hold so many books that their spines stay sharp."""
PAPER = Material("paper", (0.74, 0.71, 0.62), 0.9)


def bookshelf(b: Bench) -> None:
    """Build an open shelf with books, a few vessels and a box or two."""
    w, d, h = b.size
    x, y = w / 2, d / 2
    timber = b.style.timber
    for side in (-1, 1):
        lo, hi = sorted((side * x, side * (x - SHELF_BOARD_M)))
        b.block((lo, -y, 0), (hi, y, h), timber, bevel_m=0.003, grain=2)
    b.block((-x + 0.01, -y + 0.003, 0.05), (x - 0.01, -y + 0.011, h - 0.01), b.style.second_timber, grain=2)
    b.block((-x + SHELF_BOARD_M, -y + 0.01, 0.0), (x - SHELF_BOARD_M, y - 0.03, 0.06), timber, grain=0)
    columns = max(1, round(w / 0.85))
    inner = (w - SHELF_BOARD_M * (columns + 1)) / columns
    for k in range(1, columns):
        at = -x + k * (inner + SHELF_BOARD_M)
        b.block((at, -y + 0.01, 0.06), (at + SHELF_BOARD_M, y - 0.002, h - SHELF_BOARD_M), timber, grain=2)
    rows = max(1, round((h - 0.08) / 0.345))
    step = (h - SHELF_BOARD_M - 0.06) / rows
    for r in range(rows + 1):
        z = 0.06 + r * step
        b.block(
            (-x + SHELF_BOARD_M - 0.001, -y + 0.008, z),
            (x - SHELF_BOARD_M + 0.001, y - 0.001, z + SHELF_BOARD_M),
            timber,
            grain=0,
        )
    for r in range(rows):
        for k in range(columns):
            low = -x + SHELF_BOARD_M + k * (inner + SHELF_BOARD_M)
            _fill(b, (low, low + inner), 0.06 + r * step + SHELF_BOARD_M, step - SHELF_BOARD_M)


def _fill(b: Bench, x: tuple[float, float], z: float, tall: float) -> None:
    """Fill a compartment: books to one side, something else beside them."""
    kind = int(b.rng.integers(0, 4))
    wide = x[1] - x[0]
    share = (0.62, 0.48, 0.86, 0.55)[kind]
    left = bool(b.rng.integers(0, 2))
    start = x[0] + 0.006 if left else x[1] - share * wide
    books(b, start, start + share * wide - 0.01, z, tall)
    spare = (start + share * wide, x[1] - 0.01) if left else (x[0] + 0.01, start)
    middle, room = (spare[0] + spare[1]) / 2, spare[1] - spare[0]
    if kind == 0 and room > 0.14:
        _pile(b, middle, min(room - 0.02, 0.24), z)
    elif kind == 1 and room > 0.12:
        _vase(b, middle, min(0.4 * room, 0.085), z, min(0.7 * tall, 0.22))
    elif kind == 3 and room > 0.16:
        side, deep = min(room - 0.02, 0.30), b.size[1] - 0.07
        body = box((-side / 2, -deep / 2, 0), (side / 2, deep / 2, min(0.55 * tall, 0.19)), 0.012, 2)
        b.add(body.moved(middle, 0.0, z), b.style.accent)


def books(b: Bench, x0: float, x1: float, z: float, tall: float) -> None:
    """Add upright books between two places, their spines to the front."""
    at, usual = x0, float(b.rng.uniform(0.19, 0.25))
    front = b.size[1] / 2 - 0.035
    while at < x1 - 0.016:
        thick = min(float(b.rng.uniform(0.018, 0.042)), x1 - at)
        high = float(np.clip(b.rng.normal(usual, 0.022), 0.15, max(tall - 0.03, 0.12)))
        deep = min(0.72 * high, b.size[1] - 0.07)
        y = front - float(b.rng.uniform(0, 0.012))
        cover, pages = _book(thick - 0.0015, deep, high, plain=b.size[0] * b.size[2] > PLAIN_M2)
        material = COVERS[int(b.rng.integers(0, len(COVERS)))]
        b.add(cover.moved(at + thick / 2, y, z), material)
        b.add(pages.moved(at + thick / 2, y, z), PAPER)
        at += thick


def _book(thick: float, deep: float, high: float, *, plain: bool = False) -> tuple[Solid, Solid]:
    """Return cover and pages of an upright book: its spine at y = 0 looking to +y, its foot at z = 0."""
    half, board = thick / 2, min(0.003, 0.2 * thick)
    covers = [
        box((-half, -deep, 0), (-half + board, -board, high), steps=0),
        box((half - board, -deep, 0), (half, -board, high), steps=0),
        box((-half, -2 * board, 0), (half, 0, high), 0.0028, 0 if plain else 1),
    ]
    pages = box((-half + board, -deep + 0.004, 0.004), (half - board, -2 * board, high - 0.004), steps=0)
    return joined(covers), pages


def _pile(b: Bench, x: float, wide: float, z: float) -> None:
    """Add books that lie on each other."""
    deep = min(0.72 * wide, b.size[1] - 0.08)
    for k in range(3):
        thick = float(b.rng.uniform(0.018, 0.036))
        cover, pages = _book(thick, deep * (1 - 0.07 * k), wide * (1 - 0.06 * k))
        material = COVERS[int(b.rng.integers(0, len(COVERS)))]
        turn = float(b.rng.uniform(-0.12, 0.12))
        for mesh, m in ((cover, material), (pages, PAPER)):
            lying = mesh.moved(0, 0, -wide / 2).turned("y", math.pi / 2).moved(0, deep / 2, 0).turned("z", turn)
            b.add(lying.moved(x, 0, z + thick / 2), m)
        z += thick


def _vase(b: Bench, x: float, r: float, z: float, tall: float) -> None:
    shape = ((0.55, 0), (0.62, 0.02), (0.9, 0.25), (1.0, 0.45), (0.88, 0.68), (0.5, 0.88), (0.46, 0.94), (0.55, 1.0))
    b.add(vessel([(r * a, tall * t) for a, t in shape], 0.006, 24).moved(x, 0.0, z), b.style.pot)

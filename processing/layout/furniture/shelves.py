"""The bookshelf, and what stands in it."""

from __future__ import annotations

import math

import numpy as np

from processing.layout.furniture.bench import Bench
from processing.layout.furniture.model import Material
from processing.layout.furniture.solids import box, vessel
from processing.layout.furniture.surface import Solid, joined

BOARD_M = 0.022
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
        lo, hi = sorted((side * x, side * (x - BOARD_M)))
        b.block((lo, -y, 0), (hi, y, h), timber, bevel_m=0.003, grain=2)
    b.block((-x + 0.01, -y + 0.003, 0.05), (x - 0.01, -y + 0.011, h - 0.01), b.style.second_timber, grain=2)
    b.block((-x + BOARD_M, -y + 0.01, 0.0), (x - BOARD_M, y - 0.03, 0.06), timber, grain=0)
    columns = max(1, round(w / 0.85))
    inner = (w - BOARD_M * (columns + 1)) / columns
    for k in range(1, columns):
        at = -x + k * (inner + BOARD_M)
        b.block((at, -y + 0.01, 0.06), (at + BOARD_M, y - 0.002, h - BOARD_M), timber, grain=2)
    rows = max(1, round((h - 0.08) / 0.345))
    step = (h - BOARD_M - 0.06) / rows
    for r in range(rows + 1):
        z = 0.06 + r * step
        b.block((-x + BOARD_M - 0.001, -y + 0.008, z), (x - BOARD_M + 0.001, y - 0.001, z + BOARD_M), timber, grain=0)
    for r in range(rows):
        for k in range(columns):
            low = -x + BOARD_M + k * (inner + BOARD_M)
            _fill(b, (low, low + inner), 0.06 + r * step + BOARD_M, step - BOARD_M)


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

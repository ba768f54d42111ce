"""Cases, doors and drawers, and the books in them: what storage of all designs is put together from."""

import math
from collections.abc import Callable

import numpy as np

from processing.ground.arrays import Vector
from processing.layout.furniture.bench import Bench
from processing.layout.furniture.solids import Solid, box, curve, joined, tube, turned_piece

Span = tuple[float, float]
BOARD_M = 0.019  # 19 mm, the usual melamine board
GAP_M = 0.004  # chosen: as between real doors
OUT_M = 0.026  # how far handles stand out; a piece's depth includes them
BOOKS = 9  # chosen: colours of spines
PLAIN_M2 = 1.8  # larger fronts hold so many books that their spines stay sharp


def case(b: Bench, role: str, low: float, cornice: float = 0.0, out: float = OUT_M) -> None:
    """Add top, bottom, sides and back around an open front."""
    w, d, h = b.size
    t, x, back, front = b.style.material(role), w / 2, -d / 2, d / 2 - out
    b.block(
        (-x, back, h - BOARD_M - cornice), (x, front + 0.004 + cornice, h), t, bevel_m=0.004 + 0.3 * cornice, grain=0
    )
    inset = 0.002 + 0.4 * cornice
    b.block((-x + inset, back + 0.002, low), (x - inset, front - 0.022, low + BOARD_M), t, grain=0)
    for side in (-1, 1):
        lo, hi = sorted((side * (x - inset), side * (x - inset - BOARD_M)))
        b.block((lo, back + 0.002, low), (hi, front - 0.022, h - BOARD_M), t, grain=2)
    second = b.style.material("timber2")
    b.block((-x + 0.01, back + 0.004, low + 0.004), (x - 0.01, back + 0.012, h - BOARD_M), second)


def niche(b: Bench, role: str, x: Span, z: Span, out: float = OUT_M) -> None:
    """Add the boards round an open compartment."""
    t, back, front = b.style.material(role), -b.size[1] / 2 + 0.0125, b.size[1] / 2 - out - 0.002
    b.block((x[0] + 0.003, back, z[1] - BOARD_M / 2), (x[1] - 0.003, front, z[1] + BOARD_M / 2), t, grain=0)
    b.block((x[0] + 0.003, back, z[0]), (x[1] - 0.003, front, z[0] + BOARD_M), t, grain=0)
    for lo, hi in ((x[0] + 0.002, x[0] + 0.002 + BOARD_M), (x[1] - 0.002 - BOARD_M, x[1] - 0.002)):
        b.block((lo, back, z[0]), (hi, front, z[1]), t, grain=2)


def front(b: Bench, role: str, x: Span, z: Span, kind: str = "plain", grain: int = 2, y: float | None = None) -> None:
    """Add a front within the gaps around it: plain, framed, slats upright on a dark ground, louvres, or cane."""
    y1 = b.size[1] / 2 - OUT_M if y is None else y
    y0, g, rail = y1 - 0.020, GAP_M / 2, 0.062
    x0, x1, z0, z1 = x[0] + g, x[1] - g, z[0] + g, z[1] - g
    m = b.style.material(role)
    if kind == "slats":
        b.block((x0, y0, z0), (x1, y0 + 0.008, z1), b.style.material("dark"))
        for at in np.linspace(x0, x1, max(4, round((x1 - x0) / 0.032)) + 1)[:-1]:
            b.block((at + 0.002, y0 + 0.004, z0), (at + 0.024, y1, z1), m, bevel_m=0.002, grain=2)
        return
    if kind == "plain" or min(z1 - z0, x1 - x0) < 0.24:
        b.block((x0, y0, z0), (x1, y1, z1), m, bevel_m=0.0025, grain=grain)
        return
    sunk = b.style.material("cane") if kind == "cane" else m
    b.block(
        (x0 + rail - 0.004, y0, z0 + rail - 0.004),
        (x1 - rail + 0.004, y1 - 0.010, z1 - rail + 0.004),
        sunk,
        grain=grain,
    )
    for lo, hi in ((x0, x0 + rail), (x1 - rail, x1)):
        b.block((lo, y0, z0), (hi, y1, z1), m, bevel_m=0.003, grain=2)
    middle = [((z0 + z1) / 2 - rail / 2, (z0 + z1) / 2 + rail / 2)] if z1 - z0 > 1.2 else []
    for lo, hi in ((z0, z0 + rail), (z1 - rail, z1), *middle):
        b.block((x0 + rail, y0, lo), (x1 - rail, y1 - 0.0005, hi), m, bevel_m=0.003, grain=0)
    for lo, hi in (
        zip(np.arange(z0 + rail, z1 - rail, 0.05), np.arange(z0 + rail, z1 - rail, 0.05) + 0.04, strict=True)
        if kind == "louvre"
        else ()
    ):
        b.block((x0 + rail, y0 + 0.008, lo), (x1 - rail, y1 - 0.004, hi), m, bevel_m=0.003, grain=0)


def drawer(b: Bench, role: str, x: Span, z: Span, kind: str = "plain", back: float = 0.03, pull: int = 1) -> None:
    """Add a drawer's front with its body behind and its handle, or two on a wide one."""
    front(b, role, x, z, kind, 0)
    y = b.size[1] / 2 - OUT_M
    dark = b.style.material("dark")
    b.block((x[0] + 0.02, -b.size[1] / 2 + back, z[0] + 0.012), (x[1] - 0.02, y - 0.019, z[1] - 0.012), dark)
    wide = x[1] - x[0]
    for share in ((0.5,) if wide < 0.75 else (0.25, 0.75)) if pull else ():
        handle(b, x[0] + share * wide, (z[0] + z[1]) / 2, z[1], upright=False)


def door(b: Bench, role: str, x: Span, z: Span, kind: str = "plain", right: int = 1, pull: int = 1) -> None:
    """Add a door's front, what is dark behind it, and its handle at its right or left."""
    front(b, role, x, z, kind, 2)
    y = b.size[1] / 2 - OUT_M
    low, high = (x[0] + 0.006, y - 0.03, z[0] + 0.006), (x[1] - 0.006, y - 0.0205, z[1] - 0.006)
    b.block(low, high, b.style.material("dark"))
    at = x[1] - 0.035 if right else x[0] + 0.035
    if pull:
        handle(b, at, min(max(1.0, z[0] + 0.15), z[0] + 0.55 * (z[1] - z[0])), z[1], upright=True)


def handle(b: Bench, x: float, z: float, top: float, *, upright: bool) -> None:
    """Add a knob, a bow or a folded grip, as the style has them."""
    y, kind, metal = b.size[1] / 2 - OUT_M, b.style.handles, b.style.material("metal")
    half = 0.16 if upright else 0.075
    if kind == "knob":
        knob = turned_piece(
            [
                (0, -0.002),
                (0.007, -0.002),
                (0.006, 0.010),
                (0.013, 0.016),
                (0.0155, 0.021),
                (0.013, OUT_M - 0.001),
                (0, OUT_M),
            ],
            16,
        )
        b.add(knob.turned("x", -math.pi / 2).moved(x, y, z), metal)
    elif kind == "bar":
        r = 0.0055
        line = [
            (0, -0.002, -half),
            (0, OUT_M - r - 0.006, -half),
            (0, OUT_M - r, -half + 0.008),
            (0, OUT_M - r, half - 0.008),
            (0, OUT_M - r - 0.006, half),
            (0, -0.002, half),
        ]
        bow = tube(curve(line, 4), r, 8)
        b.add((bow if upright else bow.turned("y", math.pi / 2)).moved(x, y, z), metal)
    elif upright:
        b.add(box((-0.004, -0.001, -half), (0.004, OUT_M, half), 0.0015).moved(x, y, z), metal)
    else:
        b.add(box((-half, -0.018, -0.003), (half, OUT_M, 0.002), 0.0012).moved(x, y, top - GAP_M / 2), metal)


def books(b: Bench, _: str, x: Span, z: float, tall: float, y: float | None = None, deep: float = 0.25) -> None:
    """Add upright books between two places, their spines to the front at y."""
    at, usual = x[0], float(b.rng.uniform(0.19, 0.25))
    front_y = b.size[1] / 2 - 0.035 if y is None else y
    while at < x[1] - 0.016:
        thick = min(float(b.rng.uniform(0.018, 0.042)), x[1] - at)
        high = float(np.clip(b.rng.normal(usual, 0.022), 0.15, max(tall - 0.03, 0.12)))
        back = float(b.rng.uniform(0, 0.012))
        cover, pages = _book(thick - 0.0015, min(0.72 * high, deep), high, plain=b.size[0] * b.size[2] > PLAIN_M2)
        for body, role in ((cover, f"book{b.rng.integers(BOOKS)}"), (pages, "paper")):
            b.add(body.moved(at + thick / 2, front_y - back, z), b.style.material(role))
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


def pile(b: Bench, _: str, at: Vector, wide: float, deep: float, count: int = 3, high: float = 0.0) -> None:
    """Add books that lie on each other; `high`: of the whole pile, else as it comes."""
    z = at[2]
    for k in range(count):
        thick = high / count if high else float(b.rng.uniform(0.018, 0.036))
        size = (wide * (1 - 0.06 * k), min(deep, 0.72 * wide) * (1 - 0.07 * k))
        turn = float(b.rng.uniform(-0.12, 0.12)) if k else 0.0
        for mesh, role in zip(_book(thick, size[1], size[0]), (f"book{b.rng.integers(BOOKS)}", "paper"), strict=True):
            lying = mesh.moved(0, 0, -size[0] / 2).turned("y", math.pi / 2).moved(0, size[1] / 2, 0).turned("z", turn)
            b.add(lying.moved(at[0], at[1], z + thick / 2), b.style.material(role))
        z += thick


VERBS: dict[str, Callable[..., None]] = {
    "case": case,
    "niche": niche,
    "front": front,
    "drawer": drawer,
    "door": door,
    "books": books,
    "pile": pile,
}

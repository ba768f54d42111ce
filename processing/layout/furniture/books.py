"""The books in shelves and on tables of all designs."""

import math

import numpy as np

from processing.ground.arrays import Vector
from processing.layout.furniture.bench import Bench
from processing.layout.furniture.solids import Solid, box, joined

Span = tuple[float, float]
BOOKS = 9  # chosen: colours of spines
PLAIN_M2 = 1.8  # larger fronts hold so many books that their spines stay sharp


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

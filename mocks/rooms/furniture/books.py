"""Books: rows on shelves, piles on tables."""

from __future__ import annotations

import numpy as np

from mocks.rooms.furniture.build import PAGES, PAPER, Build
from mocks.rooms.mesh import Mesh, box, merge
from mocks.rooms.shapes import moved, turned


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

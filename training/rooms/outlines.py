"""Floor plans for training: rectangles less some bites, now and then with a slanted wall; and places for cameras."""

from __future__ import annotations

import math

import numpy as np
from shapely import box
from shapely.affinity import rotate
from shapely.geometry import Point as Spot
from shapely.geometry import Polygon

from processing.ground.arrays import Doubles

LEAST_SIDE_M = 0.5


def draw_outline(rng: np.random.Generator) -> Doubles:
    """Return corners (N, 2), counter-clockwise, somewhere about the origin, turned at random."""
    small = rng.random() < 0.12
    short = rng.uniform(1.1, 2.2) if small else rng.uniform(2.2, 4.8)
    long = short * rng.uniform(1.0, 2.2 if not small else 3.0)
    bites = int(rng.choice([0, 1, 2, 3], p=[0.46, 0.33, 0.14, 0.07]))
    for _ in range(20):
        room = _bitten(rng, long, short, 0 if small else bites)
        if room is not None:
            break
    else:
        room = box(0, 0, long, short)
    corners = np.array(room.exterior.coords)[:-1]
    if rng.random() < 0.12:
        corners = _slanted(rng, corners)
    turn = 90 * rng.integers(4) + (rng.normal(0, 3) if rng.random() < 0.45 else rng.uniform(-45, 45))
    turned = rotate(Polygon(corners), turn, origin=(0, 0))
    ring = np.array(turned.exterior.coords)[:-1]
    return ring if turned.exterior.is_ccw else ring[::-1]


def _bitten(rng: np.random.Generator, long: float, short: float, bites: int) -> Polygon | None:
    """Return a rectangle less rectangles at its corners or sides; None if too little is left."""
    room = box(0, 0, long, short)
    for _ in range(bites):
        w, d = rng.uniform(0.15, 0.55) * long, rng.uniform(0.15, 0.5) * short
        if rng.random() < 0.35:
            w, d = rng.uniform(0.4, 1.0, 2)
        at_corner = rng.random() < 0.75
        x = float(rng.choice([0.0, long - w])) if at_corner else rng.uniform(0.5, max(0.6, long - w - 0.5))
        y = float(rng.choice([0.0, short - d]))
        room = room.difference(box(x, y, x + w, y + d))
    if room.geom_type != "Polygon" or room.interiors or room.area < 0.4 * long * short:
        return None
    ring = np.array(room.simplify(0.01).exterior.coords)
    if np.linalg.norm(np.diff(ring, axis=0), axis=1).min() < 0.3:
        return None
    return room.simplify(0.01) if not room.buffer(-0.35).is_empty else None


def _slanted(rng: np.random.Generator, corners: Doubles) -> Doubles:
    """Cut one corner, or shift one along a wall."""
    out = corners.copy()
    k = int(rng.integers(len(out)))
    before, after = out[k - 1] - out[k], out[(k + 1) % len(out)] - out[k]
    a, b = rng.uniform(0.15, 0.45, 2)
    if rng.random() < 0.6:
        ring = np.insert(out, k + 1, out[k] + b * after, axis=0)
        ring[k] = out[k] + a * before
    else:
        ring = out
        ring[k] = out[k] + 0.6 * a * before
    shape = Polygon(ring)
    return ring if shape.is_valid and shape.area > 1.5 else corners


def draw_cameras(rng: np.random.Generator, outline: Doubles, count: int) -> list[tuple[float, float]]:
    """Return places within an outline (N, 2), metres, some near a wall, most at ease."""
    room = Polygon(outline)
    found: list[tuple[float, float]] = []
    for _ in range(count):
        gap = rng.uniform(0.3, 0.5) if rng.random() < 0.3 else rng.uniform(0.5, 1.0)
        free = room.buffer(-gap)
        while free.is_empty:
            gap *= 0.7
            free = room.buffer(-gap)
        x0, y0, x1, y1 = free.bounds
        place = free.representative_point()
        for _try in range(30):
            spot = Spot(rng.uniform(x0, x1), rng.uniform(y0, y1))
            if free.contains(spot):
                place = spot
                break
        found.append((float(place.x), float(place.y)))
    return found


def draw_height_m(rng: np.random.Generator) -> float:
    """Return a ceiling height."""
    return float(rng.uniform(2.7, 3.7) if rng.random() < 0.25 else rng.uniform(2.2, 2.7))


def draw_eye_m(rng: np.random.Generator, ceiling_m: float) -> float:
    """Return a camera height."""
    high = rng.uniform(0.9, 2.0) if rng.random() < 0.3 else rng.normal(1.5, 0.12)
    return float(min(max(high, 0.85), ceiling_m - 0.4, math.inf))

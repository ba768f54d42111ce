"""One room for training, with its walls' openings, fixtures and furniture, as triangles.

Unlike `mocks.rooms` it need not be buildable: what matters is that every kind of confusion occurs, and that the labels
are right. Behind passages and open doors lies another room (`training.rooms.beyond`).
"""

from __future__ import annotations

import itertools
import math
from contextlib import suppress
from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np
from shapely import box
from shapely.affinity import rotate
from shapely.geometry import Point as Spot
from shapely.geometry import Polygon

from processing.errors import SceneError
from processing.ground.arrays import Doubles
from processing.ground.polygons import triangles
from processing.segmentation.evidence import SceneClass
from training.rooms.soup import WORLD, Frame, Soup

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
    if not small and rng.random() < 0.15:
        room = _with_bay(rng, room, long)
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


def _with_bay(rng: np.random.Generator, room: Polygon, long: float) -> Polygon:
    """Return a room with a bay, square or with slanted sides, on its side y = 0."""
    wide, deep = float(rng.uniform(1.0, 2.6)), float(rng.uniform(0.35, 0.95))
    at = float(rng.uniform(0.0, max(long - wide, 0.01)))
    inset = 0.0 if rng.random() < 0.4 else min(deep * float(rng.uniform(0.5, 1.2)), 0.35 * wide)
    bay = Polygon([(at, 0.0), (at + inset, -deep), (at + wide - inset, -deep), (at + wide, 0.0)])
    whole = room.union(bay.buffer(1e-6, join_style="mitre")).simplify(0.01)
    return whole if whole.geom_type == "Polygon" and not whole.interiors else room


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


class Portal(NamedTuple):
    """An opening to elsewhere: a frame whose y axis points into this room, and its rectangle on the wall."""

    frame: Frame
    rect: tuple[float, float, float, float]
    depth_m: float
    """Of the wall."""


@dataclass
class House:
    """A room as triangles, and what gives light in it."""

    outline: Doubles
    ceiling_m: float
    soup: Soup
    cameras: list[tuple[float, float]]
    eyes_m: list[float]
    panes: list[tuple[Doubles, Doubles, Doubles]] = field(default_factory=list)
    """Corner and two sides of each bright rectangle."""
    portals: list[Portal] = field(default_factory=list)
    mirrors: list[int] = field(default_factory=list)
    """Paints that reflect."""
    lamps: list[tuple[float, float, float]] = field(default_factory=list)
    blocked: list[tuple[int, float, float]] = field(default_factory=list)
    """Stretches of walls (wall, start, end) before which nothing may stand."""

    def wall(self, number: int) -> tuple[Frame, float]:
        """Return a wall's frame and length."""
        a, b = self.outline[number], self.outline[(number + 1) % len(self.outline)]
        length = float(np.hypot(*(b - a)))
        along = (b - a) / length
        return Frame((float(a[0]), float(a[1])), (float(along[0]), float(along[1]))), length


def draw_house(rng: np.random.Generator, cameras: int) -> House:
    """Return a room without fixtures and furniture: floor, ceiling and walls with openings."""
    from training.rooms.walls import build_walls

    outline, flat = _floor(rng)
    ceiling = draw_height_m(rng)
    places = draw_cameras(rng, outline, cameras)
    eyes = [draw_eye_m(rng, ceiling) for _ in places]
    house = House(outline, ceiling, Soup(), places, eyes)
    floor, top = house.soup.paint("floor"), house.soup.paint("ceiling")
    house.soup.add(np.concatenate([flat, np.zeros((*flat.shape[:2], 1))], axis=2), SceneClass.FLOOR, floor)
    house.soup.add(np.concatenate([flat, np.full((*flat.shape[:2], 1), ceiling)], axis=2), SceneClass.CEILING, top)
    build_walls(rng, house)
    ceiling_things(rng, house)
    if house.portals and rng.random() < 0.3:
        house.cameras[-1] = _on_threshold(rng, house)
    return house


def _on_threshold(rng: np.random.Generator, house: House) -> tuple[float, float]:
    """Return a place just inside an opening: the room is still the one that the nadir belongs to."""
    frame, (x0, _, x1, _), _ = house.portals[int(rng.integers(len(house.portals)))]
    x, y, _ = frame.world((x0 + rng.uniform(0.3, 0.7) * (x1 - x0), rng.uniform(0.03, 0.5), 0.0))
    inside = Polygon(house.outline).buffer(-0.02).contains(Spot(x, y))
    return (float(x), float(y)) if inside else house.cameras[-1]


def _floor(rng: np.random.Generator) -> tuple[Doubles, Doubles]:
    """Return an outline and its triangles; now and then an outline has none (corners in a line, to rounding)."""
    for _ in range(10):
        outline = draw_outline(rng)
        with suppress(SceneError):
            return outline, triangles(outline)
    raise RuntimeError("ten outlines in a row that cannot be divided into triangles")


def ceiling_things(rng: np.random.Generator, house: House) -> None:
    """Hang lamps, and now and then a fan, a beam or a hatch."""
    x0, y0 = house.outline.min(axis=0)
    x1, y1 = house.outline.max(axis=0)
    room = Polygon(house.outline).buffer(-0.4)
    from shapely.geometry import Point as Spot

    wanted = int(rng.choice([0, 1, 2, 4, 6], p=[0.2, 0.45, 0.15, 0.1, 0.1]))
    glow = house.soup.paint("lamp", emission=1.0)
    body = house.soup.paint("metal")
    for _ in range(wanted * 3):
        if len(house.lamps) >= wanted:
            break
        x, y = rng.uniform(x0, x1), rng.uniform(y0, y1)
        if not room.contains(Spot(x, y)):
            continue
        radius = rng.uniform(0.06, 0.1) if wanted > 2 else rng.uniform(0.12, 0.3)
        drop = rng.uniform(0.02, 0.15) if rng.random() < 0.75 else rng.uniform(0.4, 1.0)
        _lamp(house, (x, y), radius, min(drop, house.ceiling_m - 1.9), glow, body)
    if rng.random() < 0.12 and house.lamps:
        _fan(rng, house, house.lamps[0])


def _lamp(house: House, at: tuple[float, float], radius: float, drop: float, glow: int, body: int) -> None:
    high = min(0.12, max(drop, 0.02))
    top, low = house.ceiling_m, house.ceiling_m - max(drop, 0.02)
    turn = np.linspace(0, 2 * np.pi, 11)
    ring = np.stack([at[0] + radius * np.cos(turn), at[1] + radius * np.sin(turn)], axis=1)
    for a, b in itertools.pairwise(ring):
        house.soup.add([[(*a, low), (*b, low), (*at, low - 0.02)]], SceneClass.FIXTURE, glow)
        side = [(*a, low), (*b, low), (*b, low + high), (*a, low + high)]
        house.soup.quad(WORLD, side, SceneClass.FIXTURE, glow)
        house.soup.add([[(*a, low + high), (*b, low + high), (*at, low + high)]], SceneClass.FIXTURE, body)
    x, y = at
    house.soup.box(WORLD, (x - 0.01, y - 0.01, low), (x + 0.01, y + 0.01, top), SceneClass.FIXTURE, body)
    house.lamps.append((x, y, low - 0.06))


def _fan(rng: np.random.Generator, house: House, at: tuple[float, float, float]) -> None:
    paint = house.soup.paint("trim")
    long, z = rng.uniform(0.45, 0.65), house.ceiling_m - rng.uniform(0.2, 0.35)
    count = int(rng.integers(3, 6))
    for turn in np.arange(count) * 2 * np.pi / count + rng.uniform(0, 6):
        along = (float(np.cos(turn)), float(np.sin(turn)))
        frame = Frame((at[0], at[1]), along)
        house.soup.box(frame, (0.12, -0.07, z), (long, 0.07, z + 0.012), SceneClass.FIXTURE, paint)

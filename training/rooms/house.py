"""One room for training, with its walls' openings, fixtures and furniture, as triangles.

Unlike `mocks.rooms` it need not be buildable: what matters is that every kind of confusion occurs, and that the labels
are right. Behind passages and open doors lies another room, seen through a portal (`training.rooms.beyond`).
"""

from __future__ import annotations

import itertools
from contextlib import suppress
from dataclasses import dataclass, field

import numpy as np
from shapely.errors import GEOSException
from shapely.geometry import Polygon

from processing.ground.arrays import Doubles
from processing.segmentation.evidence import SceneClass
from training.rooms.outlines import draw_cameras, draw_eye_m, draw_height_m, draw_outline
from training.rooms.soup import WORLD, Frame, Soup


@dataclass(frozen=True)
class Portal:
    """An opening to elsewhere: a frame whose y axis points into this room, and its rectangle on the wall."""

    frame: Frame
    rect: tuple[float, float, float, float]
    paint: int
    seed: int


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
    return house


def _floor(rng: np.random.Generator) -> tuple[Doubles, Doubles]:
    """Return an outline and its triangles; now and then an outline has none (corners in a line, to rounding)."""
    for _ in range(10):
        outline = draw_outline(rng)
        with suppress(GEOSException):
            return outline, triangulated(outline)
    raise RuntimeError("ten outlines in a row that cannot be divided into triangles")


def triangulated(outline: Doubles) -> Doubles:
    """Return triangles (N, 3, 2) that fill a polygon."""
    import shapely

    pieces = shapely.get_parts(shapely.constrained_delaunay_triangles(Polygon(outline)))
    return np.array([shapely.get_coordinates(piece)[:3] for piece in pieces])


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

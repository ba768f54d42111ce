"""What stands around a simulated house: a street with houses, trees, bushes and hedges, drawn from a seed.

Metres; ``x``, ``y`` in room axes from the viewer, heights over the ground. The street is the line of points whose
distance along ``across`` is ``offset_m``.
"""

import math
from dataclasses import dataclass
from functools import lru_cache
from typing import TypeAlias

import numpy as np

from mocks.worlds.light import Vector, vector_of
from processing.ground.tables import table_of

ROAD_M = 3.0  # half the road's width
PAVEMENT_M = 4.7  # from the road's middle to the pavement's outer edge

WALLS, ROOFS, LEAVES = (
    tuple(map(vector_of, table_of(__package__, "outdoors")["street"][name])) for name in ("walls", "roofs", "leaves")
)


@dataclass(frozen=True)
class House:
    """A gabled house: ``turn_rad`` is the azimuth that its front faces; width along the front."""

    x: float
    y: float
    turn_rad: float
    width_m: float
    depth_m: float
    eaves_m: float
    rise_m: float
    wall: Vector
    roof: Vector
    seed: int


@dataclass(frozen=True)
class Tree:
    """A tree, or with no trunk a bush: a crown of leaves ``crown_m`` wide."""

    x: float
    y: float
    height_m: float
    crown_m: float
    trunk_m: float
    leaves: Vector
    seed: int


Thing: TypeAlias = House | Tree


@dataclass(frozen=True)
class Street:
    """A street and what stands along it, farthest first."""

    across_rad: float
    offset_m: float
    things: tuple[Thing, ...]

    def place(self, along_m: float, across_m: float) -> tuple[float, float]:
        """Return the point at a distance along and across the street, counted from the viewer."""
        s, c = math.sin(self.across_rad), math.cos(self.across_rad)
        return across_m * s + along_m * c, across_m * c - along_m * s


@lru_cache(maxsize=16)
def draw_street(seed: int) -> Street:
    """Return the street of a seed."""
    rng = np.random.default_rng([seed, 7303])
    bare = Street(float(rng.uniform(0, 2 * math.pi)), float(rng.uniform(15.5, 21)), ())
    houses = _houses(rng, bare)
    bushes: list[Tree] = []
    for across_m in (bare.offset_m - PAVEMENT_M - 0.9, bare.offset_m + PAVEMENT_M + 0.9, -16.0, -19.5):
        height_m, leaves = float(rng.uniform(0.9, 1.7)), LEAVES[int(rng.integers(len(LEAVES)))]
        along_m = -45.0
        while along_m < 45:
            if rng.random() < 0.05:
                along_m += float(rng.uniform(2.5, 8))
            x, y = bare.place(along_m, across_m)
            size = height_m * float(rng.uniform(0.92, 1.06))
            bushes.append(Tree(x, y, size, 1.5 * size, 0.0, leaves, int(rng.integers(2**31))))
            along_m += 0.8 * height_m
    things: list[Thing] = [*houses, *bushes, *_trees(rng, bare, houses)]
    things.sort(key=lambda thing: -math.hypot(thing.x, thing.y))
    return Street(bare.across_rad, bare.offset_m, tuple(things))


def _houses(rng: np.random.Generator, street: Street) -> list[House]:
    rows = (
        (street.offset_m + float(rng.uniform(13, 17)), 0.0, 0.0),
        (0.0, 24.0, 0.0),
        (-float(rng.uniform(25, 34)), 0.0, math.pi),
        (street.offset_m + 48.0, 0.0, 0.0),
        (-62.0, 0.0, 0.0),
    )
    houses: list[House] = []
    for across_m, gap_m, turn_rad in rows:
        along_m = -95.0 + float(rng.uniform(0, 14))
        while along_m < 95:
            if abs(along_m) >= gap_m and rng.random() < 0.85:
                houses.append(_house(rng, street, along_m, across_m + float(rng.uniform(-1.5, 1.5)), turn_rad))
            along_m += float(rng.uniform(15, 23))
    return houses


def _house(rng: np.random.Generator, street: Street, along_m: float, across_m: float, turn_rad: float) -> House:
    x, y = street.place(along_m, across_m)
    storeys = int(rng.choice((1, 2, 2)))
    return House(
        x,
        y,
        # Fronts look at the street; some houses stand gable on.
        street.across_rad + math.pi + turn_rad + (math.pi / 2 if rng.random() < 0.3 else 0.0),
        float(rng.uniform(8, 12)),
        float(rng.uniform(7, 9)),
        0.4 + 2.7 * storeys,
        float(rng.uniform(2.2, 3.8)),
        WALLS[int(rng.integers(len(WALLS)))],
        ROOFS[int(rng.integers(len(ROOFS)))],
        int(rng.integers(2**31)),
    )


def _trees(rng: np.random.Generator, street: Street, houses: list[House]) -> list[Tree]:
    trees: list[Tree] = []
    while len(trees) < 75:
        distance_m = math.exp(float(rng.uniform(math.log(10), math.log(110))))
        azimuth = float(rng.uniform(0, 2 * math.pi))
        x, y = distance_m * math.sin(azimuth), distance_m * math.cos(azimuth)
        across_m = x * math.sin(street.across_rad) + y * math.cos(street.across_rad) - street.offset_m
        on_road = abs(across_m) < PAVEMENT_M + 1
        in_house = any(math.hypot(x - h.x, y - h.y) < 6.5 for h in houses)
        bush = bool(rng.random() < 0.3)
        height_m = float(rng.uniform(0.8, 2.2)) if bush else min(float(rng.uniform(4, 12)), 2 + 0.38 * distance_m)
        crown_m = height_m * float(rng.uniform(1.0, 1.5) if bush else rng.uniform(0.5, 0.85))
        leaves, seed = LEAVES[int(rng.integers(len(LEAVES)))], int(rng.integers(2**31))
        crowded = any(math.hypot(x - t.x, y - t.y) < 0.35 * (crown_m + t.crown_m) for t in trees)
        if not (on_road or in_house or crowded):
            trees.append(Tree(x, y, height_m, crown_m, 0.0 if bush else 0.25 * height_m, leaves, seed))
    return trees

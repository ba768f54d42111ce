"""Bedrooms: the bed with its head to a wall, what stands beside it, and where the clothes are."""

from __future__ import annotations

import math
from dataclasses import replace

from mocks.rooms.furnish.clutter import on_the_floor, picture_over, plants, rug_under, things_on, wall_things
from mocks.rooms.furnish.space import Arrangement, beside, towards
from mocks.rooms.model import Finish, Item, Role

DOUBLE_M = (1.88, 1.68, 1.48)
SINGLE_M = (1.28, 0.98)
BED_TOP_M = 0.562  # where things lie on a duvet


def essentials(a: Arrangement, finish: Finish) -> bool:
    """Place the bed with its nightstands, and the wardrobe."""
    bed = _bed(a)
    if bed is None:
        return False
    # Place nightstands (a pair is alike) with a lamp, books, a mug
    size = (a.draw(0.38, 0.5), a.draw(0.34, 0.42), a.draw(0.44, 0.56))
    lamp = (a.draw(0.2, 0.28), a.draw(0.36, 0.5))
    for side in (-1, 1):
        stand = a.add(replace(_beside_bed(a, bed, side, size), seed=bed.seed))
        if stand is None:
            continue
        if a.chance(0.85):
            a.put_on(stand, "table lamp", (lamp[0], lamp[0], lamp[1]), at=(side * 0.5, 0.6))
        if a.chance(0.3 + 0.5 * a.messy):
            a.put_on(stand, "books", (0.15, 0.21, a.draw(0.02, 0.08)))
        if a.chance(0.5 * a.messy):
            a.put_on(stand, "mug", (0.115, 0.085, 0.095))
    _rug(a, bed, finish)
    tall = min(a.draw(1.9, 2.3), a.plan.height_m - 0.08)
    for width in (a.draw(1.4, 2.1), a.draw(0.9, 1.3)):
        if a.against_wall("wardrobe", (width, a.draw(0.58, 0.64), round(tall, 3)), front_m=0.55):
            break
    return True


def extras(a: Arrangement, finish: Finish) -> None:
    """Place what else a bedroom may hold."""
    bed = next(item for item in a.items if item.kind == "bed")
    if a.chance(0.85):
        picture_over(a, bed)
    if a.chance(0.6):
        chest = a.against_wall(
            "chest of drawers", (a.draw(0.75, 1.3), a.draw(0.42, 0.5), a.draw(0.72, 1.0)), front_m=0.4
        )
        if chest:
            _on_chest(a, chest)
    # Lay a blanket over the foot of the bed, or cushions by the pillows
    if a.chance(0.45):
        x, y = beside(bed, a.draw(-0.2, 0.2), -bed.size_m[1] / 2 + 0.45)
        size = (round(min(0.7, bed.size_m[0] * 0.5), 3), 0.42, 0.075)
        a.add(a.item("blanket", size, (x, y, BED_TOP_M), bed.turn_rad + a.draw(-0.2, 0.2), (), Role.CLUTTER))
    if a.chance(0.2 + 0.4 * a.messy):
        x, y = beside(bed, a.draw(-0.3, 0.3), a.draw(-0.3, 0.1))
        a.add(a.item("books", (0.16, 0.23, 0.025), (x, y, BED_TOP_M), a.draw(0, 6), (), Role.CLUTTER))
    if a.chance(0.35):
        a.against_wall("armchair", (0.78, 0.82, 0.8))
    if a.chance(0.3):
        a.against_wall("chair", (0.45, 0.53, a.draw(0.8, 0.88)))
    if a.chance(0.25):
        a.against_wall("bookcase", (a.draw(0.4, 0.8), 0.3, a.draw(1.2, 1.95)))
    plants(a, 2)
    wall_things(a, int(a.rng.integers(0, 3)))
    on_the_floor(a, toys=bed.size_m[0] < 1.3)


def _bed(a: Arrangement) -> Item | None:
    """Place the largest bed that fits, its head to a wall, room beside it."""
    widths = [w for w in (DOUBLE_M + SINGLE_M) if a.chance(0.7)] + [SINGLE_M[-1]]
    for width in widths:
        size = (width, a.draw(2.08, 2.16), a.draw(0.88, 1.15))
        bed = a.against_wall("bed", size, lambda item: _calm(a, item))
        if bed:
            a.keep_free(bed, 0.35)
            return bed
    return _along_a_wall(a)


def _along_a_wall(a: Arrangement) -> Item | None:
    """Place a single bed with its long side to a wall, as in small rooms."""
    size = (0.94, 2.06, 0.9)
    model = a.item("bed", size, (0.0, 0.0, 0.0))
    for (x, y), turn in a.wall_places((size[1], size[0], size[2]), tries=24):
        quarter = math.pi / 2 if a.chance(0.5) else -math.pi / 2
        bed = a.add(replace(model, position_m=(x, y, 0.0), turn_rad=turn + quarter))
        if bed:
            return bed
    return None


def _calm(a: Arrangement, bed: Item) -> float:
    """Return how good a place for a bed is: free on both sides, its foot towards the room, away from doors."""
    free = sum(a.fits(_beside_bed(a, bed, side, (0.42, 0.38, 0.48))) for side in (-1, 1))
    doors = [a.plan.on_wall(d.wall, d.start_m + d.width_m / 2) for d in a.plan.doors]
    away = min((math.dist(bed.position_m[:2], door) for door in doors), default=3.0)
    return free + 0.4 * min(away, 3.0) + 0.3 * towards(bed, (0.0, 0.0))


def _beside_bed(a: Arrangement, bed: Item, side: int, size: tuple[float, float, float]) -> Item:
    along = side * (bed.size_m[0] / 2 + size[0] / 2 + 0.05)
    x, y = beside(bed, along, bed.size_m[1] / 2 - size[1] / 2)
    return a.item("nightstand", size, (x, y, 0.0), bed.turn_rad)


def _rug(a: Arrangement, bed: Item, finish: Finish) -> None:
    if not a.chance(0.65):
        return
    if a.chance(0.7):
        x, y = beside(bed, 0.0, -0.55)
        size = (bed.size_m[0] + a.draw(0.7, 1.2), a.draw(1.5, 2.1))
        if rug_under(a, x, y, size, bed.turn_rad, finish.floor.name):
            return
    for side in (-1, 1):
        size = (a.draw(0.6, 0.8), a.draw(1.2, 1.6))
        x, y = beside(bed, side * (bed.size_m[0] / 2 + 0.08 + size[0] / 2), a.draw(-0.3, 0.0))
        if rug_under(a, x, y, size, bed.turn_rad, finish.floor.name):
            return


def _on_chest(a: Arrangement, chest: Item) -> None:
    if a.chance(0.3) and chest.size_m[0] > 0.95:
        w = a.draw(0.75, 0.9)
        a.put_on(chest, "television", (w, 0.2, round(0.6 * w + 0.06, 3)), at=(0.0, 0.2), turn_rad=0.0)
    elif a.chance(0.5):
        picture_over(a, chest)
    if a.chance(0.4):
        a.put_on(chest, "table lamp", (0.26, 0.26, 0.45), at=(0.8, 0.3))
    things_on(a, chest, 5)

"""Living rooms: the sofa group round its table, the television across, books, plants and pictures."""

from __future__ import annotations

import math
from dataclasses import replace

from mocks.rooms.furnish.clutter import (
    cushions_on,
    floor_lamp_by,
    on_the_floor,
    picture_over,
    plants,
    rug_under,
    things_on,
    wall_things,
)
from mocks.rooms.furnish.space import Arrangement, beside, facing, towards
from mocks.rooms.model import Finish, Item, Point, Role


def essentials(a: Arrangement, finish: Finish) -> bool:
    """Place the sofa, its table and rug, and the television."""
    sofa = _sofa(a)
    if sofa is None:
        return False
    reach = a.draw(0.72, 0.95)
    middle = beside(sofa, 0.0, -sofa.size_m[1] / 2 - reach)
    if a.chance(0.75):
        size = (sofa.size_m[0] + a.draw(-0.1, 0.5), a.draw(1.4, 1.9))
        rug_under(a, *middle, size, sofa.turn_rad, finish.floor.name)
    _coffee_table(a, sofa, middle)
    _television(a, sofa)
    return True


def extras(a: Arrangement, finish: Finish) -> None:
    """Place seats, shelves and what gathers on them."""
    sofa = next(item for item in a.items if item.kind == "sofa")
    middle = beside(sofa, 0.0, -sofa.size_m[1] / 2 - 0.8)
    for _ in range(int(a.rng.integers(0, 3))):
        _armchair(a, sofa, middle)
    if a.chance(0.7):
        floor_lamp_by(a, sofa)
    for _ in range(int(a.rng.integers(1, 3))):
        a.against_wall("bookcase", (a.draw(0.6, 1.2), a.draw(0.27, 0.34), a.draw(1.1, 2.05)), front_m=0.3)
    if a.chance(0.35):
        chest = a.against_wall("cabinet", (a.draw(1.0, 1.5), 0.42, a.draw(0.75, 0.9)), front_m=0.4)
        if chest:
            things_on(a, chest, 5)
            picture_over(a, chest)
    cushions_on(a, sofa, int(a.rng.integers(0, 5)))
    if a.chance(0.85):
        picture_over(a, sofa)
    if a.chance(0.25):
        a.on_floor("ottoman", (0.5, 0.5, a.draw(0.36, 0.44)), edge_m=1.2, role=Role.FURNITURE)
    plants(a, 3)
    wall_things(a, int(a.rng.integers(1, 4)))
    on_the_floor(a, toys=a.chance(0.4))


def _sofa(a: Arrangement) -> Item | None:
    """Place the sofa against a wall, facing across the room; smaller ones where a large one does not fit."""
    for width in (a.draw(1.9, 2.4), a.draw(1.5, 1.8)):
        size = (width, a.draw(0.86, 0.98), a.draw(0.78, 0.88))
        sofa = a.against_wall("sofa", size, lambda item: towards(item, (0.0, 0.0)) + 0.5 * float(a.rng.random()))
        if sofa:
            return sofa
    return None


def _coffee_table(a: Arrangement, sofa: Item, middle: Point) -> None:
    """Place a low table before the sofa; further along where the camera stands."""
    round_top = a.chance(0.3)
    w = a.draw(0.6, 0.85) if round_top else a.draw(0.9, 1.2)
    size = (w, w if round_top else a.draw(0.5, 0.65), a.draw(0.36, 0.45))
    options = (("round", 1.0),) if round_top else ()
    for shift in (0.0, 0.3, -0.3, 0.6, -0.6):
        x, y = beside(sofa, shift, -sofa.size_m[1] / 2 - 0.38 - size[1] / 2)
        turn = sofa.turn_rad + float(a.rng.normal(0, 0.03))
        table = a.add(a.item("coffee table", size, (x, y, 0.0), turn, options))
        if table:
            things_on(a, table, 4)
            return


def _television(a: Arrangement, sofa: Item) -> None:
    """Stand the television on its cabinet, as nearly across from the sofa as the walls allow."""
    size = (a.draw(1.3, 1.9), a.draw(0.38, 0.45), a.draw(0.42, 0.6))

    def across(item: Item) -> float:
        place = (item.position_m[0], item.position_m[1])
        at = (sofa.position_m[0], sofa.position_m[1])
        return towards(sofa, place) + towards(item, at) - 0.05 * math.dist(place, at)

    stand = a.against_wall("cabinet", size, across, front_m=0.35)
    if stand is None:
        return
    w = a.draw(0.95, 1.35)
    if a.chance(0.85):
        a.put_on(stand, "television", (w, 0.24, round(0.575 * w + 0.06, 3)), at=(0.0, 0.0), turn_rad=0.0)
    things_on(a, stand, 3)


def _armchair(a: Arrangement, sofa: Item, middle: Point) -> None:
    """Place an armchair beside the table, turned towards it."""
    size = (a.draw(0.72, 0.85), a.draw(0.76, 0.86), a.draw(0.76, 0.86))
    model = a.item("armchair", size, (0.0, 0.0, 0.0))
    for _ in range(12):
        side = -1 if a.chance(0.5) else 1
        x, y = beside(sofa, side * a.draw(1.1, 1.9), -sofa.size_m[1] / 2 - a.draw(0.3, 1.6))
        turn = facing((x, y), middle) + float(a.rng.normal(0, 0.12))
        chair = a.add(replace(model, position_m=(x, y, 0.0), turn_rad=turn))
        if chair:
            cushions_on(a, chair, int(a.rng.integers(0, 2)))
            return

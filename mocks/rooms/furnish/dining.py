"""Dining rooms: a table with its chairs, partly pulled out, and a sideboard."""

from __future__ import annotations

import math
from dataclasses import replace

from shapely.geometry import Polygon

from mocks.rooms.furnish.clutter import on_the_floor, picture_over, plants, quarter, rug_under, things_on, wall_things
from mocks.rooms.furnish.space import Arrangement, beside
from mocks.rooms.model import Finish, Item
from mocks.worlds.light import Vector

TABLES_M = ((2.0, 0.95), (1.7, 0.9), (1.4, 0.85), (1.2, 0.8), (0.9, 0.75))

PLACES = 6
"""How many places for the table are compared."""


def essentials(a: Arrangement, finish: Finish) -> bool:
    """Place the table and its chairs."""
    table = _table(a)
    if table is None:
        return False
    if a.chance(0.35):
        x, y, _ = table.position_m
        size = (table.size_m[0] + 1.1, table.size_m[1] + 1.1)
        rug_under(a, x, y, size, table.turn_rad, finish.floor.name)
    _chairs(a, table)
    return len([item for item in a.items if item.kind == "chair"]) >= 2


def extras(a: Arrangement, finish: Finish) -> None:
    """Place the sideboard and the rest."""
    table = next(item for item in a.items if item.kind == "dining table")
    if a.chance(0.7):
        a.put_on(table, str(a.rng.choice(["bowl", "vase"])), (0.25, 0.25, 0.1), at=(a.draw(-0.2, 0.2), 0.0))
    things_on(a, table, 5)
    side = a.against_wall("cabinet", (a.draw(1.2, 1.9), a.draw(0.4, 0.47), a.draw(0.75, 0.92)), front_m=0.4)
    if side:
        things_on(a, side, 6)
        picture_over(a, side)
    if a.chance(0.4):
        a.against_wall("bookcase", (a.draw(0.6, 1.0), 0.3, a.draw(1.2, 2.0)))
    if a.chance(0.3):
        a.against_wall("chair", (0.45, 0.53, 0.84))
    if a.chance(0.2):
        a.against_wall("armchair", (0.8, 0.84, 0.8))
    plants(a, 3)
    wall_things(a, int(a.rng.integers(1, 4)))
    on_the_floor(a, toys=False)


def _table(a: Arrangement) -> Item | None:
    """Place the largest table that leaves room for chairs, square to the room: where most of them find a place."""
    floor = Polygon(a.plan.polygon)
    x0, y0, x1, y1 = floor.bounds
    for wide, deep in TABLES_M[int(a.rng.integers(3)) :]:
        round_top = wide < 1.5 and a.chance(0.5)
        size: Vector = (wide, wide, 0.75) if round_top else (wide, deep, a.draw(0.73, 0.76))
        room, found = floor.buffer(-0.75), []
        for _ in range(30):
            x, y = a.draw(x0, x1), a.draw(y0, y1)
            item = a.item("dining table", size, (x, y, 0.0), quarter(a), (("round", 1.0),) if round_top else ())
            if room.covers(Polygon(item.corners()).buffer(-0.15)):
                found += [item] if a.fits(item) else []
            if len(found) == PLACES:
                break
        if found:
            return a.add(max(found, key=lambda table: _served(a, table)))
    return None


def _served(a: Arrangement, table: Item) -> float:
    """Return the share of a table's seats where a chair would fit."""
    seats = _seats(table)
    chairs = [_chair_at(a, table, seat, (0.46, 0.52, 0.85), 0.08) for seat in seats]
    return sum(a.fits(chair) for chair in chairs) / len(seats)


def _chair_at(
    a: Arrangement, table: Item, seat: tuple[float, float, float], size: Vector, pulled_m: float, loose_rad: float = 0.0
) -> Item:
    along, back, turn = seat
    off = size[1] / 2 - 0.2 + pulled_m
    x, y = beside(table, along + math.sin(turn) * -off, back + math.cos(turn) * off)
    return a.item("chair", size, (x, y, 0.0), table.turn_rad + turn + loose_rad)


def _chairs(a: Arrangement, table: Item) -> None:
    """Place chairs round the table: all of one design, some pulled out and turned as people leave them."""
    size = (a.draw(0.43, 0.47), a.draw(0.5, 0.54), a.draw(0.8, 0.92))
    design = (("design", float(a.rng.integers(3))),)
    for seat in _seats(table):
        for _ in range(5):
            pulled = a.draw(0.04, 0.12) if a.chance(0.65 - 0.3 * a.messy) else a.draw(0.12, 0.45)
            loose = float(a.rng.normal(0, 0.03 + 0.3 * max(pulled - 0.1, 0.0)))
            chair = _chair_at(a, table, seat, size, pulled, loose)
            if a.add(replace(chair, seed=table.seed, options=design)):
                break


def _seats(table: Item) -> list[tuple[float, float, float]]:
    """Return the places at the table's edge in its own axes, and the turn of one who sits there."""
    w, d, _ = table.size_m
    if dict(table.options).get("round", 0.0):
        count = 4 if w >= 1.1 else 3
        angles = [2 * math.pi * k / count + 0.4 for k in range(count)]
        return [(-math.sin(t) * w / 2, math.cos(t) * w / 2, t) for t in angles]
    along = max(1, int((w - 0.1) / 0.58))
    step = w / along
    places = [(-w / 2 + (k + 0.5) * step) * (0.92 if along > 1 else 1.0) for k in range(along)]
    seats = [(x, s * d / 2, 0.0 if s > 0 else math.pi) for x in places for s in (1, -1)]
    ends = [(w / 2, 0.0, -math.pi / 2), (-w / 2, 0.0, math.pi / 2)] if w > 1.3 and table.seed % 3 else []
    return seats + ends

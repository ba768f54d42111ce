"""Offices at home: a desk or two, screens, shelves."""

from __future__ import annotations

from mocks.rooms.furnish.clutter import floor_lamp_by, on_the_floor, plants, rug_under, things_on, wall_things
from mocks.rooms.furnish.space import Arrangement, beside
from mocks.rooms.model import Finish, Item


def essentials(a: Arrangement, finish: Finish) -> bool:
    """Place the desk with its chair and screens, and the first shelf."""
    if not workplace(a, finish):
        return False
    a.against_wall("bookcase", (a.draw(0.7, 1.2), a.draw(0.28, 0.36), a.draw(1.6, 2.1)), front_m=0.4)
    return True


def extras(a: Arrangement, finish: Finish) -> None:
    """Place a second desk, cabinets, an easy chair and what gathers there."""
    if a.chance(0.25):
        workplace(a, finish)
    for _ in range(int(a.rng.integers(0, 3))):
        a.against_wall("bookcase", (a.draw(0.4, 1.0), a.draw(0.28, 0.36), a.draw(0.8, 2.1)), front_m=0.3)
    if a.chance(0.5):
        low = a.against_wall("cabinet", (a.draw(0.9, 1.6), 0.42, a.draw(0.6, 0.85)), front_m=0.4)
        if low:
            things_on(a, low, 5)
    if a.chance(0.3):
        chair = a.against_wall("armchair", (a.draw(0.72, 0.82), 0.8, 0.8))
        if chair:
            floor_lamp_by(a, chair)
    plants(a, 2)
    wall_things(a, int(a.rng.integers(1, 4)))
    on_the_floor(a, toys=False)


def workplace(a: Arrangement, finish: Finish) -> bool:
    """Place a desk at a wall or window with what stands on and before it."""
    size = (a.draw(1.2, 1.7), a.draw(0.65, 0.8), a.draw(0.72, 0.75))
    desk = a.against_wall("desk", size) or a.against_wall("desk", (1.0, 0.6, 0.73))
    if desk is None:
        return False
    _screens(a, desk)
    if a.chance(0.6):
        a.put_on(desk, "table lamp", (0.22, 0.22, a.draw(0.38, 0.46)), at=(0.92, 0.75))
    x, y = beside(desk, 0.0, -desk.size_m[1] / 2 - 0.3)
    if a.chance(0.3):
        rug_under(a, x, y, (1.8, 1.3), desk.turn_rad, finish.floor.name)
    _chair(a, desk)
    things_on(a, desk, 5)
    return True


def _screens(a: Arrangement, desk: Item) -> None:
    """Put one or two screens and a keyboard on the desk, or a laptop."""
    count = int(a.rng.integers(0, 3)) if desk.size_m[0] > 1.35 else int(a.rng.integers(0, 2))
    placed = []
    for k in range(count):
        along = 0.0 if count == 1 else (-0.55, 0.55)[k]
        spread = (along * 0.62, 0.85)
        size = (a.draw(0.54, 0.62), 0.2, a.draw(0.45, 0.5))
        turn = -0.16 * along + float(a.rng.normal(0, 0.03))
        screen = a.put_on(desk, "monitor", size, at=spread, turn_rad=turn)
        placed += [screen] if screen else []
    if placed:
        a.put_on(desk, "keyboard", (0.56, 0.14, 0.032), at=(a.draw(-0.1, 0.1), a.draw(-0.75, -0.5)))
    else:
        a.put_on(desk, "laptop", (0.34, 0.33, 0.235), at=(a.draw(-0.15, 0.15), -0.35))


def _chair(a: Arrangement, desk: Item) -> None:
    """Place the chair before the desk's knee space, turned as it was left."""
    size = (a.draw(0.6, 0.66), a.draw(0.6, 0.66), a.draw(0.98, 1.12))
    unit = 0.0 if desk.seed % 3 == 1 else (-0.24 if desk.seed % 2 else 0.24)
    for _ in range(10):
        back = desk.size_m[1] / 2 + a.draw(0.12, 0.55)
        x, y = beside(desk, unit + float(a.rng.normal(0, 0.05)), -back)
        # Who sits at the desk looks at its wall: the chair faces the other way than the desk does.
        turn = desk.turn_rad + 3.1416 + float(a.rng.normal(0, 0.35))
        if a.add(a.item("swivel chair", size, (x, y, 0.0), turn)):
            return

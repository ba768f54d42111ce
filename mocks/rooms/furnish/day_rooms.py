"""Which furniture stands where in living rooms, dining rooms and offices."""

import math
from dataclasses import replace

from shapely.geometry import Polygon

from mocks.rooms.furnish import clutter
from mocks.rooms.furnish.space import Arrangement, beside, facing, towards
from mocks.rooms.model import Finish, Item, Point, Role
from mocks.worlds.light import Vector


def living_essentials(a: Arrangement, finish: Finish) -> bool:
    """Place the sofa, its table and rug, and the television."""
    # Against a wall, facing across the room; a smaller one where a large one does not fit
    for width in (a.draw(1.9, 2.4), a.draw(1.5, 1.8)):
        solid = (width, a.draw(0.86, 0.98), a.draw(0.78, 0.88))
        sofa = a.against_wall("sofa", solid, lambda item: towards(item, (0.0, 0.0)) + 0.5 * float(a.rng.random()))
        if sofa:
            break
    else:
        return False
    middle = beside(sofa, 0.0, -sofa.size_m[1] / 2 - a.draw(0.72, 0.95))
    if a.chance(0.75):
        size = (sofa.size_m[0] + a.draw(-0.1, 0.5), a.draw(1.4, 1.9))
        clutter.rug_under(a, *middle, size, sofa.turn_rad, finish.floor.name)
    _coffee_table(a, sofa, middle)
    _television(a, sofa)
    return True


def living_extras(a: Arrangement, finish: Finish) -> None:
    """Place seats, shelves and what gathers on them."""
    sofa = next(item for item in a.items if item.kind == "sofa")
    middle = beside(sofa, 0.0, -sofa.size_m[1] / 2 - 0.8)
    for _ in range(int(a.rng.integers(0, 3))):
        _armchair(a, sofa, middle)
    if a.chance(0.7):
        clutter.lamp_by(a, sofa)
    for _ in range(int(a.rng.integers(1, 3))):
        a.against_wall("bookcase", (a.draw(0.6, 1.2), a.draw(0.27, 0.34), a.draw(1.1, 2.05)), front_m=0.3)
    if a.chance(0.35):
        chest = a.against_wall("cabinet", (a.draw(1.0, 1.5), 0.42, a.draw(0.75, 0.9)), front_m=0.4)
        if chest:
            clutter.things_on(a, chest, 5)
            clutter.picture_over(a, chest)
    clutter.cushions_on(a, sofa, int(a.rng.integers(0, 5)))
    if a.chance(0.85):
        clutter.picture_over(a, sofa)
    if a.chance(0.25):
        a.on_floor("ottoman", (0.5, 0.5, a.draw(0.36, 0.44)), edge_m=1.2, role=Role.FURNITURE)
    clutter.plants(a, 3)
    clutter.wall_things(a, int(a.rng.integers(1, 4)))
    clutter.on_the_floor(a, toys=a.chance(0.4))


def _coffee_table(a: Arrangement, sofa: Item, middle: Point) -> None:
    """Place a low table before the sofa; further along where the camera stands."""
    round_top = a.chance(0.3)
    w = a.draw(0.6, 0.85) if round_top else a.draw(0.9, 1.2)
    size = (w, w if round_top else a.draw(0.5, 0.65), a.draw(0.36, 0.45))
    options = (("round", 1.0),) if round_top else ()
    back = -sofa.size_m[1] / 2 - 0.38 - size[1] / 2
    places = [(*beside(sofa, shift, back), 0.0) for shift in (0.0, 0.3, -0.3, 0.6, -0.6)]
    table = a.first(
        a.item("coffee table", size, at, sofa.turn_rad + float(a.rng.normal(0, 0.03)), options) for at in places
    )
    if table:
        clutter.things_on(a, table, 4)


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
    clutter.things_on(a, stand, 3)


def _armchair(a: Arrangement, sofa: Item, middle: Point) -> None:
    """Place an armchair beside the table, turned towards it."""
    model = a.item("armchair", (a.draw(0.72, 0.85), a.draw(0.76, 0.86), a.draw(0.76, 0.86)), (0.0, 0.0, 0.0))
    for _ in range(12):
        side = -1 if a.chance(0.5) else 1
        x, y = beside(sofa, side * a.draw(1.1, 1.9), -sofa.size_m[1] / 2 - a.draw(0.3, 1.6))
        turn = facing((x, y), middle) + float(a.rng.normal(0, 0.12))
        chair = a.add(replace(model, position_m=(x, y, 0.0), turn_rad=turn))
        if chair:
            clutter.cushions_on(a, chair, int(a.rng.integers(0, 2)))
            return


TABLES_M = ((2.0, 0.95), (1.7, 0.9), (1.4, 0.85), (1.2, 0.8), (0.9, 0.75))

PLACES = 6  # how many places for the table are compared


def dining_essentials(a: Arrangement, finish: Finish) -> bool:
    """Place the table and its chairs."""
    table = _table(a)
    if table is None:
        return False
    if a.chance(0.35):
        x, y, _ = table.position_m
        clutter.rug_under(a, x, y, (table.size_m[0] + 1.1, table.size_m[1] + 1.1), table.turn_rad, finish.floor.name)
    _chairs(a, table)
    return len([item for item in a.items if item.kind == "chair"]) >= 2


def dining_extras(a: Arrangement, finish: Finish) -> None:
    """Place the sideboard and the rest."""
    table = next(item for item in a.items if item.kind == "dining table")
    if a.chance(0.7):
        a.put_on(table, str(a.rng.choice(["bowl", "vase"])), (0.25, 0.25, 0.1), at=(a.draw(-0.2, 0.2), 0.0))
    clutter.things_on(a, table, 5)
    side = a.against_wall("cabinet", (a.draw(1.2, 1.9), a.draw(0.4, 0.47), a.draw(0.75, 0.92)), front_m=0.4)
    if side:
        clutter.things_on(a, side, 6)
        clutter.picture_over(a, side)
    if a.chance(0.4):
        a.against_wall("bookcase", (a.draw(0.6, 1.0), 0.3, a.draw(1.2, 2.0)))
    if a.chance(0.3):
        a.against_wall("chair", (0.45, 0.53, 0.84))
    if a.chance(0.2):
        a.against_wall("armchair", (0.8, 0.84, 0.8))
    clutter.plants(a, 3)
    clutter.wall_things(a, int(a.rng.integers(1, 4)))
    clutter.on_the_floor(a, toys=False)


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
            item = a.item("dining table", size, (x, y, 0.0), clutter.quarter(a), (("round", 1.0),) if round_top else ())
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


def office_essentials(a: Arrangement, finish: Finish) -> bool:
    """Place the desk with its chair and screens, and the first shelf."""
    if not workplace(a, finish):
        return False
    a.against_wall("bookcase", (a.draw(0.7, 1.2), a.draw(0.28, 0.36), a.draw(1.6, 2.1)), front_m=0.4)
    return True


def office_extras(a: Arrangement, finish: Finish) -> None:
    """Place a second desk, cabinets, an easy chair and what gathers there."""
    if a.chance(0.25):
        workplace(a, finish)
    for _ in range(int(a.rng.integers(0, 3))):
        a.against_wall("bookcase", (a.draw(0.4, 1.0), a.draw(0.28, 0.36), a.draw(0.8, 2.1)), front_m=0.3)
    if a.chance(0.5):
        low = a.against_wall("cabinet", (a.draw(0.9, 1.6), 0.42, a.draw(0.6, 0.85)), front_m=0.4)
        if low:
            clutter.things_on(a, low, 5)
    if a.chance(0.3):
        chair = a.against_wall("armchair", (a.draw(0.72, 0.82), 0.8, 0.8))
        if chair:
            clutter.lamp_by(a, chair)
    clutter.plants(a, 2)
    clutter.wall_things(a, int(a.rng.integers(1, 4)))
    clutter.on_the_floor(a, toys=False)


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
        clutter.rug_under(a, x, y, (1.8, 1.3), desk.turn_rad, finish.floor.name)
    _chair(a, desk)
    clutter.things_on(a, desk, 5)
    return True


def _screens(a: Arrangement, desk: Item) -> None:
    """Put one or two screens and a keyboard on the desk, or a laptop."""
    count = int(a.rng.integers(0, 3)) if desk.size_m[0] > 1.35 else int(a.rng.integers(0, 2))
    placed = []
    for k in range(count):
        along = 0.0 if count == 1 else (-0.55, 0.55)[k]
        spread = (along * 0.62, 0.85)
        size = (a.draw(0.54, 0.62), 0.2, a.draw(0.45, 0.5))
        screen = a.put_on(desk, "monitor", size, at=spread, turn_rad=-0.16 * along + float(a.rng.normal(0, 0.03)))
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
        if a.add(a.item("swivel chair", size, (x, y, 0.0), desk.turn_rad + 3.1416 + float(a.rng.normal(0, 0.35)))):
            return

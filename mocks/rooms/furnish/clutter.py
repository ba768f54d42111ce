"""What gathers in any room: lamps, plants, pictures, things on tables, shelves and floors."""

import math

from mocks.rooms.furnish.space import Arrangement, beside
from mocks.rooms.model import Item, Role
from processing.ground.tables import table_of

SMALL = table_of(__package__, "clutter")
EYE_M = 1.5  # pictures hang with their middle about here


def picture_over(a: Arrangement, below: Item) -> None:
    """Hang a picture, or two side by side, over a piece of furniture."""
    h = a.draw(0.4, 0.8)
    w = min(h * a.draw(0.75, 1.7), below.size_m[0] * 0.8)
    low = round(max(below.position_m[2] + below.size_m[2] + 0.18, EYE_M - h / 2), 3)
    if low + h < a.plan.height_m - 0.15:
        a.hang_over(below, "picture", (round(w, 3), 0.025, h), low)


def wall_things(a: Arrangement, pictures: int) -> None:
    """Hang pictures, and now and then a clock or a shelf, on what walls are left."""
    for _ in range(pictures):
        h = a.draw(0.3, 0.75) if a.chance(0.6) else a.draw(0.7, 1.05)
        a.hang("picture", (round(h * a.draw(0.7, 1.4), 3), 0.025, h), round(EYE_M - h / 2, 3))
    if a.chance(0.2):
        d = a.draw(0.24, 0.34)
        a.hang("wall clock", (d, 0.04, d), a.draw(1.65, 1.8))
    if a.chance(0.3):
        a.hang("wall shelf", (a.draw(0.6, 1.1), 0.2, 0.28), a.draw(1.35, 1.55))


def plants(a: Arrangement, most: int) -> None:
    """Stand plants in corners and by walls, the first one large."""
    for k in range(int(a.rng.integers(0, most + 1))):
        h = a.draw(0.9, 1.6) if k == 0 else a.draw(0.35, 0.8)
        w = round(min(0.7, 0.5 * h + 0.05), 3)
        a.against_wall("plant", (w, w, h), role=Role.CLUTTER)


def lamp_by(a: Arrangement, seat: Item) -> Item | None:
    """Stand a floor lamp beside a seat, a little back."""
    w = a.draw(0.36, 0.46)
    sides = (-1, 1) if a.chance(0.5) else (1, -1)
    places = [beside(seat, s * (seat.size_m[0] / 2 + w / 2 + 0.06), seat.size_m[1] / 2 - w / 2) for s in sides]
    return a.first(a.item("floor lamp", (w, w, a.draw(1.45, 1.75)), (*place, 0.0), a.draw(0, 6.28)) for place in places)


def things_on(a: Arrangement, support: Item, most: int) -> None:
    """Put small things on top of a table or a cabinet, more of them where people are messy."""
    for _ in range(int(a.rng.binomial(most, 0.25 + 0.6 * a.messy))):
        kind = str(a.rng.choice(list(SMALL), p=[row["share"] for row in SMALL.values()]))
        wide, deep, high = (side if isinstance(side, float) else a.draw(*side) for side in SMALL[kind]["size_m"])
        a.put_on(support, kind, (wide, deep or wide, high), turn_rad=a.draw(-0.6, 0.6))


def cushions_on(a: Arrangement, seat: Item, count: int) -> None:
    """Set cushions on a sofa, leaning against its back, none quite straight."""
    for place in sorted(float(v) for v in a.rng.uniform(-1, 1, count)):
        side = a.draw(0.38, 0.48)
        along = place * max(seat.size_m[0] / 2 - 0.24 - side / 2, 0.0)
        x, y = beside(seat, along, seat.size_m[1] / 2 - 0.46 - 0.14)
        lean = (("lean", a.draw(0.25, 0.5)),)
        turn = seat.turn_rad + float(a.rng.normal(0, 0.1))
        a.add(a.item("cushion", (side, 0.28, side), (x, y, 0.470), turn, lean, Role.CLUTTER))


def on_the_floor(a: Arrangement, toys: bool) -> None:
    """Leave things on the floor: a basket, boxes, books, toys, a ball."""
    if a.chance(0.2 + 0.4 * a.messy):
        w = a.draw(0.3, 0.42)
        a.on_floor("basket", (w, w, a.draw(0.26, 0.4)))
    for _ in range(int(a.rng.poisson(1.6 * a.messy))):
        kind = str(a.rng.choice(["box", "books", "toy blocks", "toy ball"] if toys else ["box", "books"]))
        if kind == "box":
            a.on_floor("box", (a.draw(0.25, 0.5), a.draw(0.2, 0.38), a.draw(0.18, 0.36)))
        elif kind == "books":
            a.on_floor("books", (0.23, 0.29, a.draw(0.03, 0.25)))
        elif kind == "toy blocks":
            a.on_floor("toy blocks", (a.draw(0.35, 0.6), a.draw(0.35, 0.6), 0.08), edge_m=1.0)
        else:
            w = a.draw(0.12, 0.24)
            a.on_floor("toy ball", (w, w, w), edge_m=1.0)


def rug_under(a: Arrangement, x: float, y: float, size: tuple[float, float], turn_rad: float, on: str) -> Item | None:
    """Lay a rug with its middle at a place, on no carpet; smaller ones are tried where it does not fit."""
    if "carpet" in on:
        return None
    sizes = [(round(size[0] * scale, 3), round(size[1] * scale, 3)) for scale in (1.0, 0.85, 0.7)]
    return a.first(
        a.item("rug", (w, d, a.draw(0.008, 0.015)), (x, y, 0.0), turn_rad + float(a.rng.normal(0, 0.02)))
        for w, d in sizes
    )


def quarter(a: Arrangement) -> float:
    """Return one of the four turns that are square to the room's longest wall."""
    plan = a.plan
    (ax, ay), _ = plan.wall_axes(max(range(len(plan.polygon)), key=plan.wall_length_m))
    return math.atan2(ay, ax) + math.pi / 2 * int(a.rng.integers(4))

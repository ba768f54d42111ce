"""Furnish a room as people do: what its use needs, against walls and round tables, then what gathers in time."""

import math
from collections.abc import Callable
from dataclasses import replace

import numpy as np
from shapely.geometry import Polygon

from mocks.rooms.furnish import clutter, day_rooms
from mocks.rooms.furnish.check import check_items, hides_board, sees_window
from mocks.rooms.furnish.space import Arrangement, beside, towards
from mocks.rooms.model import USES, Finish, Item, Plan, Role, Use

# Bedrooms: the bed with its head to a wall, what stands beside it, and where the clothes are.

DOUBLE_M = (1.88, 1.68, 1.48)
SINGLE_M = (1.28, 0.98)
BED_TOP_M = 0.562  # where things lie on a duvet


def bedroom_essentials(a: Arrangement, finish: Finish) -> bool:
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


def bedroom_extras(a: Arrangement, finish: Finish) -> None:
    """Place what else a bedroom may hold."""
    bed = next(item for item in a.items if item.kind == "bed")
    if a.chance(0.85):
        clutter.picture_over(a, bed)
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
    clutter.plants(a, 2)
    clutter.wall_things(a, int(a.rng.integers(0, 3)))
    clutter.on_the_floor(a, toys=bed.size_m[0] < 1.3)


def _bed(a: Arrangement) -> Item | None:
    """Place the largest bed that fits, its head to a wall, room beside it."""
    for width in [w for w in (DOUBLE_M + SINGLE_M) if a.chance(0.7)] + [SINGLE_M[-1]]:
        bed = a.against_wall("bed", (width, a.draw(2.08, 2.16), a.draw(0.88, 1.15)), lambda item: _calm(a, item))
        if bed:
            a.keep_free(bed, 0.35)
            return bed
    # A single bed with its long side to a wall, as in small rooms
    size = (0.94, 2.06, 0.9)
    model = a.item("bed", size, (0.0, 0.0, 0.0))
    places = a.wall_places((size[1], size[0], size[2]), tries=24)
    return a.first(
        replace(model, position_m=(*place, 0.0), turn_rad=turn + (math.pi / 2 if a.chance(0.5) else -math.pi / 2))
        for place, turn in places
    )


def _calm(a: Arrangement, bed: Item) -> float:
    """Return how good a place for a bed is: free on both sides, its foot towards the room, away from doors."""
    free = sum(a.fits(_beside_bed(a, bed, side, (0.42, 0.38, 0.48))) for side in (-1, 1))
    doors = [a.plan.on_wall(d.wall, d.start_m + d.width_m / 2) for d in a.plan.doors]
    away = min((math.dist(bed.position_m[:2], door) for door in doors), default=3.0)
    return free + 0.4 * min(away, 3.0) + 0.3 * towards(bed, (0.0, 0.0))


def _beside_bed(a: Arrangement, bed: Item, side: int, size: tuple[float, float, float]) -> Item:
    x, y = beside(bed, side * (bed.size_m[0] / 2 + size[0] / 2 + 0.05), bed.size_m[1] / 2 - size[1] / 2)
    return a.item("nightstand", size, (x, y, 0.0), bed.turn_rad)


def _rug(a: Arrangement, bed: Item, finish: Finish) -> None:
    if not a.chance(0.65):
        return
    if a.chance(0.7):
        x, y = beside(bed, 0.0, -0.55)
        size = (bed.size_m[0] + a.draw(0.7, 1.2), a.draw(1.5, 2.1))
        if clutter.rug_under(a, x, y, size, bed.turn_rad, finish.floor.name):
            return
    for side in (-1, 1):
        size = (a.draw(0.6, 0.8), a.draw(1.2, 1.6))
        x, y = beside(bed, side * (bed.size_m[0] / 2 + 0.08 + size[0] / 2), a.draw(-0.3, 0.0))
        if clutter.rug_under(a, x, y, size, bed.turn_rad, finish.floor.name):
            return


def _on_chest(a: Arrangement, chest: Item) -> None:
    if a.chance(0.3) and chest.size_m[0] > 0.95:
        w = a.draw(0.75, 0.9)
        a.put_on(chest, "television", (w, 0.2, round(0.6 * w + 0.06, 3)), at=(0.0, 0.2), turn_rad=0.0)
    elif a.chance(0.5):
        clutter.picture_over(a, chest)
    if a.chance(0.4):
        a.put_on(chest, "table lamp", (0.26, 0.26, 0.45), at=(0.8, 0.3))
    clutter.things_on(a, chest, 5)


# Fill large rooms as people do: a second place to eat or work, more along the walls, pictures where they are bare.

PLAIN_M2 = 11.0  # rooms up to this size have enough without
PIECE_M2 = 5.0  # about one more piece for each of these
PICTURE_M = 6.0  # of the room's perimeter for one picture more


def fill(a: Arrangement, finish: Finish) -> None:
    """Place more in a large room; some people leave theirs as it is."""
    floor = Polygon(a.plan.polygon)
    spare_m2 = floor.area - PLAIN_M2
    # Place a table to eat at in a large living room, a desk in others
    if a.plan.use is Use.LIVING and floor.area > 19.0 and a.chance(0.65):
        # Not where people look from the sofa; a living room that could only be a study has none.
        for sofa in [item for item in a.items if item.kind == "sofa"]:
            a.keep_free(sofa, 1.7, 0.3)
        if day_rooms.dining_essentials(a, finish):
            clutter.things_on(a, next(item for item in a.items if item.kind == "dining table"), 4)
    elif a.plan.use is Use.BEDROOM and floor.area > 13.0 and a.chance(0.45):
        day_rooms.workplace(a, finish)
    for _ in range(int(a.rng.poisson(max(spare_m2, 0.0) / PIECE_M2 * a.draw(0.4, 1.4)))):
        _piece(a, str(a.rng.choice(USES[a.plan.use]["pieces"])))
    clutter.wall_things(a, int(a.rng.binomial(max(int(floor.length / PICTURE_M), 1), 0.7)))


def _piece(a: Arrangement, kind: str) -> None:
    """Stand one more piece against a wall, with what goes with it."""
    placed = _stood(a, kind)
    if placed is None:
        return
    if kind in ("cabinet", "chest of drawers"):
        clutter.things_on(a, placed, 5)
        clutter.picture_over(a, placed)
    elif kind == "armchair" and a.chance(0.6):
        clutter.lamp_by(a, placed)


def _stood(a: Arrangement, kind: str) -> Item | None:
    if kind == "plant":
        h = a.draw(0.9, 1.7)
        w = round(min(0.75, 0.5 * h + 0.05), 3)
        return a.against_wall(kind, (w, w, h), role=Role.CLUTTER)
    size = {
        "bookcase": (a.draw(0.7, 1.6), a.draw(0.28, 0.36), a.draw(1.2, 2.1)),
        "cabinet": (a.draw(1.0, 1.9), a.draw(0.4, 0.46), a.draw(0.7, 0.95)),
        "chest of drawers": (a.draw(0.75, 1.2), a.draw(0.42, 0.5), a.draw(0.72, 1.0)),
        "wardrobe": (a.draw(1.0, 2.0), 0.6, round(min(a.draw(1.9, 2.2), a.plan.height_m - 0.08), 3)),
        "armchair": (a.draw(0.72, 0.85), a.draw(0.78, 0.86), a.draw(0.76, 0.86)),
        "chair": (0.45, 0.53, a.draw(0.8, 0.88)),
    }[kind]
    return a.against_wall(kind, size, front_m=0.0 if kind in ("armchair", "chair") else 0.4)


ATTEMPTS = 6  # chosen: then as a study
BOARD_TRIES = 60  # chosen: places tried for the board's stand
TRIPOD_M = (0.82, 0.82, 1.475)  # feet on a circle of 0.4 m; its head ends below the camera

Step = Callable[[Arrangement, Finish], object]
RECIPES: dict[Use, tuple[Step, Step]] = {
    Use.BEDROOM: (bedroom_essentials, bedroom_extras),
    Use.LIVING: (day_rooms.living_essentials, day_rooms.living_extras),
    Use.DINING: (day_rooms.dining_essentials, day_rooms.dining_extras),
    Use.OFFICE: (day_rooms.office_essentials, day_rooms.office_extras),
}


def furnish(plan: Plan, finish: Finish, rng: np.random.Generator) -> tuple[Item, ...]:
    """Return the items of a room, `check_items` finding nothing: always tripod and meter board (alone in empty rooms).

    A room too small for what it is meant for is furnished as a study.
    """
    for use in [plan.use] * ATTEMPTS + [Use.OFFICE] * 2 if plan.use in RECIPES else []:
        items = _furnished(plan, RECIPES[use], finish, rng)
        if items is not None:
            return items
    room = Arrangement(plan, rng)
    _stand_tripod(room)
    for _ in range(20):
        if _stand_board(room):
            break
    return tuple(room.items)


def _furnished(
    plan: Plan, recipe: tuple[Step, Step], finish: Finish, rng: np.random.Generator
) -> tuple[Item, ...] | None:
    """Return the items, or None if what the room is for or the meter board found no place."""
    essentials, extras = recipe
    room = Arrangement(plan, rng, messy=float(rng.beta(1.2, 1.8)))
    _stand_tripod(room)
    if not essentials(room, finish) or _stand_board(room) is None:
        return None
    extras(room, finish)
    fill(room, finish)
    items = tuple(room.items)
    return None if check_items(plan, items) else items


def _stand_tripod(room: Arrangement) -> None:
    room.add(room.item("tripod", TRIPOD_M, (0.0, 0.0, 0.0), room.draw(0.0, 2.1), (), Role.EQUIPMENT))


def _stand_board(room: Arrangement) -> Item | None:
    """Stand the meter board where the camera sees it, roughly facing the camera, rather not before a window."""
    found: list[Item] = []
    for _ in range(BOARD_TRIES):
        far, azimuth = room.draw(1.05, 1.95), room.draw(0.0, 2 * math.pi)
        x, y = far * math.sin(azimuth), far * math.cos(azimuth)
        turn = math.atan2(-x, y) + float(np.clip(room.rng.normal(0, 0.15), -0.5, 0.5))
        board = room.item("meter board", (0.5, 0.4, room.draw(1.2, 1.45)), (x, y, 0.0), turn, (), Role.EQUIPMENT)
        if not any(hides_board(board, item) for item in room.items) and room.fits(board):
            found.append(board)
            if not sees_window(room.plan, board):
                return room.add(board)
    return room.add(found[0]) if found else None

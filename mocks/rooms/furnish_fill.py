"""Fill large rooms as people do: a second place to eat or work, more along the walls, pictures where they are bare."""

from __future__ import annotations

from shapely.geometry import Polygon

from mocks.rooms import furnish_dining, furnish_office
from mocks.rooms.furnish_clutter import floor_lamp_by, picture_over, things_on, wall_things
from mocks.rooms.furnish_space import Arrangement
from mocks.rooms.model import Finish, Item, Role, Use

PLAIN_M2 = 11.0
"""Rooms up to this size have enough without."""
PIECE_M2 = 5.0
"""About one more piece for each of these."""
PICTURE_M = 6.0
"""Of the room's perimeter for one picture more."""

PIECES: dict[Use, tuple[str, ...]] = {
    Use.LIVING: ("bookcase", "cabinet", "armchair", "chest of drawers", "plant", "bookcase"),
    Use.BEDROOM: ("chest of drawers", "wardrobe", "armchair", "bookcase", "plant", "chair"),
    Use.DINING: ("cabinet", "bookcase", "plant", "armchair", "cabinet"),
    Use.OFFICE: ("bookcase", "cabinet", "armchair", "plant", "bookcase", "chest of drawers"),
}


def fill(a: Arrangement, finish: Finish) -> None:
    """Place more in a large room; some people leave theirs as it is."""
    floor = Polygon(a.plan.polygon)
    spare_m2 = floor.area - PLAIN_M2
    _second_place(a, finish, floor.area)
    for _ in range(int(a.rng.poisson(max(spare_m2, 0.0) / PIECE_M2 * a.draw(0.4, 1.4)))):
        kind = str(a.rng.choice(PIECES[a.plan.use]))
        _piece(a, kind)
    wall_things(a, int(a.rng.binomial(max(int(floor.length / PICTURE_M), 1), 0.7)))


def _second_place(a: Arrangement, finish: Finish, area_m2: float) -> None:
    """Place a table to eat at in a large living room, a desk in others."""
    if a.plan.use is Use.LIVING and area_m2 > 19.0 and a.chance(0.65):
        # Not where people look from the sofa; a living room that could only be a study has none.
        for sofa in [item for item in a.items if item.kind == "sofa"]:
            a.keep_free(sofa, 1.7, 0.3)
        if furnish_dining.essentials(a, finish):
            things_on(a, next(item for item in a.items if item.kind == "dining table"), 4)
    elif a.plan.use is Use.BEDROOM and area_m2 > 13.0 and a.chance(0.45):
        furnish_office.workplace(a, finish)


def _piece(a: Arrangement, kind: str) -> None:
    """Stand one more piece against a wall, with what goes with it."""
    placed = _stood(a, kind)
    if placed is None:
        return
    if kind in ("cabinet", "chest of drawers"):
        things_on(a, placed, 5)
        picture_over(a, placed)
    elif kind == "armchair" and a.chance(0.6):
        floor_lamp_by(a, placed)


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

"""Furnish a room as people do: what its use needs, against walls and round tables, then what gathers in time."""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np

from mocks.rooms import furnish_bedroom, furnish_dining, furnish_living, furnish_office
from mocks.rooms.furnish_check import check_items, hides_board, sees_window
from mocks.rooms.furnish_fill import fill
from mocks.rooms.furnish_space import Arrangement
from mocks.rooms.model import Finish, Item, Plan, Role, Use

__all__ = ["check_items", "furnish"]

ATTEMPTS = 6
BOARD_TRIES = 60
TRIPOD_M = (0.82, 0.82, 1.475)
"""Feet on a circle of 0.4 m; its head ends below the camera."""

Step = Callable[[Arrangement, Finish], object]
RECIPES: dict[Use, tuple[Step, Step]] = {
    Use.BEDROOM: (furnish_bedroom.essentials, furnish_bedroom.extras),
    Use.LIVING: (furnish_living.essentials, furnish_living.extras),
    Use.DINING: (furnish_dining.essentials, furnish_dining.extras),
    Use.OFFICE: (furnish_office.essentials, furnish_office.extras),
}


def furnish(plan: Plan, finish: Finish, rng: np.random.Generator) -> tuple[Item, ...]:
    """Return the items of a room, `check_items` finding nothing: always tripod and meter board (alone in empty rooms).

    A room too small for what it is meant for is furnished as a study.
    """
    uses = [plan.use] * ATTEMPTS + [Use.OFFICE] * 2 if plan.use in RECIPES else []
    for use in uses:
        items = _furnished(plan, RECIPES[use], finish, rng)
        if items is not None:
            return items
    return _bare(plan, rng)


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


def _bare(plan: Plan, rng: np.random.Generator) -> tuple[Item, ...]:
    """Return the equipment alone."""
    room = Arrangement(plan, rng)
    _stand_tripod(room)
    for _ in range(20):
        if _stand_board(room):
            break
    return tuple(room.items)


def _stand_tripod(room: Arrangement) -> None:
    room.add(room.item("tripod", TRIPOD_M, (0.0, 0.0, 0.0), room.draw(0.0, 2.1), (), Role.EQUIPMENT))


def _stand_board(room: Arrangement) -> Item | None:
    """Stand the meter board where the camera sees it, roughly facing the camera, rather not before a window."""
    found: list[Item] = []
    for _ in range(BOARD_TRIES):
        far, azimuth = room.draw(1.05, 1.95), room.draw(0.0, 2 * math.pi)
        x, y = far * math.sin(azimuth), far * math.cos(azimuth)
        turn = math.atan2(-x, y) + float(np.clip(room.rng.normal(0, 0.15), -0.5, 0.5))
        size = (0.5, 0.4, room.draw(1.2, 1.45))
        board = room.item("meter board", size, (x, y, 0.0), turn, (), Role.EQUIPMENT)
        if _in_sight(room, board) and room.fits(board):
            found.append(board)
            if not sees_window(room.plan, board):
                return room.add(board)
    return room.add(found[0]) if found else None


def _in_sight(room: Arrangement, board: Item) -> bool:
    return not any(hides_board(board, item) for item in room.items)

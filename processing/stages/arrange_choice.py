"""Which furniture a room gets when nobody says: by its name, else by what fits its floor."""

from __future__ import annotations

import re
from dataclasses import dataclass

from processing.errors import RoomTooSmallError
from processing.layout.arrange import arrange
from processing.layout.item_list import set_items
from processing.layout.plan import FloorPlan
from processing.room.model import Opening, OpeningKind, RoomModel

NAMES: dict[str, tuple[str, ...]] = {
    "bedroom": ("bed", "bedroom", "bedrm", "master", "guest", "nursery", "kids"),
    "living": ("living", "livingroom", "lounge", "sitting", "family", "parlor", "parlour", "den"),
    "dining": ("dining", "diningroom", "dinner", "breakfast"),
    "office": ("office", "study", "work", "workroom"),
}
"""Words in a session's name that tell what its room is for."""
LIVING_FROM_M2 = 16.0
"""Of floor from which a room that holds both is more often lived in than slept in."""
DOOR_M = 0.9
FROM_CORNER_M = 0.15


@dataclass(frozen=True)
class Choice:
    """A set of furniture, and why."""

    name: str
    why: str


def named_choice(session_name: str) -> Choice | None:
    """Return the set that a session's name tells, None where it tells none."""
    words = [w for w in re.split(r"[^a-z]+", session_name.lower()) if w]
    for name, known in NAMES.items():
        told = next((w for w in words if w in known), None)
        if told:
            return Choice(name, f"the session's name says '{told}'")
    return None


def fitting_choice(plan: FloorPlan, rules: str, seed: int) -> Choice:
    """Return the set of which the room holds most; of those alike the one that rooms of its size are usually for."""
    order = ("living", "bedroom", "dining", "office")
    if plan.area_m2 < LIVING_FROM_M2:
        order = ("bedroom", "office", "dining", "living")
    found: list[tuple[float, int, str, str]] = []
    for place, name in enumerate(order):
        items = set_items(name)
        try:
            made = arrange(plan, items, rules, n=1, seed=seed).arrangements
        except RoomTooSmallError:
            continue
        held = len(made[0].items) if made else 0
        found.append((-held / len(items), place, name, f"{held} of {len(items)} pieces fit"))
        if held == len(items):
            break
    if not found:
        return Choice(order[0], f"the session's name tells no use, and no set fits {plan.area_m2:.1f} m2")
    _, _, name, held_text = min(found)
    return Choice(name, f"the session's name tells no use; {plan.area_m2:.1f} m2 of floor, {held_text}")


def with_door(room: RoomModel) -> tuple[RoomModel, str]:
    """Return the room with a doorway where it has none, and what was assumed: people have to get in.

    It is put beside a corner of the longest wall without windows, or of the longest wall.
    """
    if any(o.kind is not OpeningKind.WINDOW for o in room.openings):
        return room, ""
    windows = {o.wall for o in room.openings}
    walls = range(len(room.floor))
    wall = max(walls, key=lambda k: (k not in windows, room.wall_length_m(k), -k))
    length_m = room.wall_length_m(wall)
    end_m = min(length_m, FROM_CORNER_M + DOOR_M)
    taken = [o for o in room.openings if o.wall == wall]
    if any(o.start_m < end_m for o in taken):
        return room, ""
    door = Opening(
        kind=OpeningKind.PASSAGE,
        wall=wall,
        start_m=max(0.0, end_m - DOOR_M),
        end_m=end_m,
        sill_m=0.0,
        head_m=min(2.0, room.ceiling_height_m),
        confidence=0.0,
    )
    text = f"no door was told in this room: one is assumed at the start of wall {wall} (daylit room --edit corrects it)"
    return room.model_copy(update={"openings": (*room.openings, door)}), text

"""What a session means for arrangements: assumed furniture and doors; a given arrangement held against the room."""

from __future__ import annotations

import re
from dataclasses import dataclass, replace

import numpy as np
import shapely

from processing.errors import LayoutError, RoomTooSmallError
from processing.ground.room_model import Opening, OpeningKind, RoomModel
from processing.layout.arrange import arrange
from processing.layout.arrangement import Arrangement
from processing.layout.items import KINDS, set_items
from processing.layout.plan import FloorPlan
from processing.layout.rules import built_in_rules
from processing.layout.verify import Judge, Piece


def broken_rules(arrangement: Arrangement, plan: FloorPlan) -> str:
    """Return the hard rules of its rule set that an arrangement breaks in a room, with the pieces; empty: none.

    Raises `LayoutError` where furniture stands outside of the room, or is of a kind that does not exist: it was made
    for another room.
    """
    known = built_in_rules()
    rules = known.named(arrangement.rule_set if arrangement.rule_set in known.sets else "standard")
    where = f"--arrangement, alternative {arrangement.rank}"
    unknown = sorted({item.category for item in arrangement.items} - set(KINDS))
    if unknown:
        raise LayoutError(
            f"no such furniture: {', '.join(unknown)}", where=where, advice="`daylit furniture` lists the kinds"
        )
    places = np.array([item.t_m[:2] for item in arrangement.items], np.float64).reshape(-1, 2)
    within = shapely.contains_xy(shapely.Polygon(plan.corners), places[:, 0], places[:, 1])
    outside = [item.id for item, fits in zip(arrangement.items, within, strict=True) if not fits]
    if outside:
        raise LayoutError(
            f"{', '.join(outside)} would stand outside of the room",
            where=where,
            likely="it was made for another room, or the room has another origin (below the camera)",
            advice="make it for this one: daylit arrange SESSION --keep-camera",
        )
    pieces = [
        Piece(i.id, replace(KINDS[i.category], size_m=i.size_m, base_m=i.base_m), *i.t_m[:2], i.theta_rad, i.group)
        for i in arrangement.items
    ]
    return "; ".join(map(str, Judge(plan, rules).judge(pieces).violations))


NAMES: dict[str, tuple[str, ...]] = {
    "bedroom": ("bed", "bedroom", "bedrm", "master", "guest", "nursery", "kids"),
    "living": ("living", "livingroom", "lounge", "sitting", "family", "parlor", "parlour", "den"),
    "dining": ("dining", "diningroom", "dinner", "breakfast"),
    "office": ("office", "study", "work", "workroom"),
}
"""Words in a session's name that say what its room is for."""
LIVING_FROM_M2 = 16.0
"""Floor area from which a room that holds both sets is taken for a living room (chosen: bedrooms are smaller)."""
DOOR_M, FROM_CORNER_M = 0.9, 0.15
"""Of the assumed doorway: width, and distance of its frame from the corner (chosen: common in housing)."""


@dataclass(frozen=True)
class Choice:
    """A set of furniture, and why."""

    name: str
    why: str


def named_choice(session_name: str) -> Choice | None:
    """Return the set of furniture that a session's name suggests, None where it suggests none."""
    words = [w for w in re.split(r"[^a-z]+", session_name.lower()) if w]
    for name, known in NAMES.items():
        word = next((w for w in words if w in known), None)
        if word:
            return Choice(name, f"the session's name says '{word}'")
    return None


def fitting_choice(plan: FloorPlan, rules: str, seed: int) -> Choice:
    """Return the set of which most pieces fit; of equals the one that rooms of this size are usually for."""
    order = ("living", "bedroom", "dining", "office")
    if plan.area_m2 < LIVING_FROM_M2:
        order = ("bedroom", "office", "dining", "living")
    fits: list[tuple[float, int, str, str]] = []
    for place, name in enumerate(order):
        items = set_items(name)
        try:
            made = arrange(plan, items, rules, n=1, seed=seed).arrangements
        except RoomTooSmallError:
            continue
        held = len(made[0].items) if made else 0
        fits.append((-held / len(items), place, name, f"{held} of {len(items)} pieces fit"))
        if held == len(items):
            break
    if not fits:
        return Choice(order[0], f"the session's name suggests no use, and no set fits {plan.area_m2:.1f} m2")
    _, _, name, held_text = min(fits)
    return Choice(name, f"the session's name suggests no use; {plan.area_m2:.1f} m2 of floor, {held_text}")


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
    text = (
        f"no door was found in this room: one is assumed at the start of wall {wall} (correct it: daylit room --edit)"
    )
    return room.model_copy(update={"openings": (*room.openings, door)}), text

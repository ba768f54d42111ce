"""The stage arrange: where furniture stands, in several ways (paper, section 5)."""

from __future__ import annotations

import re
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from processing.errors import LayoutError, NoDoorError, RoomTooSmallError
from processing.ground.room_model import Opening, OpeningKind, RoomModel
from processing.layout.arrange import arrange
from processing.layout.arrangement import Arrangements
from processing.layout.drawn.drawing import write_drawings
from processing.layout.items import KINDS, Item, parse_items, set_items, set_list
from processing.layout.models.catalogue import Catalogue
from processing.layout.plan import FloorPlan, from_room_model
from processing.layout.rules import built_in_rules
from processing.stages.contract import StageContext, StageOutput, StageWarning
from processing.stages.parameters import MOST_STAGED, NO_SUCH, ArrangeParameters
from processing.stages.upright import known_room

# Which furniture a room gets when nobody says: by its name, else by what fits its floor.


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


def nothing_to_arrange(context: StageContext) -> str | None:
    """Return why there is nothing to do: no furniture asked, no room, no door."""
    asked = context.parameters
    assert isinstance(asked, ArrangeParameters)
    if not asked.wanted:
        return "no furniture asked"
    if context.optional_artifact("room", "room") is None:
        return "the stage room told no room; give one (--room)"
    return None


def run(context: StageContext) -> StageOutput:
    """Arrange what is asked."""
    asked = context.parameters
    assert isinstance(asked, ArrangeParameters)
    room = known_room(context)
    room, assumed = with_door(room)
    # The camera's place stays free: furniture around it would hide the room from the picture.
    plan = from_room_model(room, name=context.session.name or "room", keep_camera_free=True)
    choice = _choice(asked, context.session.name, plan)
    context.progress(0.3, choice.name)
    items = _items(asked, choice)
    try:
        found = arrange(plan, items, asked.rules, n=asked.alternatives, seed=asked.seed)
    except (NoDoorError, RoomTooSmallError) as error:
        return _nothing(error, choice)
    context.progress(0.8, "drawing")
    drawn = _draw(found, context.folder)
    return _output(found, choice, drawn, assumed)


def _choice(asked: ArrangeParameters, session_name: str, plan: FloorPlan) -> Choice:
    if asked.items is not None:
        return Choice("items", "given by you")
    if asked.set != "auto":
        return Choice(asked.set, "asked for")
    return named_choice(session_name) or fitting_choice(plan, asked.rules, asked.seed)


def _items(asked: ArrangeParameters, choice: Choice) -> list[Item]:
    """Return the items; with a folder of furniture, in the sizes of its models (kinds that it lacks are built in)."""
    kinds = KINDS if asked.furniture is None else {**KINDS, **Catalogue.at(asked.furniture).kinds(asked.seed)}
    return parse_items(asked.items if asked.items is not None else set_list(choice.name), kinds)


def _nothing(error: LayoutError, choice: Choice) -> StageOutput:
    """Tell that nothing can be arranged: no failure of the session, its other results stand."""
    reason = f"{error.code}: {str(error).split(' | ')[0]}"[:480]
    names = ("arrangement", "contact-sheet", *(f"plan-{k}" for k in range(1, MOST_STAGED + 1)))
    return StageOutput(
        metrics={"set": choice.name, "why": choice.why, "alternatives": 0},
        warnings=(StageWarning(code="arrange", message=f"nothing is arranged: {reason}"),),
        left_out=dict.fromkeys(names, reason),
    )


def _draw(found: Arrangements, folder: Path) -> set[str]:
    """Write the plans under the names of the row; return which artifacts there are."""
    drawn = set()
    for path in write_drawings(found, folder, built_in_rules().sets.get(found.rule_set)):
        if path.suffix == ".svg":
            name = path.name.replace("layout-", "plan-")
            path.rename(folder / name)
            drawn.add(name.removesuffix(".svg"))
        elif path.name == "contact-sheet.png":
            drawn.add("contact-sheet")
        else:
            path.unlink()
    return drawn


def _output(found: Arrangements, choice: Choice, drawn: set[str], assumed: str) -> StageOutput:
    first = found.arrangements[0] if found.arrangements else None
    every = {"contact-sheet", *(f"plan-{k}" for k in range(1, MOST_STAGED + 1))}
    refused = () if first is None else first.not_placed
    texts = [assumed] if assumed else []
    texts += [*found.notes, *(f"{one.id} is not placed: {one.reason}" for one in refused)]
    metrics: dict[str, Any] = {
        "set": choice.name,
        "why": choice.why,
        "asked": list(found.asked),
        "alternatives": len(found.arrangements),
        "scores": [round(one.score, 4) for one in found.arrangements],
        "placed": [len(one.items) for one in found.arrangements],
        "not_placed": {one.id: one.reason for one in refused},
    }
    return StageOutput(
        artifacts={"arrangement": found} | dict.fromkeys(sorted(drawn), True),
        metrics=metrics,
        warnings=tuple(StageWarning(code="arrange", message=text[:500]) for text in texts),
        left_out=dict.fromkeys(sorted(every - drawn), NO_SUCH),
    )

"""The stage arrange: where furniture stands, in several ways (paper, section 5)."""

from collections.abc import Sequence
from contextlib import suppress
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from processing.errors import LayoutError, NoDoorError, PlanError, RoomTooSmallError
from processing.ground.seam import resized
from processing.layout.arrange import arrange
from processing.layout.arrangement import Arrangements
from processing.layout.assumed import Choice, broken_rules, fitting_choice, hung_things, named_choice, open_doors
from processing.layout.assumed import session_plan as plan_of
from processing.layout.drawn.drawing import write_drawings
from processing.layout.given_places import parse_pins
from processing.layout.items import KINDS, Item, ItemSpec, number_items, parse_items, set_list
from processing.layout.models.catalogue import Catalogue
from processing.layout.plan import FloorPlan, Hung
from processing.layout.rules import built_in_rules
from processing.segmentation.evidence import SceneClass, read_evidence
from processing.stages.contract import StageContext, StageOutput, StageWarning
from processing.stages.parameters import MOST_STAGED, NO_SUCH, ArrangeParameters
from processing.stages.upright import known_room, why_unfit


def judged(given: Arrangements, context: StageContext) -> tuple[StageWarning, ...]:
    """Return a warning for each alternative that the user gives and that breaks hard rules in this room.

    The user may want it so; what stands in a wall is still shown as it is. Without a room nothing can be checked.
    Raises `LayoutError` for an arrangement of another room.
    """
    if context.optional_artifact("room", "room") is None:
        return ()
    plan, _ = plan_of(known_room(context))
    broken = {one.rank: broken_rules(one, plan) for one in given.arrangements}
    texts = (f"alternative {rank} breaks rules in this room: {rules}" for rank, rules in broken.items() if rules)
    return tuple(StageWarning(code="arrangement", message=text[:500]) for text in texts)


def nothing_to_arrange(context: StageContext) -> str | None:
    """Return why there is nothing to do: no furniture asked, no room, no door."""
    asked = context.parameters_of(ArrangeParameters)
    return why_unfit(context, asked=asked.doubtful_room) if asked.wanted else "no furniture requested"


def run(context: StageContext) -> StageOutput:
    """Arrange what is asked."""
    asked = context.parameters_of(ArrangeParameters)
    hung = _hung(context)
    try:
        plan, assumed = plan_of(known_room(context), hung, context.session.name or "room")
    except PlanError as error:  # it can stand, and is no room to live in: one lower than furniture
        return _nothing(error, Choice(asked.set, "the room has no plan"))
    choice = _choice(asked, context.session.name, plan)
    context.progress(0.3, choice.name)
    items = _items(asked, choice)
    try:
        found = _arranged(plan, items, asked)
    except (NoDoorError, RoomTooSmallError) as error:
        return _nothing(error, choice)
    context.progress(0.8, "drawing")
    made = _output(found, choice, _draw(found, context.folder), assumed)
    seen: list[Any] = [f"{thing.name} on wall {thing.edge + 1}, {thing.width_m:.1f} m wide" for thing in hung]
    return replace(made, metrics={**made.metrics, "kept_in_sight": seen})


def _hung(context: StageContext) -> tuple[Hung, ...]:
    """Return what hangs on the walls, where the room stage's networks saw it."""
    kept = context.optional_artifact("room", "evidence")
    if kept is None:
        return ()
    # Doors that only the pixels show are no openings of the room: nothing is put before them all the same.
    evidence, removed = read_evidence(kept), context.optional_artifact("detect", "target")
    fixtures, doors = evidence.share(SceneClass.FIXTURE), evidence.share(SceneClass.DOOR)
    if removed is not None:
        open_ones = open_doors(known_room(context), evidence, removed).astype(np.float32)
        doors = np.maximum(doors, resized(open_ones, doors.shape))
    return hung_things(known_room(context), fixtures, doors)


def _choice(asked: ArrangeParameters, session_name: str, plan: FloorPlan) -> Choice:
    if asked.items is not None:
        return Choice("items", "given by you")
    if asked.set != "auto":
        return Choice(asked.set, "asked for")
    return named_choice(session_name) or fitting_choice(plan, asked.rules, asked.seed)


def _items(asked: ArrangeParameters, choice: Choice) -> list[Item]:
    """Return the items; with a folder of furniture, in the sizes of its models (kinds that it lacks are built in)."""
    return parse_items(asked.items if asked.items is not None else set_list(choice.name), _kinds(asked))


def _kinds(asked: ArrangeParameters) -> dict[str, ItemSpec]:
    return KINDS if asked.furniture is None else {**KINDS, **Catalogue.at(asked.furniture).kinds(asked.seed)}


SMALLER_BEDS = (("single bed", ""), ("bed", "tight"), ("single bed", "tight"))
"""What is tried, in this order, before a bedroom is left without a bed: a smaller one, then tighter rules (chosen)."""


def _arranged(plan: FloorPlan, items: Sequence[Item], asked: ArrangeParameters) -> Arrangements:
    """Return the arrangements, or others with a smaller bed or by tighter rules, where a set's bed has no place.

    Where no bed has one, what else the set has stands by itself. Raises `RoomTooSmallError` as `arrange` does, where
    nothing of a set can stand, or something that is asked for by name cannot."""
    made = partial(arrange, plan, n=asked.alternatives, seed=asked.seed, pins=parse_pins(asked.pin))
    found, refused = list[Arrangements](), list[RoomTooSmallError]()
    try:
        found.append(made(items, asked.rules))
    except RoomTooSmallError as error:
        refused.append(error)
    of_a_set = asked.items is None and not asked.pin and any(item.spec.category == "bed" for item in items)
    kinds = _kinds(asked)
    for bed, rules in SMALLER_BEDS if of_a_set and not any(map(_beds, found)) else ():
        specs = [kinds[bed] if item.spec.category == "bed" else item.spec for item in items]
        with suppress(RoomTooSmallError):
            other = made(number_items(specs), rules or asked.rules)
            if _beds(other):
                said = f"the bed does not fit: {bed} used instead" + (f", by the rules '{rules}'" if rules else "")
                return other.model_copy(update={"notes": (said, *other.notes)})
            found += [other] if other.arrangements and other.arrangements[0].items else []
    if not found:
        raise refused[0]
    return found[0]


def _beds(found: Arrangements) -> bool:
    return any("bed" in item.category for one in found.arrangements[:1] for item in one.items)


def _nothing(error: LayoutError, choice: Choice) -> StageOutput:
    """Report that nothing can be arranged: the session has not failed, its other results stand."""
    reason = f"{error.code}: {str(error).split(' | ')[0]}"[:480]
    names = ("arrangement", "contact-sheet", *(f"plan-{k}" for k in range(1, MOST_STAGED + 1)))
    return StageOutput(
        metrics={"set": choice.name, "why": choice.why, "alternatives": 0},
        warnings=(StageWarning(code="arrange", message=f"no furniture arranged: {reason}"),),
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
    texts += [*found.notes, *(f"{one.id} was not placed: {one.reason}" for one in refused)]
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

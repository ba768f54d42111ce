"""An arrangement that the user gives, held against the session's room by the judge of `processing.layout.verify`."""

from __future__ import annotations

import json
from dataclasses import replace

import numpy as np

from processing.errors import LayoutError
from processing.layout.arrangement import Arrangement, Arrangements
from processing.layout.items import KINDS
from processing.layout.plan import FloorPlan, from_room_model
from processing.layout.rules import RuleSet, built_in_rules
from processing.layout.verify import Judge, Piece
from processing.light.scene.patches import inside
from processing.stages.arrange import with_door
from processing.stages.contract import StageContext, StageWarning
from processing.stages.upright import known_room


def judged(value: object, context: StageContext) -> tuple[StageWarning, ...]:
    """Return a warning for each alternative that breaks hard rules in this room, naming rule and pieces.

    The user may want it so; what stands in a wall is still shown as it is. Without a room nothing can be told.

    Raises
    ------
    LayoutError
        Furniture stands outside of the room, or is of a kind that does not exist: it was made for another room.
    """
    if context.optional_artifact("room", "room") is None:
        return ()
    found = Arrangements.model_validate_json(json.dumps(value))
    room, _ = with_door(known_room(context))
    plan = from_room_model(room, name="room", keep_camera_free=True)
    every = [_broken(one, plan, _rules(one.rule_set)) for one in found.arrangements]
    return tuple(
        StageWarning(code="arrangement", message=f"alternative {one.rank} breaks rules in this room: {told}"[:500])
        for one, told in zip(found.arrangements, every, strict=True)
        if told
    )


def _rules(name: str) -> RuleSet:
    known = built_in_rules()
    return known.named(name if name in known.sets else "standard")


def _broken(one: Arrangement, plan: FloorPlan, rules: RuleSet) -> str:
    where = f"--arrangement, alternative {one.rank}"
    unknown = sorted({item.category for item in one.items} - set(KINDS))
    if unknown:
        raise LayoutError(
            f"no such furniture: {', '.join(unknown)}", where=where, advice="`daylit furniture` lists the kinds"
        )
    places = np.array([item.t_m[:2] for item in one.items], np.float64).reshape(-1, 2)
    within = inside(np.asarray(plan.corners, np.float64), places)
    outside = [item.id for item, fits in zip(one.items, within, strict=True) if not fits]
    if outside:
        raise LayoutError(
            f"{', '.join(outside)} would stand outside of the room",
            where=where,
            likely="it was made for another room, or the room has another origin (below the camera)",
            advice="make it for this one: daylit arrange SESSION --keep-camera",
        )
    pieces = [
        Piece(i.id, replace(KINDS[i.category], size_m=i.size_m, base_m=i.base_m), *i.t_m[:2], i.theta_rad, i.group)
        for i in one.items
    ]
    return "; ".join(map(str, Judge(plan, rules).judge(pieces).violations))

"""An arrangement made elsewhere, held against the room that it is to stand in by the judge of `verify`."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import shapely

from processing.errors import LayoutError
from processing.layout.arrangement import Arrangement
from processing.layout.items import KINDS
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

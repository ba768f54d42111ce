"""What an arrangement leaves out is tried once more beside what stands, place by place, by the judge itself.

The search keeps paths open on a grid that proves them, so that it passes by places that leave a path open by less than
the grid can show. Only arrangements that leave something out come here: at most some hundred looks of the judge.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np

from processing.layout.items import Item
from processing.layout.solver.field import Row, outlines
from processing.layout.solver.grouping import LAST_SPLIT, Packing, alone, host_role, packings
from processing.layout.solver.poses import Stand, anchor, stands
from processing.layout.solver.refusals import outline_rows
from processing.layout.solver.search import Effort, Search
from processing.layout.solver.units import Unit

_EVERY_PLACE = Effort(96, 96, 4, 1200, tuple(np.linspace(0.0, 1.0, 13).tolist()), 0.0)


def with_last_places(
    placed: Sequence[Stand], left: Sequence[Item], bare: Search, passes: Callable[[Sequence[Stand]], bool]
) -> list[Stand]:
    """Return the pieces placed, with those of `left` for which there is a place that the judge passes.

    Parameters
    ----------
    placed
        What stands, pinned pieces too, in the frame of the search's field.
    left
        What was left out; what is worth most is tried first.
    bare
        A search in the room without any piece.
    passes
        Whether the judge passes all these pieces together.
    """
    all_placed = list(placed)
    *_, last = packings(left, bare.field.rules)
    for unit in sorted(last.units, key=lambda one: one.loss, reverse=True):
        for stood in _places(unit, all_placed, bare):
            if passes([*all_placed, *stood]):
                all_placed += stood
                break
    return all_placed


def _places(unit: Unit, placed: Sequence[Stand], bare: Search) -> list[list[Stand]]:
    """Return where a unit could stand beside the others, paths aside, the best first."""
    item, hosts = unit.items[0], [stand.item.spec.category for stand in placed]
    if len(unit.items) == 1:
        if item.spec.placement == "on" or (item.spec.bound and not host_role(item, hosts)):
            return []
        unit = alone(item, bare.field.rules, LAST_SPLIT, hosts)
    fixed = bare.field.fixed
    heights = fixed.heights_m.tolist()
    rows: list[Row] = [
        (corners, low, high, int(kind), name)
        for corners, (low, high), kind, name in zip(fixed.corners, heights, fixed.classes, fixed.names, strict=True)
    ]
    rows += [row for stand in placed for row in outline_rows(stand)]
    field, packing = replace(bare.field, fixed=outlines(rows)), Packing((unit,), 0)
    found = Search(field, (), [anchor(stand) for stand in placed], bare).run(packing, _EVERY_PLACE, 0)
    return [stands(one, packing) for one in found if not one.dropped]

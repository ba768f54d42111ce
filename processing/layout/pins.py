"""Pieces that stand already: checked, with what belongs on top of them."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import replace

from shapely.geometry import Polygon

from processing.errors import PinError
from processing.layout.items import Item
from processing.layout.plan import FloorPlan
from processing.layout.rules import RuleSet
from processing.layout.solver.poses import Pose, Stand
from processing.layout.solver.units import Rect, zone_choices

TOUCH_M2 = 1e-5
"""Smaller overlaps of use zones with walls and pieces are contact."""


def parse_pin(text: str) -> tuple[str, Pose]:
    """Return (item id, pose) of ``"bed=1.2,0.5,90"`` (x, y in metres, degrees); raise `PinError` for other forms."""
    name, _, numbers = text.partition("=")
    try:
        x, y, degrees = (float(v) for v in numbers.split(","))
    except ValueError:
        raise PinError(f"'{text[:60]}' is not ITEM=X,Y,DEGREES") from None
    if not all(math.isfinite(v) for v in (x, y, degrees)):
        raise PinError(f"'{text[:60]}' has a number that is none")
    return name.strip().replace(" ", "-"), (x, y, math.radians(degrees))


def pinned_stands(
    items: Sequence[Item], pins: Mapping[str, Pose], plan: FloorPlan, rules: RuleSet
) -> tuple[list[Stand], list[Item]]:
    """Return the pinned pieces in the room's frame, with what stands on them, and the items that are free.

    Raises `PinError` for ids that are not among the items.
    """
    known = {item.id: item for item in items}
    unknown = [name for name in pins if name not in known]
    if unknown:
        raise PinError(f"'{unknown[0]}' is not among the items", advice=f"pin one of: {', '.join(known)}")
    stood = [_stand(known[name], pose) for name, pose in pins.items()]
    free = [item for item in items if item.id not in pins]
    for host in list(stood):
        on_top = next(
            (i for i in free if i.spec.placement == "on" and i.spec.group_with == host.item.spec.category), None
        )
        if on_top is not None:
            free.remove(on_top)
            raised = Item(on_top.id, replace(on_top.spec, base_m=host.item.spec.top_m))
            stood.append(replace(_stand(raised, (host.x_m, host.y_m, host.theta_rad)), group=host.item.id))
    room = Polygon(plan.corners, list(plan.holes))
    return [replace(s, zones=_zones(s, stood, room, rules)) for s in stood], free


def _stand(item: Item, pose: Pose) -> Stand:
    return Stand(item, round(pose[0], 6), round(pose[1], 6), round(pose[2], 9), item.id, None, (), pinned=True)


def _zones(stand: Stand, others: Sequence[Stand], room: Polygon, rules: RuleSet) -> tuple[Rect, ...]:
    """Return the first of the use zones' choices that walls and other pinned pieces leave free (else the last)."""
    choices = zone_choices(stand.item, rules)
    solid = [Polygon(o.corners()) for o in others if o.group != stand.group and not o.item.spec.is_rug]
    for zones in choices:
        shapes = [Polygon(stand.corners(zone)) for zone in zones]
        if all(
            s.difference(room).area < TOUCH_M2 and all(s.intersection(o).area < TOUCH_M2 for o in solid) for s in shapes
        ):
            return zones
    return choices[-1]

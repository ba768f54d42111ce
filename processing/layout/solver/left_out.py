"""What has no place: tried once more beside what stands, and else the rule, obstacle and missing width that stop it.

The search keeps paths open on a grid that proves them, so that it passes by places that leave a path open by less than
the grid can show; the judge looks at those again, place by place. For the reason each rule is taken away in turn, and
what lets the piece in is the reason: a fact about this room, not a guess. The lines searched are those of the solver:
every wall, and free lines along the walls' directions.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from processing.errors import RoomTooSmallError
from processing.layout.arrangement import NotPlaced
from processing.layout.items import Item
from processing.layout.solver.field import Field, more_outlines
from processing.layout.solver.free_sets import BODY, DOOR, KEPT, RUG, WINDOW, ZONE, Outlines
from processing.layout.solver.grouping import LAST_SPLIT, alone, host_role, packings
from processing.layout.solver.poses import Stand, anchor, outline_rows, stands
from processing.layout.solver.search import Search
from processing.layout.solver.units import Unit

HALVINGS = 7  # the missing width is found to 1/128 of the piece's
LEAST_WIDTH_M = 0.05  # chosen: narrower than any piece
_RULES = {
    "window": ("window free", "nothing taller than the sill stands in front of a window"),
    "door": ("door free", "doors and the floor in front of them stay clear"),
    "place": ("view kept free", "nothing tall stands right in front of the camera, and its position stays clear"),
    "zone": ("use zone free", "the floor needed to use it stays clear"),
}


@dataclass(frozen=True)
class _Look:
    """A room to look for a place in: what counts as an obstacle, and whether the piece's own zones do."""

    field: Field
    """The room without the placed pieces."""
    stands: tuple[Stand, ...]
    zones_of_others: bool = True
    own_zones: bool = True
    keeps_near: bool = True
    without: tuple[int, ...] = ()
    """Classes of fixed outlines that do not count."""

    def search(self) -> Search:
        """Return a search in this room."""
        corners, heights, classes = self.field.fixed
        keep = ~np.isin(classes, self.without)
        fixed = Outlines(corners[keep], heights[keep], classes[keep])
        rows = [row for stand in self.stands for row in outline_rows(stand, zones=self.zones_of_others)]
        field = replace(self.field, fixed=more_outlines(fixed, rows))
        return Search(field, stood=[anchor(stand) for stand in self.stands])

    def fits(self, item: Item) -> bool:
        """Return whether the piece has a place, paths aside."""
        bare = item if self.own_zones else Item(item.id, replace(item.spec, zones=(), sides_needed=None))
        hosts = [stand.item.spec.category for stand in self.stands] if self.keeps_near else []
        return self.search().has_place(alone(bare, self.field.rules, LAST_SPLIT, hosts))


def refuse_too_small(field: Field, items: Sequence[Item]) -> None:
    """Raise `RoomTooSmallError` where the largest piece has no place on the bare floor, whatever the rules."""
    largest = max(items, key=lambda item: item.spec.footprint_m2)
    bare = _Look(field, (), own_zones=False, without=(DOOR, WINDOW, KEPT, BODY, ZONE, RUG))
    if bare.fits(largest):
        return
    missing = _missing_m(bare, largest)
    size = f"{largest.spec.size_m[0]:.2f} x {largest.spec.size_m[1]:.2f} m"
    short = "" if missing is None else f"; {missing:.2f} m of width are missing"
    text = f"{largest.id} ({size}) fits nowhere on the bare floor of {field.floor.plan.area_m2:.1f} m2{short}"
    raise RoomTooSmallError(text, where=field.floor.plan.name, item=largest.id)


def not_placed(item: Item, placed: Sequence[Stand], field: Field) -> NotPlaced:
    """Return why a piece has no place beside those that are placed (both in the field's frame)."""
    whole, rules = _Look(field, tuple(placed)), field.rules
    hosts = [s for s in placed if host_role(item, [s.item.spec.category])]
    if whole.fits(item):
        return _reason(item, "path", "", None, f"every remaining place for it blocks a path of {rules.path:.2f} m")
    if hosts and replace(whole, keeps_near=False).fits(item):
        why = f"no place is left for it within {rules.together:.2f} m of {hosts[0].item.id}"
        return _reason(item, "kept together", hosts[0].item.id, None, why)
    room = replace(whole, stands=(), keeps_near=False)
    if not room.fits(item):
        return _stopped_by_room(item, room)
    lack_m = _missing_m(whole, item)
    for stand in sorted(placed, key=lambda s: s.item.spec.footprint_m2):
        if replace(whole, stands=tuple(s for s in placed if s is not stand)).fits(item):
            rule = "no overlap" if not replace(whole, zones_of_others=False).fits(item) else "use zone free"
            what = stand.item.id if rule == "no overlap" else f"the use zone of {stand.item.id}"
            return _reason(item, rule, stand.item.id, lack_m, f"{what} takes the last space wide enough")
    if replace(whole, own_zones=False).fits(item) or replace(whole, zones_of_others=False).fits(item):
        rule, why = _RULES["zone"]
        return _reason(item, rule, "several pieces", lack_m, f"{why}, and no gap between the pieces is wide enough")
    names = ", ".join(s.item.id for s in placed[:3])
    return _reason(item, "no overlap", names, lack_m, "no gap between the pieces is wide enough")


def host_lost(item: Item) -> NotPlaced:
    """Return that what a piece belongs to has no place itself."""
    host = item.spec.group_with
    return _reason(item, "kept together", host, None, f"the {host} it belongs to could not be placed")


def _stopped_by_room(item: Item, room: _Look) -> NotPlaced:
    """Return which rule of the empty room leaves no place."""
    missing = _missing_m(room, item)
    for name, kind in (("window", WINDOW), ("door", DOOR), ("place", KEPT)):
        if replace(room, without=(*room.without, kind)).fits(item):
            rule, why = _RULES[name]
            return _reason(item, rule, name, missing, f"{why}, and no wall is free for it even in the empty room")
    if replace(room, own_zones=False).fits(item):
        return _reason(item, "use zone free", "wall", missing, "the room is too narrow for the floor needed to use it")
    if replace(room, own_zones=False, without=(DOOR, WINDOW, KEPT)).fits(item):
        why = "doors, windows and the floor needed to use it leave no wall for it, even in the empty room"
        return _reason(item, "door free", "doors and windows", missing, why)
    return _reason(item, "inside the floor", "walls", missing, "it is too large for the floor")


def _reason(item: Item, rule: str, obstacle: str, missing_m: float | None, why: str) -> NotPlaced:
    short = f"; {missing_m:.2f} m of width are missing" if missing_m is not None else ""
    left_m = None if missing_m is None else round(missing_m, 3)
    reason = f"{why}{short}"
    return NotPlaced(
        id=item.id, category=item.spec.category, rule=rule, obstacle=obstacle, missing_m=left_m, reason=reason
    )


def _missing_m(look: _Look, item: Item) -> float | None:
    """Return by how much the piece is too wide (to 1/128 of its width); None where no narrower one fits either."""
    width_m, depth_m, height_m = item.spec.size_m

    def fits(narrow_m: float) -> bool:
        return look.fits(Item(item.id, replace(item.spec, size_m=(narrow_m, depth_m, height_m))))

    low, high = LEAST_WIDTH_M, width_m
    if not fits(low):
        return None
    for _ in range(HALVINGS):
        middle = (low + high) / 2
        low, high = (middle, high) if fits(middle) else (low, middle)
    return width_m - low


def with_last_places(
    placed: Sequence[Stand], left: Sequence[Item], bare: Field, passes: Callable[[Sequence[Stand]], bool]
) -> list[Stand]:
    """Return the pieces placed, with those of `left` for which there is a place that the judge passes.

    ``placed``: what stands, pinned pieces too, in the field's frame.
    ``left``: what was left out; what is worth most is tried first.
    ``bare``: the room without any piece.
    ``passes``: whether the judge passes all these pieces together.
    """
    all_placed = list(placed)
    *_, last = packings(left, bare.rules)
    for unit in sorted(last.units, key=lambda one: one.loss, reverse=True):
        for stood in _places(unit, all_placed, bare):
            if passes([*all_placed, *stood]):
                all_placed += stood
                break
    return all_placed


def _places(unit: Unit, placed: Sequence[Stand], bare: Field) -> list[list[Stand]]:
    """Return where a unit could stand beside the others, paths aside, the best first."""
    item, hosts = unit.items[0], [stand.item.spec.category for stand in placed]
    if len(unit.items) == 1:
        if item.spec.placement == "on" or (item.spec.bound and not host_role(item, hosts)):
            return []
        unit = alone(item, bare.rules, LAST_SPLIT, hosts)
    return [stands(one) for one in _Look(bare, tuple(placed)).search().all_places(unit)]

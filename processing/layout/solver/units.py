"""Units: what is placed as one piece, a single item or a group such as a bed with its nightstands, in its variants.

A unit's frame: x along the line it is placed on, y away from it; the part that touches the line spans 0 <= x <= width.
Members stand in it turned by quarters.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import combinations
from typing import TypeAlias

from processing.layout.items import Item, UseZone
from processing.layout.rules import RuleSet
from processing.layout.solver.field import PERSON_M
from processing.layout.solver.free_sets import BODY, RUG, ZONE

Rect: TypeAlias = tuple[float, float, float, float]  # x0, x1, y0, y1 in metres
LEAST_ZONE_M = 1e-6  # use zones less deep than this are none
PLACE_M = 0.61  # width of one place at a dining table (24 in, docs/reference/arrangement.md)
BIG_M2 = 0.25  # footprint from which pieces distinguish arrangements
MAIN = ("bed", "single bed", "king bed", "sofa", "dining table", "desk")  # what rooms are for: left out last


@dataclass(frozen=True)
class Member:
    """An item's place in its unit."""

    item: Item
    x_m: float
    y_m: float
    quarters: int = 0
    """Turned counter-clockwise by so many right angles."""
    zones: tuple[Rect, ...] = ()
    """The use zones that this variant keeps free, in the item's own frame."""

    def rect(self, local: Rect) -> Rect:
        """Return a rectangle of the item's frame in the unit's frame."""
        x0, x1, y0, y1 = local
        for _ in range(self.quarters % 4):
            x0, x1, y0, y1 = -y1, -y0, x0, x1
        return x0 + self.x_m, x1 + self.x_m, y0 + self.y_m, y1 + self.y_m

    def body(self) -> Rect:
        """Return its footprint in the unit's frame."""
        width_m, depth_m, _ = self.item.spec.size_m
        return self.rect((-width_m / 2, width_m / 2, -depth_m / 2, depth_m / 2))

    def front(self) -> tuple[float, float]:
        """Return where its front points in the unit's frame."""
        return ((0.0, 1.0), (-1.0, 0.0), (0.0, -1.0), (1.0, 0.0))[self.quarters % 4]


@dataclass(frozen=True)
class Variant:
    """One way to put a unit together."""

    members: tuple[Member, ...]
    width_m: float
    """Of the part that touches the line."""
    depth_m: float
    """From the line to the far side of the last body."""
    at_wall: bool
    bonus: float = 0.0
    """How much better than plain, in units of the search's score."""

    def rects(self) -> list[tuple[tuple[float, ...], int]]:
        """Return (x0, x1, y0, y1, low, high) and class (`free_sets`) of its footprints and use zones."""
        rows: list[tuple[tuple[float, ...], int]] = []
        for member in self.members:
            spec = member.item.spec
            rows.append(((*member.body(), spec.base_m, spec.top_m), RUG if spec.is_rug else BODY))
            rows += [((*member.rect(zone), 0.0, PERSON_M), ZONE) for zone in member.zones]
        return rows


@dataclass(frozen=True)
class Unit:
    """A unit: its main item first in each variant's members."""

    items: tuple[Item, ...]
    variants: tuple[Variant, ...]
    role: str
    keeps_to: str = ""
    """Role of what it stands by: a nightstand alone by the bed."""
    keeps_within_m: float = 0.0

    @cached_property
    def footprint_m2(self) -> float:
        """Return what its items cover together."""
        return sum(item.spec.footprint_m2 for item in self.items if not item.spec.is_rug)

    @property
    def loss(self) -> float:
        """Return how much is lost where it is left out."""
        return sum(loss_of(item) for item in self.items)


def loss_of(item: Item) -> float:
    """Return how much is lost without a piece: one, its footprint, and more for what a room is for."""
    return 1.0 + item.spec.footprint_m2 + (3.0 if item.spec.category in MAIN else 0.0)


def zone_choices(item: Item, rules: RuleSet) -> list[tuple[Rect, ...]]:
    """Return the sets of use zones of which one must be free, the most generous first, in the item's frame."""
    spec = item.spec
    rects = {zone.side: zone_rect(item, zone, rules) for zone in spec.zones}
    found = {side: rect for side, rect in rects.items() if rect is not None}
    if spec.sides_needed is None:
        return [tuple(found.values())]
    sides = [side for side in ("left", "right") if side in found]
    rest = [rect for side, rect in found.items() if side not in sides]
    least = min(getattr(rules, spec.sides_needed), len(sides))
    return [
        (*(found[s] for s in chosen), *rest)
        for count in range(len(sides), least - 1, -1)
        for chosen in combinations(sides, count)
    ]


def zone_rect(item: Item, zone: UseZone, rules: RuleSet) -> Rect | None:
    """Return a use zone in the item's frame, None where the rules ask for none."""
    deep = zone.depth_m(rules)
    if deep < LEAST_ZONE_M:
        return None
    half_w, half_d = item.spec.size_m[0] / 2, item.spec.size_m[1] / 2
    return {
        "front": (-half_w, half_w, half_d, half_d + deep),
        "back": (-half_w, half_w, -half_d - deep, -half_d),
        "left": (-half_w - deep, -half_w, -half_d, half_d),
        "right": (half_w, half_w + deep, -half_d, half_d),
    }[zone.side]


def single(item: Item, rules: RuleSet, *, at_wall: bool) -> list[Variant]:
    """Return the variants of an item that stands by itself."""
    width_m, depth_m, _ = item.spec.size_m
    return [
        Variant((Member(item, width_m / 2, depth_m / 2, 0, zones),), width_m, depth_m, at_wall, 0.15 * len(zones))
        for zones in zone_choices(item, rules)
    ]


def sideways(item: Item, rules: RuleSet, *, bonus: float) -> list[Variant]:
    """Return the variants of an item with its left or right side to the wall."""
    width_m, depth_m, _ = item.spec.size_m
    return [
        Variant((Member(item, depth_m / 2, width_m / 2, quarters, zones),), depth_m, width_m, at_wall=True, bonus=bonus)
        for zones in zone_choices(item, rules)
        for quarters in (1, 3)
    ]


def turned(variant: Variant, quarters: int, bonus: float) -> Variant:
    """Return a variant turned by right angles, moved so that its bodies begin at the line and at x = 0."""
    members = list(variant.members)
    for _ in range(quarters % 4):
        members = [Member(m.item, -m.y_m, m.x_m, m.quarters + 1, m.zones) for m in members]
    return from_zero(members, at_wall=variant.at_wall, bonus=variant.bonus + bonus)


def from_zero(members: Sequence[Member], *, at_wall: bool, bonus: float = 0.0) -> Variant:
    """Return members as a variant, moved so that its bodies begin at the line and at x = 0."""
    bodies = [m.body() for m in members if not m.item.spec.is_rug]
    x0, y0 = min(b[0] for b in bodies), min(b[2] for b in bodies)
    moved = tuple(Member(m.item, m.x_m - x0, m.y_m - y0, m.quarters, m.zones) for m in members)
    return Variant(moved, max(b[1] for b in bodies) - x0, max(b[3] for b in bodies) - y0, at_wall, bonus)


def beside(bed: Item, left: Sequence[Item], right: Sequence[Item], rules: RuleSet, gap_m: float) -> list[Variant]:
    """Return the variants of a bed with nightstands on its left and right, backs to the same line."""
    variants = []
    before = sum(item.spec.size_m[0] + gap_m for item in left)
    width_m, depth_m, _ = bed.spec.size_m
    for zones in zone_choices(bed, rules):
        members = [Member(bed, before + width_m / 2, depth_m / 2, 0, zones)]
        at = 0.0
        for item in left:
            members.append(_backed(item, at, rules))
            at += item.spec.size_m[0] + gap_m
        at = before + width_m
        for item in right:
            members.append(_backed(item, at + gap_m, rules))
            at += gap_m + item.spec.size_m[0]
        variants.append(Variant(tuple(members), at, depth_m, at_wall=True, bonus=0.3 * len(zones)))
    return variants


def _backed(item: Item, start_m: float, rules: RuleSet) -> Member:
    width_m, depth_m, _ = item.spec.size_m
    return Member(item, start_m + width_m / 2, depth_m / 2, 0, zone_choices(item, rules)[0])


def desk_and_chair(desk: Item, chairs: Sequence[Item], rules: RuleSet) -> list[Variant]:
    """Return a desk at the wall with its chair pushed to it."""
    width_m, depth_m, _ = desk.spec.size_m
    members = [Member(desk, width_m / 2, depth_m / 2, 0, zone_choices(desk, rules)[0])]
    members += [Member(chair, width_m / 2, depth_m + chair.spec.size_m[1] / 2, 2) for chair in chairs[:1]]
    return [Variant(tuple(members), width_m, depth_m, at_wall=True)]


def seating(
    sofa: Item, table: Item | None, chairs: Sequence[tuple[Item, str]], rug: Item | None, rules: RuleSet
) -> Variant:
    """Return a sofa at the wall, the table before it, armchairs at the table's `left` and `right` end, a rug below."""
    width_m, depth_m, _ = sofa.spec.size_m
    members = [Member(sofa, width_m / 2, depth_m / 2, 0, zone_choices(sofa, rules)[0])]
    reach_m, middle_y = width_m / 2, depth_m + rules.table_gap + 0.3
    if table is not None:
        middle_y = depth_m + rules.table_gap + table.spec.size_m[1] / 2
        reach_m = table.spec.size_m[0] / 2
        members.append(Member(table, width_m / 2, middle_y))
    for chair, side in chairs:
        away_m = reach_m + rules.table_gap + chair.spec.size_m[1] / 2
        sign = -1.0 if side == "left" else 1.0
        zones = zone_choices(chair, rules)[0]
        y_m = max(middle_y, depth_m + 0.1 + chair.spec.size_m[0] / 2) if away_m < width_m / 2 + 0.5 else middle_y
        members.append(Member(chair, width_m / 2 + sign * away_m, y_m, 3 if side == "left" else 1, zones))
    if rug is not None:
        members.append(Member(rug, width_m / 2, middle_y))
    far = max(m.body()[3] for m in members)
    return Variant(tuple(members), width_m, far, at_wall=True, bonus=0.8 * len(chairs) + 0.3 * (rug is not None))


def dining(table: Item, chairs: Sequence[Item], rug: Item | None, rules: RuleSet) -> list[Variant]:
    """Return a table with its chairs: free in the room, an end at the wall, or a long side at the wall."""
    length_m, _, _ = table.spec.size_m
    places = max(1, int((length_m + 1e-9) / PLACE_M))
    found = []
    for near, far, ends in _seats(len(chairs), places):
        straight = _table_set(table, chairs, (near, far, ends), rug, rules, turned=False)
        found += [straight] if near == 0 else []
        if ends == 0:
            found.append(_table_set(table, chairs, (near, far, 0), rug, rules, turned=True))
        found.append(replace(straight, at_wall=False, bonus=0.5 + 0.2 * (near == far)))
    return found


def _seats(count: int, places: int) -> list[tuple[int, int, int]]:
    """Return (near side, far side, each end) seats that hold exactly `count` chairs; ends hold one each or none."""
    return [
        (near, left - near, ends)
        for ends, left in ((0, count), (1, count - 2))
        for near in range(max(0, left - places), min(places, left // 2) + 1)
    ]


def _table_set(
    table: Item, chairs: Sequence[Item], seats: tuple[int, int, int], rug: Item | None, rules: RuleSet, *, turned: bool
) -> Variant:
    """Return the set with the table's long side along the line, or turned with its end at it; seats as in `_seats`."""
    length_m, depth_m, _ = table.spec.size_m
    rest = list(chairs)
    near, far, ends = seats
    members = [Member(table, 0.0, 0.0, 0, zone_choices(table, rules)[0])]
    for side, quarters, number in ((-1.0, 0, near), (1.0, 2, far)):
        for k in range(number):
            chair = rest.pop(0)
            x = length_m * ((k + 0.5) / number - 0.5)
            y = side * (depth_m + chair.spec.size_m[1]) / 2
            members.append(Member(chair, x, y, quarters, zone_choices(chair, rules)[0]))
    for side, quarters in ((-1.0, 3), (1.0, 1)):
        for _ in range(ends):
            chair = rest.pop(0)
            x = side * (length_m + chair.spec.size_m[1]) / 2
            members.append(Member(chair, x, 0.0, quarters, zone_choices(chair, rules)[0]))
    if rug is not None:
        members.append(Member(rug, 0.0, 0.0))
    if turned:
        members = [Member(m.item, -m.y_m, m.x_m, m.quarters + 1, m.zones) for m in members]
    return from_zero(members, at_wall=True)

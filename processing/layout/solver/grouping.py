"""From a list of items to units: groups kept whole first, then ever more of their members by themselves."""

from collections.abc import Collection, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

from processing.ground.tables import table_of
from processing.layout.items import Item
from processing.layout.rules import RuleSet
from processing.layout.solver import units
from processing.layout.solver.units import Unit, Variant

GAP_M = 0.05  # between a bed and its nightstands
ROLES: dict[str, str] = table_of("processing.layout", "items")["roles"]
HUNG_TV_M = 1.0  # chosen: the eyes of people who sit
END_TO_WALL = -0.6  # bonus of a desk with an end to the wall
SIDEWAYS_BED = -2.5  # bonus of a bed with a side to the wall, and so mostly with its head in the room: a last resort
LAST_SPLIT = 3  # chosen: three ways to break a group up


@dataclass(frozen=True)
class Packing:
    """One division of the items into units, in the order they are placed."""

    units: tuple[Unit, ...]

    @cached_property
    def large(self) -> dict[int, str]:
        """The large units' numbers, with the names of their main pieces; rugs are none."""
        return {
            number: unit.items[0].id
            for number, unit in enumerate(self.units)
            if unit.footprint_m2 >= units.BIG_M2 and unit.role != "rug"
        }


def packings(items: Sequence[Item], rules: RuleSet) -> Iterator[Packing]:
    """Yield the divisions to try, whole groups first, at last every piece in every position that is legal."""
    shapes: list[list[tuple[str, ...]]] = []
    for split in range(LAST_SPLIT + 1):
        packing = _packing(list(items), rules, split)
        shape = [tuple(item.id for item in unit.items) for unit in packing.units]
        if shape not in shapes or split == LAST_SPLIT:
            shapes.append(shape)
            yield packing


def _packing(items: list[Item], rules: RuleSet, split: int) -> Packing:
    left = list(items)
    found: list[Unit] = []
    for build in (_beds, _sofas, _tvs, _desks, _tables):
        found += build(left, rules, split)
    hosts = {item.spec.category for item in items}
    found += [alone(item, rules, split, hosts) for item in left]
    # What rooms are for goes first, then by size; rugs and small pieces last
    first = {"bed": 3, "sofa": 3, "dining": 3, "rug": -1}
    found.sort(key=lambda u: (-first.get(u.role, 1 + (len(u.items) > 1)), -u.footprint_m2, u.items[0].id))
    return Packing(tuple(found))


def _take(left: list[Item], *categories: str) -> list[Item]:
    taken = [item for item in left if item.spec.category in categories]
    left[:] = [item for item in left if item not in taken]
    return taken


def _beds(left: list[Item], rules: RuleSet, split: int) -> list[Unit]:
    beds = _take(left, "bed", "single bed", "king bed")
    tables = _take(left, "nightstand")
    found = []
    for number, bed in enumerate(beds):
        share = tables[number :: len(beds)]
        kept = share[: max(0, 2 - split)]
        left += [item for item in share if item not in kept]
        found.append(Unit((bed, *kept), tuple(_bed_variants(bed, kept, rules)), "bed"))
    if not beds:
        left += tables
    return found


def _bed_variants(bed: Item, tables: Sequence[Item], rules: RuleSet) -> list[Variant]:
    if not tables:
        return [*units.single(bed, rules, at_wall=True), *units.sideways(bed, rules, bonus=SIDEWAYS_BED)]
    if len(tables) == 1:
        return [*units.beside(bed, tables, (), rules, GAP_M), *units.beside(bed, (), tables, rules, GAP_M)]
    return units.beside(bed, tables[:1], tables[1:2], rules, GAP_M)


def _sofas(left: list[Item], rules: RuleSet, split: int) -> list[Unit]:
    sofas = _take(left, "sofa")
    if not sofas:
        return []
    tables, chairs = _take(left, "coffee table"), _take(left, "armchair")
    rugs = _take(left, "rug") if not any(i.spec.category in {"dining table", "bed"} for i in left) else []
    sofa, table = sofas[0], tables[0] if tables and split < 3 else None
    rug = rugs[0] if rugs and split < 2 else None
    kept = [] if split else chairs[:2]
    sides = [["left", "right"]] if len(kept) == 2 else [["left"], ["right"]] if kept else [[]]
    variants = [units.seating(sofa, table, list(zip(kept, s, strict=True)), rug, rules) for s in sides]
    members = [sofa, *([table] if table else []), *kept, *([rug] if rug else [])]
    if len(members) == 1:
        variants += units.sideways(sofa, rules, bonus=-1.0)
    left += [i for i in (*sofas[1:], *tables, *chairs, *rugs) if i not in members]
    return [Unit(tuple(members), tuple(variants), "sofa")]


def _tvs(left: list[Item], rules: RuleSet, split: int) -> list[Unit]:
    del split  # a TV never leaves its stand
    stands, screens = _take(left, "tv stand"), _take(left, "tv")
    found = []
    for number, stand in enumerate(stands):
        on = screens[number : number + 1]
        width_m, depth_m, height_m = stand.spec.size_m
        members = [units.Member(stand, width_m / 2, depth_m / 2, 0, units.zone_choices(stand, rules)[0])]
        placed = [Item(tv.id, replace(tv.spec, base_m=height_m)) for tv in on]
        members += [units.Member(tv, width_m / 2, depth_m / 2) for tv in placed]
        found.append(Unit((stand, *placed), (Variant(tuple(members), width_m, depth_m, at_wall=True),), "tv"))
    for tv in screens[len(stands) :]:
        hung = Item(tv.id, replace(tv.spec, base_m=HUNG_TV_M))
        found.append(Unit((hung,), tuple(units.single(hung, rules, at_wall=True)), "tv"))
    return found


def _desks(left: list[Item], rules: RuleSet, split: int) -> list[Unit]:
    del split  # a chair never leaves its desk
    desks, chairs = _take(left, "desk"), _take(left, "desk chair")
    found = []
    for number, desk in enumerate(desks):
        own = chairs[number : number + 1]
        straight = units.desk_and_chair(desk, own, rules)
        across = [units.turned(v, quarters, END_TO_WALL) for v in straight for quarters in (1, 3)]
        found.append(Unit((desk, *own), (*straight, *across), "desk"))
    used = {item.id for unit in found for item in unit.items}
    left += [chair for chair in chairs if chair.id not in used]
    return found


def _tables(left: list[Item], rules: RuleSet, split: int) -> list[Unit]:
    tables, chairs = _take(left, "dining table"), _take(left, "dining chair")
    if not tables:
        left += chairs
        return []
    rugs = _take(left, "rug") if split < 2 else []
    table, rug = tables[0], rugs[0] if rugs else None
    keep = len(chairs) if split < 2 else max(0, len(chairs) - split + 1)
    most = 2 * max(1, int((table.spec.size_m[0] + 1e-9) / units.PLACE_M)) + 2
    own = chairs[: min(keep, most)]
    variants = units.dining(table, own, rug, rules)
    members = [table, *own, *([rug] if rug else [])]
    left += [i for i in (*tables[1:], *chairs, *rugs) if i not in members]
    return [Unit(tuple(members), tuple(variants), "dining")]


def alone(item: Item, rules: RuleSet, split: int, hosts: Collection[str] = ()) -> Unit:
    """Return the unit of a piece that stands by itself; the last split allows every legal position.

    Against walls only, but what is made to stand free, and armchairs. Where its host is among `hosts`, a bound piece
    keeps near it.
    """
    spec = item.spec
    at_wall = spec.placement == "wall" or spec.category in {"desk chair", "dining chair"}
    role = ROLES.get(spec.category, "tall" if spec.size_m[2] > 1.2 and spec.footprint_m2 > 0.2 else "small")
    variants = units.single(item, rules, at_wall=at_wall)
    if spec.category == "armchair":
        variants += units.single(item, rules, at_wall=False)
    if split == LAST_SPLIT and at_wall and spec.base_m == 0 and spec.footprint_m2 >= 0.35:
        variants += units.sideways(item, rules, bonus=-1.0)
    near = host_role(item, hosts)
    return Unit((item,), tuple(variants), role, near, rules.together if near else 0.0)


def host_role(item: Item, categories: Collection[str]) -> str:
    """Return the role of what a bound piece keeps to, where one of `categories` is that; else nothing."""
    role = ROLES.get(item.spec.group_with, "")
    return role if item.spec.bound and role in {ROLES.get(name) for name in categories} else ""

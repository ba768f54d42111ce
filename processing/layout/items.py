"""Furniture as the solver sees it: a footprint, a height interval and use zones; no meshes (`model` names one).

An item's local frame: origin on the floor in the middle of its footprint, x along its width, +y to its front (away from
the wall it stands at), z up. Its footprint is the rectangle |x| <= width/2, |y| <= depth/2.
"""

import difflib
import math
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Literal, Self, TypeAlias

from processing.errors import ItemError
from processing.ground.arrays import Vector
from processing.ground.tables import table_of
from processing.layout.rules import RuleSet

Side: TypeAlias = Literal["front", "back", "left", "right"]
Placement: TypeAlias = Literal["wall", "free", "on"]
"""`wall`: back to a wall where one is free; `free`: anywhere; `on`: on top of another item (a TV on its stand)."""
MAX_SIZE_M = 6.0  # chosen: longer than any piece sold
RUG_HEIGHT_M = 0.03  # chosen: what people walk over


@dataclass(frozen=True)
class UseZone:
    """Floor kept free beside an item, as deep as the rule set says.

    `left` and `right` are the item's own, looking along +y: left is -x.
    """

    side: Side
    rule: str
    """The rule set's key of its depth."""
    less_m: float = 0.0
    """Taken off that depth: a dining chair's zone is counted from the table's edge."""

    def depth_m(self, rules: RuleSet) -> float:
        """Return its depth by a rule set, in metres; 0 or less asks for nothing."""
        return float(getattr(rules, self.rule)) - self.less_m


@dataclass(frozen=True)
class ItemSpec:
    """A kind of furniture of one size."""

    category: str
    size_m: Vector
    """Width along its back, depth, height."""
    base_m: float = 0.0
    """Height of its underside above the floor."""
    placement: Placement = "wall"
    zones: tuple[UseZone, ...] = ()
    sides_needed: str | None = None
    """The rule set's key of how many of its left and right zones must be free; None: all."""
    group_with: str = ""
    """Category that it belongs to: a nightstand to a bed."""
    bound: bool = False
    """It is of no use away from what it belongs to, and stands within `together` metres of it."""
    model: str = ""
    """Key of its mesh in the catalogue; empty: the category's built-in one."""
    handed: bool = False
    """Left and right differ (a corner sofa), so that mirrored rooms get arrangements of their own."""

    @property
    def is_rug(self) -> bool:
        """Whether other items may stand on it."""
        return self.category == "rug" or self.size_m[2] <= RUG_HEIGHT_M

    @property
    def footprint_m2(self) -> float:
        """Return the footprint's area."""
        return self.size_m[0] * self.size_m[1]

    @property
    def top_m(self) -> float:
        """Return the height of its top above the floor."""
        return self.base_m + self.size_m[2]

    def checked(self) -> Self:
        """Return itself; raise `ItemError` where a size cannot be right."""
        if not all(math.isfinite(v) and 0 < v <= MAX_SIZE_M for v in self.size_m):
            raise ItemError(f"size {self.size_m} m: each must be over 0, at most {MAX_SIZE_M:g} m", where=self.category)
        if not (math.isfinite(self.base_m) and 0 <= self.base_m < 5):
            raise ItemError(f"its underside at {self.base_m} m", where=self.category)
        return self


@dataclass(frozen=True)
class Item:
    """One piece to be placed."""

    id: str
    spec: ItemSpec


# The built-in kinds of furniture, the sets made of them, and what else kinds are called (`items.toml`).

_TABLES = table_of(__package__, "items")
SETS: dict[str, str] = _TABLES["sets"]
OTHER_NAMES: dict[str, str] = _TABLES["other_names"]


def _spec(category: str, row: dict[str, Any]) -> ItemSpec:
    own = {"size_m": tuple(row["size_m"]), "zones": tuple(UseZone(*zone) for zone in row.get("zones", ()))}
    return ItemSpec(category, **row | own)


KINDS: dict[str, ItemSpec] = {category: _spec(category, row) for category, row in _TABLES["kinds"].items()}

# Lists of furniture as people write them: ``"bed, 2 nightstand, desk"``.

MAX_ITEMS = 40  # chosen: more than any room's furniture
_ENTRY = re.compile(r"^(?:(\d{1,3})\s*(?:x|×)?\s+)?(.+?)$")


def parse_items(text: str, kinds: Mapping[str, ItemSpec] = KINDS) -> list[Item]:
    """Return the items of a list; ids are the kind, numbered where there are several (`nightstand-2`).

    Raises `ItemError` for names that are not known, with the nearest that are.
    """
    specs: list[ItemSpec] = []
    for part in (p.strip() for p in re.split(r"[,;\n]", text)):
        if not part:
            continue
        match = _ENTRY.match(part)
        assert match is not None  # the second group takes anything
        count = int(match[1] or 1)
        if count < 1:
            raise ItemError(f"'{part}': a count of 0; leave it out instead")
        specs += [_kind(match[2], kinds)] * min(count, MAX_ITEMS + 1)
    return number_items(specs)


def set_items(name: str) -> list[Item]:
    """Return the items of a built-in set; raise `ItemError` naming those there are."""
    return parse_items(set_list(name))


def set_list(name: str) -> str:
    """Return a built-in set as a list; raise `ItemError` naming those there are."""
    if name not in SETS:
        raise ItemError(f"no set '{name}'; there are: {', '.join(SETS)}")
    return SETS[name]


def number_items(specs: Sequence[ItemSpec]) -> list[Item]:
    """Return the specs as items with ids of their own; raise `ItemError` for none, too many, or impossible sizes."""
    if not specs:
        raise ItemError("no items", advice="name some, such as 'bed, 2 nightstand, desk'")
    if len(specs) > MAX_ITEMS:
        raise ItemError(f"more than {MAX_ITEMS} items")
    seen: dict[str, int] = {}
    items = []
    for spec in specs:
        spec.checked()
        name = spec.category.replace(" ", "-")
        seen[name] = seen.get(name, 0) + 1
        items.append(Item(f"{name}-{seen[name]}", spec))
    single = {name for name, count in seen.items() if count == 1}
    return [Item(item.id[:-2], item.spec) if item.id[:-2] in single else item for item in items]


def _kind(name: str, kinds: Mapping[str, ItemSpec]) -> ItemSpec:
    plain = re.sub(r"[\s_-]+", " ", name.strip().lower())
    for tried in (plain, plain.removesuffix("s"), plain.removesuffix("es"), re.sub("ves$", "f", plain)):
        found = kinds.get(OTHER_NAMES.get(tried, tried)) or kinds.get(tried)
        if found:
            return found
    near = difflib.get_close_matches(plain, [*kinds, *OTHER_NAMES], n=3, cutoff=0.5)
    hint = f"nearest: {', '.join(near)}" if near else f"there are: {', '.join(kinds)}"
    raise ItemError(f"unknown item '{name.strip()[:40]}'; {hint}")

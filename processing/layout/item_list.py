"""Lists of furniture as people write them: ``"bed, 2 nightstand, desk"``."""

from __future__ import annotations

import difflib
import re
from collections.abc import Mapping, Sequence

from processing.errors import ItemError
from processing.layout.item_table import KINDS, OTHER_NAMES, SETS
from processing.layout.items import Item, ItemSpec

MAX_ITEMS = 40
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
            raise ItemError(f"'{part}': none asked for; leave it out instead")
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

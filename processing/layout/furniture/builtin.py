"""The built-in models: every design of every category, in any size within its limits, in the materials of a style."""

from __future__ import annotations

from functools import cache, lru_cache
from typing import Any, NamedTuple

import numpy as np

from processing.errors import CatalogueError, ItemError
from processing.layout.furniture.bench import Bench
from processing.layout.furniture.model import FurnitureModel, Size
from processing.layout.furniture.script import build, designs
from processing.layout.furniture.styles import style_named
from processing.layout.furniture.verbs import VERBS

LICENCE = "Apache-2.0 (part of daylit)"


class Kind(NamedTuple):
    """A category's sizes in metres, and its designs."""

    smallest_m: Size
    usual_m: Size
    largest_m: Size
    designs: dict[str, str]


@cache
def _shared() -> dict[str, str]:
    return {name: text for table in designs()["shared"] for name, text in table.items()}


def _kind(tables: dict[str, Any], row: dict[str, Any]) -> Kind:
    smallest, usual, largest = (tuple(size) for size in row["sizes"])
    texts = tables[row["like"]] if "like" in row else row
    return Kind(smallest, usual, largest, {name: text for name, text in texts.items() if name not in ("sizes", "like")})


BUILT_IN: dict[str, Kind] = {name: _kind(designs(), row) for name, row in designs().items() if name != "shared"}


def checked_size(category: str, size_m: Size | None) -> Size:
    """Return a size within the kind's limits, its usual one for None; raise `CatalogueError` for others."""
    kind = BUILT_IN[category]
    size = kind.usual_m if size_m is None else size_m
    rows = zip(("wide", "deep", "high"), size, kind.smallest_m, kind.largest_m, strict=True)
    for word, value, low, high in rows:
        if not low - 1e-6 <= value <= high + 1e-6:
            raise CatalogueError(f"{value:g} m {word}: it is made {low:g} to {high:g} m {word}", where=category)
    return size


def design_of(category: str, style: str) -> str:
    """Return the name of the design that a style has of a category: its own, else the first."""
    texts, chosen = BUILT_IN[category].designs, style_named(style).designs
    of = next((name for name in (category, category.split()[-1]) if chosen.get(name) in texts), "")
    return chosen[of] if of else next(iter(texts))


@lru_cache(maxsize=64)
def build_model(category: str, style: str, size_m: Size | None = None, design: str = "") -> FurnitureModel:
    """Return a built-in model, in a style's design or another; the same arguments give the same triangles."""
    size = checked_size(category, size_m)
    name = design or design_of(category, style)
    if name not in BUILT_IN[category].designs:
        raise ItemError(f"no design '{name[:40]}'; there are: {', '.join(BUILT_IN[category].designs)}", where=category)
    bench = Bench(size, style_named(style), np.random.default_rng(sum(category.encode())))
    build(bench, BUILT_IN[category].designs[name], VERBS, _shared())
    return FurnitureModel(f"{category}/{style}", category, bench.parts(), size, LICENCE, notes=(f"design {name}",))

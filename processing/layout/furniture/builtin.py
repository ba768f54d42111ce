"""The built-in models: every design of every category, in any size within its limits, in the materials of a style.

Designs are texts (`processing.ground.designs`) in `*.toml` beside this file.
"""

from functools import cache, lru_cache, partial
from typing import Any, NamedTuple

import numpy as np

from processing.errors import CatalogueError, ItemError
from processing.ground.designs import build
from processing.ground.tables import table_of
from processing.layout.furniture.bench import Bench, style_named
from processing.layout.furniture.model import FurnitureModel, Size
from processing.layout.furniture.verbs import VERBS


@cache
def _designs() -> dict[str, Any]:
    """Return all designs: category -> {"sizes": [smallest, usual, largest], design: text}, and `shared` texts."""
    found: dict[str, Any] = {}
    shared: dict[str, str] = {}
    for name in ("seats", "cases", "tables", "decor"):
        table = dict(table_of(__package__, name))
        shared |= table.pop("shared", {})
        found |= table
    return {**found, "shared": shared}


LICENCE = "Apache-2.0 (part of daylit)"
LENGTHS_M = {
    "BOARD": 0.019,  # the usual melamine board
    "GAP": 0.004,  # chosen: as between real doors
    "OUT": 0.026,  # how far handles stand out; a piece's depth includes them
}
"""What designs know by name."""


class Kind(NamedTuple):
    """A category's sizes in metres, and its designs."""

    smallest_m: Size
    usual_m: Size
    largest_m: Size
    designs: dict[str, str]


def _kind(tables: dict[str, Any], row: dict[str, Any]) -> Kind:
    smallest, usual, largest = (tuple(size) for size in row["sizes"])
    texts = tables[row["like"]] if "like" in row else row
    return Kind(smallest, usual, largest, {name: text for name, text in texts.items() if name not in ("sizes", "like")})


BUILT_IN: dict[str, Kind] = {name: _kind(_designs(), row) for name, row in _designs().items() if name != "shared"}


def checked_size(category: str, size_m: Size | None) -> Size:
    """Return a size within the kind's limits, its usual one for None; raise `CatalogueError` for others."""
    kind = BUILT_IN[category]
    size = kind.usual_m if size_m is None else size_m
    for word, value, low, high in zip(("wide", "deep", "high"), size, kind.smallest_m, kind.largest_m, strict=True):
        if not low - 1e-6 <= value <= high + 1e-6:
            raise CatalogueError(f"{value:g} m {word}: it can be {low:g} to {high:g} m {word}", where=category)
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
    make = {verb: partial(add, bench) for verb, add in VERBS.items()}
    chance = {"rnd": lambda low, high: float(bench.rng.uniform(low, high))}
    names = {**chance, **LENGTHS_M, "handles": bench.style.handles, "manner": bench.style.legs}
    build(BUILT_IN[category].designs[name], size, make, shared=_designs()["shared"], names=names)
    return FurnitureModel(f"{category}/{style}", category, bench.parts(), size, LICENCE, notes=(f"design {name}",))

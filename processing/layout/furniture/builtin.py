"""The table of built-in models: how each is built, and the sizes it can be made in."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from processing.errors import CatalogueError
from processing.layout.furniture import beds_and_tables, decor, seating, storage
from processing.layout.furniture.bench import Bench
from processing.layout.furniture.model import FurnitureModel, Size, style_named
from processing.layout.items import KINDS

LICENCE = "Apache-2.0 (part of daylit)"


@dataclass(frozen=True)
class Kind:
    """How a kind is built, and its smallest and largest size in metres."""

    build: Callable[[Bench], None]
    smallest_m: Size
    largest_m: Size


BUILT_IN: dict[str, Kind] = {
    "bed": Kind(beds_and_tables.bed, (1.2, 1.9, 0.8), (1.6, 2.2, 1.3)),
    "single bed": Kind(beds_and_tables.bed, (0.8, 1.9, 0.8), (1.1, 2.2, 1.3)),
    "king bed": Kind(beds_and_tables.bed, (1.6, 1.9, 0.8), (2.2, 2.2, 1.3)),
    "nightstand": Kind(storage.nightstand, (0.35, 0.30, 0.40), (0.65, 0.50, 0.70)),
    "wardrobe": Kind(storage.wardrobe, (0.5, 0.45, 1.6), (3.0, 0.70, 2.6)),
    "chest": Kind(storage.chest, (0.45, 0.35, 0.60), (1.8, 0.60, 1.30)),
    "bookshelf": Kind(storage.bookshelf, (0.4, 0.22, 0.7), (1.6, 0.45, 2.4)),
    "desk": Kind(beds_and_tables.desk, (0.9, 0.5, 0.68), (2.0, 0.9, 0.80)),
    "desk chair": Kind(seating.desk_chair, (0.50, 0.50, 0.80), (0.72, 0.72, 1.25)),
    "sofa": Kind(seating.sofa, (1.2, 0.75, 0.70), (2.8, 1.1, 1.0)),
    "armchair": Kind(seating.armchair, (0.62, 0.68, 0.70), (0.95, 0.95, 1.05)),
    "coffee table": Kind(beds_and_tables.coffee_table, (0.6, 0.4, 0.32), (1.5, 0.9, 0.55)),
    "tv stand": Kind(storage.tv_stand, (0.9, 0.30, 0.35), (2.4, 0.55, 0.70)),
    "tv": Kind(decor.television, (0.7, 0.06, 0.42), (1.9, 0.35, 1.15)),
    "dining table": Kind(beds_and_tables.dining_table, (0.8, 0.65, 0.70), (2.6, 1.2, 0.80)),
    "dining chair": Kind(seating.dining_chair, (0.40, 0.44, 0.75), (0.55, 0.60, 1.05)),
    "rug": Kind(decor.rug, (0.6, 0.4, 0.006), (4.0, 3.0, 0.03)),
    "floor lamp": Kind(decor.floor_lamp, (0.25, 0.25, 1.2), (0.6, 0.6, 2.0)),
    "plant": Kind(decor.plant, (0.25, 0.25, 0.4), (0.9, 0.9, 1.9)),
}


def checked_size(category: str, size_m: Size | None) -> Size:
    """Return a size within the kind's limits, its usual one for None; raise `CatalogueError` for others."""
    kind = BUILT_IN[category]
    size = KINDS[category].size_m if size_m is None else size_m
    rows = zip(("wide", "deep", "high"), size, kind.smallest_m, kind.largest_m, strict=True)
    for word, value, low, high in rows:
        if not low - 1e-6 <= value <= high + 1e-6:
            raise CatalogueError(f"{value:g} m {word}: it is made {low:g} to {high:g} m {word}", where=category)
    return size


@lru_cache(maxsize=32)
def build_model(category: str, style: str, size_m: Size | None = None) -> FurnitureModel:
    """Return a built-in model; the same arguments give the same triangles."""
    size = checked_size(category, size_m)
    bench = Bench(size, style_named(style), np.random.default_rng(sum(category.encode())))
    BUILT_IN[category].build(bench)
    return FurnitureModel(f"{category}/{style}", category, bench.parts(), size, LICENCE)

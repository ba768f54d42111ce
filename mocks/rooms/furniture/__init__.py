"""Procedural furniture: the meshes of an `Item`, in its place."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from mocks.rooms.furniture import (
    beds,
    devices,
    pictures,
    plants,
    seating,
    small,
    storage,
    tables,
)
from mocks.rooms.furniture import (
    beds as textiles,
)
from mocks.rooms.furniture import (
    devices as equipment,
)
from mocks.rooms.furniture import (
    storage as books,
)
from mocks.rooms.furniture.build import Build
from mocks.rooms.model import ADE20K, NO_CLASS, Finish, Item, Material, Part
from processing.ground.mesh import Mesh, merge

_CHANCE = 7301
"""Sets these generators apart from all others of the same seed."""


@dataclass(frozen=True)
class Model:
    """How a kind is built, and the name of its ADE20K class ("" for none)."""

    build: Callable[[Build], None]
    ade: str


MODELS: dict[str, Model] = {
    "bed": Model(beds.bed, "bed"),
    "nightstand": Model(storage.nightstand, "table"),
    "wardrobe": Model(storage.wardrobe, "wardrobe"),
    "chest of drawers": Model(storage.chest_of_drawers, "chest of drawers"),
    "cabinet": Model(storage.cabinet, "cabinet"),
    "bookcase": Model(storage.bookcase, "bookcase"),
    "wall shelf": Model(storage.wall_shelf, "shelf"),
    "sofa": Model(seating.sofa, "sofa"),
    "armchair": Model(seating.sofa, "armchair"),
    "ottoman": Model(seating.ottoman, "ottoman"),
    "chair": Model(seating.chair, "chair"),
    "swivel chair": Model(seating.swivel_chair, "swivel chair"),
    "dining table": Model(tables.dining_table, "table"),
    "coffee table": Model(tables.coffee_table, "coffee table"),
    "desk": Model(tables.desk, "desk"),
    "floor lamp": Model(devices.floor_lamp, "lamp"),
    "table lamp": Model(devices.table_lamp, "lamp"),
    "television": Model(devices.television, "television"),
    "monitor": Model(devices.monitor, "monitor"),
    "laptop": Model(devices.laptop, "computer"),
    "keyboard": Model(devices.keyboard, "computer"),
    "vase": Model(small.vase, "vase"),
    "bottle": Model(small.bottle, "bottle"),
    "bowl": Model(small.bowl, "plate"),
    "mug": Model(small.mug, "glass"),
    "box": Model(small.box, "box"),
    "basket": Model(small.basket, "basket"),
    "toy blocks": Model(small.toy_blocks, "plaything"),
    "toy ball": Model(small.toy_ball, "ball"),
    "books": Model(books.books, "book"),
    "plant": Model(plants.plant, "plant"),
    "picture": Model(pictures.picture, "painting"),
    "wall clock": Model(pictures.wall_clock, "clock"),
    "rug": Model(textiles.rug, "rug"),
    "cushion": Model(textiles.cushion, "cushion"),
    "blanket": Model(textiles.blanket, "blanket"),
    "tripod": Model(equipment.tripod, ""),
    "meter board": Model(equipment.meter_board, ""),
}
"""Every kind of item."""


def item_parts(item: Item, finish: Finish) -> list[Part]:
    """Return the meshes of an item in world coordinates, one part for each of its materials and classes."""
    model = MODELS[item.kind]
    build = Build(item, finish, np.random.default_rng([item.seed, _CHANCE]))
    model.build(build)
    groups: dict[tuple[Material, str], list[Mesh]] = {}
    for mesh, material, ade in build.pieces:
        groups.setdefault((material, ade or model.ade), []).append(mesh)
    return [
        Part(merge(meshes), material, item.kind, ADE20K[ade] if ade else NO_CLASS, item.role, item.instance).placed(
            item.position_m, item.turn_rad
        )
        for (material, ade), meshes in groups.items()
    ]

"""Procedural furniture: the meshes of an `Item`, in its place."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from mocks.rooms.furniture import cases, devices, small, soft
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
    "bed": Model(soft.bed, "bed"), "nightstand": Model(cases.nightstand, "table"),
    "wardrobe": Model(cases.wardrobe, "wardrobe"),
    "chest of drawers": Model(cases.chest_of_drawers, "chest of drawers"), "cabinet": Model(cases.cabinet, "cabinet"),
    "bookcase": Model(cases.bookcase, "bookcase"), "wall shelf": Model(cases.wall_shelf, "shelf"),
    "sofa": Model(soft.sofa, "sofa"), "armchair": Model(soft.sofa, "armchair"),
    "ottoman": Model(soft.ottoman, "ottoman"), "chair": Model(soft.chair, "chair"),
    "swivel chair": Model(soft.swivel_chair, "swivel chair"), "dining table": Model(cases.dining_table, "table"),
    "coffee table": Model(cases.coffee_table, "coffee table"), "desk": Model(cases.desk, "desk"),
    "floor lamp": Model(devices.floor_lamp, "lamp"), "table lamp": Model(devices.table_lamp, "lamp"),
    "television": Model(devices.television, "television"), "monitor": Model(devices.monitor, "monitor"),
    "laptop": Model(devices.laptop, "computer"), "keyboard": Model(devices.keyboard, "computer"),
    "vase": Model(small.vase, "vase"), "bottle": Model(small.bottle, "bottle"), "bowl": Model(small.bowl, "plate"),
    "mug": Model(small.mug, "glass"), "box": Model(small.carton, "box"), "basket": Model(small.basket, "basket"),
    "toy blocks": Model(small.toy_blocks, "plaything"), "toy ball": Model(small.toy_ball, "ball"),
    "books": Model(cases.books, "book"), "plant": Model(small.plant, "plant"),
    "picture": Model(small.picture, "painting"), "wall clock": Model(small.wall_clock, "clock"),
    "rug": Model(soft.rug, "rug"), "cushion": Model(soft.cushion, "cushion"),
    "blanket": Model(soft.blanket, "blanket"), "tripod": Model(devices.tripod, ""),
    "meter board": Model(devices.meter_board, ""),
}  # fmt: skip
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

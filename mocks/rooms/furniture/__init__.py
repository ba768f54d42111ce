"""Procedural furniture: the meshes of an `Item`, in its place."""

from collections.abc import Callable

import numpy as np

from mocks.rooms.furniture import cases, devices, small, soft
from mocks.rooms.furniture.build import Build
from mocks.rooms.model import ADE20K, NO_CLASS, Finish, Item, Material, Part
from processing.ground.mesh import Mesh, merge

_CHANCE = 7301  # sets these generators apart from all others of the same seed


MODELS: dict[str, tuple[Callable[[Build], None], str]] = {
    "bed": (soft.bed, "bed"),
    "nightstand": (cases.nightstand, "table"),
    "wardrobe": (cases.wardrobe, "wardrobe"),
    "chest of drawers": (cases.chest_of_drawers, "chest of drawers"),
    "cabinet": (cases.cabinet, "cabinet"),
    "bookcase": (cases.bookcase, "bookcase"),
    "wall shelf": (cases.wall_shelf, "shelf"),
    "sofa": (soft.sofa, "sofa"),
    "armchair": (soft.sofa, "armchair"),
    "ottoman": (soft.ottoman, "ottoman"),
    "chair": (soft.chair, "chair"),
    "swivel chair": (soft.swivel_chair, "swivel chair"),
    "dining table": (cases.dining_table, "table"),
    "coffee table": (cases.coffee_table, "coffee table"),
    "desk": (cases.desk, "desk"),
    "floor lamp": (devices.floor_lamp, "lamp"),
    "table lamp": (devices.table_lamp, "lamp"),
    "television": (devices.television, "television"),
    "monitor": (devices.monitor, "monitor"),
    "laptop": (devices.laptop, "computer"),
    "keyboard": (devices.keyboard, "computer"),
    "vase": (small.vase, "vase"),
    "bottle": (small.bottle, "bottle"),
    "bowl": (small.bowl, "plate"),
    "mug": (small.mug, "glass"),
    "box": (small.carton, "box"),
    "basket": (small.basket, "basket"),
    "toy blocks": (small.toy_blocks, "plaything"),
    "toy ball": (small.toy_ball, "ball"),
    "books": (cases.books, "book"),
    "plant": (small.plant, "plant"),
    "picture": (small.picture, "painting"),
    "wall clock": (small.wall_clock, "clock"),
    "rug": (soft.rug, "rug"),
    "cushion": (soft.cushion, "cushion"),
    "blanket": (soft.blanket, "blanket"),
    "tripod": (devices.tripod, ""),
    "meter board": (devices.meter_board, ""),
}
"""Every kind of item: how it is built, and the name of its ADE20K class ("" for none)."""


def item_parts(item: Item, finish: Finish) -> list[Part]:
    """Return the meshes of an item in world coordinates, one part for each of its materials and classes."""
    make, usual_ade = MODELS[item.kind]
    build = Build(item, finish, np.random.default_rng([item.seed, _CHANCE]))
    make(build)
    groups: dict[tuple[Material, str], list[Mesh]] = {}
    for mesh, material, ade in build.pieces:
        groups.setdefault((material, ade or usual_ade), []).append(mesh)
    return [
        Part(merge(meshes), material, item.kind, ADE20K[ade] if ade else NO_CLASS, item.role, item.instance).placed(
            item.position_m, item.turn_rad
        )
        for (material, ade), meshes in groups.items()
    ]

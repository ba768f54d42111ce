"""Procedural furniture: the meshes of an `Item`, in its place.

Designs are texts (`processing.ground.designs`) in `*.toml` beside this file; what they cannot say is a verb of its own.
"""

from collections.abc import Callable
from functools import partial
from typing import Any

import numpy as np

from mocks.rooms.furniture import small, soft
from mocks.rooms.furniture.build import SHAPES, Build
from mocks.rooms.model import ADE20K, NO_CLASS, Finish, Item, Material, Part
from processing.ground.designs import build as build_design
from processing.ground.mesh import Mesh, merge
from processing.ground.tables import table_of

_CHANCE = 7301  # sets these generators apart from all others of the same seed
_TABLES = [table_of(__package__, name) for name in ("cases", "devices", "soft", "small")]
_SHARED = {name: text for table in _TABLES for name, text in table["shared"].items()}
MODELS: dict[str, dict[str, str]] = {k: row for table in _TABLES for k, row in table.items() if k != "shared"}
"""Every kind of item: its ``design``, and the name ``ade`` of its ADE20K class ("" for none)."""


def item_parts(item: Item, finish: Finish) -> list[Part]:
    """Return the meshes of an item in world coordinates, one part for each of its materials and classes."""
    build = Build(item, finish, np.random.default_rng([item.seed, _CHANCE]))
    make_item(build)
    groups: dict[tuple[Material, str], list[Mesh]] = {}
    for mesh, material, ade in build.pieces:
        groups.setdefault((material, ade or MODELS[item.kind]["ade"]), []).append(mesh)
    return [
        Part(merge(meshes), material, item.kind, ADE20K[ade] if ade else NO_CLASS, item.role, item.instance).placed(
            item.position_m, item.turn_rad
        )
        for (material, ade), meshes in groups.items()
    ]


def make_item(b: Build) -> None:
    """Make an item's design on the bench."""
    names = b.names()
    makers: dict[str, Callable[..., None]] = {name: partial(b.shape, name) for name in SHAPES}
    makers |= {name: partial(make, b) for name, make in {**soft.VERBS, **small.VERBS}.items()}

    def run(verb: str, role: str | Material, **measures: Any) -> None:
        makers[verb](names[role.replace(" ", "_")] if isinstance(role, str) and role else role, **measures)

    verbs = {verb: partial(run, verb) for verb in makers}
    build_design(MODELS[b.item.kind]["design"], b.size, verbs, shared=_SHARED, names=names)

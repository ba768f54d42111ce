"""Placed furniture as parts of a scene: the catalogue's meshes, turned and moved to where they stand."""

import math
from collections.abc import Sequence

import numpy as np

from processing.ground.arrays import Vector
from processing.ground.colour import linear_of_srgb
from processing.ground.mesh import crosses
from processing.layout.arrangement import PlacedItem
from processing.layout.furniture.model import Material as LookedUp
from processing.layout.furniture.model import Part as MeshPart
from processing.layout.models.catalogue import Catalogue
from processing.light.scene.scene import Material, Part

LIFT_M = 0.001  # by which everything stands above the floor, so that undersides do not lie in it
WARM_WHITE = (1.9354, 0.8036, 0.1918)
"""Linear Rec. 709 of unit luminance of a black body at 2,700 K, as lamps at home (CIE 15: x 0.4599, y 0.4106)."""


def furniture_parts(
    items: Sequence[PlacedItem], built_in: Catalogue, own: Catalogue | None = None, *, lit: bool = False
) -> tuple[Part, ...]:
    """Return the parts of all items in the room's frame; ``lit``: lamps are on.

    An item that names a built-in design (`sofa/classic`, in another finish `sofa/classic/industrial`) has it, one that
    names another model has that of ``own``, all others are ``built_in``: those that name no more than their kind, where
    ``own`` has none of it, too. Raises `CatalogueError` or `ModelFileError`.
    """
    found, every = list[Part](), Catalogue.builtin()
    for item in items:
        if item.model in every:
            model = every.mesh(item.model, item.size_m)
        elif item.model and own is not None and (item.model != item.category or own.of_category(item.category)):
            model = own.mesh(item.model, item.size_m)
        else:
            model = built_in.mesh(item.category, item.size_m)
        found += scene_parts(model.parts, item.id, item.t_m, item.theta_rad, lit=lit)
    return tuple(found)


def scene_parts(
    parts: Sequence[MeshPart],
    name: str = "",
    at_m: Vector = (0.0, 0.0, 0.0),
    turn_rad: float = 0.0,
    *,
    lit: bool = False,
) -> tuple[Part, ...]:
    """Return a model's parts as those of a scene, turned counter-clockwise about z, then moved."""
    return tuple(_placed(part, name, at_m, turn_rad, lit=lit) for part in parts if len(part.faces))


def _placed(part: MeshPart, name: str, at_m: Vector, turn_rad: float, *, lit: bool) -> Part:
    c, s = math.cos(turn_rad), math.sin(turn_rad)
    turn = np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])
    moved = part.vertices.astype(np.float64) @ turn.T + np.asarray(at_m) + (0.0, 0.0, LIFT_M)
    doubled_m2 = np.linalg.norm(crosses(part.vertices.astype(np.float64), part.faces), axis=1).sum() if lit else 0.0
    return Part(
        name=f"{name}: {part.material.name}",
        vertices_m=moved,
        faces=np.ascontiguousarray(part.faces, np.int32),
        material=_material(part.material, float(doubled_m2 / 2)),
        uv=part.texture_coordinates(),
        normals=np.asarray(part.normals @ turn.T.astype(np.float32), np.float32),
    )


def _material(look: LookedUp, area_m2: float) -> Material:
    """Return a material of the scene; what a lamp of some lumens sends out evenly (Lambert) over its area, 0: off."""
    level = look.lumen / (math.pi * area_m2) if area_m2 > 0 else 0.0
    colour = tuple(float(min(max(v, 0.0), 1.0)) for v in look.base_colour)
    return Material(
        name=look.name,
        colour=(colour[0], colour[1], colour[2]),
        texture=None if look.texture is None else linear_of_srgb(look.texture),
        roughness=look.roughness,
        metallic=look.metallic,
        creases=look.creases,
        emission_cd_m2=(level * WARM_WHITE[0], level * WARM_WHITE[1], level * WARM_WHITE[2]),
    )

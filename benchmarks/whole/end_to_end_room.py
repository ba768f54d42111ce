"""The simulated room with the furniture that was staged in it, truly placed: what a staged picture is compared with."""

from __future__ import annotations

import hashlib
import json
import math
from collections.abc import Sequence
from dataclasses import dataclass, field, fields

import numpy as np

from mocks.rooms.model import Material, Role
from mocks.rooms.model import Part as TruePart
from mocks.rooms.room import Room
from mocks.rooms.truth import equirectangular
from mocks.rooms.world import RoomWorld
from mocks.worlds.light import LUMINANCE_WEIGHTS, Site
from processing.ground.arrays import Floats
from processing.ground.mesh import Mesh
from processing.layout.arrangement import PlacedItem
from processing.layout.models.catalogue import Catalogue
from processing.light.scene.scene import Part
from processing.stages.furnishing import furniture_parts

MATTE = 0.6
"""Roughness from which a thing counts as matte in the simulated room."""
LEAST_ALBEDO, MOST_ALBEDO = 0.02, 0.9
_CHAIR = 19
"""ADE20K class of what is put in; no figure depends on which."""


@dataclass(frozen=True)
class StagedRoom(Room):
    """An emptied room with the catalogue's furniture in it."""

    digest: str = ""
    """Of the furniture: the light is kept on disk by it."""
    extra: tuple[TruePart, ...] = field(default=(), repr=False, compare=False)

    def parts(self) -> list[TruePart]:
        """Return all meshes."""
        return [*super().parts(), *self.extra]


def staged_room(room: Room, items: Sequence[PlacedItem], style: str) -> StagedRoom:
    """Return the room emptied, with the arranged furniture where it was put."""
    empty = room.emptied()
    content = json.dumps([style, [item.model_dump(mode="json") for item in items]], sort_keys=True)
    found = furniture_parts(items, Catalogue.builtin(style))
    return StagedRoom(
        **{f.name: getattr(empty, f.name) for f in fields(Room)},
        digest=hashlib.sha256(content.encode()).hexdigest(),
        extra=tuple(_true_part(part, number) for number, part in enumerate(found, 1)),
    )


def _true_part(part: Part, number: int) -> TruePart:
    """Return a part with a normal a face (the simulated room's own meshes share no shading with the catalogue's)."""
    corners = np.asarray(part.vertices_m, np.float64)[part.faces].reshape(-1, 3)
    across = np.cross(corners[1::3] - corners[::3], corners[2::3] - corners[::3])
    length = np.linalg.norm(across, axis=1, keepdims=True)
    normal = np.where(length > 0, across / np.maximum(length, 1e-20), (0.0, 0.0, 1.0))
    mesh = Mesh(
        corners,
        np.repeat(normal, 3, axis=0),
        np.zeros((len(corners), 2)),
        np.arange(len(corners), dtype=np.int32).reshape(-1, 3),
    )
    look = part.material
    colour = np.asarray(look.colour, np.float64)
    if look.texture is not None:
        colour = colour * look.texture.reshape(-1, look.texture.shape[-1])[:, :3].mean(axis=0, dtype=np.float64)
    red, green, blue = (float(v) for v in np.clip(colour, LEAST_ALBEDO, MOST_ALBEDO))
    roughness = look.roughness if look.roughness is not None and look.roughness < MATTE else None
    return TruePart(
        mesh, Material(part.name, (red, green, blue), roughness=roughness), "staged", _CHAIR, Role.FURNITURE, number
    )


def staged_luminance(room: StagedRoom, quality: str, rows: int, samples: int = 2) -> Floats:
    """Return the true luminance (cd/m2) of each pixel of a panorama of ``rows``, mean of ``samples`` squared rays."""
    world = RoomWorld(room, quality)
    fine = equirectangular(rows * samples)
    found = world.radiance(Site.INDOOR, fine.reshape(-1, 3), math.pi / (rows * samples)).reshape(fine.shape)
    mean = found.reshape(rows, samples, 2 * rows, samples, 3).mean(axis=(1, 3), dtype=np.float64)
    return np.asarray(mean @ np.asarray(LUMINANCE_WEIGHTS), np.float32)

"""Furniture as GLB: one model, or all of an arrangement where it stands.

glTF has y upwards: (x, y, z) of our frame, z up, becomes (x, z, -y). A model's front (+y) so looks to -z, an
arrangement's room lies as docs/reference/coordinates.md has it.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from PIL import Image

from processing.errors import CatalogueError, ModelFileError
from processing.ground.arrays import Floats
from processing.layout.arrangement import Arrangement, PlacedItem
from processing.layout.furniture.builtin import BUILT_IN
from processing.layout.furniture.model import FurnitureModel, Part
from processing.layout.furniture.solids import rotation
from processing.layout.furniture.styles import STYLES
from processing.layout.models.catalogue import Catalogue


def _model_of(item: PlacedItem, catalogue: Catalogue) -> FurnitureModel:
    try:
        return catalogue.mesh(item.model or item.category, item.size_m)
    except (CatalogueError, ModelFileError) as error:
        if item.category not in BUILT_IN:
            raise
        note = f"the built-in {item.category} instead: {error}"
    model = Catalogue.builtin(STYLES[0]).mesh(item.category, item.size_m)
    return replace(model, notes=(*model.notes, note))


def in_place(item: PlacedItem, model: FurnitureModel) -> tuple[Part, ...]:
    """Return a model's parts moved to where the piece stands: x' = R_z(theta) x + t."""
    turn = rotation("z", item.theta_rad)
    return tuple(
        replace(
            part,
            vertices=np.asarray(part.vertices @ turn.T + np.array(item.t_m), dtype=np.float32),
            normals=np.asarray(part.normals @ turn.T, dtype=np.float32),
        )
        for part in model.parts
    )


def write_model(path: Path, model: FurnitureModel) -> None:
    """Write one model as GLB, standing on the origin."""
    _write(path, [(model.model_id, model.parts)], [model])


def write_arrangement(path: Path, arrangement: Arrangement, catalogue: Catalogue) -> list[FurnitureModel]:
    """Write an arrangement's furniture as GLB, one node a piece, without the room; return the models used."""
    placed = [(item, _model_of(item, catalogue)) for item in arrangement.items]
    _write(path, [(item.id, in_place(item, model)) for item, model in placed], [model for _, model in placed])
    return [model for _, model in placed]


def _write(path: Path, groups: Sequence[tuple[str, Sequence[Part]]], models: Sequence[FurnitureModel]) -> None:
    import trimesh

    scene: Any = trimesh.Scene()
    for name, parts in groups:
        for number, part in enumerate(parts):
            label = f"{name}.{number}".replace("/", "_")
            scene.add_geometry(_trimesh(part), node_name=label, geom_name=label)
    licences = sorted({model.licence for model in models})
    scene.metadata["licences"] = licences
    path.write_bytes(scene.export(file_type="glb"))


def _trimesh(part: Part) -> Any:
    import trimesh

    visuals: Any = trimesh.visual
    m = part.material
    picture = None if m.texture is None else Image.fromarray(m.texture)
    look = visuals.material.PBRMaterial(
        name=m.name,
        baseColorFactor=[*(float(c) for c in m.base_colour), float(m.opacity)],
        baseColorTexture=picture,
        roughnessFactor=float(m.roughness),
        metallicFactor=float(m.metallic),
        doubleSided=m.two_sided,
        alphaMode="BLEND" if m.opacity < 1 else "OPAQUE",
    )
    uv = part.texture_coordinates()
    visual = visuals.TextureVisuals(uv=np.zeros((len(part.vertices), 2)) if uv is None else uv, material=look)
    return trimesh.Trimesh(
        vertices=y_up(part.vertices), faces=part.faces, vertex_normals=y_up(part.normals), visual=visual, process=False
    )


def y_up(vectors: Floats) -> Floats:
    """Return (N, 3) vectors of our frame (z up) in glTF's (y up)."""
    return np.column_stack([vectors[:, 0], vectors[:, 2], -vectors[:, 1]]).astype(np.float32)

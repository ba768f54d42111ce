"""The catalogue: furniture by category, as meshes; built in, from a folder of files, or from a 3D-FUTURE folder.

Written as GLB: glTF has y upwards: (x, y, z) of our frame, z up, becomes (x, z, -y). A model's front (+y) so looks to
-z, an arrangement's room lies as docs/reference/coordinates.md has it.
"""

from __future__ import annotations

import difflib
import re
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from PIL import Image

from processing.errors import CatalogueError, ModelFileError
from processing.ground.mesh import y_up
from processing.ground.tables import table_of
from processing.layout.arrangement import Arrangement, PlacedItem
from processing.layout.furniture.bench import STYLES, style_named
from processing.layout.furniture.builtin import BUILT_IN, LICENCE, build_model, design_of
from processing.layout.furniture.model import FurnitureModel, Part, Size
from processing.layout.furniture.solids import rotation
from processing.layout.items import KINDS, ItemSpec, UseZone
from processing.pictures.writing import write_bytes

if TYPE_CHECKING:
    from processing.layout.models.catalogue_folder import FileSource


OTHER = "other"
APART = {"desklamp": "desk lamp", "bedside": "bedside", "nightstand": "nightstand"}
"""Words that are written as one and are two."""


def category_of(name: str) -> str:
    """Return the category that a file's or model's name stands for; `other` where it stands for none."""
    spaced = re.sub(r"(?<=[a-z])(?=[A-Z])|(?<=[A-Za-z])(?=\d)|[^A-Za-z0-9]+", " ", name).lower()
    words = {part for word in spaced.split() for part in APART.get(word, word).split()}
    words |= {word[:-1] for word in words if word.endswith("s") and len(word) > 3}
    words |= {"plant" for word in words if word.endswith("plant")} | {
        "bed" for word in words if re.match(r"bed(with|double)", word)
    }
    named = (
        category
        for category, names in table_of(__package__, "categories")["words"]
        if any(words.issuperset(n.split()) for n in names.split("|"))
    )
    return next(named, OTHER)


@dataclass(frozen=True)
class CatalogueEntry:
    """What is known of a model without its triangles. Its front is +y, as an item's is."""

    model_id: str
    category: str
    """A kind of the item table, or another name for what the arranger does not place by itself."""
    size_m: Size
    smallest_m: Size
    largest_m: Size
    licence: str
    file: str = ""
    """Its file within the catalogue's folder; empty for a built-in one."""
    notes: tuple[str, ...] = ()

    @property
    def placeable(self) -> bool:
        """Whether the item table has its category, and so its use zones."""
        return self.category in KINDS

    @property
    def zones(self) -> tuple[UseZone, ...]:
        """Return the use zones of its category."""
        return self.item_spec().zones if self.placeable else ()

    def item_spec(self) -> ItemSpec:
        """Return it as an item to be arranged, of its own size; raise `CatalogueError` for an unknown category."""
        if not self.placeable:
            raise CatalogueError(f"'{self.category}' is not a category that can be arranged", where=self.model_id)
        usual = KINDS[self.category]
        less_m = self.size_m[1]
        zones = tuple(replace(z, less_m=less_m) if z.less_m else z for z in usual.zones)
        return replace(usual, size_m=self.size_m, zones=zones, model=self.model_id)


@dataclass(frozen=True)
class BuiltInSource:
    """A built-in kind in one style's design, in that style's materials or in those of another (``finish``)."""

    category: str
    style: str
    finish: str = ""

    @property
    def model_id(self) -> str:
        """Return category, style and finish, as in `sofa/classic` or `sofa/classic/industrial`."""
        return "/".join(filter(None, (self.category, self.style, self.finish)))

    def entry(self) -> CatalogueEntry:
        """Return its usual size and its limits."""
        kind = BUILT_IN[self.category]
        notes = (f"design {design_of(self.category, self.style)}",)
        sizes = (kind.usual_m, kind.smallest_m, kind.largest_m)
        return CatalogueEntry(self.model_id, self.category, *sizes, LICENCE, notes=notes)

    def model(self, size_m: Size | None) -> FurnitureModel:
        """Return it in the size asked for."""
        design = design_of(self.category, self.style)
        return replace(build_model(self.category, self.finish or self.style, size_m, design), model_id=self.model_id)


class Catalogue:
    """Models by name. Files are read when they are first needed; those that cannot be read are in `refused`."""

    def __init__(self, name: str, sources: Iterable[BuiltInSource | FileSource]) -> None:
        self.name = name
        self._sources = {source.model_id: source for source in sources}
        self.refused: dict[str, ModelFileError] = {}

    @classmethod
    def builtin(cls, style: str | None = None) -> Catalogue:
        """Return the built-in furniture in one style, or in all; raise `ItemError` for an unknown one."""
        styles = STYLES if style is None else [style_named(style).name]
        return cls(f"built-in, {style or 'all styles'}", [BuiltInSource(k, s) for k in BUILT_IN for s in styles])

    @classmethod
    def at(cls, path: Path) -> Catalogue:
        """Return the models of a folder: of 3D-FUTURE, or the glTF, GLB and OBJ files in it and the folders in it.

        Unit and front are guessed where no `catalog.json` states them, and the guess is in the model's notes. Raises
        `CatalogueError` where there are no models.
        """
        from processing.layout.models.catalogue_folder import folder_sources, future_sources

        future = path.is_dir() and any(
            (one / "model_info.json").is_file() for one in (path, *sorted(p for p in path.iterdir() if p.is_dir()))
        )
        return cls(path.name, (future_sources if future else folder_sources)(path))

    @property
    def ids(self) -> tuple[str, ...]:
        """Return the names of all models, sorted as they were found."""
        return tuple(self._sources)

    @property
    def entries(self) -> tuple[CatalogueEntry, ...]:
        """Return what is known of every model that can be read (this reads every file once)."""
        return tuple(entry for name in self._sources if (entry := self._entry_or_none(name)) is not None)

    def entry(self, model_id: str) -> CatalogueEntry:
        """Return a model's entry; raise `CatalogueError` (with the nearest names) or `ModelFileError`."""
        return self._source(model_id).entry()

    def of_category(self, category: str) -> tuple[str, ...]:
        """Return the names of a category's models."""
        return tuple(name for name, source in self._sources.items() if source.category == category)

    def choose(self, category: str, *, largest_m: Size | None = None, seed: int = 0) -> CatalogueEntry:
        """Return a model of a category, no larger than a limit, drawn by a seed.

        Raises `CatalogueError` where there is none, saying how many were too large or unreadable.
        """
        names = self.of_category(category)
        if not names:
            known = sorted({s.category for s in self._sources.values()})
            raise CatalogueError(f"no {category} here; there are: {', '.join(known)}", where=self.name)
        for k in np.random.default_rng(seed).permutation(len(names)):
            entry = self._entry_or_none(names[int(k)])
            if entry and all(v <= b + 1e-6 for v, b in zip(entry.size_m, largest_m or entry.size_m, strict=True)):
                return entry
        what = f"at most {largest_m}" if largest_m else "readable"
        raise CatalogueError(f"none of {len(names)} models of {category} is {what}", where=self.name)

    def mesh(self, model_id: str, size_m: Size | None = None) -> FurnitureModel:
        """Return a model, made (or, from a file, stretched within limits) to a size.

        A category's name stands for its first model. Raises `CatalogueError` or `ModelFileError`.
        """
        return self._source(model_id).model(None if size_m is None else (size_m[0], size_m[1], size_m[2]))

    def kinds(self, seed: int = 0) -> dict[str, ItemSpec]:
        """Return item specs for the arranger: for each category one model, drawn by a seed, in its own size."""
        kinds: dict[str, ItemSpec] = {}
        for category in sorted({s.category for s in self._sources.values()} & set(KINDS)):
            try:
                kinds[category] = self.choose(category, seed=seed).item_spec()
            except CatalogueError:
                continue
        return kinds

    def __contains__(self, model_id: str) -> bool:
        """Return whether it has a model, or a built-in one in another style's finish (`sofa/classic/industrial`)."""
        return self._named(model_id) is not None

    def _named(self, model_id: str) -> BuiltInSource | FileSource | None:
        name, _, finish = model_id.rpartition("/")
        if isinstance(plain := self._sources.get(name), BuiltInSource) and finish in STYLES:
            return replace(plain, finish=finish)
        return self._sources.get(model_id)

    def _source(self, model_id: str) -> BuiltInSource | FileSource:
        found = self._named(model_id)
        if found is not None:
            return found
        of_kind = self.of_category(model_id.replace("-", " "))
        if of_kind:
            return self._sources[of_kind[0]]
        near = difflib.get_close_matches(model_id, self._sources, n=3, cutoff=0.4)
        raise CatalogueError(
            f"no model '{model_id[:60]}'" + (f"; nearest: {', '.join(near)}" if near else ""), where=self.name
        )

    def _entry_or_none(self, name: str) -> CatalogueEntry | None:
        if name in self.refused:
            return None
        try:
            return self._sources[name].entry()
        except ModelFileError as error:
            self.refused[name] = error
            return None


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
    scene.metadata["licences"] = sorted({model.licence for model in models})
    write_bytes(path, scene.export(file_type="glb"))


def _trimesh(part: Part) -> Any:
    import trimesh

    visuals: Any = trimesh.visual
    m = part.material
    look = visuals.material.PBRMaterial(
        name=m.name,
        baseColorFactor=[*(float(c) for c in m.base_colour), float(m.opacity)],
        baseColorTexture=None if m.texture is None else Image.fromarray(m.texture),
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

"""A folder of glTF, GLB and OBJ files as a catalogue; with a `catalog.json`, what that says goes before guesses."""

import json
import re
from collections.abc import Collection
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np

from processing.errors import CatalogueError, ModelFileError
from processing.ground.tables import table_of
from processing.layout.furniture.model import FurnitureModel, Part, Size, bounds
from processing.layout.furniture.solids import Solid, part_of
from processing.layout.items import KINDS, OTHER_NAMES
from processing.layout.models.catalogue import OTHER, CatalogueEntry, category_of
from processing.layout.models.mesh_files import SUFFIXES, read_model_file
from processing.layout.models.mesh_pose import Given, Sound, posed, repaired

MAX_FILES = 20_000  # chosen: beyond any catalogue; a home folder named by mistake ends here
MAX_DEPTH = 4  # folders; chosen: category, maker, model and its file
MOST_STRETCH = 2.0  # chosen: beyond it a model is another piece
MOST_DISTORTION = 1.6  # chosen: beyond it shapes look squeezed
CREASE_RAD = np.radians(40.0)
MAX_SIZE_M = 12.0  # chosen: larger ones are in another unit
VAGUE = ("dining chair", "dining table")  # what mere chairs and tables are taken for


@dataclass(frozen=True)
class FileSource:
    """A model in a file."""

    model_id: str
    category: str
    path: Path
    root: Path
    licence: str
    given: Given = Given()  # noqa: RUF009 (frozen)
    notes: tuple[str, ...] = ()
    """What was not understood or changed before the file was read."""

    def entry(self) -> CatalogueEntry:
        """Return its size as loaded; it may be stretched to half and twice of that."""
        size, notes = self._measured
        low = (size[0] / MOST_STRETCH, size[1] / MOST_STRETCH, size[2] / MOST_STRETCH)
        high = (size[0] * MOST_STRETCH, size[1] * MOST_STRETCH, size[2] * MOST_STRETCH)
        file = self.path.relative_to(self.root).as_posix()
        return CatalogueEntry(self.model_id, self.category, size, low, high, self.licence, file, notes)

    @cached_property
    def _measured(self) -> tuple[Size, tuple[str, ...]]:
        model = self.model(None)
        return model.size_m, model.notes

    def model(self, size_m: Size | None) -> FurnitureModel:
        """Return its triangles, stretched to a size; raise `CatalogueError` where that would distort it too much."""
        model = load_model(self)
        return model if size_m is None else stretched(model, size_m)


def folder_sources(path: Path) -> list[FileSource]:
    """Return the models of a folder; raise `CatalogueError` where there are none."""
    if not path.is_dir():
        raise CatalogueError("no such folder", where=str(path))
    files = _files(path)
    if not files:
        raise CatalogueError(f"no {', '.join(SUFFIXES)} files in it", where=str(path))
    listed = _listed(path, files)
    licence = _licence(path)
    sources: dict[str, FileSource] = {}
    for file in files:
        row = listed.get(file.resolve(), {})
        given = _given(row, file.name)
        own = _licence(file.parent) if file.parent != path else ""
        said = str(row.get("licence") or row.get("license") or own or licence or "not stated")[:200]
        model_id, notes = _own_id(file.relative_to(path), sources)
        kind, unknown = _category(row, file.stem)
        sources[model_id] = FileSource(model_id, kind, file, path, said, given.checked(file.name), (*notes, *unknown))
    return list(sources.values())


def _own_id(file: Path, taken: Collection[str]) -> tuple[str, tuple[str, ...]]:
    """Return a name that no other file has, and a note where it is not the usual one.

    Usual is the path without its suffix, `sofa` for `sofa/sofa.glb`; files beside each other may share that."""
    name = file.with_suffix("").as_posix()
    parts = name.split("/")
    usual = "/".join(parts[:-1]) if len(parts) > 1 and parts[-1] == parts[-2] else name
    if usual not in taken:
        return usual, ()
    free = name if name not in taken else file.as_posix()
    return free, (f"another file is called {usual}; this one is {free}",)


def _files(root: Path) -> list[Path]:
    """Return the model files, sorted; links that lead out are left in, to be refused by name when read."""
    found = []
    for file in sorted(root.rglob("*")):
        if file.suffix.lower() in SUFFIXES and len(file.relative_to(root).parts) <= MAX_DEPTH and file.is_file():
            found.append(file)
        if len(found) > MAX_FILES:
            raise CatalogueError(f"more than {MAX_FILES} model files", where=str(root))
    return found


def _listed(root: Path, files: list[Path]) -> dict[Path, dict[str, Any]]:
    """Return what `catalog.json` files say, by file; raise `CatalogueError` where one cannot be read."""
    listed: dict[Path, dict[str, Any]] = {}
    for folder in sorted({root, *(f.parent for f in files), *(f.parent.parent for f in files)}):
        catalog = folder / "catalog.json"
        if not folder.is_relative_to(root) or not catalog.is_file():
            continue
        try:
            rows = json.loads(catalog.read_bytes()) if catalog.stat().st_size < 64 * 2**20 else None
        except (OSError, ValueError, RecursionError):
            rows = None
        if isinstance(rows, list):
            rows = {str(k): row for k, row in enumerate(rows)}
        if not isinstance(rows, dict) or not all(isinstance(row, dict) for row in rows.values()):
            raise CatalogueError("catalog.json is not a table of models", where=str(catalog))
        for key, row in rows.items():
            file = row.get("file") or row.get("obj") or row.get("model") or key
            if isinstance(file, str) and file.isprintable() and len(file) < 500:
                listed[(folder / file).resolve()] = row
    return listed


def _given(row: dict[str, Any], where: str) -> Given:
    size = row.get("size_m")
    if size is None and all(f"{k}_cm" in row for k in ("width", "depth", "height")):
        size = [_number(row[f"{k}_cm"], where) / 100 for k in ("width", "depth", "height")]
    if size is not None:
        if not isinstance(size, list) or len(size) != 3:
            raise CatalogueError("size_m is width, depth and height", where=where)
        size = [_number(v, where) for v in size]
    texts = {key: str(row[key]) for key in ("unit", "up", "front") if row.get(key) is not None}
    return Given(size_m=None if size is None else (size[0], size[1], size[2]), **texts)


def _number(value: Any, where: str) -> float:
    if isinstance(value, bool) or not isinstance(value, int | float) or not 1e-4 < value < 1e5:
        raise CatalogueError(f"a size of {str(value)[:20]}", where=where)
    return float(value)


def _category(row: dict[str, Any], name: str) -> tuple[str, tuple[str, ...]]:
    """Return a model's category, and a note where the one that is given is not understood.

    What `category` says goes first, by its words where it is none of ours; but where it says no more than chair or
    table, the model's own name or the file's may be more exact."""
    said = " ".join(re.split(r"[\s_-]+", str(row.get("category") or "").lower())).strip()
    if said in KINDS:
        return said, ()
    of_said = OTHER_NAMES.get(said) or category_of(said)
    found = [of_said, category_of(str(row.get("name") or "")), category_of(name)]
    exact = next((c for c in found if c not in (OTHER, *VAGUE)), None)
    category = exact or next((c for c in reversed(found) if c != OTHER), OTHER)
    if not said or of_said != OTHER:
        return category, ()
    instead = f"by its name it is of the kind {category}" if category != OTHER else "it cannot be arranged on its own"
    return category, (f"its category '{said[:40]}' is not known; {instead}",)


def _licence(folder: Path) -> str:
    """Return the first words of a licence file; "" where there is none."""
    for file in sorted(folder.iterdir()):
        named = "licen" in file.name.lower() or file.name.lower().startswith("copying")
        if named and file.is_file() and file.stat().st_size < 2**20:
            text = re.sub(r"<[^>]*>", " ", file.read_text("utf-8", errors="replace")).lower()
            licences = table_of(__package__, "categories")["licences"].items()
            known = next((name for word, name in licences if word in text), "")
            return f"{known} ({file.name})" if known else f"see {file.name}"
    return ""


def load_model(source: FileSource) -> FurnitureModel:
    """Return a file's model, posed and sound; `notes`: what was guessed or corrected. Raises `ModelFileError`."""
    where = source.path.name
    raw = read_model_file(source.path, source.root)
    clean = [p.vertices[(np.abs(p.vertices) < 1e12).all(axis=1)] for p in raw.parts]  # NaN is not less
    every = np.concatenate(clean)
    scale = float(np.ptp(every, axis=0).max()) if len(every) else 0.0
    if not scale > 1e-9:
        raise ModelFileError("its vertices are not numbers, or all coincide", where=where)
    sound = [(part, repaired(part, scale)) for part in raw.parts]
    kept = [(part.material, body) for part, body in sound if body is not None]
    if not kept:
        raise ModelFileError("none of its triangles has an area", where=where)
    used = np.concatenate([body.vertices for _, body in kept])
    if np.ptp(used, axis=0).min() <= 0 and np.sort(np.ptp(used, axis=0))[1] <= 0:
        raise ModelFileError("it has no extent", where=where)
    matrix, guessed = posed(used, source.category, source.given, y_up=source.path.suffix.lower() != ".obj")
    parts = tuple(_part(material, body, matrix) for material, body in kept)
    low, high = bounds([part.vertices for part in parts])
    size = [float(max(v, 1e-3)) for v in high - low]
    if max(size) > MAX_SIZE_M:
        raise ModelFileError(f"{max(size):.4g} m large; at most {MAX_SIZE_M:g}", where=where, advice="give its unit")
    notes = (*source.notes, *raw.notes, *_repairs([body for _, body in sound]), *guessed)
    size_m, closed = (size[0], size[1], size[2]), all(body.closed for _, body in kept)
    return FurnitureModel(source.model_id, source.category, parts, size_m, source.licence, closed, notes)


def _repairs(bodies: list[Sound | None]) -> list[str]:
    known = [body for body in bodies if body is not None]
    found = {
        "parts without area or with vertices that are no numbers were left out": len(bodies) - len(known),
        "triangles with vertices that are no numbers were left out": sum(body.dropped_nan for body in known),
        "triangles without area were left out": sum(body.dropped_flat for body in known),
        "triangles wound inwards were turned": sum(body.turned for body in known),
    }
    notes = [f"{count} {what}" for what, count in found.items() if count]
    if not all(body.closed for body in known):
        notes.append("open surfaces are rendered two-sided")
    return notes


def _part(material: Any, body: Sound, matrix: Any) -> Part:
    vertices = body.vertices @ matrix[:3, :3].T + matrix[:3, 3]
    look = material if body.closed else replace(material, two_sided=True)
    return part_of(Solid(vertices, body.faces, vertices), look, body.uv, float(CREASE_RAD))


def stretched(model: FurnitureModel, size_m: Size) -> FurnitureModel:
    """Return a loaded model at a size; raise `CatalogueError` beyond half, twice, or too uneven a stretch."""
    factor = np.array(size_m) / np.array(model.size_m)
    if not np.isfinite(factor).all() or (factor <= 0).any():
        raise CatalogueError(f"a size of {size_m} m", where=model.model_id)
    if factor.max() > MOST_STRETCH + 1e-6 or factor.min() < 1 / MOST_STRETCH - 1e-6:
        text = f"it is {' x '.join(f'{v:.2f}' for v in model.size_m)} m and is stretched to half or twice that at most"
        raise CatalogueError(text, where=model.model_id)
    if factor.max() / factor.min() > MOST_DISTORTION + 1e-6:
        raise CatalogueError(
            f"stretched {factor.max() / factor.min():.2f} times more one way than another", where=model.model_id
        )
    parts = []
    for part in model.parts:
        normals = part.normals / factor
        normals /= np.maximum(np.linalg.norm(normals, axis=1, keepdims=True), 1e-12)
        vertices = np.asarray(part.vertices * factor, np.float32)
        parts.append(replace(part, vertices=vertices, normals=np.asarray(normals, np.float32)))
    said = model.notes
    if np.ptp(factor) > 0.01 or abs(factor[0] - 1) > 0.01:
        said = (*said, f"stretched by {', '.join(f'{f:.2f}' for f in factor)}")
    return replace(model, parts=tuple(parts), size_m=(size_m[0], size_m[1], size_m[2]), notes=said)


LICENCE = "3D-FUTURE terms of use (non-commercial research, by agreement)"
MAX_INFO_BYTES = 256 * 2**20


def future_sources(path: Path) -> list[FileSource]:
    """Return the models that the folder's `model_info.json` lists and that lie beside it.

    Models are in metres, y up, their fronts at +z. Raises `CatalogueError` where the list is missing or is none.
    """
    if not path.is_dir():
        raise CatalogueError("no such folder", where=str(path))
    sources: dict[str, FileSource] = {}
    for info in (path / "model_info.json", *sorted(path.glob("*/model_info.json"))):
        if info.is_file():
            for source in _of_list(info, path):
                sources.setdefault(source.model_id, source)  # the same model in two lists is one model
    if not sources:
        raise CatalogueError("no model_info.json, or none of its models lies beside it", where=str(path))
    return list(sources.values())


def _of_list(info: Path, root: Path) -> list[FileSource]:
    try:
        rows = json.loads(info.read_bytes()) if info.stat().st_size <= MAX_INFO_BYTES else None
    except (OSError, ValueError, RecursionError):
        rows = None
    if not isinstance(rows, list):
        raise CatalogueError("model_info.json is not a list of models", where=str(info))
    sources = []
    for row in rows:
        name = row.get("model_id") if isinstance(row, dict) else None
        # A model's name is its folder's: nothing with separators or dots is one.
        if not isinstance(name, str) or not name.replace("-", "").replace("_", "").isalnum() or len(name) > 100:
            continue
        usual = (info.parent / name / n for n in ("raw_model.obj", "normalized_model.obj"))
        file = next((f for f in usual if f.is_file()), None)
        if file is not None:
            given = Given(unit="m" if file.name == "raw_model.obj" else None, up="y", front="+z")
            sources.append(FileSource(name, _future_category(row), file, root, LICENCE, given))
    return sources


def _future_category(row: dict[str, Any]) -> str:
    for key in ("category", "super-category"):
        said = str(row.get(key) or "").strip().lower()
        if found := table_of(__package__, "categories")["future"].get(said):
            return str(found)
    return category_of(f"{row.get('category') or ''} {row.get('super-category') or ''}")

"""A 3D-FUTURE folder as its users have it: `model_info.json`, and a folder a model with OBJ, texture and picture."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

from processing.errors import CatalogueError
from processing.layout.models.catalogue_folder import FileSource
from processing.layout.models.catalogue_names import category_of
from processing.layout.models.mesh_pose import Given

# Which kind of furniture a name means: `loungeSofaLong`, `bedside table 2`, `Three-Seat / Multi-seat Sofa`.


LICENCE = "3D-FUTURE terms of use (non-commercial research, by agreement)"
MAX_INFO_BYTES = 256 * 2**20
CATEGORIES = {
    "king-size bed": "king bed", "single bed": "single bed", "kids bed": "single bed", "bunk bed": "bunk bed",
    "bed frame": "bed", "double bed": "bed", "nightstand": "nightstand", "wardrobe": "wardrobe",
    "drawer chest / corner cabinet": "chest", "children cabinet": "chest",
    "sideboard / side cabinet / console table": "chest",
    "bookcase / jewelry armoire": "bookshelf", "shelf": "bookshelf", "tv stand": "tv stand",
    "coffee table": "coffee table",
    "corner/side table": "side table", "round end table": "side table", "dining table": "dining table", "desk": "desk",
    "dressing table": "desk", "dining chair": "dining chair", "lounge chair / cafe chair / office chair": "armchair",
    "classic chinese chair": "dining chair", "dressing chair": "stool", "folding chair": "dining chair",
    "armchair": "armchair", "three-seat / multi-seat sofa": "sofa", "three-seat / multi-person sofa": "sofa",
    "loveseat sofa": "sofa", "l-shaped sofa": "sofa", "lazy sofa": "armchair", "chaise longue sofa": "sofa",
    "two-seat sofa": "sofa", "footstool / sofastool / bed end stool / stool": "ottoman", "barstool": "stool",
    "floor lamp": "floor lamp", "wine cabinet": "cabinet", "shoe cabinet": "chest",
}  # fmt: skip
"""The data set's own category names (lower case) in our terms; others go by their words."""


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
        raise CatalogueError("model_info.json is no list of models", where=str(info))
    sources = []
    for row in rows:
        name = row.get("model_id") if isinstance(row, dict) else None
        # A model's name is its folder's: nothing with separators or dots is one.
        if not isinstance(name, str) or not name.replace("-", "").replace("_", "").isalnum() or len(name) > 100:
            continue
        file = next(
            (f for f in (info.parent / name / n for n in ("raw_model.obj", "normalized_model.obj")) if f.is_file()),
            None,
        )
        if file is not None:
            raw = file.name == "raw_model.obj"
            given = Given(unit="m" if raw else None, up="y", front="+z")
            sources.append(FileSource(name, _category(row), file, root, LICENCE, given))
    return sources


def _category(row: dict[str, Any]) -> str:
    for key in ("category", "super-category"):
        said = str(row.get(key) or "").strip().lower()
        if said in CATEGORIES:
            return CATEGORIES[said]
    return category_of(f"{row.get('category') or ''} {row.get('super-category') or ''}")

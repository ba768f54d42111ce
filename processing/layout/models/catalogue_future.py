"""A 3D-FUTURE folder as its users have it: `model_info.json`, and a folder a model with OBJ, texture and picture."""

from __future__ import annotations

import json
import re
from pathlib import Path
from typing import Any

from processing.errors import CatalogueError
from processing.layout.models.catalogue_folder import FileSource
from processing.layout.models.mesh_pose import Given

# Which kind of furniture a name means: `loungeSofaLong`, `bedside table 2`, `Three-Seat / Multi-seat Sofa`.


RULES: tuple[tuple[tuple[str, ...], str], ...] = (
    # The first rule all of whose words are in the name holds; longer descriptions go first.
    (("kitchen",), "kitchen"),
    (("bathroom",), "bathroom"),
    (("bath",), "bathroom"),
    (("toilet",), "bathroom"),
    (("bunk",), "bunk bed"),
    (("bedside",), "nightstand"),
    (("nightstand",), "nightstand"),
    (("night", "stand"), "nightstand"),
    (("cabinet", "bed"), "nightstand"),
    (("bed", "single"), "single bed"),
    (("bed", "king"), "king bed"),
    (("bed",), "bed"),
    (("tv", "stand"), "tv stand"),
    (("television", "cabinet"), "tv stand"),
    (("tv", "cabinet"), "tv stand"),
    (("television",), "tv"),
    (("tv",), "tv"),
    (("bookcase",), "bookshelf"),
    (("bookshelf",), "bookshelf"),
    (("shelves",), "bookshelf"),
    (("shelf",), "bookshelf"),
    (("books",), "books"),
    (("wardrobe",), "wardrobe"),
    (("closet",), "wardrobe"),
    (("ottoman",), "ottoman"),
    (("footstool",), "ottoman"),
    (("stool",), "stool"),
    (("bench",), "bench"),
    (("pillow",), "pillow"),
    (("lamp", "floor"), "floor lamp"),
    (("lamp",), "lamp"),
    (("desk", "chair"), "desk chair"),
    (("office", "chair"), "desk chair"),
    (("swivel", "chair"), "desk chair"),
    (("armchair",), "armchair"),
    (("lounge", "chair"), "armchair"),
    (("lounge", "design", "chair"), "armchair"),
    (("relax", "chair"), "armchair"),
    (("sofa",), "sofa"),
    (("couch",), "sofa"),
    (("loveseat",), "sofa"),
    (("dining", "table"), "dining table"),
    (("coffee", "table"), "coffee table"),
    (("tea", "table"), "coffee table"),
    (("side", "table"), "side table"),
    (("corner", "table"), "side table"),
    (("desk",), "desk"),
    (("chair",), "dining chair"),
    (("table",), "dining table"),
    (("sideboard",), "chest"),
    (("dresser",), "chest"),
    (("drawer",), "chest"),
    (("drawers",), "chest"),
    (("chest",), "chest"),
    (("cupboard",), "chest"),
    (("cabinet",), "cabinet"),
    (("rug",), "rug"),
    (("carpet",), "rug"),
    (("plant",), "plant"),
)
OTHER = "other"
APART = {"desklamp": "desk lamp", "bedside": "bedside", "nightstand": "nightstand"}
"""Words that are written as one and are two."""


def category_of(name: str) -> str:
    """Return the category that a file's or model's name tells; `other` where it tells none."""
    spaced = re.sub(r"(?<=[a-z])(?=[A-Z])|(?<=[A-Za-z])(?=\d)|[^A-Za-z0-9]+", " ", name).lower()
    words = {part for word in spaced.split() for part in APART.get(word, word).split()}
    words |= {word[:-1] for word in words if word.endswith("s") and len(word) > 3}
    words |= {"plant" for word in words if word.endswith("plant")} | {
        "bed" for word in words if re.match(r"bed(with|double)", word)
    }
    for needed, category in RULES:
        if words.issuperset(needed):
            return category
    return OTHER


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

"""Which kind of furniture a name means: `loungeSofaLong`, `bedside table 2`, `Three-Seat / Multi-seat Sofa`."""

from __future__ import annotations

import re

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

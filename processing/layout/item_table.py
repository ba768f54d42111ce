"""The built-in kinds of furniture and the sets made of them. Sizes are common ones of the trade, in metres."""

from __future__ import annotations

from processing.layout.items import ItemSpec, UseZone

_BED_ZONES = (UseZone("left", "bed_side"), UseZone("right", "bed_side"), UseZone("front", "bed_foot"))


def _bed(name: str, width_m: float, length_m: float, sides_rule: str) -> ItemSpec:
    return ItemSpec(name, (width_m, length_m, 0.85), zones=_BED_ZONES, sides_rule=sides_rule)


def _front(rule: str, less_m: float = 0.0) -> tuple[UseZone, ...]:
    return (UseZone("front", rule, less_m),)


_ALL = (
    _bed("bed", 1.4, 2.0, "bed_sides"),
    _bed("single bed", 0.9, 2.0, "bed_single_sides"),
    _bed("king bed", 1.8, 2.0, "bed_sides"),
    ItemSpec("nightstand", (0.45, 0.40, 0.50), group_with="bed", bound=True),
    ItemSpec("wardrobe", (1.2, 0.60, 2.0), zones=_front("wardrobe_front")),
    ItemSpec("chest", (0.9, 0.45, 0.85), zones=_front("chest_front")),
    ItemSpec("bookshelf", (0.8, 0.30, 1.8), zones=_front("shelf_front")),
    ItemSpec("desk", (1.2, 0.60, 0.74), zones=_front("desk_back")),
    ItemSpec("desk chair", (0.55, 0.55, 0.95), placement="free", group_with="desk", bound=True),
    ItemSpec("sofa", (1.8, 0.85, 0.80), zones=_front("seat_front")),
    ItemSpec("armchair", (0.80, 0.80, 0.85), zones=_front("seat_front"), group_with="sofa"),
    ItemSpec("coffee table", (1.0, 0.55, 0.42), placement="free", group_with="sofa", bound=True),
    ItemSpec("tv stand", (1.4, 0.40, 0.50), zones=_front("tv_front")),
    ItemSpec("tv", (1.10, 0.08, 0.65), base_m=0.50, placement="on", group_with="tv stand"),
    ItemSpec("dining table", (1.4, 0.80, 0.74), placement="free"),
    ItemSpec(
        "dining chair",
        (0.45, 0.50, 0.85),
        placement="free",
        zones=(UseZone("back", "dining_edge", less_m=0.50),),
        group_with="dining table",
        bound=True,
    ),
    ItemSpec("rug", (2.0, 1.4, 0.012), placement="free"),
    ItemSpec("floor lamp", (0.35, 0.35, 1.6), placement="wall"),
    ItemSpec("plant", (0.40, 0.40, 0.8), placement="wall"),
)

KINDS: dict[str, ItemSpec] = {spec.category: spec for spec in _ALL}

SETS: dict[str, str] = {
    "bedroom": "bed, 2 nightstand, wardrobe, chest, desk, desk chair, plant",
    "living": "sofa, armchair, coffee table, tv stand, tv, bookshelf, floor lamp, rug",
    "dining": "dining table, 4 dining chair, chest, bookshelf, plant",
    "office": "desk, desk chair, 2 bookshelf, armchair, chest, floor lamp, plant",
}

OTHER_NAMES = {
    "couch": "sofa",
    "double bed": "bed",
    "queen bed": "bed",
    "shelf": "bookshelf",
    "bookcase": "bookshelf",
    "bedside table": "nightstand",
    "night stand": "nightstand",
    "closet": "wardrobe",
    "dresser": "chest",
    "chest of drawers": "chest",
    "sideboard": "chest",
    "television": "tv",
    "tv cabinet": "tv stand",
    "office chair": "desk chair",
    "chair": "dining chair",
    "table": "dining table",
    "carpet": "rug",
    "lamp": "floor lamp",
}

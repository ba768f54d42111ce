"""What the classes of published networks are to daylit: ADE20K's 150 and Pascal VOC's 21, in their index order.

Outdoor classes (ship, hill, traffic light) are seen indoors only through a window, so they are WINDOW (the trick of
Zhi et al. 2022). A class that may be several of ours spreads its probability evenly among them.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from processing.errors import SegmenterError
from processing.ground.arrays import Floats
from processing.segmentation.evidence import SceneClass

ADE20K = tuple(
    """wall, building, sky, floor, tree, ceiling, road, bed, windowpane, grass, cabinet, sidewalk, person, earth, door,
    table, mountain, plant, curtain, chair, car, water, painting, sofa, shelf, house, sea, mirror, rug, field, armchair,
    seat, fence, desk, rock, wardrobe, lamp, bathtub, railing, cushion, base, box, column, signboard, chest of drawers,
    counter, sand, sink, skyscraper, fireplace, refrigerator, grandstand, path, stairs, runway, case, pool table,
    pillow, screen door, stairway, river, bridge, bookcase, blind, coffee table, toilet, flower, book, hill, bench,
    countertop, stove, palm, kitchen island, computer, swivel chair, boat, bar, arcade machine, hovel, bus, towel,
    light, truck, tower, chandelier, awning, streetlight, booth, television, airplane, dirt track, apparel, pole, land,
    bannister, escalator, ottoman, bottle, buffet, poster, stage, van, ship, fountain, conveyer belt, canopy, washer,
    plaything, swimming pool, stool, barrel, basket, waterfall, tent, bag, minibike, cradle, oven, ball, food, step,
    tank, trade name, microwave, pot, animal, bicycle, lake, dishwasher, screen, blanket, sculpture, hood, sconce, vase,
    traffic light, tray, ashcan, fan, pier, crt screen, plate, monitor, bulletin board, shower, radiator, glass, clock,
    flag""".replace("\n    ", " ").split(", ")
)
"""The 150 names, index 0..149 (dataset label minus 1: label 0 is "other")."""

VOC = tuple(
    """background, aeroplane, bicycle, bird, boat, bottle, bus, car, cat, chair, cow, diningtable, dog, horse,
    motorbike, person, pottedplant, sheep, sofa, train, tvmonitor""".replace("\n    ", " ").split(", ")
)
"""The 21 names, index 0..20."""

_OUTDOORS = """building, sky, tree, road, grass, sidewalk, earth, mountain, car, water, house, sea, field, fence, rock,
    sand, skyscraper, grandstand, path, runway, river, bridge, hill, palm, boat, hovel, bus, truck, tower, awning,
    streetlight, airplane, dirt track, land, van, ship, fountain, canopy, swimming pool, waterfall, tent, minibike,
    lake, traffic light, pier"""
_FURNITURE = """bed, cabinet, person, table, plant, chair, sofa, shelf, armchair, seat, desk, wardrobe, lamp, cushion,
    base, box, chest of drawers, refrigerator, case, pool table, pillow, bookcase, coffee table, flower, book, bench,
    computer, swivel chair, arcade machine, television, apparel, ottoman, bottle, buffet, conveyer belt, washer,
    plaything, stool, barrel, basket, bag, cradle, ball, food, microwave, pot, animal, bicycle, screen, blanket,
    sculpture, vase, tray, ashcan, crt screen, plate, monitor, glass, towel, tank"""
_FIXTURES = """curtain, painting, mirror, rug, bathtub, railing, signboard, counter, sink, fireplace, stairs, stairway,
    blind, toilet, countertop, stove, kitchen island, bar, light, chandelier, booth, pole, bannister, escalator, poster,
    stage, oven, step, trade name, dishwasher, hood, sconce, fan, bulletin board, shower, radiator, clock, flag"""


def _names(text: str) -> list[str]:
    return [" ".join(name.split()) for name in text.split(",")]


Table = Mapping[str, tuple[SceneClass, ...]]
"""A network's class name -> ours; several: it may be any of them."""

ADE20K_TABLE: Table = {
    "wall": (SceneClass.WALL,),
    "column": (SceneClass.WALL,),
    "floor": (SceneClass.FLOOR,),
    "ceiling": (SceneClass.CEILING,),
    "windowpane": (SceneClass.WINDOW,),
    "door": (SceneClass.DOOR,),
    "screen door": (SceneClass.DOOR,),
    **dict.fromkeys(_names(_OUTDOORS), (SceneClass.WINDOW,)),
    **dict.fromkeys(_names(_FURNITURE), (SceneClass.FURNITURE,)),
    **dict.fromkeys(_names(_FIXTURES), (SceneClass.FIXTURE,)),
}
"""Cabinets and shelves are FURNITURE, though some are built in: what is missed stays in the picture for good."""

_NOT_FURNITURE = tuple(kind for kind in SceneClass if kind is not SceneClass.FURNITURE)
VOC_TABLE: Table = {
    "background": _NOT_FURNITURE,
    **dict.fromkeys(
        _names("aeroplane, boat, bus, car, cow, horse, motorbike, sheep, train, bird"), (SceneClass.WINDOW,)
    ),
    **dict.fromkeys(
        _names("bicycle, bottle, cat, chair, diningtable, dog, person, pottedplant, sofa, tvmonitor"),
        (SceneClass.FURNITURE,),
    ),
}
"""VOC knows no floor, wall or window: its background is anything but furniture."""

KNOWN: Mapping[str, tuple[tuple[str, ...], Table]] = {"ade20k": (ADE20K, ADE20K_TABLE), "voc": (VOC, VOC_TABLE)}
"""Names in index order and their table, by data set."""


def class_matrix(names: Sequence[str], table: Table) -> Floats:
    """Return (len(names), len(SceneClass)): row n spreads class n's probability over ours; rows sum to 1.

    Raises
    ------
    SegmenterError
        A name that the table does not know; all such are named.
    """
    unknown = [name for name in names if not table.get(name)]
    if unknown:
        raise SegmenterError(
            f"classes without a meaning: {', '.join(unknown[:8])}" + (" ..." if len(unknown) > 8 else ""),
            likely="another data set's names, or a background class that is not listed",
            advice="say in the contract's meanings what they are",
            classes=unknown,
        )
    matrix = np.zeros((len(names), len(SceneClass)), dtype=np.float32)
    for row, name in enumerate(names):
        for kind in table[name]:
            matrix[row, kind] = 1 / len(table[name])
    return matrix

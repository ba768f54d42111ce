"""The use zones reported are those that can be walked to."""

from __future__ import annotations

import math

from benchmarks.layout.raster import Raster
from processing.layout.arrange import arrange
from processing.layout.items import KINDS, Item, parse_items
from processing.layout.plan import Door, FloorPlan, make_plan
from processing.layout.rules import built_in_rules
from processing.layout.solver.poses import Stand, with_reached_sides
from processing.layout.solver.units import zone_choices
from processing.layout.verify import Judge

TIGHT = built_in_rules().named("tight")
FROM_THE_LEFT = make_plan(((0, 0), (4, 0), (4, 3), (0, 3)), doors=(Door(3, 1.0, 1.8),))


def test_a_side_behind_the_bed_is_not_reported() -> None:
    bed = Item("bed", KINDS["bed"])
    _, left, right = zone_choices(bed, TIGHT)
    # Its head at the right wall: the left side is cut off by a wardrobe, the right one is open.
    stands = [
        Stand(bed, 4 - bed.spec.size_m[1] / 2, 1.3, math.pi / 2, "bed", 1, left),
        Stand(Item("wardrobe", KINDS["wardrobe"]), 1.35, 0.3, 0.0, "wardrobe", 0),
    ]
    judge = Judge(FROM_THE_LEFT, TIGHT)
    reported = with_reached_sides(stands, judge, TIGHT)
    assert reported[0].zones == right
    assert reported[1] == stands[1]
    alone = with_reached_sides([stands[0]], judge, TIGHT)
    assert alone[0].zones == left


def test_arrangements_list_sides_that_the_raster_reaches() -> None:
    doors = (Door(3, 0.018, 0.72), Door(0, 0.8136, 2.7636), Door(3, 1.2504, 2.202))
    plan: FloorPlan = make_plan(((0, 3.3744), (0, 0), (3.2808, 0), (3.2808, 3.3744)), doors=doors)
    items = parse_items("bed, wardrobe, chest, 2 nightstand, plant")
    result = arrange(plan, items, TIGHT, n=7, seed=0)
    raster = Raster(plan, TIGHT)
    assert result.arrangements
    assert [raster.faults(one) for one in result.arrangements] == [[] for _ in result.arrangements]

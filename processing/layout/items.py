"""Furniture as the solver sees it: a footprint, a height interval and use zones; no meshes (`model` names one).

An item's local frame: origin on the floor in the middle of its footprint, x along its width, +y to its front (away from
the wall it stands at), z up. Its footprint is the rectangle |x| <= width/2, |y| <= depth/2.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Literal, TypeAlias

from processing.errors import ItemError

Side: TypeAlias = Literal["front", "back", "left", "right"]
Placement: TypeAlias = Literal["wall", "free", "on"]
"""`wall`: back to a wall where one is free; `free`: anywhere; `on`: on top of another item (a TV on its stand)."""
MAX_SIZE_M = 6.0
RUG_HEIGHT_M = 0.03


@dataclass(frozen=True)
class UseZone:
    """Floor kept free beside an item, as deep as the rule set says.

    `left` and `right` are the item's own, looking along +y: left is -x.
    """

    side: Side
    rule: str
    """Key of the rule set that gives the depth in metres; a depth of 0 asks for nothing."""
    less_m: float = 0.0
    """Taken off that depth: a dining chair's zone is counted from the table's edge."""


@dataclass(frozen=True)
class ItemSpec:
    """A kind of furniture of one size."""

    category: str
    size_m: tuple[float, float, float]
    """Width along its back, depth, height."""
    base_m: float = 0.0
    """Height of its underside above the floor."""
    placement: Placement = "wall"
    zones: tuple[UseZone, ...] = ()
    sides_rule: str = ""
    """Key of the number of its left and right zones that must be free; empty: all."""
    group_with: str = ""
    """Category that it belongs to: a nightstand to a bed."""
    bound: bool = False
    """It is of no use away from what it belongs to, and stands within `together` metres of it."""
    model: str = ""
    """Key of its mesh in the catalogue; empty: the category's built-in one."""
    handed: bool = False
    """Left and right differ (a corner sofa), so that mirrored rooms get arrangements of their own."""

    @property
    def is_rug(self) -> bool:
        """Tell whether other items may stand on it."""
        return self.category == "rug" or self.size_m[2] <= RUG_HEIGHT_M

    @property
    def footprint_m2(self) -> float:
        """Return the footprint's area."""
        return self.size_m[0] * self.size_m[1]

    @property
    def top_m(self) -> float:
        """Return the height of its top above the floor."""
        return self.base_m + self.size_m[2]

    def checked(self) -> ItemSpec:
        """Return itself; raise `ItemError` where a size cannot be right."""
        if not all(math.isfinite(v) and 0 < v <= MAX_SIZE_M for v in self.size_m):
            raise ItemError(
                f"size {self.size_m} m: each must be over 0 and at most {MAX_SIZE_M:g} m", where=self.category
            )
        if not (math.isfinite(self.base_m) and 0 <= self.base_m < 5):
            raise ItemError(f"its underside at {self.base_m} m", where=self.category)
        return self


@dataclass(frozen=True)
class Item:
    """One piece to be placed."""

    id: str
    spec: ItemSpec

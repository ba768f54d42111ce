"""Why a piece has no place: the rule, the obstacle, and the width missing."""

from __future__ import annotations

from collections.abc import Sequence

from processing.layout.arrangement import NotPlaced
from processing.layout.canonical import Frame
from processing.layout.items import Item
from processing.layout.plan import FloorPlan
from processing.layout.poses import Stand
from processing.layout.rules import RuleSet
from processing.layout.search import Search


def too_small(plan: FloorPlan, items: Sequence[Item], rules: RuleSet) -> None:
    """Raise `RoomTooSmallError` where the largest piece finds no place in the bare floor."""


def not_placed(item: Item, placed: Sequence[Stand], search: Search, frame: Frame) -> NotPlaced:
    """Return the reason of one piece beside those that are placed."""
    return NotPlaced(id=item.id, category=item.spec.category, rule="?", reason="?")

"""The space that an item takes: a few upright prisms, so that a chair may stand with its seat under a table's top."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import lru_cache

from shapely.geometry import Point as Spot
from shapely.geometry import Polygon

from mocks.rooms.model import Item

ROUND = frozenset(
    {"floor lamp", "table lamp", "plant", "basket", "vase", "bottle", "bowl", "wall clock", "toy ball", "tripod"}
)
"""Kinds with a round footprint."""
Box = tuple[float, float, float, float, float, float]
"""x from and to, y from and to, height from and to, in the item's own axes."""


@dataclass(frozen=True)
class Volume:
    """An upright prism."""

    floor: Polygon
    low_m: float
    high_m: float

    def meets(self, other: Volume, slack_m: float = 0.004) -> bool:
        """Return whether two prisms share space, beyond touching."""
        if self.low_m > other.high_m - slack_m or other.low_m > self.high_m - slack_m:
            return False
        return bool(self.floor.intersects(other.floor)) and self.floor.intersection(other.floor).area > 1e-4


@lru_cache(maxsize=4096)
def footprint(item: Item) -> Polygon:
    """Return the floor below an item."""
    if item.kind in ROUND - {"wall clock"} or (item.kind != "wall clock" and dict(item.options).get("round", 0.0)):
        return Spot(item.position_m[:2]).buffer(item.size_m[0] / 2, quad_segs=6)
    return Polygon(item.corners())


@lru_cache(maxsize=4096)
def volumes(item: Item) -> tuple[Volume, ...]:
    """Return the prisms that hold an item."""
    boxes = _boxes(item)
    base = item.position_m[2]
    if not boxes:
        return (Volume(footprint(item), base, base + item.size_m[2]),)
    return tuple(Volume(_turned(item, box), base + box[4], base + box[5]) for box in boxes)


def _turned(item: Item, box: Box) -> Polygon:
    c, s = math.cos(item.turn_rad), math.sin(item.turn_rad)
    x0, x1, y0, y1 = box[:4]
    px, py, _ = item.position_m
    return Polygon([(px + c * u - s * v, py + s * u + c * v) for u, v in ((x0, y0), (x1, y0), (x1, y1), (x0, y1))])


def _boxes(item: Item) -> list[Box]:
    """Return the boxes of kinds that leave room below or above themselves; none for plain ones."""
    w, d, h = item.size_m[0] / 2, item.size_m[1] / 2, item.size_m[2]
    if item.kind == "bed":
        return [(-w, w, -d, d, 0.0, 0.56), (-w, w, d - 0.62, d, 0.0, min(h, 0.85)), (-w, w, d - 0.11, d, 0.0, h)]
    if item.kind in ("sofa", "armchair"):
        arms: list[Box] = [(-w, -w + 0.22, -d, d, 0.0, 0.65), (w - 0.22, w, -d, d, 0.0, 0.65)]
        return [(-w, w, -d, d, 0.0, 0.465), (-w, w, d - 0.42, d, 0.0, h), *arms]
    if item.kind == "chair":
        return [(-w, w, -d, d, 0.0, 0.475), (-w, w, d - 0.16, d, 0.0, h)]
    if item.kind == "swivel chair":
        return [(-w, w, -d, d, 0.0, 0.69), (-w, w, d - 0.22, d, 0.0, h)]
    if item.kind == "desk":
        return _desk(item)
    if item.kind == "dining table":
        return _dining_table(item)
    if item.kind == "meter board":
        return [(-w, w, -0.02, 0.03, h - 0.5, h), (-0.19, 0.19, -d, d, 0.0, 0.3), (-0.03, 0.03, -0.03, 0.03, 0.0, h)]
    return []


def _desk(item: Item) -> list[Box]:
    w, d, h = item.size_m[0] / 2, item.size_m[1] / 2, item.size_m[2]
    top: Box = (-w, w, -d, d, h - 0.03, h)
    sides: list[Box] = [(-w, -w + 0.08, -d, d, 0.0, h), (w - 0.08, w, -d, d, 0.0, h), (-w, w, d - 0.07, d, 0.0, h)]
    if item.seed % 3 == 1:
        return [top, *sides]
    unit: Box = (w - 0.52, w, -d, d, 0.0, h) if item.seed % 2 else (-w, -w + 0.52, -d, d, 0.0, h)
    return [top, *sides, unit]


def _dining_table(item: Item) -> list[Box]:
    w, d, h = item.size_m[0] / 2, item.size_m[1] / 2, item.size_m[2]
    top: Box = (-w, w, -d, d, h - 0.125, h)
    if dict(item.options).get("round", 0.0):
        foot = 0.31 * item.size_m[0]
        return [top, (-foot, foot, -foot, foot, 0.0, 0.06), (-0.12, 0.12, -0.12, 0.12, 0.0, h)]
    if item.seed % 3 == 0:
        return [top, *((s * (w - 0.18) - 0.04, s * (w - 0.18) + 0.04, -d, d, 0.0, h) for s in (-1, 1))]
    legs = [(sx, sy) for sx in (-1, 1) for sy in (-1, 1)]
    return [
        top,
        *(
            (sx * w - 0.1 * (sx > 0), sx * w + 0.1 * (sx < 0), sy * d - 0.1 * (sy > 0), sy * d + 0.1 * (sy < 0), 0.0, h)
            for sx, sy in legs
        ),
    ]

"""What is wrong with a furnished room: things through walls, each other, doors, windows, the camera or the meter."""

import math
from dataclasses import dataclass
from functools import lru_cache
from typing import Self

from shapely.geometry import LineString, Polygon
from shapely.geometry import Point as Spot

from mocks.rooms.model import Item, Plan, Role
from mocks.rooms.plan.forms import FLUSH_M, door_swing, fixture_floor

# The space that an item takes: a few upright prisms, so that a chair may stand with its seat under a table's top.

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

    def meets(self, other: Self, slack_m: float = 0.004) -> bool:
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


CAMERA_FREE_M = 0.65  # nothing stands nearer to the camera's axis, but the tripod
WINDOW_FREE_M = 0.45  # depth of the strip before a window where nothing rises above the sill
BOARD_NEAR_M, BOARD_FAR_M = 1.0, 2.0
BOARD_TURN_RAD = math.radians(35.0)  # between the board's normal and the way to the camera
UNDERFOOT = frozenset({"rug"})  # kinds that others may stand on: feet sink into the pile


def check_items(plan: Plan, items: tuple[Item, ...]) -> list[str]:
    """Return what is wrong; an empty list for a room as it should be."""
    found = [f"{item.kind} {item.instance}: {problem}" for item in items for problem in item_problems(plan, item)]
    for k, a in enumerate(items):
        found += [f"{a.kind} {a.instance} and {b.kind} {b.instance}: overlap" for b in items[k + 1 :] if overlap(a, b)]
    if sorted(item.instance for item in items) != list(range(1, len(items) + 1)):
        found.append(f"instances are not 1 to {len(items)}")
    for kind in ("tripod", "meter board"):
        if sum(item.kind == kind for item in items) != 1:
            found.append(f"not one {kind}")
    for board in (item for item in items if item.kind == "meter board"):
        found += [f"meter board hidden by {i.kind} {i.instance}" for i in items if hides_board(board, i)]
    return found


def item_problems(plan: Plan, item: Item) -> list[str]:
    """Return what is wrong with an item by itself in the room."""
    floor, found = footprint(item), []
    if not ground(plan).covers(floor):
        found.append("outside the room")
    low, high = item.position_m[2], item.position_m[2] + item.size_m[2]
    if high > plan.height_m or low < 0.0:
        found.append("above the ceiling or below the floor")
    if any(low < door.height_m and arc.intersects(floor) for door, arc in zip(plan.doors, swings(plan), strict=True)):
        found.append("in the way of a door")
    if any(high > sill and low < head and strip.intersects(floor) for strip, sill, head in window_strips(plan)):
        found.append("in front of a window")
    if item.kind not in UNDERFOOT and item.kind != "tripod" and floor.distance(Spot(0.0, 0.0)) < CAMERA_FREE_M:
        found.append("too near the camera")
    if any(v.meets(f) for v in volumes(item) for f in fixture_volumes(plan)):
        found.append("in a fixture")
    if item.kind == "meter board":
        found += _board_problems(item)
    return found


def _board_problems(board: Item) -> list[str]:
    x, y, _ = board.position_m
    found = []
    if not BOARD_NEAR_M <= math.hypot(x, y) <= BOARD_FAR_M:
        found.append("not 1 to 2 m from the camera")
    facing = (math.sin(board.turn_rad), -math.cos(board.turn_rad))
    if -(x * facing[0] + y * facing[1]) / math.hypot(x, y) < math.cos(BOARD_TURN_RAD):
        found.append("turned from the camera")
    return found


def overlap(a: Item, b: Item) -> bool:
    """Return whether two items are in each other; what stands on a rug is not."""
    if (a.kind in UNDERFOOT) != (b.kind in UNDERFOOT):
        rug, other = (a, b) if a.kind in UNDERFOOT else (b, a)
        return other.role is Role.CLUTTER and other.position_m[2] < 1e-6 and rug.size_m[2] > 0.02
    reach = (math.hypot(*a.size_m[:2]) + math.hypot(*b.size_m[:2])) / 2
    if math.hypot(a.position_m[0] - b.position_m[0], a.position_m[1] - b.position_m[1]) > reach:
        return False
    return any(v.meets(w) for v in volumes(a) for w in volumes(b))


def hides_board(board: Item, item: Item) -> bool:
    """Return whether an item stands between the camera and the face of the meter board."""
    if item.kind in ("tripod", "meter board"):
        return False
    middle = (board.position_m[0], board.position_m[1])
    along = (math.cos(board.turn_rad) * board.size_m[0] / 2, math.sin(board.turn_rad) * board.size_m[0] / 2)
    edges = [(middle[0] - along[0], middle[1] - along[1]), (middle[0] + along[0], middle[1] + along[1])]
    sight = Polygon([(0.0, 0.0), *edges]).buffer(0.02)
    far = math.hypot(*middle)
    low = board.position_m[2] + board.size_m[2] - 0.5
    return any(_rises_above(v, sight, middle, far, low) for v in volumes(item))


def _rises_above(volume: Volume, sight: Polygon, middle: tuple[float, float], far: float, low: float) -> bool:
    """Return whether a prism reaches into the lowest rays from the camera (1.6 m) to the board."""
    shared = volume.floor.intersection(sight)
    if shared.is_empty:
        return False
    x0, y0, x1, y1 = shared.bounds
    nearest = max((x * middle[0] + y * middle[1]) / far**2 for x in (x0, x1) for y in (y0, y1))
    ray = 1.6 + min(max(nearest, 0.0), 1.0) * (low - 1.6)
    return bool(volume.high_m > ray)


@lru_cache(maxsize=64)
def ground(plan: Plan) -> Polygon:
    """Return the floor."""
    return Polygon(plan.polygon)


@lru_cache(maxsize=64)
def swings(plan: Plan) -> tuple[Polygon, ...]:
    """Return the floor that each door needs."""
    return tuple(door_swing(door, plan) for door in plan.doors)


@lru_cache(maxsize=64)
def window_strips(plan: Plan) -> tuple[tuple[Polygon, float, float], ...]:
    """Return for each window the floor before it, its sill and its head."""
    found = []
    for w in plan.windows:
        before = Polygon(plan.floor_along(w.wall, (w.start_m, w.start_m + w.width_m), (0.0, WINDOW_FREE_M)))
        found.append((before, w.sill_m, w.sill_m + w.height_m))
    return tuple(found)


@lru_cache(maxsize=64)
def fixture_volumes(plan: Plan) -> tuple[Volume, ...]:
    """Return the space that fixtures take, sockets and switches apart."""
    return tuple(
        Volume(
            fixture_floor(f, plan) if f.wall >= 0 else Spot(f.centre).buffer(f.width_m / 2),
            f.bottom_m,
            f.bottom_m + f.height_m,
        )
        for f in plan.fixtures
        if f.wall < 0 or f.depth_m >= FLUSH_M
    )


def sees_window(plan: Plan, board: Item) -> bool:
    """Return whether a window lies straight behind the meter board, seen from the camera."""
    x, y, _ = board.position_m
    ray = LineString([(0.0, 0.0), (6 * x, 6 * y)])
    return any(strip.buffer(0.2).intersects(ray) for strip, _, _ in window_strips(plan))

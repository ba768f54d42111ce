"""A room being furnished: what stands there already, and whether one more thing fits."""

import math
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass, field, replace
from functools import lru_cache

import numpy as np
from shapely.geometry import Point as Spot
from shapely.geometry import Polygon

from mocks.rooms.furnish.check import footprint, hides_board, item_problems, overlap
from mocks.rooms.model import Item, Plan, Point, Role
from mocks.rooms.plan.forms import WallSpan, free_spans
from mocks.worlds.light import Vector

WALL_GAP_M = 0.03  # between a wall and what stands against it: the skirting board
HANGING_GAP_M = 0.004  # chosen: no two surfaces in one plane
TALL_M, TALL_AWAY_M = 1.4, 0.95  # a photographer does not set up right beside a wardrobe

Score = Callable[[Item], float]
Options = tuple[tuple[str, float], ...]


@dataclass
class Arrangement:
    """The items so far. ``messy`` is 0 for tidy people and 1 for the other kind."""

    plan: Plan
    rng: np.random.Generator
    messy: float = 0.3
    items: list[Item] = field(default_factory=list)
    kept_free: list[Polygon] = field(default_factory=list)
    """Floor where nothing else is to stand: before cupboards, beside beds."""

    def draw(self, low: float, high: float) -> float:
        """Return a number between two, rounded to a millimetre."""
        return round(float(self.rng.uniform(low, high)), 3)

    def chance(self, probability: float) -> bool:
        """Return true with a probability."""
        return bool(self.rng.random() < probability)

    def item(
        self,
        kind: str,
        size_m: Vector,
        at: Vector,
        turn_rad: float = 0.0,
        options: Options = (),
        role: Role = Role.FURNITURE,
    ) -> Item:
        """Return a new item, not yet placed."""
        return Item(kind, role, len(self.items) + 1, at, size_m, turn_rad, int(self.rng.integers(1, 2**31)), options)

    def fits(self, item: Item) -> bool:
        """Return whether an item would cause no problem and stand in no way."""
        if item_problems(self.plan, item) or any(overlap(item, other) for other in self.items):
            return False
        if any(hides_board(other, item) for other in self.items if other.kind == "meter board"):
            return False
        floor = footprint(item)
        if item.size_m[2] > TALL_M and item.role is Role.FURNITURE and floor.distance(Spot(0.0, 0.0)) < TALL_AWAY_M:
            return False
        on_floor = item.position_m[2] < 0.3 and item.kind != "rug"
        return not (on_floor and any(zone.intersects(floor) for zone in self.kept_free))

    def add(self, item: Item) -> Item | None:
        """Place an item if it fits; return it as placed."""
        if not self.fits(item):
            return None
        placed = replace(item, instance=len(self.items) + 1)
        self.items.append(placed)
        return placed

    def first(self, items: Iterable[Item]) -> Item | None:
        """Place the first of some items that fits, none drawn after it; return it as placed."""
        return next(filter(None, map(self.add, items)), None)

    def keep_free(self, item: Item, front_m: float, side_m: float = 0.0) -> None:
        """Keep the floor before an item (and beside it) free."""
        w, d = item.size_m[0] / 2 + side_m, item.size_m[1] / 2
        corners = ((-w, -d - front_m), (w, -d - front_m), (w, -d), (-w, -d))
        self.kept_free.append(Polygon([beside(item, u, v) for u, v in corners]))

    def wall_places(
        self, size_m: Vector, low_m: float = 0.0, tries: int = 14, away_m: float = WALL_GAP_M
    ) -> Iterator[tuple[Point, float]]:
        """Yield places (and turns) with the back to a wall, where the wall is free over the height, in random order.

        Wide stretches come more often; for what hangs, those that fill more of the camera's view.
        """
        hanging = low_m > 0.0
        spans = [
            (wall, span)
            for wall in range(len(self.plan.polygon))
            for span in _spans(self.plan, wall, flush_too=hanging)
            if span.width_m >= size_m[0] + 0.06 and span.bottom_m <= low_m and span.top_m >= low_m + size_m[2]
        ]
        if not spans:
            return
        weights = np.array([_seen_rad(self.plan, *one) if hanging else one[1].width_m for one in spans])
        for _ in range(tries):
            wall, span = spans[int(self.rng.choice(len(spans), p=weights / weights.sum()))]
            slack = span.width_m - size_m[0] - 0.06
            # People put things into corners and middles rather than anywhere.
            part = float(self.rng.choice([0.0, 0.5, 1.0, self.rng.random()]))
            along = span.start_m + 0.03 + size_m[0] / 2 + part * slack
            _, inward = self.plan.wall_axes(wall)
            yield self.plan.on_wall(wall, along, away_m + size_m[1] / 2), math.atan2(inward[0], -inward[1])

    def against_wall(
        self, kind: str, size_m: Vector, score: Score | None = None, front_m: float = 0.0, role: Role = Role.FURNITURE
    ) -> Item | None:
        """Place something with its back to a wall, at the place of the best score; keep ``front_m`` before it free."""
        model = self.item(kind, size_m, (0.0, 0.0, 0.0), role=role)
        found = []
        for (x, y), turn in self.wall_places(size_m):
            item = replace(model, position_m=(x, y, 0.0), turn_rad=turn)
            if self.fits(item):
                found.append(item)
                if score is None:
                    break
        if not found:
            return None
        placed = self.add(max(found, key=score) if score else found[0])
        if placed and front_m:
            self.keep_free(placed, front_m)
        return placed

    def hang(self, kind: str, size_m: Vector, low_m: float) -> Item | None:
        """Hang something on any free wall."""
        model = self.item(kind, size_m, (0.0, 0.0, low_m), role=Role.CLUTTER)
        places = self.wall_places(size_m, low_m, 10, HANGING_GAP_M)
        return self.first(replace(model, position_m=(*place, low_m), turn_rad=turn) for place, turn in places)

    def hang_over(self, below: Item, kind: str, size_m: Vector, low_m: float) -> Item | None:
        """Hang something on the wall behind an item, over its middle."""
        x, y = beside(below, 0.0, below.size_m[1] / 2 + WALL_GAP_M - HANGING_GAP_M - size_m[1] / 2)
        item = self.item(kind, size_m, (x, y, low_m), below.turn_rad, (), Role.CLUTTER)
        return self.add(item) if self._wall_is_free(item) else None

    def _wall_is_free(self, item: Item) -> bool:
        """Return whether the wall behind a hanging thing is free of openings and fixtures."""
        x, y, low = item.position_m
        for wall in range(len(self.plan.polygon)):
            (x0, y0), _ = self.plan.wall_ends(wall)
            along, inward = self.plan.wall_axes(wall)
            at = (x - x0) * along[0] + (y - y0) * along[1]
            away = (x - x0) * inward[0] + (y - y0) * inward[1]
            if abs(away - HANGING_GAP_M - item.size_m[1] / 2) > 0.005:
                continue
            start, end = at - item.size_m[0] / 2, at + item.size_m[0] / 2
            if any(
                s.start_m <= start and end <= s.end_m and s.bottom_m <= low and low + item.size_m[2] <= s.top_m
                for s in _spans(self.plan, wall, flush_too=True)
            ):
                return True
        return False

    def put_on(
        self, support: Item, kind: str, size_m: Vector, at: Point | None = None, turn_rad: float | None = None
    ) -> Item | None:
        """Put something on top of an item, at ``at`` (fractions of its half width and depth) or anywhere on it."""
        z = support.position_m[2] + support.size_m[2]
        w = max(support.size_m[0] / 2 - size_m[0] / 2 - 0.02, 0.0)
        d = max(support.size_m[1] / 2 - size_m[1] / 2 - 0.02, 0.0)
        if size_m[0] > support.size_m[0] or size_m[1] > support.size_m[1]:
            return None
        round_top = 0.6 if dict(support.options).get("round", 0.0) else 1.0
        for _ in range(6):
            u, v = at or (float(self.rng.uniform(-1, 1)), float(self.rng.uniform(-1, 1)))
            x, y = beside(support, u * w * round_top, v * d * round_top)
            turn = support.turn_rad + (float(self.rng.normal(0, 0.15)) if turn_rad is None else turn_rad)
            placed = self.add(self.item(kind, size_m, (x, y, z), turn, role=Role.CLUTTER))
            if placed or at:
                return placed
        return None

    def on_floor(self, kind: str, size_m: Vector, edge_m: float = 0.35, role: Role = Role.CLUTTER) -> Item | None:
        """Put something on the floor, near a wall or a piece of furniture rather than in the middle."""
        x0, y0, x1, y1 = Polygon(self.plan.polygon).bounds
        model = self.item(kind, size_m, (0.0, 0.0, 0.0), role=role)
        edge = Polygon(self.plan.polygon).exterior
        for _ in range(25):
            x, y = self.draw(x0, x1), self.draw(y0, y1)
            item = replace(model, position_m=(x, y, 0.0), turn_rad=self.draw(0.0, 6.28))
            near = edge.distance(footprint(item)) < edge_m
            if near or any(footprint(o).distance(footprint(item)) < 0.3 for o in self.items if o.size_m[2] > 0.3):
                placed = self.add(item)
                if placed:
                    return placed
        return None


_spans = lru_cache(maxsize=256)(free_spans)


def _seen_rad(plan: Plan, wall: int, span: WallSpan) -> float:
    """Return the angle that a stretch of wall fills as seen from the camera."""
    (x0, y0), (x1, y1) = plan.on_wall(wall, span.start_m), plan.on_wall(wall, span.end_m)
    return abs(math.atan2(x0 * y1 - x1 * y0, x0 * x1 + y0 * y1))


def beside(item: Item, along_m: float, back_m: float) -> Point:
    """Return the floor point at a place in an item's own axes (x along its width, y to its back)."""
    c, s = math.cos(item.turn_rad), math.sin(item.turn_rad)
    x, y, _ = item.position_m
    return (x + c * along_m - s * back_m, y + s * along_m + c * back_m)


def towards(item: Item, place: Point) -> float:
    """Return the cosine between where an item faces and the way to a place."""
    dx, dy = place[0] - item.position_m[0], place[1] - item.position_m[1]
    far = math.hypot(dx, dy)
    return (dx * math.sin(item.turn_rad) - dy * math.cos(item.turn_rad)) / max(far, 1e-9)


def facing(at: Point, target: Point) -> float:
    """Return the turn with which something at a place faces a target."""
    return math.atan2(target[0] - at[0], -(target[1] - at[1]))

"""Places that the user gives: pieces that stand already (pins), and the paper's own form of a position (section 5).

The paper gives an item, a floor edge, ratios along and away from it, and what it faces. Its ratios run over an edge's
length whatever stands there. Ours run over the free set of that edge, so that every pair in [0, 1] is a legal position:
`away` over the distances at which the item has a place at all, `along` over the places at that distance. 0 away is
against the edge.
"""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import shapely
from shapely.affinity import translate
from shapely.geometry import LineString, Polygon
from shapely.geometry.base import BaseGeometry

from processing.errors import PinError
from processing.ground.arrays import Doubles
from processing.layout.items import Item
from processing.layout.plan import FloorPlan
from processing.layout.rules import RuleSet
from processing.layout.solver.field import PERSON_M, Field, Floor, Row, make_field
from processing.layout.solver.free_sets import BODY, MEETS, RUG, SKIN_M, ZONE
from processing.layout.solver.poses import Pose, Stand, outline_rows, wrapped
from processing.layout.solver.units import Rect, zone_choices

TOUCH_M2 = 1e-5  # smaller overlaps of use zones with walls and pieces are contact


def parse_pin(text: str) -> tuple[str, Pose]:
    """Return (item id, pose) of ``"bed=1.2,0.5,90"`` (x, y in metres, degrees); raise `PinError` for other forms."""
    name, _, numbers = text.partition("=")
    try:
        x, y, degrees = (float(v) for v in numbers.split(","))
    except ValueError:
        raise PinError(f"'{text[:60]}' is not ITEM=X,Y,DEGREES") from None
    if not all(math.isfinite(v) for v in (x, y, degrees)):
        raise PinError(f"'{text[:60]}' has an invalid number")
    return name.strip().replace(" ", "-"), (x, y, math.radians(degrees))


def parse_pins(text: str | None) -> dict[str, Pose]:
    """Return the pose of each item of ``"bed=1.2,0.5,90; desk=0,1,0"``."""
    return dict(parse_pin(one) for one in (text or "").split(";") if one.strip())


def pinned_stands(
    items: Sequence[Item], pins: Mapping[str, Pose], plan: FloorPlan, rules: RuleSet
) -> tuple[list[Stand], list[Item]]:
    """Return the pinned pieces in the room's frame, with what stands on them, and the items that are free.

    Raises `PinError` for ids that are not among the items.
    """
    known = {item.id: item for item in items}
    unknown = [name for name in pins if name not in known]
    if unknown:
        raise PinError(f"'{unknown[0]}' is not among the items", advice=f"pin one of: {', '.join(known)}")
    stood = [_stand(known[name], pose) for name, pose in pins.items()]
    free = [item for item in items if item.id not in pins]
    for host in list(stood):
        top = next((i for i in free if i.spec.placement == "on" and i.spec.group_with == host.item.spec.category), None)
        if top is not None:
            free.remove(top)
            raised = Item(top.id, replace(top.spec, base_m=host.item.spec.top_m))
            stood.append(replace(_stand(raised, (host.x_m, host.y_m, host.theta_rad)), group=host.item.id))
    room = Polygon(plan.corners, list(plan.holes))
    return [replace(s, zones=_zones(s, stood, room, rules)) for s in stood], free


def _stand(item: Item, pose: Pose) -> Stand:
    return Stand(item, round(pose[0], 6), round(pose[1], 6), round(pose[2], 9), item.id, None, (), pinned=True)


def _zones(stand: Stand, others: Sequence[Stand], room: Polygon, rules: RuleSet) -> tuple[Rect, ...]:
    """Return the first of the use zones' choices that walls and other pinned pieces leave free (else the last)."""
    choices = zone_choices(stand.item, rules)
    solid = [Polygon(o.corners()) for o in others if o.group != stand.group and not o.item.spec.is_rug]
    for zones in choices:
        shapes = [Polygon(stand.corners(zone)) for zone in zones]
        if all(
            s.difference(room).area < TOUCH_M2 and all(s.intersection(o).area < TOUCH_M2 for o in solid) for s in shapes
        ):
            return zones
    return choices[-1]


INSIDE_M = 1e-6  # positions are taken this far inside the free set, so that rounding cannot carry them out


@dataclass(frozen=True)
class Place:
    """One item's position as the paper gives it."""

    item: str
    edge: str
    """A wall's number, `wall` (the longest without a window) or `window` (the one with the widest)."""
    along: float
    away: float
    facing: str
    """`in`: its back to the edge; `wall`: its front to the edge (the paper's `facewindow` at a window)."""


def parse_place(text: str) -> Place:
    """Return the place of ``"sofa=window,0.5,0,in"``; raise `PinError` for other forms and ratios outside [0, 1]."""
    name, _, rest = text.partition("=")
    parts = [p.strip() for p in rest.split(",")]
    try:
        edge, along, away, facing = parts[0], float(parts[1]), float(parts[2]), parts[3] if len(parts) > 3 else "in"
    except (IndexError, ValueError):
        raise PinError(f"'{text[:60]}' is not ITEM=EDGE,ALONG,AWAY,FACING") from None
    if not (0 <= along <= 1 and 0 <= away <= 1) or facing not in {"in", "wall"}:
        raise PinError(f"'{text[:60]}': ratios lie in 0 to 1, facing is 'in' or 'wall'")
    return Place(name.strip().replace(" ", "-"), edge, along, away, facing)


def placed_by_ratios(
    plan: FloorPlan, items: Sequence[Item], rules: RuleSet, places: Sequence[Place], pins: Mapping[str, Pose]
) -> dict[str, Pose]:
    """Return `pins` and a pose for each place, one after the other, each legal beside those before it.

    Raises `PinError` for unknown items and edges, and where an edge has no legal position for an item at all.
    """
    known = {item.id: item for item in items}
    poses = dict(pins)
    for place in places:
        if place.item not in known:
            raise PinError(f"'{place.item}' is not among the items", advice=f"place one of: {', '.join(known)}")
        stood, _ = pinned_stands(items, poses, plan, rules)
        rows = [row for stand in stood for row in outline_rows(stand)]
        poses[place.item] = position(plan, known[place.item], rules, place, rows)
    return poses


def position(plan: FloorPlan, item: Item, rules: RuleSet, place: Place, extra: Sequence[Row] = ()) -> Pose:
    """Return the pose (x, y, theta) of one place in the room's frame."""
    edge = _edge(plan, place.edge)
    corner, along, length_m = plan.edge(edge)
    inward = np.array([-along[1], along[0]])
    theta = math.atan2(along[1], along[0]) + (math.pi if place.facing == "wall" else 0.0)
    field = make_field(Floor(plan), rules, extra)
    for zones in zone_choices(item, rules):
        width_m, depth_m, height_m = item.spec.size_m
        body = (-width_m / 2, width_m / 2, -depth_m / 2, depth_m / 2, item.spec.base_m, item.spec.base_m + height_m)
        rows = [(body, RUG if item.spec.is_rug else BODY), *(((*zone, 0.0, PERSON_M), ZONE) for zone in zones)]
        found = _pick(free_region(field, rows, theta), corner, along, inward, length_m, place)
        if found is not None:
            return found[0], found[1], wrapped(theta)
    raise PinError(f"edge {edge} has no legal position for {item.id} under '{rules.name}'", where=plan.name)


def free_region(field: Field, rects: Sequence[tuple[tuple[float, ...], int]], theta_rad: float) -> BaseGeometry:
    """Return where the origin of a frame at an angle may be, as a closed (multi)polygon.

    `rects`: (x0, x1, y0, y1, low, high) in the frame and class (`free_sets`) of each rectangle that moves with it. The
    region is the floor's inner fit, every position at which the rectangles lie on the floor, without the Minkowski sums
    of the obstacles with the turned rectangles; all are convex, so that the sums are hulls of corner sums. Places that
    exist only as a point or a line (exact fits) are left out; `free_sets` finds those along walls.
    """
    room = Polygon(field.floor.plan.corners, list(field.floor.plan.holes))
    region = room.buffer(0)
    c, s = math.cos(theta_rad), math.sin(theta_rad)
    blocked = []
    for (x0, x1, y0, y1, low, high), kind in rects:
        corners = np.array([(x0, y0), (x1, y0), (x1, y1), (x0, y1)]) @ np.array([[c, s], [-s, c]])
        blocked += [_sum(segment.reshape(2, 2), corners) for segment in field.floor.walls]
        middle = corners.mean(axis=0)
        region = region.intersection(translate(room, -middle[0], -middle[1]))
        for outline, (bottom, top), other in zip(*field.fixed, strict=True):
            if MEETS[kind, other] and bottom < high - SKIN_M and top > low + SKIN_M:
                blocked.append(_sum(outline, corners))
    return region.difference(shapely.union_all([b for b in blocked if b.area > 0]))


def _sum(outline: Doubles, corners: Doubles) -> BaseGeometry:
    """Return the positions at which a rectangle at `corners` (4, 2) from the origin meets a convex outline (C, 2)."""
    sums = (outline[:, None, :] - corners[None, :, :]).reshape(-1, 2)
    return shapely.convex_hull(shapely.multipoints(sums))


def _pick(
    region: BaseGeometry, corner: Any, along: Any, inward: Any, length_m: float, place: Place
) -> tuple[float, float] | None:
    """Return the position in a region at the two ratios; None where the region is empty."""
    region = region.buffer(-INSIDE_M, join_style="mitre")
    parts = [p for p in getattr(region, "geoms", [region]) if not p.is_empty]
    if not parts:
        return None
    away = [(np.asarray(part.exterior.coords) - corner) @ inward for part in parts]
    levels = [(float(one.min()), float(one.max())) for one in away]
    distance_m = _at_ratio(_joined(levels), place.away)
    reach_m = 4 * (length_m + sum(abs(b - a) for a, b in levels)) + 100.0
    middle = corner + inward * distance_m
    cut = LineString([middle - along * reach_m, middle + along * reach_m]).intersection(region)
    pieces = [g for g in getattr(cut, "geoms", [cut]) if not g.is_empty]
    at = [(np.asarray(piece.coords) - corner) @ along for piece in pieces]
    spans = [(float(one.min()), float(one.max())) for one in at]
    if not spans:  # a level that touches the region in a point only
        point = parts[0].representative_point()
        return point.x, point.y
    at_point = middle + along * _at_ratio(_joined(spans), place.along)
    return float(at_point[0]), float(at_point[1])


def _joined(spans: Sequence[tuple[float, float]]) -> list[tuple[float, float]]:
    joined: list[tuple[float, float]] = []
    for low, high in sorted(spans):
        if joined and low <= joined[-1][1]:
            joined[-1] = joined[-1][0], max(high, joined[-1][1])
        else:
            joined.append((low, high))
    return joined


def _at_ratio(spans: Sequence[tuple[float, float]], ratio: float) -> float:
    """Return the value at a ratio of the spans' whole length."""
    left = ratio * sum(high - low for low, high in spans)
    for low, high in spans:
        if left <= high - low:
            return low + left
        left -= high - low
    return spans[-1][1]


def _edge(plan: FloorPlan, name: str) -> int:
    count = len(plan.corners)
    if name.isdecimal() and int(name) < count:
        return int(name)
    if name == "window" and plan.windows:
        return max(plan.windows, key=lambda w: w.width_m).edge
    if name == "wall":
        bare = [i for i in range(count) if all(w.edge != i for w in plan.windows)]
        return max(bare or list(range(count)), key=lambda i: plan.edge(i)[2])
    raise PinError(f"'{name}' is not an edge of the room", advice=f"0 to {count - 1}, 'wall', or 'window' if any")

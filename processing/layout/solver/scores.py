"""Soft scores of a whole arrangement: each 0 to 1, None where it does not apply; `rules.toml` has the weights."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import replace
from itertools import combinations

import numpy as np

from processing.ground.kernels import compiled, inner
from processing.layout.plan import FloorPlan, Window
from processing.layout.solver.field import Floor
from processing.layout.solver.free_sets import inside_walls
from processing.layout.solver.grouping import ROLES
from processing.layout.solver.poses import Stand
from processing.layout.solver.walk_grid import WORD, count_bits, lowest, spread, stamp


@inner
def box_corners(box, out):  # type: ignore[no-untyped-def]
    """Write the corners (4, 2) of a box (x, y, cos, sin, half width, half depth)."""
    for c in range(4):
        u = -box[4] if c in (0, 3) else box[4]
        v = -box[5] if c < 2 else box[5]
        out[c, 0] = box[0] + u * box[2] - v * box[3]
        out[c, 1] = box[1] + u * box[3] + v * box[2]


@compiled
def largest_circle(points, clear, boxes):  # type: ignore[no-untyped-def]
    """Return the radius of the largest circle around one of the points (n, 2) that walls (clear) and boxes leave."""
    best = 0.0
    for i in range(points.shape[0]):
        if clear[i] <= best:
            continue
        least = clear[i]
        for k in range(boxes.shape[0]):
            dx, dy = points[i, 0] - boxes[k, 0], points[i, 1] - boxes[k, 1]
            u = abs(dx * boxes[k, 2] + dy * boxes[k, 3]) - boxes[k, 4]
            v = abs(dy * boxes[k, 2] - dx * boxes[k, 3]) - boxes[k, 5]
            gap = np.sqrt(max(u, 0.0) ** 2 + max(v, 0.0) ** 2) if max(u, v) > 0 else max(u, v)
            least = min(least, gap)
            if least <= best:
                break
        best = max(best, least)
    return best


@compiled
def share_in_one_piece(clearance2, grid, radius, boxes):  # type: ignore[no-untyped-def]
    """Return the share, in the largest part, of the cells where a walker's middle may be (radius from walls, boxes).

    `clearance2` (rows, columns): squared distance of cells to walls, m2; `boxes` (B, 6) as in `box_corners`.
    """
    rows, columns = clearance2.shape
    free = np.zeros((rows, (columns + WORD - 1) // WORD), dtype=np.uint64)
    blocked, reached = np.zeros_like(free), np.zeros_like(free)
    corners = np.empty((4, 2))
    for k in range(boxes.shape[0]):
        box_corners(boxes[k], corners)
        stamp(blocked, corners, grid, radius)
    for i in range(rows):
        for j in range(columns):
            if clearance2[i, j] >= radius * radius:
                free[i, j // WORD] |= np.uint64(1) << np.uint64(j % WORD)
    total, best = 0, 0
    for i in range(rows):
        for w in range(free.shape[1]):
            free[i, w] &= ~blocked[i, w]
    for i in range(rows):
        for w in range(free.shape[1]):
            while free[i, w] != np.uint64(0):
                reached[:] = np.uint64(0)
                reached[i, w] = lowest(free[i, w])
                spread(reached, free, i)
                count = take_away(free, reached)
                total += count
                best = max(best, count)
    return best / total if total > 0 else 0.0


@inner
def take_away(free, reached):  # type: ignore[no-untyped-def]
    """Clear the reached bits of a grid; return how many there were."""
    count = 0
    for i in range(free.shape[0]):
        for w in range(free.shape[1]):
            free[i, w] &= ~reached[i, w]
            count += count_bits(reached[i, w])
    return count


SEATS = ("sofa", "armchair")
SLIM_M = 0.2  # half the width of the walker of the score `walk`
HEAD_ROOM_M = 2.0  # what hangs above this is in nobody's way
HIDDEN_M = 0.1  # what hangs on a wall may be covered by so much at its lower edge
ELBOW_M = 0.3  # chosen: a hand's room to reach, clean and see that a nightstand is the bed's; none at half of it
MAIN = ("bed", "sofa", "dining")  # what a picture of the room is of
HALF_RAD, NO_HALF_RAD = math.radians(28), math.radians(40)
"""Half of what a main piece spans from the camera: whole in a picture of a 20 mm lens (84 degrees) with air on both
sides, and in no picture of the trade (16 mm: 97 degrees)."""
WHOLE_M, CUT_M = 2.0, 1.2
"""From the camera to a main piece's nearest corner, seen whole from eye height above a picture's lower edge, and cut
whatever the lens (chosen by looking)."""
AT_WALL_M = 0.06  # a head this near to a wall stands at it (chosen: a skirting board)


def soft_scores(floor: Floor, placed: Sequence[Stand]) -> dict[str, float]:
    """Return the scores that apply to what is placed (in the frame of the floor's plan)."""
    rows = [
        (s.x_m, s.y_m, math.cos(s.theta_rad), math.sin(s.theta_rad), w / 2, d / 2)
        for s in placed
        for w, d, _ in [s.item.spec.size_m]
        if not s.item.spec.is_rug and s.item.spec.base_m < HEAD_ROOM_M
    ]
    solid = np.array(rows, dtype=np.float64).reshape(-1, 6)
    # How large a free circle is left, against the largest that furniture of this area could leave
    covered = sum(s.item.spec.footprint_m2 for s in placed if not s.item.spec.is_rug)
    best = 0.5 * math.sqrt(max(0.5, floor.plan.area_m2 - covered))
    found: dict[str, float | None] = {
        "conversation": _conversation(placed),
        "viewing": _viewing(placed),
        "bed_view": _bed_view(floor, placed),
        "bed_wall": _bed_wall(floor, placed),
        "desk_light": _desk_light(floor, placed),
        "wall_use": _wall_use(placed),
        "alignment": _alignment(placed),
        "balance": _balance(floor, placed),
        "openness": float(largest_circle(floor.samples.points, floor.samples.clear_m, solid) / (0.8 * best)),
        "daylight": _daylight(floor, placed),
        # A slim walker: 0 where 90 % of what he can stand on is in one piece, 1 where all is.
        "in_sight": _in_sight(floor, placed),
        "walk": _ramp(share_in_one_piece(floor.samples.cells2, floor.samples.grid, SLIM_M, solid), 0.9, 1.0),
        "together": _together(placed),
        "elbow": _elbow(placed),
        "whole": _whole(floor, placed),
    }
    return {name: round(min(1.0, max(0.0, value)), 4) for name, value in found.items() if value is not None}


def weighted(scores: Mapping[str, float], weights: Mapping[str, float]) -> float:
    """Return the weighted mean of the scores that apply."""
    total = sum(weights.get(name, 0.0) for name in scores)
    return round(sum(weights.get(name, 0.0) * value for name, value in scores.items()) / total, 4) if total else 0.0


def _ramp(value: float, zero: float, one: float) -> float:
    return min(1.0, max(0.0, (value - zero) / (one - zero)))


def _of(placed: Sequence[Stand], *names: str) -> list[Stand]:
    return [s for s in placed if s.item.spec.category in names or ROLES.get(s.item.spec.category) in names]


def _looks(a: Stand, x_m: float, y_m: float) -> tuple[float, float, float]:
    """Return the distance to a place, and cosine and sine of the angle from a piece's front to the way there."""
    dx, dy = x_m - a.x_m, y_m - a.y_m
    d = math.hypot(dx, dy) + 1e-9
    fx, fy = a.facing()
    return d, (dx * fx + dy * fy) / d, (dx * fy - dy * fx) / d


def _conversation(placed: Sequence[Stand]) -> float | None:
    seats = _of(placed, *SEATS)
    if len(seats) < 2:
        return None
    values = []
    for a, b in combinations(seats, 2):
        d, to, _ = _looks(a, b.x_m, b.y_m)
        back = _looks(b, a.x_m, a.y_m)[1]
        near = _ramp(d, 4.0, 2.6) * _ramp(d, 0.6, 1.3)
        values.append(near * (0.5 * _ramp(to, -0.2, 0.6) + 0.5 * _ramp(back, -0.2, 0.6)))
    return float(np.mean(values))


def _viewing(placed: Sequence[Stand]) -> float | None:
    screens = _of(placed, "tv") or _of(placed, "tv stand")
    viewers = _of(placed, "sofa") or _of(placed, "armchair") or _of(placed, "bed")
    if not screens or not viewers:
        return None
    tv, best = screens[0], 0.0
    width_m, _, height_m = tv.item.spec.size_m
    diagonal_m = max(0.8, math.hypot(width_m, height_m if tv.item.spec.category == "tv" else 0.6))
    for seat in viewers:
        d, to, _ = _looks(tv, seat.x_m, seat.y_m)
        back = _looks(seat, tv.x_m, tv.y_m)[1]
        far = _ramp(d, 0.8 * diagonal_m, 1.2 * diagonal_m) * _ramp(d, 4.0 * diagonal_m, 2.6 * diagonal_m)
        best = max(best, _ramp(to, 0.5, 0.94) * _ramp(back, 0.3, 0.94) * (0.4 + 0.6 * far))
    return best


def _bed_view(floor: Floor, placed: Sequence[Stand]) -> float | None:
    beds, doors = _of(placed, "bed"), floor.door_middles.tolist()
    if not beds or not doors:
        return None
    values = []
    for bed in beds:
        for x, y in doors:
            d, to, aside = _looks(bed, x, y)
            in_line = to > 0 and abs(d * aside) < 0.5
            values.append(_ramp(to, -0.4, 0.3) * (0.6 if in_line else 1.0))
    return float(np.mean(values))


def _bed_wall(floor: Floor, placed: Sequence[Stand]) -> float | None:
    """Return how well beds lie: the head at a wall without a window, both sides free."""
    beds = _of(placed, "bed")
    if not beds:
        return None
    values = []
    for bed in beds:
        sides = sum(1 for x0, x1, _, _ in bed.zones if x1 <= 0 or x0 >= 0)
        head = replace(bed, edge=_edge_behind(floor.plan, bed))
        behind = min(1.0, sum(_cover_m(floor.plan, head, w) for w in floor.plan.windows) / bed.item.spec.size_m[0])
        values.append((0.5 if _head_at_wall(floor, bed) else 0.0) * (1 - behind) + 0.25 * min(2, sides))
    return float(np.mean(values))


def _edge_behind(plan: FloorPlan, bed: Stand) -> int | None:
    """Return the wall behind a bed's head: one that lies along its own wall has another there."""
    (fx, fy), back = bed.facing(), -bed.item.spec.size_m[1] / 2
    for k in [bed.edge or 0, *range(len(plan.corners))]:
        corner, (ax, ay), length_m = plan.edge(k)
        x, y = bed.corners((0.0, 0.0, back, back))[0] - corner
        at_wall = abs(ax * y - ay * x) < AT_WALL_M and 0 <= ax * x + ay * y <= length_m
        if abs(fx * ax + fy * ay) < math.sqrt(0.5) and (k == bed.edge or at_wall):
            return int(k)
    return None


def _head_at_wall(floor: Floor, bed: Stand) -> bool:
    """Return whether there is no floor just behind a bed's head."""
    w, d = bed.item.spec.size_m[0] / 4, -bed.item.spec.size_m[1] / 2 - AT_WALL_M
    return not any(inside_walls(floor.walls, x, y) for x, y in bed.corners((-w, w, d, d)))


def _in_sight(floor: Floor, placed: Sequence[Stand]) -> float | None:
    """Return how much of what hangs on walls no piece hides, by its width."""
    if not floor.plan.hung:
        return None
    whole = sum(thing.width_m for thing in floor.plan.hung)
    lost = [
        min(t.width_m, sum(_cover_m(floor.plan, s, t) for s in placed if s.item.spec.top_m > t.sill_m + HIDDEN_M))
        for t in floor.plan.hung
    ]
    return 1 - sum(lost) / whole


def _cover_m(plan: FloorPlan, stand: Stand, window: Window) -> float:
    """Return the metres of a window, or of what hangs on a wall, that a piece at that wall stands before."""
    if stand.edge != window.edge or stand.item.spec.base_m >= window.head_m:
        return 0.0
    corner, along, _ = plan.edge(window.edge)
    at = (np.array(stand.corners()) - corner) @ along
    return max(0.0, min(float(at.max()), window.end_m) - max(float(at.min()), window.start_m))


def _desk_light(floor: Floor, placed: Sequence[Stand]) -> float | None:
    desks, windows = _of(placed, "desk"), floor.windows.tolist()
    if not desks or not windows:
        return None
    values = []
    for desk in desks:
        ways = [_looks(desk, x, y) for *_, x, y, _, _ in windows]
        values.append(max(abs(aside) * _ramp(d, 5.0, 1.5) for d, _, aside in ways))
    return float(np.mean(values))


def _wall_use(placed: Sequence[Stand]) -> float | None:
    large = [s for s in placed if s.item.spec.placement == "wall" and s.item.spec.footprint_m2 >= 0.15]
    if not large:
        return None
    areas_m2 = [s.item.spec.footprint_m2 for s in large]
    return float(np.average([s.edge is not None for s in large], weights=areas_m2))


def _alignment(placed: Sequence[Stand]) -> float | None:
    if len(placed) < 2:
        return None
    weights = np.array([s.item.spec.footprint_m2 for s in placed])
    phases = np.array([s.theta_rad * 4 for s in placed])
    return float(np.hypot((weights * np.cos(phases)).sum(), (weights * np.sin(phases)).sum()) / weights.sum())


def _balance(floor: Floor, placed: Sequence[Stand]) -> float | None:
    solid = [s for s in placed if not s.item.spec.is_rug]
    if not solid:
        return None
    weights = [math.prod(s.item.spec.size_m) for s in solid]
    middle = np.average([(s.x_m, s.y_m) for s in solid], axis=0, weights=weights)
    away_m = math.dist(middle, floor.middle)
    return 1 - away_m / (0.5 * math.sqrt(floor.plan.area_m2))


def _daylight(floor: Floor, placed: Sequence[Stand]) -> float | None:
    """Return how much of the windows' light is kept: tall pieces near a window take from it."""
    windows = floor.windows.tolist()
    if not windows:
        return None
    lost, total = 0.0, 0.0
    for _, start_m, end_m, _, x, y, nx, ny in windows:
        width_m = end_m - start_m
        total += width_m
        worst = 0.0
        for s in placed:
            if s.item.spec.top_m < 1.1:
                continue
            dx, dy = s.x_m - x, s.y_m - y
            ahead, aside = dx * nx + dy * ny, abs(dx * ny - dy * nx)
            near = _ramp(ahead, 2.5, 0.8) if ahead > 0 else 0.0
            worst += near * _ramp(aside, width_m / 2 + 0.9, width_m / 2) * min(1.0, s.item.spec.size_m[0])
        lost += width_m * min(1.0, worst)
    return 1 - lost / total


def _elbow(placed: Sequence[Stand]) -> float | None:
    """Return how far nightstands have room beside them, from what one sits at; None where all have.

    It does not apply then: a score of 1 would make every other fault of a bedroom weigh less."""
    found = []
    for night in _of(placed, "night"):
        x, y = np.array(night.corners()).T
        other = [s for s in _of(placed, "desk", "seat", "sofa", "dining") if s.group != night.group]
        boxes = [np.array(s.corners()).T for s in other]
        sides = [(x.min() - u.max(), u.min() - x.max(), y.min() - v.max(), v.min() - y.max()) for u, v in boxes]
        found.append(_ramp(min((max(side) for side in sides), default=ELBOW_M), 0.5 * ELBOW_M, ELBOW_M))
    return float(np.mean(found)) if min(found, default=1.0) < 1 else None


def _whole(floor: Floor, placed: Sequence[Stand]) -> float | None:
    """Return how far main pieces are whole in a picture from where the camera stands; None where it is not known.

    Seen from another place a room would have to be rendered from there: stills are cut from the camera's panorama."""
    main, found = [s for s in _of(placed, *MAIN) if not s.item.spec.is_rug], []
    for eye, stand in ((np.array(eye), stand) for eye in floor.plan.keep_free for stand in main):
        way, corners = np.array([stand.x_m, stand.y_m]) - eye, np.array(stand.corners()) - eye
        aside = np.arctan2(way[0] * corners[:, 1] - way[1] * corners[:, 0], corners @ way)
        half_rad, near_m = float(np.ptp(aside)) / 2, float(np.hypot(*corners.T).min())
        found.append(_ramp(half_rad, NO_HALF_RAD, HALF_RAD) * _ramp(near_m, CUT_M, WHOLE_M))
    return float(np.mean(found)) if found else None


def _together(placed: Sequence[Stand]) -> float | None:
    present = {s.item.spec.category for s in placed} | {ROLES.get(s.item.spec.category, "") for s in placed}
    present.discard("")
    rugs = {"sofa", "dining"} & present
    bound = [s for s in placed if s.item.spec.group_with in present or (rugs and s.item.spec.is_rug)]
    return sum(1.0 for s in bound if s.group != s.item.id) / len(bound) if bound else None

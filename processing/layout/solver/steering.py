"""What makes one place better than another while searching: a compiled score of a unit's place among those placed.

These scores only steer the search; those that users see are `scores.py`'s. Their weights were chosen by the benchmark's
mean score on its tuning rooms. Anchors are rows (A, 7) of the pieces that stand: x, y, facing x, facing y, role, half
width, half depth; windows are rows (K, 8) as in `field.Floor.windows`.
"""

from typing import NamedTuple

import numpy as np

from processing.ground.kernels import inner

ROLE = {
    name: number
    for number, name in enumerate(
        ("bed", "sofa", "tv", "desk", "seat", "dining", "night", "tall", "low", "table", "rug", "small")
    )
}
BED, SOFA, TV, DESK, SEAT, DINING, NIGHT, TALL, LOW, TABLE, RUGS, SMALL = range(12)
HUNG_WEIGHT = 2.0  # for each metre of what hangs on a wall that a piece hides: more than a better place elsewhere gains
NEAR_WEIGHT, NEAR_M, FAR_M = 0.4, 2.0, 3.2
"""What a main piece loses whose middle is so near to a camera, and from where nothing: no lens shows it whole."""
RUG_WEIGHT = 3.0  # a rug has nothing else to keep to, and lies in a corner otherwise where the search adds noise
TALL_TOP_M, LOW_TOP_M = 1.8, 0.8
"""Height of tall and of all other pieces, as far as hiding goes (chosen: wardrobes and shelves; beds and chests)."""


class Spot(NamedTuple):
    """A place for a unit's main piece."""

    x: float
    y: float
    fx: float
    """Where its front points, a unit vector."""
    fy: float
    edge: int
    """The wall behind it; -1 for none."""
    low: float
    """The span of the wall behind it, metres from the edge's first corner."""
    high: float
    ends: int
    """How many of its sides are flush to something: 0 to 2."""
    centred: float
    """1 in the middle of its line, else 0."""


@inner
def ramp(value, zero, one):  # type: ignore[no-untyped-def]
    """Return 0 at `zero`, 1 at `one`, linear between (either may be larger)."""
    t = (value - zero) / (one - zero)
    return min(1.0, max(0.0, t))


@inner
def covered(spot, windows, more):  # type: ignore[no-untyped-def]
    """Return the metres of windows (K, 8) behind a spot and `more` metres to either side of it."""
    total = 0.0
    for k in range(windows.shape[0]):
        if int(windows[k, 0]) == spot.edge:
            total += max(0.0, min(spot.high + more, windows[k, 2]) - max(spot.low - more, windows[k, 1]))
    return total


@inner
def facing(spot, anchor):  # type: ignore[no-untyped-def]
    """Return the distance to an anchor (7,), how much the spot looks at it and it at the spot, -1 to 1."""
    dx, dy = anchor[0] - spot.x, anchor[1] - spot.y
    d = np.sqrt(dx * dx + dy * dy) + 1e-9
    return d, (spot.fx * dx + spot.fy * dy) / d, -(anchor[2] * dx + anchor[3] * dy) / d


@inner
def score_bed(spot, doors, windows):  # type: ignore[no-untyped-def]
    """Return how well a bed lies: seeing doors (D, 2) without lying in their line, head at a wall without windows."""
    total = -0.5 * min(1.0, covered(spot, windows, 0.0)) + 0.35 * spot.centred
    for k in range(doors.shape[0]):
        dx, dy = doors[k, 0] - spot.x, doors[k, 1] - spot.y
        d = np.sqrt(dx * dx + dy * dy) + 1e-9
        ahead = (dx * spot.fx + dy * spot.fy) / d
        aside = abs(dx * spot.fy - dy * spot.fx)
        weight = 1.0 / doors.shape[0]
        total += weight * (0.4 * ramp(ahead, -0.3, 0.3) - 0.3 * (1.0 if ahead > 0 and aside < 0.5 else 0.0))
    return total


@inner
def score_view(spot, anchors):  # type: ignore[no-untyped-def]
    """Return how well a TV and the seats among the anchors (A, 7) see each other: opposite, at a good distance."""
    total = 0.0
    for k in range(anchors.shape[0]):
        role = int(anchors[k, 4])
        if role in (SOFA, SEAT, BED):
            d, to, back = facing(spot, anchors[k])
            weight = 2.0 if role == SOFA else 0.3
            total += weight * (ramp(to, 0.3, 0.97) * ramp(back, 0.3, 0.97) - 0.8 * ramp(back, 0.3, -0.3))
            total += 0.5 * weight * ramp(d, 1.2, 2.0) * ramp(d, 5.0, 3.4)
    return total


@inner
def score_desk(spot, windows):  # type: ignore[no-untyped-def]
    """Return how well daylight falls on a desk: from a side, near."""
    best = 0.0
    for k in range(windows.shape[0]):
        dx, dy = windows[k, 4] - spot.x, windows[k, 5] - spot.y
        d = np.sqrt(dx * dx + dy * dy) + 1e-9
        side = abs((dx * spot.fy - dy * spot.fx) / d)
        best = max(best, side * ramp(d, 4.0, 1.0))
    return 0.6 * best + 0.3 * min(1, spot.ends)


@inner
def score_near(spot, anchors, role, want, spread):  # type: ignore[no-untyped-def]
    """Return 1 where the nearest anchor of a role is `want` metres away, falling to 0 over `spread`; 0 without one."""
    best = 0.0
    for k in range(anchors.shape[0]):
        if int(anchors[k, 4]) == role:
            dx, dy = anchors[k, 0] - spot.x, anchors[k, 1] - spot.y
            best = max(best, 1.0 - min(1.0, abs(np.sqrt(dx * dx + dy * dy) - want) / spread))
    return best


@inner
def score_seat(spot, anchors):  # type: ignore[no-untyped-def]
    """Return how well a seat stands to sofa and TV."""
    total = 0.15 * min(1, spot.ends)
    for k in range(anchors.shape[0]):
        role = int(anchors[k, 4])
        if role in (SOFA, TV):
            d, to, back = facing(spot, anchors[k])
            near = ramp(d, 4.0, 2.2)
            total += near * ramp(to, -0.3, 0.8) * (0.9 if role == SOFA else 0.5) * ramp(back, -0.5, 0.3)
    return total


@inner
def score_small(role, spot, anchors):  # type: ignore[no-untyped-def]
    """Return how well a small piece or a rug stands to what it belongs to."""
    if role == NIGHT:
        return score_near(spot, anchors, BED, 1.2, 1.5) + 0.3 * min(1, spot.ends)
    if role == TABLE:
        return score_near(spot, anchors, SOFA, 1.1, 1.0)
    if role == RUGS:
        near = score_near(spot, anchors, SOFA, 1.0, 1.5) + score_near(spot, anchors, BED, 1.1, 1.2)
        return RUG_WEIGHT * (near + score_near(spot, anchors, DINING, 0.0, 1.2))
    return 0.4 * spot.ends + 0.3 * score_near(spot, anchors, SOFA, 1.3, 1.5)


@inner
def hidden(role, spot, hung):  # type: ignore[no-untyped-def]
    """Return the metres of what hangs on walls (K, 8) that a piece of a role hides."""
    total = 0.0
    for k in range(hung.shape[0]):
        if hung[k, 3] < (TALL_TOP_M if role == TALL else LOW_TOP_M):
            total += covered(spot, hung[k : k + 1], 0.0)
    return total


@inner
def cut_short(spot, eyes):  # type: ignore[no-untyped-def]
    """Return how far a main piece is too near to cameras (E, 2) to be whole in a picture, 0 to 1."""
    worst = 0.0
    for k in range(eyes.shape[0]):
        worst = max(worst, ramp(np.sqrt((eyes[k, 0] - spot.x) ** 2 + (eyes[k, 1] - spot.y) ** 2), FAR_M, NEAR_M))
    return worst


@inner
def score_spot(role, spot, room, anchors):  # type: ignore[no-untyped-def]
    """Return the steering score of a spot for a role; `room`: `search.Room`, `anchors` (A, 7)."""
    near = NEAR_WEIGHT * cut_short(spot, room.eyes) if role in (BED, SOFA, DINING) else 0.0
    return score_role(role, spot, room, anchors) - HUNG_WEIGHT * hidden(role, spot, room.hung) - near


@inner
def score_role(role, spot, room, anchors):  # type: ignore[no-untyped-def]
    """Return it without what the piece hides, and without the cameras; `anchors` (A, 7)."""
    windows = room.windows
    if role == BED:
        return score_bed(spot, room.door_middles, windows)
    if role == SOFA:
        ahead = (room.middle[0] - spot.x) * spot.fx + (room.middle[1] - spot.y) * spot.fy
        light = 0.25 * spot.centred - 0.15 * min(1.0, covered(spot, windows, 0.0))
        return light + 0.6 * ramp(ahead, 0.4, 2.0) + 0.8 * score_view(spot, anchors)
    if role == TV:
        return score_view(spot, anchors) - 0.6 * min(1.0, covered(spot, windows, 0.0)) + 0.1 * spot.centred
    if role == DESK:
        return score_desk(spot, windows)
    if role == SEAT:
        return score_seat(spot, anchors)
    if role == DINING:
        dx, dy = room.middle[0] - spot.x, room.middle[1] - spot.y
        return 0.5 * ramp(np.sqrt(dx * dx + dy * dy), 2.5, 0.3)
    if role == TALL:
        return 0.5 * spot.ends - 0.5 * covered(spot, windows, 0.4)
    if role == LOW:
        return 0.35 * spot.ends + 0.1 * spot.centred
    return score_small(role, spot, anchors)

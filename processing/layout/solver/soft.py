"""What makes one place better than another while searching: a compiled score of a unit's place among those placed.

Roles are numbers (`ROLE`), anchors rows of (x, y, facing x, facing y, role, half width, half depth). The scores that
users see are `scores.py`'s; this one only steers.
"""

from __future__ import annotations

import numpy as np
from numba import njit

ROLE = {
    name: number
    for number, name in enumerate(
        ("bed", "sofa", "tv", "desk", "seat", "dining", "night", "tall", "low", "table", "rug", "small")
    )
}
RUG_WEIGHT = 3.0
"""A rug has nothing else to keep to, and lies in a corner otherwise where the search adds noise."""
BED, SOFA, TV, DESK, SEAT, DINING, NIGHT, TALL, LOW, TABLE, RUGS, SMALL = range(12)


@njit(cache=True)
def ramp(value, zero, one):  # type: ignore[no-untyped-def]
    """Return 0 at `zero`, 1 at `one`, linear between (either may be larger)."""
    t = (value - zero) / (one - zero)
    return min(1.0, max(0.0, t))


@njit(cache=True)
def covered(edge, low, high, windows):  # type: ignore[no-untyped-def]
    """Return the metres of windows (rows: edge, start, end, sill, x, y, nx, ny) on an edge behind low..high."""
    total = 0.0
    for k in range(windows.shape[0]):
        if int(windows[k, 0]) == edge:
            total += max(0.0, min(high, windows[k, 2]) - max(low, windows[k, 1]))
    return total


@njit(cache=True)
def facing_pair(ax, ay, afx, afy, bx, by, bfx, bfy):  # type: ignore[no-untyped-def]
    """Return (distance, how much a looks at b, how much b looks at a) with looks in -1..1."""
    dx, dy = bx - ax, by - ay
    d = np.sqrt(dx * dx + dy * dy) + 1e-9
    return d, (afx * dx + afy * dy) / d, -(bfx * dx + bfy * dy) / d


@njit(cache=True)
def score_bed(x, y, fx, fy, edge, low, high, doors, windows):  # type: ignore[no-untyped-def]
    """Return how well a bed lies: seeing doors without lying in their line, head at a solid wall."""
    total = -0.5 * min(1.0, covered(edge, low, high, windows))
    for k in range(doors.shape[0]):
        dx, dy = doors[k, 0] - x, doors[k, 1] - y
        d = np.sqrt(dx * dx + dy * dy) + 1e-9
        ahead = (dx * fx + dy * fy) / d
        aside = abs(dx * fy - dy * fx)
        weight = 1.0 / doors.shape[0]
        total += weight * (0.4 * ramp(ahead, -0.3, 0.3) - 0.3 * (1.0 if ahead > 0 and aside < 0.5 else 0.0))
    return total


@njit(cache=True)
def score_tv(x, y, fx, fy, edge, low, high, windows, anchors, n):  # type: ignore[no-untyped-def]
    """Return how well a TV stands to the seats: opposite, at a good distance, no window behind."""
    total = -0.6 * min(1.0, covered(edge, low, high, windows))
    for k in range(n):
        role = int(anchors[k, 4])
        if role in (SOFA, SEAT, BED):
            d, to, back = facing_pair(x, y, fx, fy, anchors[k, 0], anchors[k, 1], anchors[k, 2], anchors[k, 3])
            weight = 2.0 if role == SOFA else 0.3
            total += weight * (ramp(to, 0.3, 0.97) * ramp(back, 0.3, 0.97) - 0.8 * ramp(back, 0.3, -0.3))
            total += 0.5 * weight * ramp(d, 1.2, 2.0) * ramp(d, 5.0, 3.4)
    return total


@njit(cache=True)
def score_desk(x, y, fx, fy, windows):  # type: ignore[no-untyped-def]
    """Return how well daylight falls on a desk: from a side, near."""
    best = 0.0
    for k in range(windows.shape[0]):
        dx, dy = windows[k, 4] - x, windows[k, 5] - y
        d = np.sqrt(dx * dx + dy * dy) + 1e-9
        side = abs((dx * fy - dy * fx) / d)
        best = max(best, side * ramp(d, 4.0, 1.0))
    return 0.6 * best


@njit(cache=True)
def score_near(x, y, anchors, n, role, want, spread):  # type: ignore[no-untyped-def]
    """Return 1 where the nearest anchor of a role is `want` metres away, falling to 0 over `spread`; 0 without one."""
    best = 0.0
    for k in range(n):
        if int(anchors[k, 4]) == role:
            dx, dy = anchors[k, 0] - x, anchors[k, 1] - y
            best = max(best, 1.0 - min(1.0, abs(np.sqrt(dx * dx + dy * dy) - want) / spread))
    return best


@njit(cache=True)
def score_seat(x, y, fx, fy, anchors, n):  # type: ignore[no-untyped-def]
    """Return how well a seat stands to sofa and TV."""
    total = 0.0
    for k in range(n):
        role = int(anchors[k, 4])
        if role in (SOFA, TV):
            d, to, back = facing_pair(x, y, fx, fy, anchors[k, 0], anchors[k, 1], anchors[k, 2], anchors[k, 3])
            near = ramp(d, 4.0, 2.2)
            total += near * ramp(to, -0.3, 0.8) * (0.9 if role == SOFA else 0.5) * ramp(back, -0.5, 0.3)
    return total


@njit(cache=True)
def score_small(role, x, y, at_end, anchors, n):  # type: ignore[no-untyped-def]
    """Return how well a small piece or a rug stands to what it belongs to."""
    if role == NIGHT:
        return score_near(x, y, anchors, n, BED, 1.2, 1.5) + 0.3 * min(1, at_end)
    if role == TABLE:
        return score_near(x, y, anchors, n, SOFA, 1.1, 1.0)
    if role == RUGS:
        near = score_near(x, y, anchors, n, SOFA, 1.0, 1.5) + score_near(x, y, anchors, n, BED, 1.1, 1.2)
        return RUG_WEIGHT * (near + score_near(x, y, anchors, n, DINING, 0.0, 1.2))
    return 0.4 * at_end + 0.3 * score_near(x, y, anchors, n, SOFA, 1.3, 1.5)


@njit(cache=True)
def score_place(role, x, y, fx, fy, edge, low, high, at_end, centred, doors, windows, anchors, n, middle):  # type: ignore[no-untyped-def]
    """Return the steering score of a unit whose main piece is at (x, y) facing (fx, fy).

    low, high: the span of edge behind it; at_end: sides flush to something; centred: 1 in its wall's middle.
    """
    total = 0.0
    if role == BED:
        total += score_bed(x, y, fx, fy, edge, low, high, doors, windows) + 0.35 * centred
    elif role == SOFA:
        total += 0.25 * centred - 0.15 * min(1.0, covered(edge, low, high, windows))
        ahead = (middle[0] - x) * fx + (middle[1] - y) * fy
        total += 0.6 * ramp(ahead, 0.4, 2.0)
        total += 0.8 * score_tv(x, y, fx, fy, -1, 0.0, 0.0, windows, anchors, n)
    elif role == TV:
        total += score_tv(x, y, fx, fy, edge, low, high, windows, anchors, n) + 0.1 * centred
    elif role == DESK:
        total += score_desk(x, y, fx, fy, windows) + 0.3 * min(1, at_end)
    elif role == SEAT:
        total += score_seat(x, y, fx, fy, anchors, n) + 0.15 * min(1, at_end)
    elif role == DINING:
        dx, dy = middle[0] - x, middle[1] - y
        total += 0.5 * ramp(np.sqrt(dx * dx + dy * dy), 2.5, 0.3)
    elif role in (TALL, LOW):
        total += 0.5 * at_end if role == TALL else 0.35 * at_end + 0.1 * centred
        if role == TALL:
            total -= 0.5 * covered(edge, low - 0.4, high + 0.4, windows)
    else:
        total += score_small(role, x, y, at_end, anchors, n)
    return total

"""What curtains, blinds and furniture hide of a window, by what rooms have in common.

Windows of a room mostly share head and sill; a pair of curtains hangs evenly about its window; a blind that hangs from
above hides the window's upper part and is as wide as the window.
"""

from __future__ import annotations

from processing.ground.arrays import Doubles

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import numpy.typing as npt

from processing.room.opening_fit import Candidate, score_of
from processing.segmentation.classes import SceneClass


CLOTH_SHARE = 0.5
STRIP_M = 0.06
"""How far from the window cloth must begin."""
FURTHEST_M = 1.2
LEAST_BLIND_M, MOST_BLIND_M = 0.08, 2.0
HEAD_REACH_M = 0.12
SHARED_REACH_M = 0.35
SHARED_COST = 0.8
"""Of the score, that a common head or sill may cost."""


def uncovered(windows: Sequence[Candidate]) -> list[Candidate]:
    """Return windows with what cloth hides of them added, and with common heads and sills."""
    return _shared([_behind_blind(_between_curtains(one)) for one in windows])


def _cloth(one: Candidate, rows: tuple[float, float], columns: tuple[float, float], axis: int) -> Doubles:
    """Return the mean share of cloth in a part of the wall, along one axis (0: per row, 1: per column)."""
    view = one.field.view
    p, share = view.px_per_m, view.share[SceneClass.FIXTURE]
    y0, y1 = (int(np.clip(round(v * p), 0, share.shape[0])) for v in rows)
    x0, x1 = (int(np.clip(round(u * p), 0, share.shape[1])) for u in columns)
    part = share[y0 : max(y1, y0 + 1), x0 : max(x1, x0 + 1)]
    return np.asarray(part.mean(axis=1 - axis), dtype=np.float64)


def _run(cloth: Doubles, px_per_m: float) -> float:
    """Return how far cloth reaches from the beginning (m); it may begin within `STRIP_M`."""
    there = cloth > CLOTH_SHARE
    begin = np.flatnonzero(there[: max(1, round(STRIP_M * px_per_m) + 1)])
    if not begin.size:
        return 0.0
    end = np.flatnonzero(~there[begin[0] :])
    return float((begin[0] + end[0]) if end.size else len(there)) / px_per_m


def _between_curtains(one: Candidate) -> Candidate:
    """Return a window widened, under a curtain, to be even about the middle of both curtains."""
    u0, v0, u1, v1 = one.box
    p, width = one.field.view.px_per_m, one.field.view.plane.width_m
    rows = (v0 + 0.25 * (v1 - v0), v0 + 0.75 * (v1 - v0))
    left = _run(_cloth(one, rows, (max(0.0, u0 - FURTHEST_M), u0), 1)[::-1], p)
    right = _run(_cloth(one, rows, (u1, min(width, u1 + FURTHEST_M)), 1), p)
    if min(left, right) <= 0.0:
        return one
    middle = ((u0 - left) + (u1 + right)) / 2
    half = max(middle - u0, u1 - middle)
    box = (max(u0 - left, middle - half), v0, min(u1 + right, middle + half), v1)
    return replace(one, box=box)


def _behind_blind(one: Candidate) -> Candidate:
    """Return a window raised to the upper end of a blind that hangs over it."""
    u0, v0, u1, v1 = one.box
    view = one.field.view
    above = _run(_cloth(one, (max(0.0, v0 - MOST_BLIND_M), v0), (u0 + 0.1, u1 - 0.1), 0)[::-1], view.px_per_m)
    if above < LEAST_BLIND_M:
        return one
    rows = (v0 - above, v0)
    beside = [
        float(_cloth(one, rows, columns, 1).mean())
        for columns in ((u0 - 0.3, u0 - 0.12), (u1 + 0.12, u1 + 0.3))
        if columns[0] >= 0 and columns[1] <= view.plane.width_m
    ]
    if beside and max(beside) > CLOTH_SHARE:
        return one
    return replace(one, box=(u0, _head(one, max(0.0, v0 - above)), u1, v1))


def _head(one: Candidate, above_m: float) -> float:
    """Return the edge near the upper end of a blind; that end itself where there is none.

    The outermost texels are left out: the wall's own edge with the ceiling runs there, and none is counted.
    """
    p = one.field.view.px_per_m
    tried = np.arange(max(1.5 / p, above_m - HEAD_REACH_M), above_m + HEAD_REACH_M, 0.5 / p)
    edge = np.array([one.field.level_edge(float(v), one.box[0], one.box[2]) for v in tried])
    return float(tried[int(edge.argmax())]) if edge.size and edge.max() > 0 else above_m


def _shared(windows: list[Candidate]) -> list[Candidate]:
    """Return windows whose head and sill are those of the surest one, where that costs little."""
    done: list[Candidate] = []
    for one in sorted(windows, key=lambda each: -each.score):
        done.append(_aligned(_aligned(one, done, 1), done, 3))
    return done


def _aligned(one: Candidate, surer: list[Candidate], side: int) -> Candidate:
    """Return a window with the head (side 1) or sill (3) of the first of surer ones under which it is as good."""
    least = score_of(one.field, one.recess_m, one.box) - SHARED_COST
    for other in surer:
        theirs = other.box[side]
        if abs(theirs - one.box[side]) > SHARED_REACH_M:
            continue
        u0, v0, u1, v1 = one.box
        box = (u0, theirs, u1, v1) if side == 1 else (u0, v0, u1, theirs)
        if score_of(one.field, one.recess_m, box) >= least:
            return replace(one, box=box)
    return one

"""From final states to a few arrangements that are good, different, and judged valid."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass

from processing.layout.solver.poses import Stand
from processing.layout.solver.units import BIG_M2

MOVED_M = 1.0
TURNED_RAD = 0.6
SAME_MAIN_COSTS = 0.05
"""So much better must one be that leaves the main piece where it was."""


@dataclass(frozen=True)
class Candidate:
    """A whole arrangement in the room's frame, with its scores."""

    placed: tuple[Stand, ...]
    left_out: tuple[str, ...]
    score: float
    scores: dict[str, float]


@dataclass(frozen=True)
class Chosen:
    """A candidate that was taken, and how it differs from those before it."""

    candidate: Candidate
    differs_by: str


def choose(
    candidates: Sequence[Candidate],
    count: int,
    main: str,
    valid: Callable[[Candidate], bool],
    most_checks: int,
    before: Sequence[Chosen] = (),
) -> list[Chosen]:
    """Return `before` and valid candidates, up to `count`, best first, each different from all before it.

    Different: the main piece on another wall or moved by 1 m; where no more of those are left, another large piece.
    """
    chosen = list(before)
    known: dict[int, bool] = {}
    while len(chosen) < count:
        best = _next(candidates, chosen, known, main)
        if best is None:
            break
        number, told = best
        if number not in known:
            if len(known) >= most_checks:
                break
            known[number] = valid(candidates[number])
        if known[number]:
            chosen.append(Chosen(candidates[number], told))
            known[number] = False  # taken
    return sorted(chosen, key=lambda c: (len(c.candidate.left_out), -c.candidate.score))


def _next(
    candidates: Sequence[Candidate], chosen: Sequence[Chosen], known: dict[int, bool], main: str
) -> tuple[int, str] | None:
    """Return the best candidate that differs from all chosen and is not known to be invalid, and how it differs."""
    best: tuple[float, int, str] | None = None
    before = [c.candidate for c in chosen]
    for number, candidate in enumerate(candidates):
        if not known.get(number, True) or (best is not None and candidate.score <= best[0]):
            continue
        for same_main, cost in ((False, 0.0), (True, SAME_MAIN_COSTS)):
            told = _difference(candidate, before, main, same_main=same_main)
            if told is not None:
                if best is None or candidate.score - cost > best[0]:
                    best = candidate.score - cost, number, told
                break
    return best[1:] if best else None


def _difference(new: Candidate, before: Sequence[Candidate], main: str, *, same_main: bool) -> str | None:
    """Return how a candidate differs from all before it, or None."""
    told = ""
    for old in before:
        if set(old.left_out) != set(new.left_out):
            told = told or f"leaves out {', '.join(new.left_out) or 'nothing'}"
            continue
        theirs = {s.item.id: s for s in old.placed}
        found = ""
        for stand in new.placed:
            spec = stand.item.spec
            if stand.item.id != main and (not same_main or spec.footprint_m2 < BIG_M2 or spec.is_rug):
                continue
            other = theirs.get(stand.item.id)
            found = found or (_moved(stand, other) if other is not None else "")
        if not found:
            return None
        told = told or found
    return told


def _moved(stand: Stand, other: Stand) -> str:
    gap_m = round(math.hypot(stand.x_m - other.x_m, stand.y_m - other.y_m), 4)
    if stand.edge != other.edge and gap_m > 0.3:
        return f"{stand.item.id} at another wall"
    if gap_m >= MOVED_M:
        return f"{stand.item.id} moved by {gap_m:.1f} m"
    if abs(math.remainder(stand.theta_rad - other.theta_rad, 2 * math.pi)) > TURNED_RAD and gap_m > 0.3:
        return f"{stand.item.id} turned"
    return ""

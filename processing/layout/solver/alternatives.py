"""From items to a few arrangements that are good, different and judged valid: ever harder searches, then a choice."""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace

from processing.layout.items import Item
from processing.layout.rules import RuleSet
from processing.layout.solver.grouping import LAST_SPLIT, Packing, alone, host_role, packings
from processing.layout.solver.poses import Stand
from processing.layout.solver.search import FIVE, THREE, Final, Rounds, Search
from processing.layout.solver.units import BIG_M2

# Counts and temperatures are chosen, measured on the even-numbered rooms of `benchmarks arrange`: the share of rooms
# fully furnished first, then time, then the mean score.
ONE = (Rounds(40, 12, 4, noise=0.5, fractions=THREE, optimistic=False),)
MANY = (
    Rounds(120, 80, 4, noise=0.3, fractions=THREE, optimistic=False),
    Rounds(120, 80, 6, noise=1.0, fractions=THREE, optimistic=False),
)
"""Whole groups, paths proved on the grid: for one arrangement, and for several."""
REPAIRS = (
    (2, Rounds(80, 12)),
    (3, Rounds(150, 12, 4, 20)),
    (3, Rounds(250, 12, 4, 30, fractions=THREE)),
    (2, Rounds(200, 12, 3, 20, fractions=FIVE)),
    (3, Rounds(500, 12, 4, 25, noise=1.0)),
)
"""(division, rounds) where not everything has found a place."""
VARIATIONS = (
    (0, Rounds(320, 150, 5, noise=1.0, fractions=THREE)),
    (2, Rounds(200, 60, 5, noise=1.0)),
    (3, Rounds(300, 90, 6, noise=1.0)),
)
"""(least division, rounds) for more kinds of whole states."""
ANY_PLACE = Rounds(1, 1, noise=0.0, tried=1200, fractions=FIVE)
"""One unit alone: every place, until one leaves all paths open."""
KINDS_EACH = 3  # kinds of whole states searched for each alternative (chosen: choice among them raises the mean score)
MOVED_M = 1.0  # by which the main piece is elsewhere in another arrangement (chosen, as TURNED_RAD: seen at a glance)
TURNED_RAD = 0.6  # chosen: 34 degrees are seen at a glance
APART_WORTH = 0.1
"""What an alternative gains whose whole footprint stands elsewhere than in any before it (chosen: of three in 14 of the
rooms of `benchmarks arrange`, 65 % do, not 48 %, for 0.01 of the mean score)."""
SAME_MAIN_COSTS = 0.05  # so much better must one be that leaves the main piece where it was


@dataclass
class _Pool:
    """What was found so far."""

    finals: list[Final] = field(default_factory=list)
    kinds: set[tuple[object, ...]] = field(default_factory=set)

    def add(self, finals: Sequence[Final]) -> None:
        self.finals += finals
        self.kinds |= {final.kind() for final in finals if not final.dropped}


def run_search(
    search: Search, items: Sequence[Item], rules: RuleSet, n: int, seed: int, valid: Callable[[Final], bool]
) -> list[Final]:
    """Return final states, best first; ever harder tries, until nothing is left out and there are enough.

    `valid`: the exact judge, for the repairs, which let gaps pass that the path grid is too coarse for.
    """
    if not items:
        return [Final(Packing(()), (), (), 0.0)]
    divisions, pool = list(packings(items, rules)), _Pool()
    wanted = 1 if n == 1 else KINDS_EACH * n
    for number, rounds in enumerate(ONE if n == 1 else MANY):
        pool.add(search.rebuild(divisions[0], rounds, 1000 * seed + 900 + number))
        if len(pool.kinds) >= wanted:
            break
    if not pool.kinds:
        hopeless = _without_place(search, max(pool.finals, key=lambda f: f.score).left_out(), rules)
        if hopeless:
            hopeless += _guests(items, hopeless)
            finals = run_search(search, [i for i in items if i not in hopeless], rules, n, seed, valid)
            return [replace(f, hopeless=(*hopeless, *f.hopeless)) for f in finals]
        _repair(search, divisions, pool, seed, valid)
    for number, (split, rounds) in enumerate(VARIATIONS if n > 1 and pool.kinds else ()):
        if len(pool.kinds) >= wanted:
            break
        whole = next(f.packing for f in pool.finals if not f.dropped)
        packing = divisions[min(split, len(divisions) - 1)] if split else whole
        pool.add(search.rebuild(packing, rounds, 1000 * seed + 500 + number))
    return sorted(pool.finals, key=lambda f: -f.score)


def _without_place(search: Search, items: Sequence[Item], rules: RuleSet) -> list[Item]:
    """Return the items that have no place even alone in the empty room, paths looked at."""
    hosts = {item.spec.category for item in items if not item.spec.bound}
    found = []
    for item in items:
        unit = alone(item, rules, LAST_SPLIT)
        if item.spec.placement != "on" and not (item.spec.bound and item.spec.group_with in hosts):
            found += [item] if search.rebuild(Packing((unit,)), ANY_PLACE, 0)[0].dropped else []
    return found


def _repair(search: Search, packed: Sequence[Packing], pool: _Pool, seed: int, valid: Callable[[Final], bool]) -> None:
    """Take units out and place them anew, until whole states are found that the judge passes."""
    for number, (split, rounds) in enumerate(REPAIRS):
        finals = search.rebuild(packed[min(split, len(packed) - 1)], rounds, 1000 * seed + number)
        if any(final.dropped or valid(final) for final in finals[:: max(1, len(finals) // 4)]):
            pool.add(finals)
        if pool.kinds:
            break


def _guests(items: Sequence[Item], hopeless: Sequence[Item]) -> list[Item]:
    """Return the bound items whose hosts are all without a place."""
    left = [item for item in items if item not in hopeless]
    wanted, hosts = ({i.spec.category for i in some} for some in (items, left))
    return [item for item in left if host_role(item, wanted) and not host_role(item, hosts)]


def varied(finals: Sequence[Final], most: int) -> list[Final]:
    """Return the best of each kind, then the second best of each."""
    rounds: dict[tuple[object, ...], int] = {}
    ranked = []
    for place, final in enumerate(finals):
        kind = final.kind()
        rounds[kind] = rounds.get(kind, -1) + 1
        ranked.append((rounds[kind], place))
    return [finals[place] for _, place in sorted(ranked)[:most]]


@dataclass(frozen=True)
class Candidate:
    """A whole arrangement in the room's frame, with its scores."""

    placed: tuple[Stand, ...]
    left_out: tuple[str, ...]
    score: float
    scores: dict[str, float]
    final: Final | None = None
    """The state that it is."""


@dataclass(frozen=True)
class Chosen:
    """A candidate that was taken, and how it differs from those before it."""

    candidate: Candidate
    differs_by: str


def choose(
    candidates: Sequence[Candidate],
    count: int,
    main: str,
    fitted: Callable[[Candidate], Candidate | None],
    most_checks: int,
    before: Sequence[Chosen] = (),
) -> list[Chosen]:
    """Return `before` and fitted candidates, up to `count`: the best, then each the best that differs from all before.

    ``fitted``: returns a candidate as it stands in the room, None where it breaks a rule there.

    What stands elsewhere in more of its footprint is preferred. More of them change none of the first ones.

    Different: the main piece on another wall or moved by 1 m; where no more of those are left, another large piece.
    """
    chosen, stand = list(before), list(before)
    known: dict[int, Candidate | None] = {}
    shares = [apart(c.placed, [b.candidate.placed for b in before]) for c in candidates]
    while len(chosen) < count:
        best = _next(candidates, chosen, (known, shares), main)
        if best is None:
            break
        number, difference = best
        if number not in known:
            if len(known) >= most_checks:
                break
            known[number] = fitted(candidates[number])
        fit = known[number]
        if fit is not None:
            more = f"; {100 * shares[number]:.0f} % of the large pieces' footprint is elsewhere" if chosen else ""
            one = candidates[number]
            near = [apart(c.placed, [one.placed]) for c in candidates]
            shares = [min(a, b) for a, b in zip(shares, near, strict=True)] if chosen else near
            chosen.append(Chosen(one, f"{difference}{more}"))
            stand.append(replace(chosen[-1], candidate=fit))
            known[number] = None  # taken
    return stand


def _next(
    candidates: Sequence[Candidate],
    chosen: Sequence[Chosen],
    seen: tuple[dict[int, Candidate | None], list[float]],
    main: str,
) -> tuple[int, str] | None:
    """Return the best candidate that differs from all chosen and is not known to be invalid, and how it differs.

    `seen`: which are known to be valid, and each one's share that stands elsewhere than in those chosen."""
    known, shares = seen
    best: tuple[float, int, str] | None = None
    before = [c.candidate for c in chosen]
    for number, candidate in enumerate(candidates):
        if (number in known and known[number] is None) or (
            best is not None and candidate.score + APART_WORTH <= best[0]
        ):
            continue
        gain = APART_WORTH * shares[number]
        for same_main, cost in ((False, 0.0), (True, SAME_MAIN_COSTS)):
            difference = _difference(candidate, before, main, same_main=same_main)
            if difference is not None:
                if best is None or candidate.score + gain - cost > best[0]:
                    best = candidate.score + gain - cost, number, difference
                break
    return best[1:] if best else None


def _difference(new: Candidate, before: Sequence[Candidate], main: str, *, same_main: bool) -> str | None:
    """Return how a candidate differs from all before it (the first difference), or None."""
    difference = ""
    for old in before:
        if set(old.left_out) != set(new.left_out):
            difference = difference or f"leaves out {', '.join(new.left_out) or 'nothing'}"
            continue
        theirs = {s.item.id: s for s in old.placed}
        moved = ""
        for stand in new.placed:
            spec = stand.item.spec
            if stand.item.id != main and (not same_main or spec.footprint_m2 < BIG_M2 or spec.is_rug):
                continue
            other = theirs.get(stand.item.id)
            moved = moved or (_moved(stand, other) if other is not None else "")
        if not moved:
            return None
        difference = difference or moved
    return difference


def apart(new: Sequence[Stand], before: Sequence[Sequence[Stand]]) -> float:
    """Return the least share of large pieces' footprints that stand elsewhere than in any plan before; 0 to 1."""
    large = [s for s in new if s.item.spec.footprint_m2 >= BIG_M2 and not s.item.spec.is_rug]
    whole = sum(s.item.spec.footprint_m2 for s in large)
    shares = []
    for placed in before if large else ():
        theirs = {s.item.id: s for s in placed}
        moved = [s for s in large if s.item.id not in theirs or _moved(s, theirs[s.item.id])]
        shares.append(sum(s.item.spec.footprint_m2 for s in moved) / whole)
    return min(shares, default=0.0)


def _moved(stand: Stand, other: Stand) -> str:
    gap_m = round(math.hypot(stand.x_m - other.x_m, stand.y_m - other.y_m), 4)
    if stand.edge != other.edge and gap_m > 0.3:
        return f"{stand.item.id} at another wall"
    if gap_m >= MOVED_M:
        return f"{stand.item.id} moved by {gap_m:.1f} m"
    if abs(math.remainder(stand.theta_rad - other.theta_rad, 2 * math.pi)) > TURNED_RAD and gap_m > 0.3:
        return f"{stand.item.id} turned"
    return ""

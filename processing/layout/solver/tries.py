"""How the search is tried: plain first, then by taking units out of the best states and placing them anew."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace

from processing.layout.items import Item
from processing.layout.rules import RuleSet
from processing.layout.solver.grouping import LAST_SPLIT, Packing, alone, host_role, packings
from processing.layout.solver.search import Effort, Rounds, Search
from processing.layout.solver.states import Found
from processing.layout.solver.units import loss_of

_THREE, _FIVE = (0.0, 0.5, 1.0), (0.0, 0.25, 0.5, 0.75, 1.0)
_NARROW = Effort(12, 4, 2, 60)
_WIDE = Effort(32, 4, 5, 160)
_ALL = Effort(1, 1, 1, 1200, _FIVE, 0.0, optimistic=True)
ONE_TRIES = ((_NARROW, 0, None), (_NARROW, 1, None))
MANY_TRIES = ((_WIDE, 0, None), (_WIDE, 0, 0))
"""(effort, division, restart)."""
REPAIRS = (
    (2, Rounds(80, 12)),
    (3, Rounds(150, 12, 4, 20)),
    (3, Rounds(250, 12, 4, 30, fractions=_THREE)),
    (2, Rounds(200, 12, 3, 20, fractions=_FIVE)),
    (3, Rounds(500, 12, 4, 25, noise=1.0)),
)
"""(division, rounds) where not everything has found a place."""
VARIATIONS = (
    (0, Rounds(160, 90, noise=0.3, fractions=_THREE)),
    (0, Rounds(320, 150, 5, noise=1.0, fractions=_THREE)),
    (2, Rounds(200, 60, 5, noise=1.0)),
    (3, Rounds(300, 90, 6, noise=1.0)),
)
"""(least division, rounds) for more kinds of whole states."""


@dataclass(frozen=True)
class Final:
    """A final state and the packing it belongs to."""

    found: Found
    packing: Packing
    hopeless: tuple[Item, ...] = ()
    """Items that have no place even in the empty room."""

    def left_out(self) -> list[Item]:
        """Return the items that found no place."""
        return [*self.hopeless, *(item for number in self.found.dropped for item in self.packing.units[number].items)]

    def loss(self) -> float:
        """Return what is lost by leaving them out (`units.loss_of`)."""
        return sum(loss_of(item) for item in self.left_out())

    def kind(self) -> tuple[object, ...]:
        """Return what tells arrangements apart at a glance: the wall and the metre of each large unit."""
        large = self.packing.large
        return tuple(
            sorted(
                (large[c.unit], c.line[5], int(c.s_m), round(c.line[0]), round(c.line[1]))
                for c in self.found.choices
                if c.unit in large
            )
        )


@dataclass
class _Pool:
    """What was found so far."""

    finals: list[Final] = field(default_factory=list)
    kinds: set[tuple[object, ...]] = field(default_factory=set)

    def add(self, found: Sequence[Found], packing: Packing) -> None:
        made = [Final(f, packing) for f in found]
        self.finals += made
        self.kinds |= {final.kind() for final in made if not final.found.dropped}


def run_search(
    search: Search, items: Sequence[Item], rules: RuleSet, n: int, seed: int, valid: Callable[[Final], bool]
) -> list[Final]:
    """Return final states, best first; ever harder tries, until nothing is left out and there are enough.

    `valid`: the exact judge, for the repairs, which let gaps pass that the path grid is too coarse for.
    """
    if not items:
        return [Final(Found((), (), 0.0), Packing((), 0))]
    divisions, pool = Divisions(items, rules), _Pool()
    wanted = 1 if n == 1 else 3 * n
    for effort, split, restart in ONE_TRIES if n == 1 else MANY_TRIES:
        packing = divisions[split]
        pool.add(search.run(packing, effort, seed, restart), packing)
        if len(pool.kinds) >= wanted:
            break
    if not pool.kinds:
        hopeless = without_place(search, max(pool.finals, key=lambda f: f.found.score).left_out(), rules)
        if hopeless:
            hopeless += _guests(items, hopeless)
            finals = run_search(search, [i for i in items if i not in hopeless], rules, n, seed, valid)
            return [replace(f, hopeless=(*hopeless, *f.hopeless)) for f in finals]
        _repair(search, divisions, pool, seed, valid)
    for number, (split, rounds) in enumerate(VARIATIONS if n > 1 and pool.kinds else ()):
        if len(pool.kinds) >= wanted:
            break
        whole = next(f.packing for f in pool.finals if not f.found.dropped)
        packing = divisions[split] if split else whole
        pool.add(search.rebuild(packing, rounds, 1000 * seed + 500 + number), packing)
    return sorted(pool.finals, key=lambda f: -f.found.score)


def without_place(search: Search, items: Sequence[Item], rules: RuleSet) -> list[Item]:
    """Return the items that have no place even alone in the empty room, paths looked at."""
    hosts = {item.spec.category for item in items if not item.spec.bound}
    found = []
    for item in items:
        unit = alone(item, rules, LAST_SPLIT)
        if item.spec.placement != "on" and not (item.spec.bound and item.spec.group_with in hosts):
            packing = Packing((unit,), 0)
            if search.run(packing, _ALL, 0)[0].dropped:
                found.append(item)
    return found


def _repair(search: Search, divisions: Divisions, pool: _Pool, seed: int, valid: Callable[[Final], bool]) -> None:
    """Take units out and place them anew, until whole states are found that the judge passes."""
    for number, (split, rounds) in enumerate(REPAIRS):
        made = [Final(f, divisions[split]) for f in search.rebuild(divisions[split], rounds, 1000 * seed + number)]
        if any(final.found.dropped or valid(final) for final in made[:: max(1, len(made) // 4)]):
            pool.add([final.found for final in made], divisions[split])
        if pool.kinds:
            break


def _guests(items: Sequence[Item], hopeless: Sequence[Item]) -> list[Item]:
    """Return the bound items whose hosts are all without a place."""
    left = [item for item in items if item not in hopeless]
    asked, hosts = ({i.spec.category for i in some} for some in (items, left))
    return [item for item in left if host_role(item, asked) and not host_role(item, hosts)]


class Divisions:
    """The divisions of the items into units, made when first asked for."""

    def __init__(self, items: Sequence[Item], rules: RuleSet) -> None:
        self._source = packings(items, rules)
        self._made: list[Packing] = []

    def __len__(self) -> int:
        return LAST_SPLIT + 1

    def __getitem__(self, number: int) -> Packing:
        while len(self._made) <= number:
            made = next(self._source, None)
            if made is None:
                return self._made[-1]
            self._made.append(made)
        return self._made[number]

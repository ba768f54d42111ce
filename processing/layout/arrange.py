"""`arrange`: a plan and a list of items in; ranked, different arrangements that break no hard rule out."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from processing.errors import ItemError, NoDoorError, PinError, RoomTooSmallError
from processing.layout.arrangement import Arrangement, Arrangements, NotPlaced, PlacedItem
from processing.layout.canonical import Frame, Pose, canonical_plan
from processing.layout.choose import BIG_M2, Candidate, Chosen, choose
from processing.layout.field import Field, make_field
from processing.layout.grouping import LAST_SPLIT, ROLES, Packing, packings
from processing.layout.items import Item
from processing.layout.pins import in_frame, pinned_stands
from processing.layout.plan import FloorPlan
from processing.layout.plan_files import plan_to_mapping
from processing.layout.poses import Stand, in_room, stands
from processing.layout.reach import reachable_doors
from processing.layout.refusals import not_placed, outline_rows, refuse_too_small
from processing.layout.rules import Rules, RuleSet, built_in_rules
from processing.layout.scores import floor_samples, soft_scores, weighted
from processing.layout.search import Effort, Found, Search
from processing.layout.soft import ROLE
from processing.layout.units import loss_of
from processing.layout.verify import Judge, Piece

MOST_ALTERNATIVES = 50
_ENDS, _THREE, _FIVE = (0.0, 1.0), (0.0, 0.5, 1.0), (0.0, 0.25, 0.5, 0.75, 1.0)
_NARROW = Effort(12, 4, 2, 60)
_WIDE = Effort(32, 4, 5, 160)
_LOOSE = Effort(16, 2, 2, 90, _ENDS, 0.9, optimistic=True)
_SCATTER = Effort(16, 1, 2, 90, _FIVE, 0.7, optimistic=True)
_QUICK = Effort(8, 2, 2, 50, _THREE, 0.6, optimistic=True)
_BROAD = Effort(40, 3, 6, 240, _FIVE, 0.3, optimistic=True)
_HARD: tuple[tuple[Effort, int, int | None], ...] = (
    (_LOOSE, 2, 2), (_SCATTER, 3, 2), (_QUICK, 0, 4), (_SCATTER, 1, 2), (_LOOSE, 3, 1), (_NARROW, 3, 4), (_BROAD, 2, 3),
)  # fmt: skip
"""Tries for crowded rooms (effort, division, restart), chosen on half of the rooms so that few of them solve most."""
ONE_TRIES = ((_NARROW, 0, None), (_NARROW, 1, None), *_HARD)
MANY_TRIES = (
    (_WIDE, 0, None), (_WIDE, 0, 0), (_WIDE, 0, 1), (_WIDE, 1, None), (_WIDE, 2, None), (_WIDE, 3, None),
    (_WIDE, 1, 2), (_WIDE, 2, 2), (_WIDE, 3, 2), *_HARD,
)  # fmt: skip
PLAIN_TRIES = len(MANY_TRIES) - len(_HARD)


@dataclass(frozen=True)
class Final:
    """A final state and the packing it belongs to."""

    found: Found
    packing: Packing

    def left_out(self) -> list[Item]:
        """Return the items that found no place."""
        return [item for number in self.found.dropped for item in self.packing.units[number].items]

    def kind(self) -> tuple[object, ...]:
        """Return what tells arrangements apart at a glance: the wall and the metre of each large unit."""
        units = self.packing.units
        return tuple(
            sorted(
                (units[c.unit].items[0].id, c.line[5], int(c.s_m), round(c.line[0]), round(c.line[1]))
                for c in self.found.choices
                if units[c.unit].footprint_m2 >= BIG_M2 and units[c.unit].role != "rug"
            )
        )


def arrange(
    plan: FloorPlan,
    items: Sequence[Item],
    rules: RuleSet | str = "standard",
    *,
    n: int = 7,
    seed: int = 0,
    pins: Mapping[str, Pose] | None = None,
    book: Rules | None = None,
) -> Arrangements:
    """Return up to `n` different arrangements, best first, none of which breaks a hard rule.

    Parameters
    ----------
    plan, items
        From `make_plan` or `plan_files`, and `parse_items`, `set_items` or `number_items`.
    rules
        A rule set, or its name in `book`.
    n, seed
        How many alternatives, and which draw: the same seed gives the same bytes.
    pins
        Pieces that stand already, by item id: (x, y, theta) in the room's frame.
    book
        Rule sets and weights; the built-in ones by default.

    Raises
    ------
    NoDoorError, RoomTooSmallError, ItemError, PinError
        See docs/arrangement.md. An item that finds no place is no error: it is in `not_placed`, with the reason.
    """
    book = book or built_in_rules()
    rules = book.named(rules) if isinstance(rules, str) else rules
    if not 1 <= n <= MOST_ALTERNATIVES:
        raise ItemError(f"{n} alternatives; 1 to {MOST_ALTERNATIVES} can be asked for")
    if not plan.doors:
        raise NoDoorError("the plan has no door", where=plan.name)
    stood, free = pinned_stands(items, pins or {}, plan, rules)
    judge = Judge(plan, rules)
    broken = judge.judge(pieces(stood)).violations if stood else ()
    if broken:
        raise PinError(f"what is pinned breaks a rule of '{rules.name}': {broken[0]}", where=plan.name)
    too_tall = [item for item in free if item.spec.top_m > plan.ceiling_height_m]
    free = [item for item in free if item not in too_tall]
    inner, frame = canonical_plan(
        plan,
        [(s.x_m, s.y_m, s.theta_rad) for s in stood],
        mirror=not any(item.spec.handed for item in items),
    )
    held = [in_frame(s, frame) for s in stood]
    field = make_field(inner, rules, [row for s in held for row in outline_rows(s)])
    doors = reachable_doors(field)
    if not doors:
        raise RoomTooSmallError(
            f"no path of {rules.path:g} m begins at any door, even in the empty room", where=plan.name
        )
    search = Search(field, doors, [np.array(anchor(s)) for s in held])
    finals = run_search(search, free, rules, n, seed) if free else []
    if any(f.found.dropped for f in finals[:1]):
        refuse_too_small(make_field(inner, rules), free)
    task = _Task(plan, items, tuple(stood), tuple(too_tall), field, frame, rules, book, judge)
    chosen = _chosen(task, finals, n)
    return Arrangements(
        plan=plan_to_mapping(plan),
        rule_set=rules.name,
        asked=tuple(i.id for i in items),
        seed=seed,
        arrangements=tuple(_arrangement(k, one, task) for k, one in enumerate(chosen, 1)),
        notes=_notes(task, len(doors), len(chosen), n),
    )


@dataclass(frozen=True)
class _Task:
    """What an arrangement is made from."""

    plan: FloorPlan
    items: Sequence[Item]
    stood: tuple[Stand, ...]
    too_tall: tuple[Item, ...]
    field: Field
    frame: Frame
    rules: RuleSet
    book: Rules
    judge: Judge

    @cached_property
    def judges(self) -> dict[str, Judge]:
        """A judge for each rule set."""
        made = {
            n: self.judge if n == self.rules.name else Judge(self.plan, r, self.judge)
            for n, r in self.book.sets.items()
        }
        return made if self.rules.name in made else {self.rules.name: self.judge, **made}


def _notes(task: _Task, doors: int, found: int, asked: int) -> tuple[str, ...]:
    notes = list(dict.fromkeys(task.plan.notes))
    lost = len(task.plan.doors) - doors
    if lost:
        path_m = task.rules.path
        notes.append(f"{lost} of {len(task.plan.doors)} doors cannot be reached on {path_m:g} m even in the empty room")
    if found < asked:
        notes.append(f"{found} different arrangements were found of {asked} asked for")
    return tuple(notes)


def _chosen(task: _Task, finals: Sequence[Final], n: int) -> list[Chosen]:
    """Return the arrangements to give: of those that leave least out, good and different ones that the judge passes."""
    if not finals:
        scores = soft_scores(task.plan, task.stood)
        only = Candidate(task.stood, (), weighted(scores, task.book.weights), scores)
        return [Chosen(only, "")] if task.stood else []
    main = finals[0].packing.units[0].items[0].id
    for candidates in _candidates(finals, task, n):
        chosen = choose(candidates, n, main, lambda c: task.judge.passes(pieces(c.placed)), 6 * n + 24)
        if chosen:
            return chosen
    return []


def run_search(search: Search, items: Sequence[Item], rules: RuleSet, n: int, seed: int) -> list[Final]:
    """Return final states; ever harder tries, until nothing is left out and there are enough different ones."""
    divisions = Divisions(items, rules)
    tries = list(ONE_TRIES if n == 1 else MANY_TRIES)
    finals: list[Final] = []
    kinds: set[tuple[object, ...]] = set()
    for number, (effort, split, restart) in enumerate(tries):
        packing = divisions[split]
        made = [Final(f, packing) for f in search.run(packing, effort, seed, restart)]
        finals += made
        kinds |= {final.kind() for final in made if not final.found.dropped}
        if len(kinds) >= (1 if n == 1 else 3 * n) or (kinds and number + 1 >= PLAIN_TRIES):
            break
    return sorted(finals, key=lambda f: -f.found.score)


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


def _candidates(finals: Sequence[Final], task: _Task, n: int) -> Iterator[list[Candidate]]:
    """Yield the best states with their soft scores, best first: those that leave least out, then the next."""
    samples = floor_samples(task.field.plan)
    held = [in_frame(s, task.frame) for s in task.stood]
    losses = sorted({round(_loss(f), 9) for f in finals})
    for least in losses:
        alike = [f for f in finals if round(_loss(f), 9) == least]
        kept = _varied(alike, 4 if n == 1 else 6 * n)
        made = []
        for final in kept:
            free = stands(final.found, final.packing)
            placed = (*task.stood, *(in_room(s, task.frame) for s in free))
            # Scored in the canonical frame, so that a turned room ranks them alike.
            scores = soft_scores(task.field.plan, [*held, *free], samples)
            left = tuple(sorted(item.id for item in final.left_out()))
            made.append(Candidate(placed, left, weighted(scores, task.book.weights), scores))
        yield sorted(made, key=lambda c: -c.score)


def _varied(finals: Sequence[Final], most: int) -> list[Final]:
    """Return the best of each kind, then the second best of each."""
    rounds: dict[tuple[object, ...], int] = {}
    ranked = []
    for place, final in enumerate(finals):
        kind = final.kind()
        rounds[kind] = rounds.get(kind, -1) + 1
        ranked.append((rounds[kind], place))
    return [finals[place] for _, place in sorted(ranked)[:most]]


def _loss(final: Final) -> float:
    return sum(loss_of(item) for item in final.left_out())


def pieces(placed: Sequence[Stand]) -> list[Piece]:
    """Return pieces in the room as the judge takes them."""
    return [Piece(s.item.id, s.item.spec, s.x_m, s.y_m, s.theta_rad, s.group) for s in placed]


def _arrangement(rank: int, chosen: Chosen, task: _Task) -> Arrangement:
    candidate, by_id = chosen.candidate, {item.id: item for item in task.items}
    refused = [_too_tall(item, task.plan) for item in task.too_tall]
    inner = [in_frame(s, task.frame) for s in candidate.placed]
    bare = make_field(task.field.plan, task.rules)
    refused += [not_placed(by_id[name], inner, bare) for name in candidate.left_out]
    known = pieces(candidate.placed)
    meets = [n for n, judge in task.judges.items() if n == task.rules.name or judge.passes(known, fits=True)]
    return Arrangement(
        rank=rank,
        items=tuple(placed_item(s) for s in candidate.placed),
        score=candidate.score,
        scores=candidate.scores,
        rule_set=task.rules.name,
        meets=tuple(meets),
        not_placed=tuple(refused),
        differs_by=chosen.differs_by,
    )


def _too_tall(item: Item, plan: FloorPlan) -> NotPlaced:
    top_m, ceiling_m = item.spec.top_m, plan.ceiling_height_m
    return NotPlaced(
        id=item.id,
        category=item.spec.category,
        rule="under the ceiling",
        obstacle="ceiling",
        missing_m=round(top_m - ceiling_m, 4),
        reason=f"its top is at {top_m:.2f} m, the ceiling at {ceiling_m:.2f} m",
    )


def anchor(stand: Stand) -> list[float]:
    """Return a piece as an anchor of the search's score."""
    role = ROLE[ROLES.get(stand.item.spec.category, "small")]
    return [stand.x_m, stand.y_m, *stand.facing(), float(role), stand.item.spec.size_m[0] / 2]


def placed_item(stand: Stand) -> PlacedItem:
    """Return a piece as data."""
    spec = stand.item.spec
    return PlacedItem(
        id=stand.item.id,
        category=spec.category,
        model=spec.model or spec.category,
        size_m=spec.size_m,
        base_m=spec.base_m,
        theta_rad=stand.theta_rad,
        t_m=(stand.x_m, stand.y_m, spec.base_m),
        group=stand.group,
        edge=stand.edge,
        use_zones_m=tuple(tuple(round(v, 6) for v in zone) for zone in stand.zones),
        pinned=stand.pinned,
    )

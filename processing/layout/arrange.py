"""`arrange`: a plan and a list of items in; ranked, different arrangements that break no hard rule out."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass

from processing.errors import ItemError, NoDoorError, RoomTooSmallError
from processing.layout.arrangement import Arrangement, Arrangements, NotPlaced, PlacedItem
from processing.layout.canonical import Frame, Pose, canonical_plan
from processing.layout.choose import BIG_M2, Candidate, Chosen, choose
from processing.layout.field import make_field
from processing.layout.grouping import LAST_SPLIT, Packing, packings
from processing.layout.items import Item
from processing.layout.plan import FloorPlan
from processing.layout.plan_files import plan_to_mapping
from processing.layout.poses import Stand, in_room, stands
from processing.layout.reach import reachable_doors
from processing.layout.refusals import not_placed, too_small
from processing.layout.rules import Rules, RuleSet, built_in_rules
from processing.layout.scores import floor_samples, soft_scores, weighted
from processing.layout.search import Effort, Found, Search
from processing.layout.verify import Judge, Piece

MOST_ALTERNATIVES = 50


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
                if units[c.unit].footprint_m2 >= BIG_M2
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
    pinned, free = _split_pins(items, pins or {})
    too_tall = [item for item in free if item.spec.top_m > plan.ceiling_height_m]
    free = [item for item in free if item not in too_tall]
    handed = any(item.spec.handed for item in items)
    stand_at = {i.id: (pins or {})[i.id] for i in pinned}
    inner, frame = canonical_plan(plan, list(stand_at.values()), mirror=not handed)
    doors = reachable_doors(make_field(inner, rules))
    if not doors:
        raise RoomTooSmallError(
            f"no path of {rules.path:g} m begins at any door, even in the empty room", where=plan.name
        )
    too_small(inner, free, rules)
    return _solve(plan, inner, frame, free, too_tall, pinned, stand_at, rules, book, n, seed, doors)


def _split_pins(items: Sequence[Item], pins: Mapping[str, Pose]) -> tuple[list[Item], list[Item]]:
    return [i for i in items if i.id in pins], [i for i in items if i.id not in pins]


def _solve(
    plan: FloorPlan, inner: FloorPlan, frame: Frame, free: list[Item], too_tall: list[Item], pinned: list[Item],
    stand_at: Mapping[str, Pose], rules: RuleSet, book: Rules, n: int, seed: int, doors: list[int],
) -> Arrangements:  # fmt: skip
    search = Search(make_field(inner, rules), doors)
    finals = run_search(search, free, rules, n, seed)
    judge = Judge(plan, rules)
    judges = {name: judge if name == rules.name else Judge(plan, other, judge) for name, other in book.sets.items()}
    judges.setdefault(rules.name, judge)
    main = finals[0].packing.units[0].items[0].id if finals else ""
    chosen: list[Chosen] = []
    for candidates in _candidates(finals, frame, plan, book, n):
        chosen = choose(candidates, n, main, lambda c: judge.passes(pieces(c.placed)), 6 * n + 24)
        if chosen:
            break
    notes = list(plan.notes)
    unreached = [k + 1 for k in range(len(inner.doors)) if k not in doors]
    if unreached:
        notes.append(
            f"{len(unreached)} of {len(inner.doors)} doors cannot be reached on {rules.path:g} m even in the empty room"
        )
    by_id = {item.id: item for item in free}
    made = [
        _arrangement(k, one, by_id, too_tall, plan, search, frame, rules, judges) for k, one in enumerate(chosen, 1)
    ]
    asked = tuple(i.id for i in (*pinned, *free, *too_tall))
    return Arrangements(
        plan=plan_to_mapping(plan),
        rule_set=rules.name,
        asked=asked,
        seed=seed,
        arrangements=tuple(made),
        notes=tuple(notes),
    )


def run_search(search: Search, items: Sequence[Item], rules: RuleSet, n: int, seed: int) -> list[Final]:
    """Return final states; ever harder tries, until nothing is left out and there are enough different ones."""
    wide = 12 if n == 1 else 32
    plain = Effort(wide, 4, max(2, wide // 6), 5 * wide)
    fine = Effort(24, 3, 4, 140, (0.0, 0.25, 0.5, 0.75, 1.0), 0.15, optimistic=True)
    divisions = Divisions(items, rules)
    last = len(divisions) - 1
    tries: list[tuple[Effort, int, int | None]] = [(plain, k, None) for k in range(last + 1)]
    if n > 1:
        tries[1:1] = [(plain, 0, 0), (plain, 0, 1)]
        tries += [(plain, k, 2) for k in range(1, last + 1)]
    whole = len(tries)
    tries += [(fine, last, None), (fine, max(0, last - 1), 1), (fine, last, 2), (fine, 0, None)]
    finals: list[Final] = []
    kinds: set[tuple[object, ...]] = set()
    for number, (effort, k, restart) in enumerate(tries):
        packing = divisions[k]
        made = [Final(f, packing) for f in search.run(packing, effort, seed, restart)]
        finals += made
        kinds |= {final.kind() for final in made if not final.found.dropped}
        if len(kinds) >= (1 if n == 1 else 3 * n) or (kinds and number + 1 >= whole):
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


def _candidates(
    finals: Sequence[Final], frame: Frame, plan: FloorPlan, book: Rules, n: int
) -> Iterator[list[Candidate]]:
    """Yield the best states with their soft scores, best first: those that leave least out, then the next."""
    samples = floor_samples(plan)
    losses = sorted({round(_loss(f), 9) for f in finals})
    for least in losses:
        alike = [f for f in finals if round(_loss(f), 9) == least]
        kept = _varied(alike, 4 if n == 1 else 6 * n)
        made = []
        for final in kept:
            placed = tuple(in_room(s, frame) for s in stands(final.found, final.packing))
            scores = soft_scores(plan, placed, samples)
            left = tuple(sorted(item.id for item in final.left_out()))
            made.append(Candidate(placed, left, weighted(scores, book.weights), scores))
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
    return sum(1 + item.spec.footprint_m2 for item in final.left_out())


def pieces(placed: Sequence[Stand]) -> list[Piece]:
    """Return pieces in the room as the judge takes them."""
    return [Piece(s.item.id, s.item.spec, s.x_m, s.y_m, s.theta_rad, s.group) for s in placed]


def _arrangement(
    rank: int, chosen: Chosen, items: Mapping[str, Item], too_tall: Sequence[Item], plan: FloorPlan, search: Search,
    frame: Frame, rules: RuleSet, judges: Mapping[str, Judge],
) -> Arrangement:  # fmt: skip
    candidate = chosen.candidate
    refused = [
        NotPlaced(
            id=i.id, category=i.spec.category, rule="under the ceiling", obstacle="ceiling",
            missing_m=round(i.spec.top_m - plan.ceiling_height_m, 4),
            reason=f"its top is at {i.spec.top_m:.2f} m, the ceiling at {plan.ceiling_height_m:.2f} m",
        )
        for i in too_tall
    ]  # fmt: skip
    refused += [not_placed(items[name], candidate.placed, search, frame) for name in candidate.left_out]
    stood = pieces(candidate.placed)
    meets = [n for n, judge in judges.items() if n == rules.name or judge.passes(stood, fits=True)]
    return Arrangement(
        rank=rank,
        items=tuple(placed_item(s) for s in candidate.placed),
        score=candidate.score,
        scores=candidate.scores,
        rule_set=rules.name,
        meets=tuple(meets),
        not_placed=tuple(refused),
        differs_by=chosen.differs_by,
    )


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
        use_zones_m=tuple(tuple(round(v, 6) for v in zone) for zone in stand.zones),  # type: ignore[misc]
        pinned=stand.pinned,
    )

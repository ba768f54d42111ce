"""`arrange`: a plan and a list of items in; ranked, different arrangements that break no hard rule out."""

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

from processing.errors import ItemError, NoDoorError, PinError, RoomTooSmallError
from processing.layout.arrangement import Arrangement, Arrangements, NotPlaced, PlacedItem
from processing.layout.given_places import pinned_stands
from processing.layout.items import Item
from processing.layout.plan import HUNG_DOOR, FloorPlan
from processing.layout.plan_files import plan_to_mapping
from processing.layout.rules import Rules, RuleSet, built_in_rules
from processing.layout.solver import poses
from processing.layout.solver.alternatives import Candidate, Chosen, choose, run_search, varied
from processing.layout.solver.field import Field, Floor, make_field
from processing.layout.solver.grouping import host_role
from processing.layout.solver.left_out import host_lost, not_placed, refuse_too_small, with_last_places
from processing.layout.solver.poses import Frame, Pose, Stand
from processing.layout.solver.scores import soft_scores, weighted
from processing.layout.solver.search import Final, Search
from processing.layout.solver.steady import CELLS_M, Rounded, rounded_room
from processing.layout.verify import Judge

MOST_ALTERNATIVES = 50  # chosen: more than anybody looks at
SEARCHED_FOR = 7
"""Alternatives that a search is for where two or more are asked: so more of them leave the first as they are (chosen:
as many as can be staged)."""
LITTLE_MORE = 1.0
"""Where something has no place, alternatives may leave out so much more (`units.loss_of`): another piece instead."""


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
    """Return up to `n` different arrangements, none of which breaks a hard rule: the best, then what differs most.

    ``plan``, ``items``: from `make_plan` or `plan_files`, and `parse_items`, `set_items` or `number_items`.
    ``rules``: a rule set, or its name in `book`.
    ``n``, ``seed``: how many alternatives, and which draw: the same seed gives the same bytes.
    ``pins``: pieces that stand already, by item id: (x, y, theta) in the room's frame.
    ``book``: rule sets and weights; the built-in ones by default.
    Raises `NoDoorError`, `RoomTooSmallError`, `ItemError`, `PinError`: see docs/reference/arrangement.md. An item that
    finds no place is no error: it is in `not_placed`, with the reason.
    """
    book = book or built_in_rules()
    rules = book.named(rules) if isinstance(rules, str) else rules
    if not 1 <= n <= MOST_ALTERNATIVES:
        raise ItemError(f"{n} alternatives; 1 to {MOST_ALTERNATIVES} can be asked for")
    if not plan.doors:
        raise NoDoorError("the plan has no door", where=plan.name)
    stood, free = pinned_stands(items, pins or {}, plan, rules)
    judge = Judge(plan, rules)
    broken = judge.judge(poses.pieces(stood)) if stood else ()
    if broken:
        raise PinError(f"a pinned piece breaks a rule of '{rules.name}': {broken[0]}", where=plan.name)
    too_tall = [item for item in free if item.spec.top_m > plan.ceiling_height_m]
    free = [item for item in free if item not in too_tall]
    inner, frame = poses.canonical_plan(
        plan, [(s.x_m, s.y_m, s.theta_rad) for s in stood], mirror=not any(item.spec.handed for item in items)
    )
    held = [poses.in_frame(s, frame) for s in stood]
    field = make_field(Floor(inner), rules, [row for s in held for row in poses.outline_rows(s)])
    doors = field.reachable_doors()
    if not doors:
        raise RoomTooSmallError(f"no path of {rules.path:g} m begins at a door, even in an empty room", where=plan.name)
    search = Search(field, doors, [poses.anchor(s) for s in held])
    task = _Task(plan, items, tuple(stood), tuple(too_tall), search, frame, rules, book, judge, doors)
    wide = n if n == 1 else max(n, SEARCHED_FOR)
    finals, chosen = _found(task, inner, free, (n, wide, seed))
    found = Arrangements(
        plan=plan_to_mapping(plan),
        rule_set=rules.name,
        asked=tuple(i.id for i in items),
        seed=seed,
        arrangements=tuple(_arrangement(k, one, task) for k, one in enumerate(chosen, 1)),
        notes=(*_notes(task, len(doors)), *_fewer(finals, len(chosen), n)),
    )
    return _doors_given_up(found, plan, lambda bare: arrange(bare, items, rules, n=n, seed=seed, pins=pins, book=book))


def _doors_given_up(found: Arrangements, plan: FloorPlan, again: Callable[[FloorPlan], Arrangements]) -> Arrangements:
    """Return arrangements that do not keep doors free which only hang on walls, where more pieces fit that way."""

    def missing(them: Arrangements) -> int:
        return len(them.arrangements[0].not_placed) if them.arrangements else 0

    if not missing(found) or all(h.name != HUNG_DOOR for h in plan.hung):
        return found
    hung = tuple(replace(h, name=GIVEN_UP if h.name == HUNG_DOOR else h.name) for h in plan.hung)
    other = again(replace(plan, hung=hung))
    if missing(other) >= missing(found):
        return found
    note = "doors seen only in the picture are not kept clear: with them clear, not everything fits"
    return other.model_copy(update={"plan": found.plan, "notes": (note, *other.notes)})


GIVEN_UP = "door not kept clear"  # name in the search of a door that only hangs on a wall and is no longer kept free
# How what the rounded room gives is taken; chosen by `benchmarks steady` (validation seeds): what stays, then scores.
GOOD, BETTER = 0.8, 0.04
"""A first arrangement of this score ends the search; below, one of a less rounded room has to be better by so much."""
TIE, LOOKED_AT = 0.02, 3
"""Of so many of the rounded room's best, the first is taken that is best in the room itself to within this score."""
MOST_CARRIED = 22  # candidates carried into the room for each arrangement asked for, at most
STILL = Frame((0.0, 0.0), 0.0, mirrored=False, count=1000)
"""The rounded room has no other frame; the count is more corners than a room has."""


@dataclass(frozen=True)
class _Task:
    """What an arrangement is made from."""

    plan: FloorPlan
    items: Sequence[Item]
    stood: tuple[Stand, ...]
    too_tall: tuple[Item, ...]
    search: Search
    frame: Frame
    rules: RuleSet
    book: Rules
    judge: Judge
    doors: list[int]
    """Doors that paths must reach."""
    rounded: "tuple[Rounded, _Task] | None" = None
    """Where this is the room rounded: the way back, and the task in the room itself."""

    def in_room(self, final: Final) -> tuple[Stand, ...]:
        """Return all pieces of a state in the room's frame."""
        return (*self.stood, *(poses.in_room(s, self.frame) for s in poses.stands(final)))

    def valid(self, final: Final) -> bool:
        """Return whether the judge passes a state."""
        return self.judge.passes(poses.pieces(self.in_room(final)))

    def candidate(self, final: Final) -> Candidate:
        """Return a state as a candidate, scored in the canonical frame, so that a turned room ranks them alike."""
        held, free = [poses.in_frame(s, self.frame) for s in self.stood], poses.stands(final)
        scores = soft_scores(self.search.field.floor, [*held, *free])
        left = tuple(sorted(item.id for item in final.left_out()))
        return Candidate(self.in_room(final), left, weighted(scores, self.book.weights), scores, final)

    def fitted(self, candidate: Candidate) -> Candidate | None:
        """Return a candidate as it stands in the room itself, None where the judge does not pass it."""
        if self.rounded is None or candidate.final is None:
            return candidate if self.judge.passes(poses.pieces(candidate.placed)) else None
        way, room = self.rounded
        carried = way.carried(candidate.final, room.search.field)
        return None if carried is None else room.fitted(room.candidate(carried))

    @cached_property
    def bare(self) -> Field:
        """The room without what is pinned."""
        return make_field(self.search.field.floor, self.rules)

    @cached_property
    def judges(self) -> dict[str, Judge]:
        """A judge for each rule set."""
        own, judge = self.rules.name, self.judge
        made = {n: judge if n == own else Judge(self.plan, r, judge) for n, r in self.book.sets.items()}
        return made if own in made else {own: judge, **made}


def _found(
    task: _Task, inner: FloorPlan, free: Sequence[Item], how: tuple[int, int, int]
) -> tuple[list[Final], list[Chosen]]:
    """Return the states found last and the arrangements chosen: of the room rounded where they are as good.

    ``inner``: the plan in the canonical frame; ``how``: how many arrangements, for how many the search is, seed."""
    n, wide, seed = how
    best: list[Chosen] = []
    for cell_m in (*CELLS_M, None):
        one = task if cell_m is None else _rounded(task, inner, cell_m)
        if one is None:
            continue
        finals = run_search(one.search, free, task.rules, wide, seed, one.valid) if free else []
        if one is task and any(f.left_out() for f in finals[:1]):
            refuse_too_small(task.bare, free)
        found = _chosen(one, finals, n, wide)
        best = found if _worth(found) > _worth(best) + BETTER else best
        if _worth(best) > GOOD and len(best) == n:
            return finals, best
    return finals, _chosen(task, finals, n, wide, best) if 0 < len(best) < n else best


def _worth(found: Sequence[Chosen]) -> float:
    """Return the first arrangement's score, less 1 for each piece that it leaves out; more of them change nothing."""
    return found[0].candidate.score - len(found[0].candidate.left_out) if found else -math.inf


def _settled(candidates: list[Candidate], task: _Task) -> list[Candidate]:
    """Return candidates of the room rounded with the one first that is best, but for a near tie, in the room itself."""
    fits = [] if task.rounded is None else [(task.fitted(one), one) for one in candidates[:LOOKED_AT]]
    most = max((fit.score for fit, _ in fits if fit is not None), default=0.0)
    first = next((one for fit, one in fits if fit is not None and fit.score >= most - TIE), None)
    if first is None:
        return candidates
    return [replace(first, score=candidates[0].score), *(one for one in candidates if one is not first)]


def _notes(task: _Task, doors: int) -> tuple[str, ...]:
    notes = list(dict.fromkeys(task.plan.notes))
    lost = len(task.plan.doors) - doors
    if lost:
        path_m = task.rules.path
        notes.append(f"{lost} of {len(task.plan.doors)} doors cannot be reached on {path_m:g} m even in the empty room")
    return tuple(notes)


def _fewer(finals: Sequence[Final], found: int, asked: int) -> tuple[str, ...]:
    """Return why there are fewer arrangements than asked for, where there are."""
    if found >= asked:
        return ()
    counted = f"{found} different arrangements were found of {asked} asked for"
    if not finals:
        return (f"{counted}: all pieces are pinned",)
    least = min(f.loss() for f in finals)
    alike = sum(f.loss() <= least + 1e-9 for f in finals)
    little = "as little" if least > 0 else "nothing"
    return (
        f"{counted}: of {alike} tried that leave out {little}, the others have every large piece at the same wall and "
        "within 1 m of where one of these has it, or a path too narrow for the judge",
    )


def _rounded(room: _Task, inner: FloorPlan, cell_m: float) -> _Task | None:
    """Return the task in the room rounded, None where there is none with the same doors.

    ``room``: the task in the room itself, whose plan in the canonical frame is ``inner``."""
    way = None if room.stood else rounded_room(inner, cell_m)
    if way is None:
        return None
    field = make_field(Floor(way.plan), room.rules)
    search, judge = Search(field, room.doors), Judge(way.plan, room.rules)
    same = field.reachable_doors() == room.doors
    return replace(room, plan=way.plan, search=search, frame=STILL, judge=judge, rounded=(way, room)) if same else None


def _chosen(task: _Task, finals: Sequence[Final], n: int, wide: int, before: Sequence[Chosen] = ()) -> list[Chosen]:
    """Return up to `n` arrangements: of those that leave least out, good and different ones that the judge passes.

    ``wide``: how many alternatives the search was for."""
    if not finals:
        scores = soft_scores(Floor(task.plan), task.stood)
        only = Candidate(task.stood, (), weighted(scores, task.book.weights), scores)
        return [Chosen(only, "")] if task.stood else []
    units = finals[0].packing.units
    main = units[0].items[0].id if units else ""
    chosen = list(before)
    least, checks = 0.0, 6 * wide + 24 if task.rounded is None else MOST_CARRIED * n
    for loss, candidates in _candidates(finals, task, wide):
        if chosen and loss > least + (LITTLE_MORE if least > 0 else 0.0):
            break
        least = least if chosen else loss
        ranked = candidates if chosen else _settled(candidates, task)
        chosen = choose(ranked, n, main, task.fitted, checks, chosen)
        if len(chosen) == n:
            break
    if not any(one.candidate.left_out for one in chosen):
        return chosen
    fuller = [
        replace(one, candidate=_fuller(one.candidate, task.rounded[1] if task.rounded else task)) for one in chosen
    ]
    return sorted(fuller, key=lambda one: len(one.candidate.left_out))


def _fuller(candidate: Candidate, task: _Task) -> Candidate:
    """Return a candidate with what it leaves out placed, where the judge passes a place after all."""
    left = [item for item in task.items if item.id in candidate.left_out]
    if not left:
        return candidate
    inner = [poses.in_frame(s, task.frame) for s in candidate.placed]

    def in_the_room(more: Sequence[Stand]) -> tuple[Stand, ...]:
        return (*candidate.placed, *(poses.in_room(s, task.frame) for s in more[len(inner) :]))

    full = with_last_places(inner, left, task.bare, lambda them: task.judge.passes(poses.pieces(in_the_room(them))))
    if len(full) == len(inner):
        return candidate
    stood = {s.item.id for s in full}
    scores = soft_scores(task.search.field.floor, full)
    out = tuple(name for name in candidate.left_out if name not in stood)
    return Candidate(in_the_room(full), out, weighted(scores, task.book.weights), scores)


def _candidates(finals: Sequence[Final], task: _Task, n: int) -> Iterator[tuple[float, list[Candidate]]]:
    """Yield (loss, the best states with their soft scores, best first): those that leave least out, then the next."""
    for least in sorted({round(f.loss(), 9) for f in finals}):
        kept = varied([f for f in finals if round(f.loss(), 9) == least], 8 if n == 1 else 6 * n)
        yield least, sorted(map(task.candidate, kept), key=lambda c: -c.score)


def _arrangement(rank: int, chosen: Chosen, task: _Task) -> Arrangement:
    candidate, by_id = chosen.candidate, {item.id: item for item in task.items}
    ceiling_m = task.plan.ceiling_height_m
    refused = [
        NotPlaced(
            id=item.id,
            category=item.spec.category,
            rule="under the ceiling",
            obstacle="ceiling",
            missing_m=round(item.spec.top_m - ceiling_m, 4),
            reason=f"its top is at {item.spec.top_m:.2f} m, the ceiling at {ceiling_m:.2f} m",
        )
        for item in task.too_tall
    ]
    inner = [poses.in_frame(s, task.frame) for s in candidate.placed]
    stood = {s.item.spec.category for s in candidate.placed}
    asked = {item.spec.category for item in task.items}
    for item in (by_id[name] for name in candidate.left_out):
        lost = host_role(item, asked) and not host_role(item, stood)
        refused.append(host_lost(item) if lost else not_placed(item, inner, task.bare))
    known = poses.pieces(candidate.placed)
    meets = [n for n, judge in task.judges.items() if n == task.rules.name or judge.passes(known, fits=True)]
    return Arrangement(
        rank=rank,
        items=tuple(placed_item(s) for s in poses.with_reached_sides(candidate.placed, task.judge, task.rules)),
        score=candidate.score,
        scores=candidate.scores,
        rule_set=task.rules.name,
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
        use_zones_m=tuple(tuple(round(v, 6) for v in zone) for zone in stand.zones),
        pinned=stand.pinned,
    )

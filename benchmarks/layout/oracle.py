"""An oracle for rooms that are not fully furnished: does any arrangement exist? CP-SAT, rooms with right angles, mm.

Pieces stand at right angles to the walls, anywhere (`custom` off) or by the solver's custom too (storage, beds, sofas
and desks with their backs or a side to a wall, TV stands with their backs). What follows its host is left out: the TV,
and the desk chair, which stands in its desk's own use zone. *Relaxed* (obstacles 1 mm smaller, paths not looked at):
without a solution none exists. *Strict* (1 mm larger): each solution goes to the judge; where a path is closed, those
pieces may not stand so again (to 10 cm).
"""

from __future__ import annotations

import time
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Any, Literal

import numpy as np
import shapely
from ortools.sat.python import cp_model
from shapely.geometry import Polygon, box

from processing.layout.items import Item
from processing.layout.plan import FloorPlan
from processing.layout.rules import RuleSet
from processing.layout.solver.poses import canonical_plan
from processing.layout.verify import Judge, Piece

Rect = tuple[int, int, int, int]
Answer = Literal["proved", "by custom", "found", "open", "not rectilinear"]
STEP_MM = 100
BESIDE_MM = 50
SIDEWAYS_M2 = 0.35
FOLLOWS = {"tv": "tv stand", "desk chair": "desk"}
TURNS = ((0, 1), (-1, 0), (0, -1), (1, 0))


@dataclass(frozen=True)
class OracleAnswer:
    """What the oracle says of a room: `proved` that nothing fits, `by custom` the same for pieces at walls, `found`."""

    answer: Answer
    seconds: float
    closed_paths: int = 0


def ask(plan: FloorPlan, items: Sequence[Item], rules: RuleSet, seconds: float = 20.0) -> OracleAnswer:
    """Return whether all items have a place in a room."""
    start = time.process_time()
    plan = canonical_plan(plan, [])[0]
    steps = np.abs(np.roll(plan.corners, -1, axis=0) - plan.corners).min(axis=1)
    if steps.max() > 1e-4 or plan.holes:
        return OracleAnswer("not rectilinear", 0.0)
    for custom in (False, True):
        if _Model(plan, items, rules, slack_mm=-1, custom=custom).solve(seconds / 4) == cp_model.INFEASIBLE:
            return OracleAnswer("by custom" if custom else "proved", time.process_time() - start)
    model, judge, closed = _Model(plan, items, rules, slack_mm=1, custom=True), Judge(plan, rules), 0
    while (left := seconds - (time.process_time() - start)) > 0:
        status = model.solve(left)
        if status not in (cp_model.OPTIMAL, cp_model.FEASIBLE):
            break
        broken = judge.judge(model.pieces())
        if not broken:
            return OracleAnswer("found", time.process_time() - start, closed)
        closed += 1
        model.forbid(_to_blame(model, judge))
    return OracleAnswer("open", time.process_time() - start, closed)


def first_solution_s(plan: FloorPlan, items: Sequence[Item], rules: RuleSet, seconds: float = 20.0) -> float | None:
    """Return the CPU seconds to a first arrangement, paths not looked at; None where none is found."""
    start = time.process_time()
    plan = canonical_plan(plan, [])[0]
    if np.abs(np.roll(plan.corners, -1, axis=0) - plan.corners).min(axis=1).max() > 1e-4 or plan.holes:
        return None
    status = _Model(plan, items, rules, slack_mm=1, custom=True).solve(seconds)
    return time.process_time() - start if status in (cp_model.OPTIMAL, cp_model.FEASIBLE) else None


def _to_blame(model: _Model, judge: Judge) -> list[int]:
    """Return the pieces that are enough to break a rule (those that can be taken away are)."""
    kept = list(range(len(model.pieces())))
    for k in list(kept):
        fewer = [i for i in kept if i != k]
        if judge.judge([model.pieces()[i] for i in fewer]):
            kept = fewer
    return kept


class _Model:
    """One room as a constraint model."""

    def __init__(self, plan: FloorPlan, items: Sequence[Item], rules: RuleSet, *, slack_mm: int, custom: bool) -> None:
        self.model, self.rules, self.plan, self.solver = cp_model.CpModel(), rules, plan, cp_model.CpSolver()
        self.items = [i for i in items if not any(o.spec.category == FOLLOWS.get(i.spec.category) for o in items)]
        self.followers = [i for i in items if i not in self.items]
        self.room = Polygon(plan.corners * 1000).buffer(-slack_mm, join_style="mitre")
        self.bounds = tuple(round(v) for v in self.room.bounds)
        frame = box(*self.bounds).buffer(5000, join_style="mitre")
        walls = frame.difference(self.room)
        doors = shapely.union_all([g.buffer(slack_mm, join_style="mitre") for g in self._doors(strict=slack_mm > 0)])
        bands = [
            (w, self._strip(w.edge, w.start_m, w.end_m, rules.window_band).buffer(slack_mm, join_style="mitre"))
            for w in plan.windows
        ]
        self.walls, self.closed = self._fixed(walls), self._fixed(shapely.union_all([walls, doors]))
        self._variables()
        for k, item in enumerate(self.items):
            tall = [g for w, g in bands if item.spec.top_m > max(0.0, w.sill_m - 0.05) and not item.spec.is_rug]
            if tall:
                self._apart([self.bodies[k], self._fixed(shapely.union_all(tall))])
            if item.spec.is_rug:
                self._apart([self.bodies[k], self.closed])
            if custom and item.spec.placement == "wall":
                self._at_wall(k)
        self.at_head: dict[int, Any] = {}
        self.beside = {k: self._nightstand(k) for k, i in enumerate(self.items) if i.spec.category == "nightstand"}
        solid = [b for b, i in zip(self.bodies, self.items, strict=True) if not i.spec.is_rug]
        self._apart([*solid, self.closed])
        for k in range(len(self.items)):
            self._zones(k)
            self._near(k)

    def solve(self, seconds: float) -> Any:
        self.solver.parameters.num_workers = 1
        self.solver.parameters.max_deterministic_time = 4 * seconds
        self.solver.parameters.max_time_in_seconds = 6 * seconds
        return self.solver.solve(self.model)

    def pieces(self) -> list[Piece]:
        found = [self._piece(k, item) for k, item in enumerate(self.items)]
        for item in self.followers:
            host = next(p for p in found if p.spec.category == FOLLOWS[item.spec.category])
            ahead = (host.spec.size_m[1] + item.spec.size_m[1]) / 2 if item.spec.placement != "on" else 0.0
            x, y = host.x_m - ahead * np.sin(host.theta_rad), host.y_m + ahead * np.cos(host.theta_rad)
            found.append(
                Piece(item.id, item.spec, float(x), float(y), host.theta_rad + np.pi * (ahead > 0), host.group)
            )
        return found

    def forbid(self, which: Sequence[int]) -> None:
        """Keep these pieces (with hosts for followers) from standing as they do, to 10 cm."""
        clause: list[Any] = []
        hosts = [i.spec.category for i in self.items]
        names = [FOLLOWS[i.spec.category] for i in self.followers]
        for k in {k if k < len(hosts) else hosts.index(names[k - len(hosts)]) for k in which}:
            for var in (self.x[k], self.y[k]):
                at = self.solver.value(var)
                for low, high in ((-(10**6), at - STEP_MM), (at + STEP_MM, 10**6)):
                    away = self.model.new_bool_var("")
                    self.model.add_linear_constraint(var, low, high).only_enforce_if(away)
                    clause.append(away)
            clause += [self.turn[k][q].negated() for q in range(4) if self.solver.value(self.turn[k][q])]
        self.model.add_bool_or(clause)

    def _piece(self, k: int, item: Item) -> Piece:
        q = next(q for q in range(4) if self.solver.value(self.turn[k][q]))
        w, d = _size(item, q)
        x, y = (self.solver.value(self.x[k]) + w / 2) / 1000, (self.solver.value(self.y[k]) + d / 2) / 1000
        group = item.spec.group_with or item.spec.category
        if k in self.at_head and not self.solver.value(self.at_head[k]):
            group = item.id
        return Piece(item.id, item.spec, x, y, q * np.pi / 2, group)

    def _variables(self) -> None:
        x0, y0, x1, y1 = self.bounds
        m = self.model
        self.x = [m.new_int_var(x0, x1, "") for _ in self.items]
        self.y = [m.new_int_var(y0, y1, "") for _ in self.items]
        self.turn = [[m.new_bool_var("") for _ in range(4)] for _ in self.items]
        self.bodies = []
        for k, item in enumerate(self.items):
            m.add_exactly_one(self.turn[k])
            self.bodies.append([self._box(k, (0, 0, *_size(item, q)), self.turn[k][q]) for q in range(4)])

    def _box(self, k: int, rect: Rect, present: Any) -> tuple[Any, Any]:
        """Return the intervals of a rectangle (offsets from the piece's corner)."""
        a, b, c, d = rect
        spans = ((self.x[k] + a, c - a), (self.y[k] + b, d - b))
        made = [self.model.new_optional_fixed_size_interval_var(at, int(size), present, "") for at, size in spans]
        return made[0], made[1]

    def _fixed(self, area: Any) -> list[tuple[Any, Any]]:
        """Return disjoint rectangles that make up an area with right angles, as intervals."""
        xs, ys = (sorted({round(p[i]) for p in shapely.get_coordinates(area)}) for i in (0, 1))
        made = []
        for y0, y1 in pairwise(ys):
            inside = shapely.contains_xy(area, [(a + b) / 2 for a, b in pairwise(xs)], (y0 + y1) / 2)
            edges = np.flatnonzero(np.diff(np.concatenate([[0], inside.astype(int), [0]])))
            for a, b in zip(edges[::2], edges[1::2], strict=True):
                spans = ((xs[a], xs[b] - xs[a]), (y0, y1 - y0))
                both = [self.model.new_fixed_size_interval_var(at, size, "") for at, size in spans]
                made.append((both[0], both[1]))
        return made

    def _apart(self, groups: Sequence[Sequence[tuple[Any, Any]]]) -> None:
        boxes = [b for group in groups for b in group]
        self.model.add_no_overlap_2d([b[0] for b in boxes], [b[1] for b in boxes])

    def _zones(self, k: int) -> None:
        """Keep the use zones of a piece free of walls and of the pieces of other groups."""
        item, free = self.items[k], dict[str, list[Any]]()
        own = {item.spec.category, item.spec.group_with} - {""}
        others = [
            self.beside[n] if item.spec.category == "bed" and n in self.beside else self.bodies[n]
            for n, o in enumerate(self.items)
            if o is not item
            and not o.spec.is_rug
            and (o.spec.category == "nightstand" or not own & ({o.spec.category, o.spec.group_with} - {""}))
        ]
        for zone in item.spec.zones:
            deep = round(1000 * zone.depth_m(self.rules))
            if deep <= 0:
                continue
            optional = item.spec.sides_needed is not None and zone.side in ("left", "right")
            kept = self.model.new_bool_var("") if optional else None
            free.setdefault("side" if optional else "all", []).append(kept)
            boxes = []
            for q in range(4):
                present = self.turn[k][q]
                if kept is not None:
                    present = self.model.new_bool_var("")
                    self.model.add_bool_or([present, kept.negated(), self.turn[k][q].negated()])
                    self.model.add_implication(present, self.turn[k][q])
                boxes.append(self._box(k, _zone_rect(item, zone.side, deep, q), present))
            self._apart([boxes, *others, self.walls])
        if item.spec.sides_needed is not None and free.get("side"):
            self.model.add(sum(free["side"]) >= min(len(free["side"]), getattr(self.rules, item.spec.sides_needed)))

    def _nightstand(self, k: int) -> list[tuple[Any, Any]]:
        """Return a nightstand's rectangles as beds' use zones see them: none where it stands at the head."""
        head = self.at_head[k] = self.model.new_bool_var("")
        choices = []
        for h, bed in enumerate(self.items):
            for q in range(4) if bed.spec.category == "bed" else ():
                for side in ("left", "right"):
                    chosen = self.model.new_bool_var("")
                    for both in (self.turn[k][q], self.turn[h][q]):
                        self.model.add_implication(chosen, both)
                    x, y = _beside_head(_size(bed, q), _size(self.items[k], q), q, side)
                    self.model.add_linear_constraint(self.x[k] - self.x[h], x, x).only_enforce_if(chosen)
                    self.model.add_linear_constraint(self.y[k] - self.y[h], y, y).only_enforce_if(chosen)
                    choices.append(chosen)
        self.model.add_bool_or([head.negated(), *choices])
        boxes = []
        for q in range(4):
            present = self.model.new_bool_var("")
            self.model.add_bool_or([present, head, self.turn[k][q].negated()])
            self.model.add_implication(present, self.turn[k][q])
            boxes.append(self._box(k, (0, 0, *_size(self.items[k], q)), present))
        return boxes

    def _near(self, k: int) -> None:
        """Keep a bound piece within reach of a host (in x and in y)."""
        if not self.items[k].spec.bound:
            return
        within = round(1000 * self.rules.together) + 1
        hosts = [h for h, i in enumerate(self.items) if i.spec.category.endswith(self.items[k].spec.group_with)]
        by = [self.model.new_bool_var("") for _ in hosts]
        for h, near in zip(hosts, by, strict=True):
            for q in range(4):
                for p in range(4):
                    if_so = [near, self.turn[k][q], self.turn[h][p]]
                    for mine, theirs, i in ((self.x[k], self.x[h], 0), (self.y[k], self.y[h], 1)):
                        own, host = _size(self.items[k], q)[i], _size(self.items[h], p)[i]
                        self.model.add_linear_constraint(mine - theirs, -within - own, host + within).only_enforce_if(
                            if_so
                        )
        if by:
            self.model.add_bool_or(by)

    def _at_wall(self, k: int) -> None:
        """Ask for a wall behind a piece, or beside it where it is large."""
        item, choices = self.items[k], []
        ring = np.array(self.room.exterior.coords)
        ring = ring if self.room.exterior.is_ccw else ring[::-1]
        sides = (0, 1, 3) if item.spec.footprint_m2 >= SIDEWAYS_M2 and item.spec.category != "tv stand" else (0,)
        for a, b in pairwise(ring):
            along = 0 if abs(b[0] - a[0]) > abs(b[1] - a[1]) else 1
            inward = (-np.sign(b[1] - a[1]), np.sign(b[0] - a[0]))
            low, high = sorted((round(a[along]), round(b[along])))
            for q in range(4):
                w, d = _size(item, q)
                facing = TURNS[q]
                turned = {0: facing, 1: TURNS[(q + 1) % 4], 3: TURNS[(q + 3) % 4]}
                if not any(turned[s] == (int(inward[0]), int(inward[1])) for s in sides):
                    continue
                chosen = self.model.new_bool_var("")
                self.model.add_implication(chosen, self.turn[k][q])
                run, across = (self.x[k], self.y[k]) if along == 0 else (self.y[k], self.x[k])
                size, deep = (w, d) if along == 0 else (d, w)
                level = round(a[1 - along])
                at = level if inward[1 - along] > 0 else level - deep
                self.model.add_linear_constraint(run, low, high - size).only_enforce_if(chosen)
                self.model.add_linear_constraint(across, at, at).only_enforce_if(chosen)
                choices.append(chosen)
        self.model.add_bool_or(choices)

    def _strip(self, edge: int, t0: float, t1: float, deep: float) -> Any:
        corner, u, _ = self.plan.edge(edge)
        n = np.array([-u[1], u[0]])
        ends = np.array([corner + u * t0, corner + u * t1 + n * deep]) * 1000
        return box(*ends.min(axis=0), *ends.max(axis=0))

    def _doors(self, *, strict: bool) -> list[Any]:
        """Return the rectangles that doors keep free: around each swing (strict) or within it."""
        r, found = self.rules, []
        for door in self.plan.doors:
            side, wide = r.door_side, door.width_m
            found.append(self._strip(door.edge, door.start_m - side, door.end_m + side, r.door_approach))
            if door.swing in ("sliding", "out") or (wide > 2 * r.door_reach and door.swing != "in"):
                continue
            pair = wide > r.door_reach and door.swing != "in"
            leaf = wide / 2 if pair else wide
            for hand, hinge, sign in (("left", door.end_m, -1), ("right", door.start_m, 1)):
                if pair or door.hinge in (hand, "unknown"):
                    for t in (None,) if strict else np.radians((15, 30, 45, 60, 75)):
                        far, deep = (leaf, leaf) if t is None else (leaf * np.cos(t), leaf * np.sin(t))
                        ends = sorted((hinge, hinge + sign * far))
                        found.append(self._strip(door.edge, ends[0], ends[1], deep))
        return found


def _size(item: Item, quarter: int) -> tuple[int, int]:
    w, d = round(1000 * item.spec.size_m[0]), round(1000 * item.spec.size_m[1])
    return (w, d) if quarter % 2 == 0 else (d, w)


def _beside_head(bed: tuple[int, int], stand: tuple[int, int], quarter: int, side: str) -> tuple[int, int]:
    """Return where a nightstand's lower left corner is from the bed's, backs on one line, 5 cm beside it."""
    fx, fy = TURNS[quarter]
    sx, sy = (-fy, fx) if side == "left" else (fy, -fx)
    x = bed[0] + BESIDE_MM if sx > 0 else -stand[0] - BESIDE_MM if sx < 0 else 0 if fx > 0 else bed[0] - stand[0]
    y = bed[1] + BESIDE_MM if sy > 0 else -stand[1] - BESIDE_MM if sy < 0 else 0 if fy > 0 else bed[1] - stand[1]
    return x, y


def _zone_rect(item: Item, side: str, deep: int, quarter: int) -> Rect:
    """Return a use zone's rectangle from the piece's lower left corner, turned by right angles."""
    place = ("front", "left", "back", "right").index(side)
    x, y = TURNS[(quarter + place) % 4]
    w, d = _size(item, quarter)
    x0, x1 = (w, w + deep) if x > 0 else (-deep, 0) if x < 0 else (0, w)
    y0, y1 = (d, d + deep) if y > 0 else (-deep, 0) if y < 0 else (0, d)
    return x0, y0, x1, y1


__all__: list[str] = ["OracleAnswer", "ask", "first_solution_s"]

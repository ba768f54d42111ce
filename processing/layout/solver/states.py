"""The states of the search: what is placed where, as arrays over all states of one depth."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from processing.ground.arrays import Doubles, Int64s
from processing.layout.solver.field import PERSON_M
from processing.layout.solver.free_sets import BODY, RUG, ZONE
from processing.layout.solver.grouping import Packing
from processing.layout.solver.units import Unit, Variant

DROPPED = 1000.0
"""Taken off the score for what is left out, times its loss (`units.loss_of`)."""


@dataclass(frozen=True)
class Choice:
    """Where a unit went: variant, line (x, y, direction, length, edge) and place along it."""

    unit: int
    variant: int
    line: tuple[float, ...]
    s_m: float


@dataclass(frozen=True)
class Found:
    """A state of the search: what was placed where, and what was left out (unit numbers)."""

    choices: tuple[Choice, ...]
    dropped: tuple[int, ...]
    score: float


@dataclass
class UnitArrays:
    """A unit as arrays over its variants."""

    rects: Doubles
    kinds: Int64s
    n_rects: Int64s
    widths: Doubles
    bonus: Doubles
    anchor_at: Doubles
    anchor_to: Doubles
    half: Doubles
    """(V, 2): half width and half depth of the main piece."""
    near: tuple[int, float]
    """Role it stands by, and how near; (-1, 0) for none."""
    lines: Doubles
    allowed: npt.NDArray[np.bool_]
    fixed: Doubles
    fixed_counts: Int64s
    role: int


@dataclass
class Walk:
    """The grid that paths are checked on."""

    grid: Doubles
    blocked: npt.NDArray[np.uint64]
    doors: Doubles
    radius2: float
    reach: float


@dataclass
class Beam:
    """The states of one depth, as arrays."""

    walk: Walk
    dyn: Doubles
    heights: Doubles
    classes: Int64s
    counts: Int64s
    blocked: npt.NDArray[np.uint64]
    anchors: Doubles
    n_anchors: Int64s
    scores: Doubles
    strata: Int64s
    choices: list[list[Choice]]
    dropped: list[list[int]]
    size: int
    placed: bool
    spare: Beam | None = None

    @classmethod
    def start(cls, walk: Walk, stood: Sequence[Doubles], packing: Packing, width: int) -> Beam:
        """Return the beam of `width` states that holds the empty room, with what stands in it already."""
        rows = sum(max(len(rows_of(v)) for v in u.variants) for u in packing.units) + 1
        beam = cls._empty(walk, width, rows, len(packing.units) + 1 + len(stood))
        beam.blocked[0] = walk.blocked
        for number, row in enumerate(stood):
            beam.anchors[0, number] = row
        beam.n_anchors[0] = len(stood)
        beam.size = 1
        return beam

    @classmethod
    def _empty(cls, walk: Walk, width: int, rows: int, units: int) -> Beam:
        return cls(
            walk,
            np.zeros((width, rows, 4, 2)),
            np.zeros((width, rows, 2)),
            np.zeros((width, rows), dtype=np.int64),
            np.zeros(width, dtype=np.int64),
            np.empty((width, *walk.blocked.shape), dtype=np.uint64),
            np.zeros((width, units, 7)),
            np.zeros(width, dtype=np.int64),
            np.zeros(width),
            np.zeros(width, dtype=np.int64),
            [[] for _ in range(width)],
            [[] for _ in range(width)],
            0,
            False,
        )

    def other(self) -> Beam:
        """Return the beam for the next depth: the one before this, whose arrays are used again."""
        after = self.spare or self._empty(self.walk, len(self.choices), self.dyn.shape[1], self.anchors.shape[1])
        after.spare, after.size = self, 0
        return after

    def adopt(
        self, new: int, old: Beam, parent: int, score: float, choice: Choice, stratum: int, unit: UnitArrays
    ) -> None:
        """Write what the compiled step left to Python for one new state."""
        self.scores[new], self.strata[new] = score, stratum
        self.choices[new] = [*old.choices[parent], choice]
        self.dropped[new] = list(old.dropped[parent])
        n = int(old.n_anchors[parent])
        self.anchors[new] = old.anchors[parent]
        self.anchors[new, n] = anchor_row(unit, choice)
        self.n_anchors[new] = n + 1

    def fill_with_drops(self, old: Beam, number: int, unit: Unit, went_on: set[int]) -> None:
        """Let states in which the unit has no place go on without it, where there is room for them."""
        for parent in np.argsort(-old.scores[: old.size], kind="stable"):
            if self.size == len(self.choices):
                break
            if int(parent) in went_on and self.size:
                continue
            new = self.size
            for mine, theirs in (
                (self.dyn, old.dyn), (self.heights, old.heights), (self.classes, old.classes),
                (self.counts, old.counts), (self.blocked, old.blocked), (self.anchors, old.anchors),
                (self.n_anchors, old.n_anchors), (self.strata, old.strata),
            ):  # fmt: skip
                mine[new] = theirs[parent]
            self.scores[new] = old.scores[parent] - DROPPED * unit.loss
            self.choices[new] = list(old.choices[parent])
            self.dropped[new] = [*old.dropped[parent], number]
            self.size += 1


def anchor_row(unit: UnitArrays, choice: Choice) -> tuple[float, ...]:
    """Return a placed unit's main piece as later units' scores see it (`soft`)."""
    ox, oy, ux, uy = choice.line[:4]
    ax, ay = unit.anchor_at[choice.variant].tolist()
    ax += choice.s_m
    tx, ty = unit.anchor_to[choice.variant].tolist()
    half_w, half_d = unit.half[choice.variant].tolist()
    return (
        ox + ax * ux - ay * uy, oy + ax * uy + ay * ux, tx * ux - ty * uy, tx * uy + ty * ux,
        unit.role, half_w, half_d,
    )  # fmt: skip


def rows_of(variant: Variant) -> list[tuple[tuple[float, ...], int]]:
    """Return (x0, x1, y0, y1, low, high) and class of a variant's footprints and zones."""
    rows: list[tuple[tuple[float, ...], int]] = []
    for member in variant.members:
        spec = member.item.spec
        rows.append(((*member.body(), spec.base_m, spec.top_m), RUG if spec.is_rug else BODY))
        rows += [((*member.rect(zone), 0.0, PERSON_M), ZONE) for zone in member.zones]
    return rows


def quarter(quarters: int) -> tuple[float, float]:
    """Return where the front of a member turned by right angles points."""
    return ((0.0, 1.0), (-1.0, 0.0), (0.0, -1.0), (1.0, 0.0))[quarters % 4]

"""So that a room measured anew gets the same arrangement: searched for in the room rounded, then carried into it.

Whatever a search compares flips somewhere, and all that follows with it. So it works in a stand-in of the room, with
lengths of walls and places of openings rounded: rooms that differ by a centimetre mostly share it. What is found is put
into the room itself piece by piece, at the same walls and beside the same neighbours: continuous in its measures.
"""

import math
from dataclasses import dataclass, replace

import numpy as np

from processing.errors import PlanError
from processing.ground.arrays import Doubles, Int64s
from processing.layout.plan import Door, FloorPlan, make_plan
from processing.layout.solver.field import NO_EDGE, Field, Floor, Row, more_outlines
from processing.layout.solver.free_sets import SKIN_M
from processing.layout.solver.places import standing, variants_of
from processing.layout.solver.poses import OpeningT, outline_rows, stands
from processing.layout.solver.search import Choice, Final
from processing.layout.solver.units import Variant

# Chosen on 80 rooms of `benchmarks steady` (validation seeds): the share of arrangements that stay, then their scores.
CELLS_M, SHORT = (0.5, 0.2), 0.3
"""What lengths are rounded to, the coarser first, and the share of it taken off distances of walls first: what fits in
less room is carried with ease."""
JOINED_M, LEAST_M = 0.06, 0.12
"""Corners nearer than the first in a coordinate lie on one level (three times what a room is off); levels are at least
the second apart."""
DOOR_M, LEAF_M = 0.85, 1.05  # what doors up to the second are taken to be wide: wider ones are rounded
SNAP_M, FREE_M, FAR_M = 0.15, 0.4, 0.8
"""So near to its gap's end a piece stands flush; beyond the second, where it was; no gap within the third, nowhere."""
REACH_M = 40.0  # half the length of a line for what stands free: beyond any room's end
_ONE = np.ones((1, 1), np.bool_)


@dataclass(frozen=True)
class Rounded:
    """A room rounded, and the way back into it."""

    plan: FloorPlan
    axes: tuple[tuple[Doubles, Doubles], ...]
    """For x and y: the levels of the room's corners, shape (N,), metres, and the same rounded; both sorted."""

    def carried(self, final: Final, field: Field) -> Final | None:
        """Return a state of the rounded room in the room itself, `field`; None where a piece has no place near by."""
        units = sorted(final.choices, key=lambda choice: choice.unit)
        variants = [final.packing.units[one.unit].variants[one.variant] for one in units]
        arrays = [variants_of([variant]) for variant in variants]
        rows: list[list[Row]] = [[] for _ in units]
        # First each unit goes as near to its place as it can; then, beside all others, flush to what it is near to.
        units = [self._target(one, variant, field.floor) for one, variant in zip(units, variants, strict=True)]
        for drawn in (False, True):
            for k, one in enumerate(units):
                others = [row for n, listed in enumerate(rows) if n != k for row in listed]
                fixed, line = more_outlines(field.fixed, others), np.array([one.line])
                gap = _gap(standing(field.floor.walls, fixed, arrays[k], line, _ONE), one, variants[k].width_m)
                if gap is None:
                    return None
                s_m = min(max(one.s_m, gap[0]), gap[1])
                units[k] = replace(one, s_m=_flush(s_m, *gap) if drawn else s_m)
                rows[k] = [row for s in stands(replace(final, choices=(units[k],))) for row in outline_rows(s)]
        return replace(final, choices=tuple(units))

    def _target(self, choice: Choice, variant: Variant, floor: Floor) -> Choice:
        """Return where in the room a unit had best stand: in the same share of its wall, or of the floor."""
        x, y, ux, uy, long_m, edge = choice.line
        wide_m, deep_m = variant.width_m, variant.depth_m
        if edge >= 0:
            x0, y0, x1, y1 = floor.walls[int(edge)].tolist()
            real_m = math.hypot(x1 - x0, y1 - y0)
            share = choice.s_m / max(1e-6, long_m - wide_m)
            line = (x0, y0, (x1 - x0) / real_m, (y1 - y0) / real_m, real_m, edge)
            return replace(choice, line=line, s_m=share * (real_m - wide_m))
        middle = (
            x + (choice.s_m + wide_m / 2) * ux - deep_m / 2 * uy,
            y + (choice.s_m + wide_m / 2) * uy + deep_m / 2 * ux,
        )
        halves = ((abs(ux) * wide_m + abs(uy) * deep_m) / 2, (abs(uy) * wide_m + abs(ux) * deep_m) / 2)
        x, y = (_back(m, half, *axis) for m, half, axis in zip(middle, halves, self.axes, strict=True))
        along_m = wide_m / 2 + REACH_M
        line = (x - along_m * ux + deep_m / 2 * uy, y - along_m * uy - deep_m / 2 * ux, ux, uy, 2 * REACH_M, NO_EDGE)
        return replace(choice, line=line, s_m=REACH_M)


def rounded_room(plan: FloorPlan, cell_m: float) -> Rounded | None:
    """Return a plan in its canonical frame with lengths rounded to `cell_m`; None where that is no room."""
    rings = (plan.corners, *plan.holes)
    axes = tuple(_levels(np.concatenate(rings)[:, k], cell_m) for k in (0, 1))
    corners, *holes = (
        np.stack([new[np.abs(ring[:, k, None] - old).argmin(axis=1)] for k, (old, new) in enumerate(axes)], axis=1)
        for ring in rings
    )
    sides_m = np.hypot(*(np.roll(corners, -1, axis=0) - corners).T).tolist()

    def opening(one: OpeningT) -> OpeningT:
        off_m = _to_cell(0.5 * (one.start_m + one.end_m - plan.edge(one.edge)[2]), cell_m)
        leaf, long_m = isinstance(one, Door) and one.width_m < LEAF_M, sides_m[one.edge]
        wide_m = min(long_m, DOOR_M if leaf else max(cell_m, _to_cell(one.width_m, cell_m)))
        start_m = min(max(0.0, long_m / 2 + off_m - wide_m / 2), long_m - wide_m)
        return replace(one, start_m=start_m, end_m=start_m + wide_m)

    free = [[_to_cell(np.interp(v, *a), cell_m) for v, a in zip(p, axes, strict=True)] for p in plan.keep_free]
    try:
        made = make_plan(
            corners,
            holes=[hole.tolist() for hole in holes],
            ceiling_height_m=plan.ceiling_height_m,
            doors=[opening(one) for one in plan.doors],
            windows=[opening(one) for one in (*plan.windows, *plan.hung)],
            keep_free=[(x, y) for x, y in free],
            name=plan.name,
        )
    except PlanError:
        return None
    return Rounded(made, axes)


def _to_cell(value_m: float, cell_m: float) -> float:
    return round(float(value_m) / cell_m) * cell_m


def _levels(values: Doubles, cell_m: float) -> tuple[Doubles, Doubles]:
    """Return the levels of coordinates, and the rounded ones; both sorted."""
    ordered = np.sort(values)
    levels = np.array([g.mean() for g in np.split(ordered, np.flatnonzero(np.diff(ordered) > JOINED_M) + 1)])
    steps = [max(LEAST_M, _to_cell(step_m - SHORT * cell_m, cell_m)) for step_m in np.diff(levels)]
    return levels, np.cumsum([0.0, *steps])


def _back(middle: float, half: float, levels: Doubles, rounded: Doubles) -> float:
    """Return a middle coordinate of the rounded room in the room; what is flush to an outer wall stays so."""
    low, high = np.interp([middle - half, middle + half], rounded, levels).tolist()
    share = min(1.0, max(0.0, (middle - half) / max(1e-6, rounded[-1] - 2 * half)))
    return float(low * (1 - share) + (high - 2 * half) * share + half)


def _gap(taken: tuple[Doubles, Int64s], unit: Choice, wide_m: float) -> tuple[float, float] | None:
    """Return the free interval nearest to a unit's place, by what `standing` says is taken; None where none is near."""
    busy = taken[0][0, 0, : max(0, taken[1][0, 0])]
    starts = np.maximum(0.0, [0.0, *busy[:, 1]])
    ends = np.minimum([*busy[:, 0], np.inf], unit.line[4] - wide_m)
    off = np.maximum(0.0, np.maximum(starts - unit.s_m, unit.s_m - ends))
    off[ends < starts - SKIN_M] = np.inf
    best = int(off.argmin())
    return (float(starts[best]), float(ends[best])) if taken[1][0, 0] >= 0 and off[best] <= FAR_M else None


def _flush(at_m: float, low: float, high: float) -> float:
    """Return a place in a gap, drawn to its nearer end: flush within `SNAP_M`, as it was from `FREE_M`; continuous."""
    end = low if at_m - low < high - at_m else high
    free_m, off_m = min(FREE_M, 0.5 * (high - low)), abs(at_m - end)
    if off_m < free_m:
        off_m = max(0.0, off_m - SNAP_M * free_m / FREE_M) / (1 - SNAP_M / FREE_M)
    return end + math.copysign(off_m, at_m - end)

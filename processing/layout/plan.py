"""The room as the solver sees it: a floor polygon with columns, a ceiling, doors, windows and places kept free.

Metres, z up, corners counter-clockwise seen from above; edge i runs from corner i to corner i + 1 with the room to its
left (docs/reference/coordinates.md). An opening lies on an edge between `start_m` and `end_m` from the edge's first
corner.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import combinations
from typing import Literal, TypeAlias, TypeVar

import numpy as np
import shapely
from shapely.geometry import LineString, Point, Polygon
from shapely.ops import nearest_points

from processing.errors import PlanError
from processing.ground.arrays import Doubles
from processing.ground.polygons import signed_area
from processing.ground.room_model import OpeningKind, RoomModel

Points: TypeAlias = Sequence[Sequence[float]] | Doubles  # corners as (N, 2) metres
TOUCHING_M = 1e-9  # edges nearer than this touch (chosen: rounding of coordinates in metres)
SAME_POINT_M = 1e-4  # corners nearer than this are one corner
MOST_ACROSS_M = 200.0  # of a floor: as a room's (chosen: what a search holds in memory grows with the area)
Hinge: TypeAlias = Literal["left", "right", "unknown"]  # where a door hangs, seen from inside the room looking at it
Swing: TypeAlias = Literal["in", "out", "sliding", "unknown"]

HEIGHT_M, SILL_M, HEAD_M, DOOR_HEAD_M = 2.4, 0.9, 2.1, 2.1  # chosen: usual in homes
SLACK_M = 0.05  # by so much may an opening stick out over the end of its edge; it is cut there, and that is said
LEAST_OPENING_M = 0.05  # of an opening's width; chosen
HUNG_DOOR = "door"  # the name of a `Hung` that is a door


@dataclass(frozen=True)
class Repaired:
    """A ring as it should be, and what was done to it."""

    ring: Doubles
    """(n, 2), counter-clockwise (or clockwise where asked), not closed."""
    edge_from: tuple[int, ...]
    """For each edge, the edge of the ring that was given."""
    turned: bool
    """The ring was given the other way round, so that edges run backwards now."""
    notes: tuple[str, ...]


def repaired_ring(points: Points, *, where: str, clockwise: bool = False) -> Repaired:
    """Return a ring (N, 2), metres, without repeated corners and the right way round.

    Raises `PlanError` for fewer than three corners, values that are no numbers, no area, and a ring that crosses or
    touches itself (the two edges and the place are named).
    """
    try:
        ring = np.asarray(points, dtype=np.float64)
    except (TypeError, ValueError):
        raise PlanError("the corners are not pairs of numbers", where=where) from None
    if ring.ndim != 2 or ring.shape[1:] != (2,) or not np.isfinite(ring).all():
        raise PlanError("the corners are not pairs of finite numbers", where=where)
    if len(ring) and (np.ptp(ring, axis=0).max() > MOST_ACROSS_M or np.abs(ring).max() > 1e4):
        raise PlanError(f"over {MOST_ACROSS_M:g} m across, or 10 km away", where=where, likely="not in metres")
    kept, notes = _without_repeats(ring)
    edge_from = tuple(kept)
    ring = ring[kept]
    if len(ring) < 3:
        raise PlanError(f"{len(ring)} different corners do not make a polygon", where=where)
    _refuse_crossings(ring, where)
    if abs(signed_area(ring)) < 1e-6:
        raise PlanError("the polygon has no area", where=where)
    turned = (signed_area(ring) < 0) != clockwise
    if turned:
        ring = ring[::-1].copy()
        edge_from = (*edge_from[-2::-1], edge_from[-1])
        notes.append(f"the corners ran {'counter-' if clockwise else ''}clockwise: turned round")
    return Repaired(np.ascontiguousarray(ring), edge_from, turned, tuple(notes))


def _without_repeats(ring: Doubles) -> tuple[list[int], list[str]]:
    notes: list[str] = []
    kept: list[int] = []
    for i in range(len(ring)):
        if kept and np.hypot(*(ring[i] - ring[kept[-1]])) < SAME_POINT_M:
            kept[-1] = i  # the edge that goes on from here is the later one's
            notes.append(f"corner {i} repeats the one before: left out")
        else:
            kept.append(i)
    if len(kept) > 1 and np.hypot(*(ring[kept[-1]] - ring[kept[0]])) < SAME_POINT_M:
        kept.pop()
        notes.append("the last corner repeats the first: left out")
    return kept, notes


def _refuse_crossings(ring: Doubles, where: str) -> None:
    ends = np.roll(ring, -1, axis=0)
    edges = [LineString(pair) for pair in zip(ring, ends, strict=True)]
    for i, j in combinations(range(len(ring)), 2):
        if j == i + 1 or (i == 0 and j == len(ring) - 1):
            # Neighbours share a corner; they fold back where the far end of one lies on the other.
            far, corner = ((ring[i], ends[j]), ring[j]) if j == i + 1 else ((ends[i], ring[j]), ring[i])
            met = min(edges[j].distance(Point(far[0])), edges[i].distance(Point(far[1]))) < TOUCHING_M
        else:
            met, corner = edges[i].distance(edges[j]) < TOUCHING_M, None
        if met:
            at = corner if corner is not None else nearest_points(edges[i], edges[j])[0].coords[0]
            text = f"edge {i} crosses or touches edge {j} at ({at[0]:.3f}, {at[1]:.3f})"
            at_m = [round(float(at[0]), 4), round(float(at[1]), 4)]
            raise PlanError(text, where=where, likely="corners in the wrong order", edges=[i, j], at_m=at_m)


@dataclass(frozen=True)
class _OnEdge:
    """An opening in an edge, from `start_m` to `end_m` along it."""

    edge: int
    start_m: float
    end_m: float

    @property
    def width_m(self) -> float:
        """Return the width of the opening."""
        return self.end_m - self.start_m


@dataclass(frozen=True)
class Door(_OnEdge):
    """A door; unknown hinges and swings are taken as either."""

    hinge: Hinge = "unknown"
    swing: Swing = "unknown"
    name: str = ""


@dataclass(frozen=True)
class Window(_OnEdge):
    """A window from sill to head above the floor."""

    sill_m: float = SILL_M
    head_m: float = HEAD_M
    name: str = ""


@dataclass(frozen=True)
class Hung(Window):
    """What is seen on a wall, sill to head: a picture, radiator, curtain (`name`); pieces had better not hide it.

    A door that is no opening of the room (`HUNG_DOOR`) is kept free like one, where everything fits that way.
    """


@dataclass(frozen=True)
class FloorPlan:
    """A checked plan: make it with `make_plan`."""

    corners: Doubles
    """(n, 2), counter-clockwise."""
    holes: tuple[Doubles, ...] = ()
    """Columns and shafts, each (m, 2), clockwise."""
    ceiling_height_m: float = HEIGHT_M
    doors: tuple[Door, ...] = ()
    windows: tuple[Window, ...] = ()
    keep_free: tuple[tuple[float, float], ...] = ()
    """Points that stay free, such as the panorama camera's."""
    name: str = "room"
    notes: tuple[str, ...] = ()
    """What was repaired or assumed."""
    hung: tuple[Hung, ...] = ()

    @property
    def area_m2(self) -> float:
        """Return the floor's area, without columns."""
        return signed_area(self.corners) + sum(signed_area(hole) for hole in self.holes)

    def edge(self, index: int) -> tuple[Doubles, Doubles, float]:
        """Return an edge's first corner, shape (2,), its unit direction (2,) and its length in metres."""
        start = self.corners[index]
        along = self.corners[(index + 1) % len(self.corners)] - start
        length_m = float(np.hypot(*along))
        return start, along / length_m, length_m


def make_plan(
    corners: Points,
    *,
    holes: Sequence[Points] = (),
    ceiling_height_m: float = HEIGHT_M,
    doors: Sequence[Door] = (),
    windows: Sequence[Window] = (),
    keep_free: Sequence[tuple[float, float]] = (),
    name: str = "room",
    notes: Sequence[str] = (),
) -> FloorPlan:
    """Return the plan with what can be repaired repaired and noted; `corners` (N, 2) and each hole in metres.

    What is `Hung` stands among the windows.

    Raises `PlanError` for polygons that cross themselves or have no area, openings that are not on their edge, columns
    outside the floor, and heights that no room has.
    """
    if not (math.isfinite(ceiling_height_m) and 1.5 <= ceiling_height_m <= 30):
        raise PlanError(f"a ceiling {ceiling_height_m} m high; 1.5 to 30 m are possible", where=name)
    floor = repaired_ring(corners, where=name)
    repairs = [*notes, *floor.notes]
    columns = []
    for index, hole in enumerate(holes):
        where = f"{name}, column {index}"
        column = repaired_ring(hole, where=where, clockwise=True)
        for corner in column.ring:
            if not _inside(floor.ring, corner):
                raise PlanError(f"its corner ({corner[0]:.3f}, {corner[1]:.3f}) is outside the floor", where=where)
        columns.append(column.ring)
        repairs += [f"column {index}: {note}" for note in column.notes]
    plan = FloorPlan(floor.ring, tuple(columns), float(ceiling_height_m), name=name)
    moved = {old: new for new, old in enumerate(floor.edge_from)}
    kept_doors = tuple(_placed(plan, door, moved, floor.turned, repairs) for door in doors)
    kept_windows = tuple(_placed(plan, window, moved, floor.turned, repairs) for window in windows)
    for w in kept_windows:
        if not (math.isfinite(w.sill_m) and math.isfinite(w.head_m) and -0.5 <= w.sill_m < w.head_m):
            raise PlanError(f"a window from {w.sill_m} to {w.head_m} m above the floor", where=name)
    for x, y in keep_free:
        if not _inside(floor.ring, np.array([x, y])):
            raise PlanError(f"the point to keep free ({x:g}, {y:g}) is outside the floor", where=name)
    windows = tuple(w for w in kept_windows if not isinstance(w, Hung))
    hung = tuple(w for w in kept_windows if isinstance(w, Hung))
    free = tuple((float(x), float(y)) for x, y in keep_free)
    return replace(plan, doors=kept_doors, windows=windows, hung=hung, keep_free=free, notes=tuple(repairs))


OpeningT = TypeVar("OpeningT", Door, Window)


def _placed(plan: FloorPlan, opening: OpeningT, moved: dict[int, int], turned: bool, notes: list[str]) -> OpeningT:
    """Return the opening on the repaired ring's edges."""
    kind = type(opening).__name__.lower()
    where = f"{plan.name}, {kind} {opening.name}".rstrip()
    if opening.edge not in moved:
        raise PlanError(f"it lies on edge {opening.edge}, which does not exist or has no length", where=where)
    edge = moved[opening.edge]
    length_m = plan.edge(edge)[2]
    start_m, end_m = opening.start_m, opening.end_m
    if not (math.isfinite(start_m) and math.isfinite(end_m)) or end_m - start_m < LEAST_OPENING_M:
        raise PlanError(f"from {start_m} to {end_m} m along edge {opening.edge}: not an opening", where=where)
    if turned:
        start_m, end_m = length_m - end_m, length_m - start_m
    if start_m < -SLACK_M or end_m > length_m + SLACK_M:
        raise PlanError(f"from {start_m:.3f} to {end_m:.3f} m on edge {edge}, of {length_m:.3f} m", where=where)
    cut = max(0.0, start_m), min(length_m, end_m)
    if max(cut[0] - start_m, end_m - cut[1]) > 1e-3:
        notes.append(f"{kind} on edge {edge} cut at the edge's end")
    return replace(opening, edge=edge, start_m=cut[0], end_m=cut[1])


def _inside(ring: Doubles, point: Doubles) -> bool:
    return bool(shapely.intersects_xy(Polygon(ring), *point))


def from_room_model(
    room: RoomModel, *, keep_camera_free: bool = False, name: str = "room", hung: Sequence[Hung] = ()
) -> FloorPlan:
    """Return the plan of a room's model; a passage is a door without a leaf.

    Openings that are too narrow for one are left out, and that is noted. Raises `PlanError` as `make_plan` does.
    """
    doors, windows, notes = [], list[Window](hung), []
    for o in room.openings:
        if o.end_m - o.start_m < LEAST_OPENING_M:
            notes.append(f"a {o.kind.value} on wall {o.wall + 1} is {o.end_m - o.start_m:.2f} m wide: left out")
        elif o.kind is OpeningKind.WINDOW:
            windows.append(Window(o.wall, o.start_m, o.end_m, o.sill_m, o.head_m))
        else:
            swing: Swing = "sliding" if o.kind is OpeningKind.PASSAGE else "unknown"
            doors.append(Door(o.wall, o.start_m, o.end_m, swing=swing))
    high_m, free = room.ceiling_height_m, [(0.0, 0.0)] if keep_camera_free else []
    return make_plan(
        room.floor, ceiling_height_m=high_m, doors=doors, windows=windows, keep_free=free, name=name, notes=notes
    )

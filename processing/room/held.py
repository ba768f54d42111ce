"""Parts of a room that somebody has placed, held while the rest is estimated again.

In every column that sees a placed wall its distance counts as if measured, and so does the ceiling's height in all: the
rooms that may be meant compete and are fitted as before, and in the end what was placed lies exactly where it was.
"""

import math
from collections.abc import Iterable
from dataclasses import replace
from typing import NamedTuple, Self

import numpy as np

from processing.errors import NoRoomError
from processing.ground.arrays import Doubles
from processing.ground.room_model import CEILING, Opening, RoomModel, geometry_problems
from processing.room.columns import Columns
from processing.surfaces.maps import wall_ranges

SURE_RAD, SURE_RATIO = math.radians(0.1), 0.002
"""Of what is held; chosen: below all that a picture says, and no jump for the robust fit."""
UNKNOWN = 10.0  # uncertainty of a ceiling's boundary over a wall that was wrong: it may have been another's
NEAR_M, NEAR_SIN = 0.01, 0.005  # within which two walls are one line: below what a hand moves
FITS_M, FITS_SIN, CORNER_M = 0.3, 0.25, 1.0
"""How far the estimate may be from a wall, or a corner, that is held, before no room fits around it; chosen."""


class Held(NamedTuple):
    """A corrected room, and what of it is held."""

    room: RoomModel
    walls: tuple[int, ...] = ()
    corners: tuple[int, ...] = ()
    """Where two walls meet; these keep their directions."""
    ceiling: bool = False
    gone: tuple[tuple[float, float], ...] = ()
    """Places (m) of openings that were estimated and taken away."""

    @classmethod
    def of(cls, room: RoomModel, estimated: RoomModel) -> Self:
        """Return what a room says that it holds; where it says nothing, all in which it differs from the estimate."""
        walls, corners = ([int(n.split()[1]) for n in room.held if n.startswith(kind)] for kind in ("wall", "corner"))
        ceiling = CEILING in room.held
        if not room.held:
            lines = [line_of(estimated, k) for k in range(len(estimated.floor))]
            near = [_nearest(line_of(room, k), lines, math.inf, NEAR_SIN) for k in range(len(room.floor))]
            apart = [_nearest(line_of(room, k), lines, NEAR_M, NEAR_SIN) < 0 for k in range(len(room.floor))]
            walls = [k for k, found in enumerate(near) if found >= 0 and apart[k]]
            there = [min(math.dist(place, one) for one in estimated.floor) for place in room.floor]
            moved = [k for k, away in enumerate(there) if away > NEAR_M]
            # What moved with a wall turned none; what turns one was placed by itself.
            corners = [k for k in moved if near[k] < 0 or near[k - 1] < 0]
            ceiling = abs(room.ceiling_height_m - estimated.ceiling_height_m) > NEAR_M
        count = len(room.floor)
        now = [middle_of(room, one) for one in room.openings]
        before = [(middle_of(estimated, one), one.end_m - one.start_m) for one in estimated.openings]
        gone = tuple(place for place, wide in before if all(math.dist(place, one) > wide / 2 for one in now))
        walls, corners = [k for k in walls if k < count], [k for k in corners if k < count]
        return cls(room, tuple(walls), tuple(corners), ceiling, gone)

    def on(self, columns: Columns) -> Columns:
        """Return columns (N) in which what is held counts as measured."""
        camera_m = self.room.camera_height_m
        distance, wall = wall_ranges(np.array(self.room.floor) / camera_m, columns.azimuth_rad)
        mine, inverse = np.isin(wall, self.walls), 1 / np.maximum(distance, 1e-3)
        for x, y in (self.room.floor[k] for k in self.corners):
            column = int(np.abs(np.angle(np.exp(1j * (columns.azimuth_rad - math.atan2(x, y))))).argmin())
            mine[column], inverse[column] = True, camera_m / math.hypot(x, y)
        ratio = self.room.ceiling_height_m / camera_m - 1
        above = inverse * ratio
        found = replace(
            columns,
            floor=np.where(mine, inverse, columns.floor),
            floor_sigma=np.where(mine, SURE_RAD * (1 + inverse**2), columns.floor_sigma),
            ceiling_sigma=np.where(mine, UNKNOWN, columns.ceiling_sigma),
        )
        if not self.ceiling:
            return found
        sure = np.where(mine, SURE_RAD * (1 + above**2), columns.ceiling_sigma)
        ceiling = np.where(mine, above, columns.ceiling)
        return replace(found, ceiling=ceiling, ceiling_sigma=sure, ratio=ratio, ratio_sigma=SURE_RATIO)

    def exact(self, room: RoomModel) -> RoomModel:
        """Return an estimated room with what is held where it was; `NoRoomError` where none fits around it."""
        lines, names = [line_of(room, k) for k in range(len(room.floor))], []
        for k in self.walls:
            mine = line_of(self.room, k)
            if (found := _wall_at(room, mine[0] + mine[1] * self.room.wall_length_m(k) / 2, mine[1])) < 0:
                raise NoRoomError(f"no room fits around wall {k}", advice="hold fewer walls, or place the rest as well")
            lines[found] = mine
            names.append(f"wall {found}")
        for k in self.corners:
            away = [math.dist(self.room.floor[k], place) for place in room.floor]
            if min(away) > CORNER_M:
                raise NoRoomError(f"no room fits around corner {k}", advice="hold fewer corners, or place the rest")
            found = int(np.argmin(away))
            for one in (found - 1, found):
                if f"wall {one % len(lines)}" not in names:
                    lines[one] = np.array(self.room.floor[k]), lines[one][1]
            names.append(f"corner {found}")
        floor = tuple(_meeting(lines[k - 1], lines[k]) for k in range(len(lines)))
        height = self.room.ceiling_height_m if self.ceiling else room.ceiling_height_m
        held = (*sorted(set(names)), *([CEILING] if self.ceiling else []))
        made = room.model_copy(update={"floor": floor, "ceiling_height_m": height, "held": held})
        if problems := geometry_problems(made):
            raise NoRoomError(f"no room fits the parts that are held: {problems[0]}", advice="hold less of it")
        return made

    def openings(self, room: RoomModel, found: Iterable[Opening]) -> tuple[Opening, ...]:
        """Return the openings placed by hand on the walls that they are now in, and those ``found`` beside them."""
        placed = [moved for one in self.room.openings if one.confidence == 1 and (moved := self._on_wall(room, one))]
        taken = [({one.wall}, middle_of(room, one), one.end_m - one.start_m) for one in placed]
        taken += [(set(range(len(room.floor))), place, 0.5) for place in self.gone]

        def free(one: Opening) -> bool:
            at, wide = middle_of(room, one), one.end_m - one.start_m
            return all(one.wall not in walls or math.dist(at, p) > (wide + w) / 2 for walls, p, w in taken)

        return tuple(placed + list(filter(free, found)))

    def _on_wall(self, room: RoomModel, one: Opening) -> Opening | None:
        start, way = line_of(self.room, one.wall)
        wall = _wall_at(room, start + way * (one.start_m + one.end_m) / 2, way)
        if wall < 0:
            return None
        far, (first, along) = room.wall_length_m(wall), line_of(room, wall)
        begin, end = sorted(float(np.clip((start + way * m - first) @ along, 0, far)) for m in (one.start_m, one.end_m))
        top = min(one.head_m, room.ceiling_height_m)
        if end - begin < 0.05 or top <= one.sill_m:
            return None
        return one.model_copy(update={"wall": wall, "start_m": round(begin, 4), "end_m": round(end, 4), "head_m": top})


def line_of(room: RoomModel, wall: int) -> tuple[Doubles, Doubles]:
    """Return a wall's first corner (shape (2,), m) and its direction (2,)."""
    start, end = np.array(room.floor[wall]), np.array(room.floor[(wall + 1) % len(room.floor)])
    return start, (end - start) / max(float(np.hypot(*(end - start))), 1e-9)


def middle_of(room: RoomModel, one: Opening) -> tuple[float, float]:
    """Return the place of an opening's middle on the plan, m."""
    start, along = line_of(room, one.wall)
    x, y = start + along * (one.start_m + one.end_m) / 2
    return float(x), float(y)


def _wall_at(room: RoomModel, place: Doubles, way: Doubles) -> int:
    """Return the wall that a place (2,), m, is part of and that looks along ``way`` (2,); -1: none does nearby.

    Two walls may lie on one line, with a recess between them."""
    lines, every = [line_of(room, k) for k in range(len(room.floor))], range(len(room.floor))
    beside = [k for k in every if 0 <= (place - lines[k][0]) @ lines[k][1] <= room.wall_length_m(k)] or list(every)
    found = _nearest((place, way), [lines[k] for k in beside], FITS_M, FITS_SIN)
    return beside[found] if found >= 0 else -1


def _nearest(line: tuple[Doubles, Doubles], some: list[tuple[Doubles, Doubles]], most_m: float, most_sin: float) -> int:
    """Return which of several lines lies nearest to a line, of those that look the same way; -1: none does."""
    best, found = most_m, -1
    for k, (start, along) in enumerate(some):
        turned = along[0] * line[1][1] - along[1] * line[1][0]
        off = abs(along[0] * (line[0] - start)[1] - along[1] * (line[0] - start)[0])
        if along @ line[1] > 0 and abs(turned) < most_sin and off < best:
            best, found = off, k
    return found


def _meeting(one: tuple[Doubles, Doubles], other: tuple[Doubles, Doubles]) -> tuple[float, float]:
    """Return where two lines meet; where they are parallel, the other's beginning."""
    across = one[1][0] * other[1][1] - one[1][1] * other[1][0]
    if abs(across) < 1e-6:
        return float(other[0][0]), float(other[0][1])
    away = other[0] - one[0]
    x, y = one[0] + one[1] * (away[0] * other[1][1] - away[1] * other[1][0]) / across
    return round(float(x), 4), round(float(y), 4)

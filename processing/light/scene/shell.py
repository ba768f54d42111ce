"""A room model as surfaces and panes: windows are cut out and get reveals and glass.

Doors and passages stay part of their wall: their look is in the wall's texture, and what light comes through a
passage counts as if the wall there reflected it.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import fields, replace

import numpy as np

from processing.errors import ParameterError
from processing.ground.arrays import Doubles, Floats
from processing.ground.room_model import Opening, OpeningKind, RoomModel
from processing.light.scene.scene import Pane, Surface, Vector, plain
from processing.surfaces.maps import FIRST_WALL, Facet, Plane, check_stands, planes_of

REVEAL_M = 0.2
"""Depth of a window's niche where nobody knows it: a common outer wall with the glass near its outer face."""
UP = np.array([0.0, 0.0, 1.0])


def shell_of(
    room: RoomModel,
    *,
    reveal_m: float = REVEAL_M,
    albedo: Callable[[str], Floats] = lambda _: plain(0.5),
    transmittance: dict[int, Vector] | None = None,
    sheets: int = 0,
) -> tuple[tuple[Surface, ...], tuple[Pane, ...]]:
    """Return the surfaces (floor, ceiling, walls in order, then reveals) and panes of a room.

    ``albedo`` gives each surface's texture, (H, W, 3) reflectances in 0..1, by its name (floor, ceiling, wall-0 ..,
    reveal-2-left ..); ``transmittance``
    that of each window by its number among the openings (1 where it is not given); ``sheets`` of clear glass let it
    fall with the angle (`scene.Pane`).

    Raises
    ------
    RoomError
        The room cannot stand.
    """
    check_stands(room)
    if not 0 <= reveal_m <= 2:
        raise ParameterError(f"reveals {reveal_m} m deep", advice="give 0 to 2", reveal_m=True)
    windows = [(i, o) for i, o in enumerate(room.openings) if o.kind is OpeningKind.WINDOW]
    surfaces = [
        _surface(plane, [o for _, o in windows if o.wall == plane.index - FIRST_WALL], room)
        for plane in planes_of(room)
    ]
    panes = []
    for number, window in windows:
        niche = _Niche(room, window, reveal_m)
        if reveal_m > 0:
            surfaces += niche.reveals(number)
        panes.append(replace(niche.pane(number, (transmittance or {}).get(number, (1.0, 1.0, 1.0))), sheets=sheets))
    return tuple(replace(one, albedo=albedo(one.name)) for one in surfaces), tuple(panes)


def _surface(plane: Plane, windows: list[Opening], room: RoomModel) -> Surface:
    top = room.ceiling_height_m
    width = plane.width_m
    # Along the plane u runs against the wall's own direction.
    holes = tuple(
        (max(width - o.end_m, 0.0), max(top - o.head_m, 0.0), min(width - o.start_m, width), top - o.sill_m)
        for o in windows
    )
    shape = {each.name: getattr(plane, each.name) for each in fields(Facet)}
    return Surface(**shape, holes_m=holes, plane=plane.index)


class _Niche:
    """A window's place in its wall."""

    def __init__(self, room: RoomModel, window: Opening, depth_m: float) -> None:
        plane = planes_of(room)[FIRST_WALL + window.wall]
        self.along, self.inward, self.depth_m = -plane.u_axis, plane.normal, depth_m
        start = np.array([*room.floor[window.wall], 0.0])
        low, high = max(window.start_m, 0.0), min(window.end_m, plane.width_m)
        self.sill_m, self.head_m = window.sill_m, min(window.head_m, room.ceiling_height_m)
        self.width_m = high - low
        self.foot = start + low * self.along

    def pane(self, number: int, transmittance: Vector) -> Pane:
        corner = self.foot + self.sill_m * UP - self.depth_m * self.inward
        rise = (self.head_m - self.sill_m) * UP
        return Pane(corner, self.width_m * self.along, rise, transmittance, number)

    def reveals(self, number: int) -> list[Surface]:
        low, high = self.foot + self.sill_m * UP, self.foot + self.head_m * UP
        end = self.width_m * self.along
        rise = self.head_m - self.sill_m
        outward = -self.inward
        return [
            self._reveal(f"reveal-{number}-sill", low, self.along, UP, self.width_m, outward),
            self._reveal(f"reveal-{number}-head", high, self.along, -UP, self.width_m, outward),
            self._reveal(f"reveal-{number}-start", low, UP, self.along, rise, outward),
            self._reveal(f"reveal-{number}-end", low + end, UP, -self.along, rise, outward),
        ]

    def _reveal(self, name: str, origin: Doubles, u: Doubles, normal: Doubles, width_m: float, v: Doubles) -> Surface:
        outline = np.array([[0, 0], [width_m, 0], [width_m, self.depth_m], [0, self.depth_m]], dtype=np.float64)
        return Surface(name, origin, u, v, normal, width_m, self.depth_m, outline)

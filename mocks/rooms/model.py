"""What a simulated room is made of, as data: plan, openings, fixtures, materials, furniture.

Metres, right-handed, z up; the origin lies on the floor below the panorama camera, y ahead, x right. A wall is an edge
of the floor polygon (counter-clockwise, so the room lies to the left of each edge); places on a wall are distances
along its edge from the edge's first corner. Albedo and emission are linear RGB with Rec. 709 primaries.
"""

import math
from dataclasses import dataclass, field, replace
from enum import StrEnum
from typing import Any, Literal, Self, TypeAlias

from mocks.worlds.light import Vector
from processing.ground.mesh import Mesh
from processing.ground.tables import table_of

ADE20K: dict[str, int] = table_of(__package__, "ade20k")
"""Numbers of the ADE20K classes (150, counted from 0) that simulated rooms hold; equipment has none and is -1."""

NO_CLASS = -1  # beside every class's number
USES: dict[str, dict[str, Any]] = table_of(__package__, "uses")  # what follows from each `Use`
Point: TypeAlias = tuple[float, float]

CAMERA_HEIGHT_M = 1.6  # the paper's tripod


class Use(StrEnum):
    """What a room is for."""

    BEDROOM = "bedroom"
    LIVING = "living"
    DINING = "dining"
    OFFICE = "office"
    EMPTY = "empty"
    """No furniture at all."""


class Role(StrEnum):
    """What a part of the room is to the pipeline."""

    SHELL = "shell"
    """Floor, walls, ceiling, reveals, frames, doors."""
    FIXTURE = "fixture"
    """Stays when the room is emptied: radiators, sockets, skirting, ceiling lamps, curtains."""
    FURNITURE = "furniture"
    CLUTTER = "clutter"
    """Small things on furniture, floor or wall; goes with the furniture."""
    EQUIPMENT = "equipment"
    """The photographer's own: tripod and meter board."""


@dataclass(frozen=True)
class Texture:
    """A generated pattern that repeats: `mocks.rooms.textures.catalogue` makes its tile from these parameters."""

    kind: str
    seed: int
    colours: tuple[Vector, ...]
    options: tuple[tuple[str, float], ...] = ()

    def option(self, name: str, default: float) -> float:
        """Return an option's value."""
        return dict(self.options).get(name, default)


@dataclass(frozen=True)
class Material:
    """How a surface meets light: diffuse albedo (plain or textured), and a gloss if ``roughness`` is given.

    ``colour`` is the albedo where there is no texture, else the texture's mean. ``roughness`` is that of a dielectric
    coat (0.05 polished .. 0.5 satin), None for a matte surface. ``emission_cd_m2`` is what a lit lamp gives off.
    """

    name: str
    colour: Vector
    texture: Texture | None = None
    roughness: float | None = None
    emission_cd_m2: Vector = (0.0, 0.0, 0.0)


@dataclass(frozen=True)
class Part:
    """A mesh of one material, and what it is to the truth. ``instance`` is 0 for the shell and its fixtures."""

    mesh: Mesh
    material: Material
    surface: str
    """floor, ceiling, wall, reveal, window frame, door, radiator, ... or the item's kind."""
    ade: int
    """ADE20K class; `NO_CLASS` for equipment."""
    role: Role
    instance: int = 0
    wall: int = -1
    """Of walls: which edge of the polygon."""

    def placed(self, position_m: Vector, turn_rad: float = 0.0) -> Self:
        """Return the part turned about z, then moved."""
        return replace(self, mesh=self.mesh.placed(position_m, turn_rad))


@dataclass(frozen=True)
class Window:
    """A window in a wall; ``depth_m`` is the wall's thickness, the panes lie at its outer side."""

    wall: int
    start_m: float
    width_m: float
    sill_m: float
    height_m: float
    depth_m: float = 0.24
    frame_m: float = 0.06
    panes_across: int = 1
    panes_up: int = 1


@dataclass(frozen=True)
class Door:
    """A door in a wall. ``hinge`` names the end of the opening (along the wall) where the leaf hangs.

    ``open_rad`` is 0 for a shut door; an open one shows a dim windowless hallway.
    """

    wall: int
    start_m: float
    width_m: float
    height_m: float
    hinge: Literal["start", "end"] = "start"
    opens: Literal["in", "out"] = "in"
    open_rad: float = 0.0
    depth_m: float = 0.12


@dataclass(frozen=True)
class Fixture:
    """Something fixed to a wall (or, with ``wall`` -1, to the ceiling at ``centre``)."""

    kind: str
    """radiator, socket, switch, curtain, blind, ceiling lamp, spot ..."""
    wall: int = -1
    start_m: float = 0.0
    width_m: float = 0.0
    bottom_m: float = 0.0
    height_m: float = 0.0
    depth_m: float = 0.0
    centre: Point = (0.0, 0.0)
    lit: bool = False
    seed: int = 0


@dataclass(frozen=True)
class Plan:
    """The empty room: where floor, walls, openings and fixtures are."""

    use: Use
    polygon: tuple[Point, ...]
    height_m: float
    windows: tuple[Window, ...]
    doors: tuple[Door, ...]
    fixtures: tuple[Fixture, ...] = ()
    skirting_m: float = 0.08
    camera_height_m: float = CAMERA_HEIGHT_M

    def wall_ends(self, wall: int) -> tuple[Point, Point]:
        """Return the two corners of a wall."""
        return self.polygon[wall], self.polygon[(wall + 1) % len(self.polygon)]

    def wall_length_m(self, wall: int) -> float:
        """Return the length of a wall."""
        (x0, y0), (x1, y1) = self.wall_ends(wall)
        return math.hypot(x1 - x0, y1 - y0)

    def wall_axes(self, wall: int) -> tuple[Point, Point]:
        """Return the unit vectors along a wall and from it into the room."""
        (x0, y0), (x1, y1) = self.wall_ends(wall)
        length = self.wall_length_m(wall)
        along = ((x1 - x0) / length, (y1 - y0) / length)
        return along, (-along[1], along[0])

    def floor_along(self, wall: int, along_m: tuple[float, float], away_m: tuple[float, float]) -> list[Point]:
        """Return the corners of the floor between two places along a wall and two distances from it, all metres."""
        (start, end), (near, far) = along_m, away_m
        return [self.on_wall(wall, a, b) for a, b in ((start, near), (end, near), (end, far), (start, far))]

    def on_wall(self, wall: int, start_m: float, away_m: float = 0.0) -> Point:
        """Return the floor point at a distance along a wall and away from it, into the room."""
        (x0, y0), _ = self.wall_ends(wall)
        along, inward = self.wall_axes(wall)
        return (x0 + along[0] * start_m + inward[0] * away_m, y0 + along[1] * start_m + inward[1] * away_m)


@dataclass(frozen=True)
class Finish:
    """The materials of one room, chosen to go together."""

    floor: Material
    wall: Material
    accent_wall: Material
    ceiling: Material
    trim: Material
    """Skirting and door frames."""
    door: Material
    window_frame: Material
    radiator: Material
    wood: Material
    """Of most furniture."""
    second_wood: Material
    lacquer: Material
    """Painted furniture fronts."""
    metal: Material
    fabric: Material
    """Sofa, armchairs."""
    second_fabric: Material
    """Cushions, chairs."""
    bedding: Material
    curtain: Material
    rug: Material
    accent_walls: tuple[int, ...] = ()
    """The walls (edge numbers) that have the accent material."""

    def wall_material(self, wall: int) -> Material:
        """Return the material of a wall."""
        return self.accent_wall if wall in self.accent_walls else self.wall


@dataclass(frozen=True)
class Item:
    """A piece of furniture or clutter in its place.

    ``position_m`` is the middle of the footprint at the item's lowest point; ``size_m`` is width, depth, height before
    turning; ``turn_rad`` turns it counter-clockwise about z. Unturned, it faces -y (a sofa's seat, a cabinet's doors),
    width along x.
    """

    kind: str
    role: Role
    instance: int
    position_m: Vector
    size_m: Vector
    turn_rad: float = 0.0
    seed: int = 0
    options: tuple[tuple[str, float], ...] = field(default=())

    def corners(self) -> tuple[Point, Point, Point, Point]:
        """Return the footprint's corners, counter-clockwise."""
        x, y, _ = self.position_m
        w, d = self.size_m[0] / 2, self.size_m[1] / 2
        c, s = math.cos(self.turn_rad), math.sin(self.turn_rad)
        a, b, e, f = ((x + c * u - s * v, y + s * u + c * v) for u, v in ((-w, -d), (w, -d), (w, d), (-w, d)))
        return (a, b, e, f)

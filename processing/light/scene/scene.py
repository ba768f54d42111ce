"""What is rendered: flat surfaces with textures, panes of glass, furniture as meshes, and the light outdoors.

World axes and units as in docs/reference/coordinates.md; radiance is linear RGB in cd/m2, irradiance in lx, albedo 0
to 1.
Light goes from surface to surface as if all were matte (Lambert); what the eye sees of furniture and of glossy floors
has highlights besides (`highlights`)."""

import math
from collections.abc import Callable
from dataclasses import dataclass, field, fields, replace
from functools import cached_property
from typing import Self

import cv2
import numpy as np
import numpy.typing as npt

from processing.errors import MaterialError, ParameterError, SceneError
from processing.ground.arrays import Doubles, Floats, Indices, Int32s, Vector
from processing.ground.mesh import crosses
from processing.ground.room_model import Opening, OpeningKind, RoomModel
from processing.surfaces.maps import FIRST_WALL, Facet, Plane, check_stands, planes_of

# How much light clear glass lets through at an angle, from what it lets through head on.
#
# Fresnel's equations for unpolarised light on both faces of each sheet, all reflections between faces counted, and
# Bouguer's law within (Duffie and Beckman, Solar Engineering of Thermal Processes, 4th edition, chapter 5): N sheets
# pass (1 - r) / (1 + (2 N - 1) r) of each polarisation, times what is not absorbed on the way, which the given
# transmittance head on implies.


INDEX = 1.526  # of refraction: window glass
TABLE = 257  # angles (even in their cosine) of `transmittance_table`; linear between them to 0.05 %
SUN_RADIUS_RAD = math.radians(0.53 / 2)
BLACK: Vector = (0.0, 0.0, 0.0)


def transmittance_at(cosine: Doubles, head_on: Vector, sheets: int) -> Doubles:
    """Return the transmittance (N, 3) of panes of clear glass at cosines (N,) of incidence, 0 to 1.

    ``head_on`` is that at a cosine of 1, of all ``sheets`` together; more than bare reflection leaves is taken as glass
    that absorbs nothing."""
    cos_out = np.clip(np.asarray(cosine, np.float64), 0, 1)
    cos_in = np.sqrt(1 - (1 - cos_out**2) / INDEX**2)
    open_share = _unabsorbed(cos_out, cos_in, sheets)
    most = float(_unabsorbed(np.ones(1), np.ones(1), sheets)[0])
    level = np.asarray(head_on, np.float64)
    left = np.minimum(level / most, 1.0)
    # Relative to head on, so that what was given comes back there.
    return np.asarray(level * (open_share / most)[:, None] * left ** (1 / cos_in[:, None] - 1))


def _unabsorbed(cos_out: Doubles, cos_in: Doubles, sheets: int) -> Doubles:
    """Return what reflection alone leaves (N,), the mean of both polarisations."""
    across = ((cos_out - INDEX * cos_in) / (cos_out + INDEX * cos_in)) ** 2
    along = ((INDEX * cos_out - cos_in) / (INDEX * cos_out + cos_in)) ** 2
    passed = [(1 - r) / (1 + (2 * sheets - 1) * r) for r in (across, along)]
    return np.asarray((passed[0] + passed[1]) / 2)


def transmittance_table(head_on: Vector, sheets: int) -> Doubles:
    """Return transmittance, shape (`TABLE`, 3), at cosines evenly from 0 to 1; one row for no sheets."""
    if sheets == 0:
        return np.asarray(head_on, np.float64).reshape(1, 3)
    return transmittance_at(np.linspace(0, 1, TABLE), head_on, sheets)


def plain(colour: Vector | float) -> Floats:
    """Return one colour as a texture of one texel, shape (1, 1, 3)."""
    return np.broadcast_to(np.asarray(colour, dtype=np.float32), (3,)).reshape(1, 1, 3).copy()


@dataclass(frozen=True)
class Material:
    """How a furniture part meets light, in the terms of glTF: albedo of the base, roughness, metallic share."""

    name: str
    colour: Vector
    texture: Floats | None = None
    """(H, W, 3) linear, multiplied with ``colour``; uv (0, 0) is its lower left corner, and it repeats."""
    roughness: float = 1.0
    metallic: float = 0.0
    emission_cd_m2: Vector = BLACK
    creases: float = 0.0
    """Slope of creases that the mesh does not have (`solver.sight.crease`), 0: none."""

    def __post_init__(self) -> None:
        where = f"material {self.name}"
        _check_albedo(where, np.asarray(self.colour))
        if self.texture is not None:
            _check_texture(where, self.texture)
        _check_emission(where, np.asarray(self.emission_cd_m2))
        if not (0 <= self.roughness <= 1 and 0 <= self.metallic <= 1):
            given = f"roughness {self.roughness:g}, metallic {self.metallic:g}"
            raise MaterialError(given, where=where, advice="give both within 0 and 1")


@dataclass(frozen=True)
class Part:
    """A mesh of one material."""

    name: str
    vertices_m: Doubles
    """(N, 3), in the world."""
    faces: Int32s
    """(M, 3), counter-clockwise seen from outside."""
    material: Material
    uv: Floats | None = None
    """(N, 2)."""
    normals: Floats | None = None
    """(N, 3) unit, in the world: round shapes look round; None: every face is flat."""

    def __post_init__(self) -> None:
        shapes = self.vertices_m.ndim == 2 and self.vertices_m.shape[1] == 3 and self.faces.shape[1:] == (3,)
        if not shapes or not len(self.faces):
            raise SceneError("no triangles", where=f"part {self.name}", advice="give vertices (n, 3) and faces (m, 3)")
        if not np.isfinite(self.vertices_m).all() or np.abs(self.vertices_m).max() > 1e4:
            text = "a vertex that is not finite, or kilometres away"
            likely = "a damaged file, or units other than metres"
            raise SceneError(text, where=f"part {self.name}", likely=likely, advice="repair the mesh")
        if self.faces.min() < 0 or self.faces.max() >= len(self.vertices_m):
            raise SceneError("a face refers to no vertex", where=f"part {self.name}", advice="repair the mesh")
        if self.normals is not None and (
            self.normals.shape != self.vertices_m.shape or not np.isfinite(self.normals).all()
        ):
            raise SceneError("normals that fit no vertices", where=f"part {self.name}", advice="leave them out")

    @cached_property
    def levels(self) -> tuple[Floats, ...]:
        """The texture, (H, W, 3) linear, and its halves, quarters, ... down to a texel (Williams 1983)."""
        texture = self.material.texture
        found = [] if texture is None else [np.asarray(texture, np.float32)]
        while found and max(found[-1].shape[:2]) > 1:
            size = [max(1, n // 2) for n in found[-1].shape[1::-1]]
            found.append(np.asarray(cv2.resize(found[-1], size, interpolation=cv2.INTER_AREA), np.float32))
        return tuple(found)

    @cached_property
    def texels_per_m(self) -> float:
        """How fine the texture lies upon the part: the mean over its area."""
        if self.uv is None or not self.levels:
            return 0.0
        flat = np.pad(np.asarray(self.uv, np.float64) * self.levels[0].shape[1::-1], ((0, 0), (0, 1)))
        doubled = [np.linalg.norm(crosses(one, self.faces), axis=1).sum() for one in (flat, self.vertices_m)]
        return float(np.sqrt(doubled[0] / max(doubled[1], 1e-12)))


@dataclass(frozen=True)
class Surface(Facet):
    """A flat piece of the room, seen from its front: floor, ceiling, a wall with its openings, a window's reveal."""

    holes_m: tuple[tuple[float, float, float, float], ...] = ()
    """Rectangles (u0, v0, u1, v1) that are cut out; only in rectangular surfaces."""
    albedo: Floats = field(default_factory=lambda: plain(0.5))
    """(H, W, 3), stretched over width x height; row 0 at v = 0."""
    emission_cd_m2: Floats = field(default_factory=lambda: plain(0.0))
    """(H, W, 3), likewise: lamps."""
    plane: int = -1
    """The room's plane (`surfaces.maps.Plane.index`) that this belongs to, -1 for reveals."""
    gloss: float = 0.0
    """How much of full varnish it mirrors, 0 to 1 (`gloss`); its albedo is without that."""

    def __post_init__(self) -> None:
        _check_texture(f"surface {self.name}", self.albedo)
        _check_emission(f"surface {self.name}", self.emission_cd_m2)
        if not 0 <= self.gloss <= 1:
            raise MaterialError(f"a gloss of {self.gloss}", where=f"surface {self.name}", advice="give 0 to 1")


@dataclass(frozen=True)
class Pane:
    """A rectangle of glass, or nothing but air, to the outdoors."""

    corner_m: Doubles
    across_m: Doubles
    """(3,), level, its length the pane's width."""
    up_m: Doubles
    """(3,), its length the pane's height."""
    transmittance: Vector = (1.0, 1.0, 1.0)
    opening: int = -1
    """Index into the room's openings."""
    clear: Floats = field(default_factory=lambda: np.ones((1, 1), np.float32))
    """(H, W): how much of the glass is clear of bars, curtains and blinds; row 0 at the top, column 0 at the corner."""
    veil_cd_m2: Floats = field(default_factory=lambda: plain(0.0))
    """(H, W, 3), of the size of ``clear``: radiance of what covers it, towards the room."""
    sheets: int = 0
    """Of clear glass: ``transmittance`` is then that head on, and falls with the angle (`glass`); 0: alike at all."""
    sun_clear: Floats | None = None
    """(H, W): ``clear`` for the sun's beam, which no tree behind the glass stops; as ``clear`` where not known."""
    sun_rim: tuple[int, ...] = (0, 0, 0, 0)
    """Cells along its first and last column, its top and bottom, that let no sun in besides (`solver.sun.sun_rim`)."""

    @property
    def clear_for_sun(self) -> Floats:
        """Return how much of each cell (H, W) the sun's beam passes, 0 to 1, but for the rim."""
        return self.clear if self.sun_clear is None else self.sun_clear

    def through(self, rays: npt.NDArray[np.floating]) -> Floats:
        """Return the transmittance (N, 3) of the clear glass along rays (N, 3), unit."""
        if not self.sheets:
            return np.broadcast_to(np.asarray(self.transmittance, np.float32), (len(rays), 3))
        cosine = np.abs(rays @ self.normal)
        return transmittance_at(cosine, self.transmittance, self.sheets).astype(np.float32)

    @property
    def normal(self) -> Doubles:
        """Return the unit vector across the pane, shape (3,)."""
        found = np.cross(self.across_m, self.up_m)
        return np.asarray(found / np.linalg.norm(found))

    def __post_init__(self) -> None:
        where = f"pane of opening {self.opening}"
        if not 0 <= self.sheets <= 4:
            raise MaterialError(f"{self.sheets} sheets of glass", where=where, advice="0 to 4")
        share = np.asarray(self.transmittance)
        if not (np.isfinite(share).all() and (share >= 0).all() and (share <= 1).all()):
            raise MaterialError(f"a transmittance of {self.transmittance}", where=where, advice="give 0 to 1")
        if self.veil_cd_m2.shape != (*self.clear.shape, 3):
            raise SceneError("veil and clear share of a pane differ in size", advice="give (h, w, 3) and (h, w)")
        if self.clear_for_sun.shape != self.clear.shape:
            raise SceneError("a pane's clear shares differ in size", advice="give (h, w) for both")
        for share in (self.clear, self.clear_for_sun):
            _check_albedo(where, share)
        _check_emission(where, self.veil_cd_m2)

    def shares(self, points: npt.NDArray[np.floating]) -> tuple[Doubles, Doubles]:
        """Return which share of the pane's width, and of its height from the top, places (N, 3) on it are at."""
        offset = points - self.corner_m
        u = offset @ self.across_m / (self.across_m @ self.across_m)
        return u, 1 - offset @ self.up_m / (self.up_m @ self.up_m)

    def cells(self, points: npt.NDArray[np.floating]) -> tuple[Indices, Indices]:
        """Return row and column of ``clear`` at places (N, 3) on the pane."""
        (rows, columns), (u, v) = self.clear.shape, self.shares(points)
        row, column = np.floor(v * rows).astype(np.intp), np.floor(u * columns).astype(np.intp)
        return row.clip(0, rows - 1), column.clip(0, columns - 1)


@dataclass(frozen=True)
class Sun:
    """The sun, kept apart from the sky so that it neither flickers nor loses energy."""

    direction: Vector
    normal_illuminance_lx: Vector
    """RGB, on a plane that faces it, outdoors."""
    radius_rad: float = SUN_RADIUS_RAD
    clipped: bool = False
    """Its disc was overexposed: the illuminance is a lower bound."""

    def __post_init__(self) -> None:
        _check_emission("sun", np.asarray(self.normal_illuminance_lx))
        length = float(np.linalg.norm(self.direction))
        if not (abs(length - 1) < 1e-3 and 0 < self.radius_rad < 0.1):
            given = f"a sun towards {self.direction}, {self.radius_rad:g} rad wide"
            raise SceneError(given, where="outdoors", advice="give a unit direction and a radius below 0.1 rad")


@dataclass(frozen=True)
class Outdoors:
    """All light from outside: an equirectangular picture without the sun's disc, and the sun."""

    rgb: Floats
    """(H, 2h, 3) cd/m2; laid out as any panorama."""
    sun: Sun | None = None

    def __post_init__(self) -> None:
        if self.rgb.ndim != 3 or self.rgb.shape[1:] != (2 * self.rgb.shape[0], 3):
            raise SceneError(f"an outdoor picture of shape {self.rgb.shape}", advice="give (h, 2 h, 3)")
        _check_emission("outdoors", self.rgb)


@dataclass(frozen=True)
class Scene:
    """All that is rendered."""

    surfaces: tuple[Surface, ...]
    panes: tuple[Pane, ...]
    outdoors: Outdoors
    parts: tuple[Part, ...] = ()

    def __post_init__(self) -> None:
        if not self.surfaces and not self.parts:
            raise SceneError("nothing to render", advice="give surfaces or parts")

    def furnished(self, parts: tuple[Part, ...]) -> Self:
        """Return the scene with furniture added."""
        return replace(self, parts=(*self.parts, *parts))

    def under(self, outdoors: Outdoors) -> Self:
        """Return the scene in another light."""
        return replace(self, outdoors=outdoors)


def _check_albedo(where: str, values: npt.NDArray[np.floating]) -> None:
    if not (np.isfinite(values).all() and (values >= 0).all() and (values <= 1).all()):
        likely = "a damaged texture, or values of 0 to 255"
        advice = "repair it; linear values within 0 and 1"
        raise MaterialError("an albedo that is not a number within 0 and 1", where=where, likely=likely, advice=advice)


def _check_texture(where: str, values: Floats) -> None:
    if values.ndim != 3 or values.shape[2] != 3 or 0 in values.shape:
        raise MaterialError(f"a texture of shape {values.shape}", where=where, advice="give (h, w, 3)")
    _check_albedo(where, values)


def _check_emission(where: str, values: npt.NDArray[np.floating]) -> None:
    if not (np.isfinite(values).all() and (values >= 0).all()):
        raise MaterialError("light that is negative or not a number", where=where, advice="give finite values from 0")


# A room model as surfaces and panes: windows are cut out and get reveals and glass.
#
# Doors and passages stay part of their wall: their look is in the wall's texture, and what light comes through a
# passage counts as if the wall there reflected it.

REVEAL_M = 0.2  # depth of a window's niche where nobody knows it: an outer wall with the glass near its outer face
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

    Raises `RoomError`: the room cannot stand."""
    check_stands(room)
    if not 0 <= reveal_m <= 2:
        raise ParameterError(f"reveals {reveal_m} m deep", advice="give 0 to 2", reveal_m=True)
    windows = [(i, o) for i, o in enumerate(room.openings) if o.kind is OpeningKind.WINDOW]
    surfaces = [_surface(p, [o for _, o in windows if o.wall == p.index - FIRST_WALL], room) for p in planes_of(room)]
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

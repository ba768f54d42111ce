"""Furniture in a session's emptied room while somebody moves it: its shade and its own light in a fraction of a second.

As `daylit process` renders it (`processing.light.picture.composite`), but from kept rays (`beams`), few of them, in a
small picture, without mirrors, and with light that furniture gives back counted once.
"""

import json
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np

from processing.ground.arrays import Flags, Floats, Indices, Vector
from processing.ground.seam import resized
from processing.layout.arrangement import PlacedItem
from processing.layout.models.catalogue import Catalogue
from processing.light.picture.beams import FAR_M, Beams, Body, Field, beams_at
from processing.light.picture.change import MISFIT
from processing.light.picture.edges import MOST_GAIN, bounded
from processing.light.scene.scene import Outdoors, Scene
from processing.light.solver.kernels import STEP_OFF_M
from processing.light.solver.sight import FIRST_PART, NOTHING, Sight, albedo_of, emission_of, sight_along, sight_of
from processing.light.solver.stage import Stage
from processing.light.solver.sun import sun_of
from processing.light.solver.transport import light_map
from processing.light.solver.upsample import Neighbours, Places, Steps
from processing.pictures.images import LUMINANCE_WEIGHTS, LuminanceImage
from processing.relighting.relit_session import read_session_room
from processing.sphere import Equirectangular
from processing.stages.furnishing import furniture_parts

ROWS, SMALL_ROWS = 512, 96
"""Of the picture, and of the one in which light is gathered (chosen: a piece that moves takes 0.1 CPU s)."""
SAMPLES, OWN_SAMPLES = (12, 3), (16, 4)
"""Rays for bounces and to each pane, of a place of the room and of furniture; chosen by look."""
TEXEL_M, SUN_SAMPLES = 0.2, 8
PARTS = 1000  # labels that each piece has for its parts
_WEIGHTS = np.asarray(LUMINANCE_WEIGHTS, np.float32)


@lru_cache(maxsize=256)
def _stage(category: str, model: str, size_m: Vector, style: str, own: Path | None) -> Stage:
    """Return a piece alone in its own frame."""
    item = PlacedItem(id="piece", category=category, model=model, size_m=size_m, theta_rad=0, t_m=(0, 0, 0))
    parts = furniture_parts([item], Catalogue.builtin(style), None if own is None else Catalogue.at(own))
    return Stage.of(Scene((), (), Outdoors(np.zeros((2, 4, 3), np.float32)), parts), TEXEL_M)


@dataclass(frozen=True)
class _Seen:
    """What a panorama's pixels see of a piece, in the room's frame."""

    pixel: Indices
    sight: Sight
    own: Sight
    """The same in the piece's own frame."""


class _Piece:
    """A piece where it stands: what it shows, and the rays that light that."""

    def __init__(self, room: "LiveFurniture", body: Body) -> None:
        self.body = body
        self.small, self.large = (self._seen(room, rays) for rays in (room.small.rays, room.large.rays))
        sight = self.small.sight
        beams, self.distance_m = beams_at(room.bare, room.light, sight.point, sight.normal, OWN_SAMPLES, 1)
        self.field, self.sun = Field(beams, len(sight.label)), room.sunlit(self.large.sight)
        self.albedo, self.emission = (f(body.stage, self.large.own) for f in (albedo_of, emission_of))

    def _seen(self, room: "LiveFurniture", rays: Floats) -> _Seen:
        stage, pose = self.body.stage, self.body.pose
        pixel, eye, own = self.body.near(np.asarray([room.eye_m], np.float32), rays * np.float32(FAR_M))
        first = tuple(float(v) for v in eye[0]) if len(eye) else (0.0, 0.0, 0.0)
        found = sight_along(stage, own / np.float32(FAR_M), first, (1, len(own)))  # type: ignore[arg-type]
        there = np.flatnonzero(found.label >= FIRST_PART)
        found, turned = found.some(there), self.body.turned
        point = turned(found.point) + np.asarray(pose[2:], np.float32)
        return _Seen(pixel[there], replace(found, point=point.astype(np.float32), normal=turned(found.normal)), found)


class LiveFurniture:
    """A session's emptied room, ready for furniture that moves."""

    def __init__(self, session: Path, sunless: Flags | None = None) -> None:
        """``sunless`` (H, W): where removal took direct sun away, which falls there again; raises as reading does."""
        found = read_session_room(session, None, ROWS)
        self.photograph: LuminanceImage = found.picture
        self.eye_m, self.bare = found.eye_m, Stage.of(found.scene, TEXEL_M)
        self.light = light_map(self.bare)
        sizes = [Equirectangular(2 * n, n) for n in (SMALL_ROWS, self.photograph.rgb.shape[0])]
        self.small, self.large = (sight_of(self.bare, size, self.eye_m) for size in sizes)
        self._solid = np.flatnonzero(self.small.solid)
        seen = self.small.some(self._solid)
        beams, mean_m = beams_at(self.bare, self.light, seen.point, seen.normal, SAMPLES, 0)
        distance_m = np.zeros(len(self.small.label), np.float32)
        distance_m[self._solid] = mean_m
        self._neighbours = Neighbours.of(self.small, distance_m)
        self._places = Places.whole(self.large.shape)
        self._steps = Steps.of(self.small, self.large, self.large.solid, self._places, wraps=True, any_solid=True)
        self._field, self._sun = Field(beams, len(self._solid)), self.sunlit(self.large)
        self._old, self._old_sun = self._in_room((), None), self._sun_in_room(())
        # Where the photograph does not show the sun that the model expects, only the rest of the light is compared.
        model = albedo_of(self.bare, self.large) * (self._old + self._old_sun) / np.float32(math.pi) @ _WEIGHTS
        shown = self.photograph.rgb.reshape(-1, 3) @ _WEIGHTS
        fits = np.abs(np.log(np.maximum(model, 1e-6) / np.maximum(shown, 1e-6))) < MISFIT
        back = np.zeros_like(fits) if sunless is None else resized(sunless.astype(np.float32), self.large.shape) > 0.5
        self._returns, self._old_sun = back.ravel() & ~fits, self._old_sun * fits[:, None]
        old = self._old + self._old_sun
        self._dark, self._all_old = old <= 0, np.maximum(old, np.float32(1e-9))
        self._pieces: dict[tuple[Any, ...], _Piece] = {}

    def sunlit(self, sight: Sight) -> tuple[Field, Indices]:
        """Return the sun's rays to what pixels (N) see, and which (K,) it reaches in the bare room."""
        light = sun_of(self.bare, sight, SUN_SAMPLES, 0, block=1)
        lit, sun = np.flatnonzero(light.any(axis=1)), self.bare.scene.outdoors.sun
        towards = np.zeros(3) if sun is None else np.asarray(sun.direction)
        origin = sight.point[lit] + np.float32(STEP_OFF_M) * sight.normal[lit]
        way = np.broadcast_to((FAR_M * towards).astype(np.float32), origin.shape)
        return Field(Beams(np.arange(len(lit)), origin, way, light[lit], np.zeros(len(lit), np.float32)), len(lit)), lit

    def staged(self, items: Sequence[PlacedItem], style: str, own: Path | None = None) -> LuminanceImage:
        """Return the room with furniture where it stands now; raises `CatalogueError` for what has no model."""
        before, self._pieces = self._pieces, {}
        for one in items:
            what = (one.category, one.model, one.size_m, style, own)
            pose = (math.cos(one.theta_rad), math.sin(one.theta_rad), *one.t_m)
            key = (one.id, *what, pose)
            self._pieces[key] = before.get(key) or _Piece(self, Body(_stage(*what), pose))
        pieces = list(self._pieces.values())
        bodies = [piece.body for piece in pieces]
        # What a piece gives back: of the light on what is seen of it, the others' own not counted.
        glow = np.zeros((len(bodies), 3))
        for number, piece in enumerate(pieces):
            light = piece.field.under(bodies)
            glow[number] = piece.body.albedo * (light.mean(axis=0) if len(light) else 0)
        rgb = self.photograph.rgb.reshape(-1, 3) * self._gain(bodies, glow)
        self._furnish(pieces, [piece.field.under(bodies, glow) for piece in pieces], rgb)
        return replace(self.photograph, rgb=rgb.reshape(self.photograph.rgb.shape))

    def _in_room(self, bodies: Sequence[Body], glow: Any) -> Floats:
        small = self.small.picture(self._field.under(bodies, glow), self._solid)
        return self._steps.apply(self._neighbours.smooth(small))

    def _sun_in_room(self, bodies: Sequence[Body]) -> Floats:
        field, lit = self._sun
        return self.large.picture(field.under(bodies), lit).reshape(-1, 3)

    def _gain(self, bodies: Sequence[Body], glow: Any) -> Floats:
        """Return by how much furniture changes what pixels (N, 3) of the room show."""
        gain, sun = self._in_room(bodies, glow), self._sun_in_room(bodies)
        returned = sun[self._returns]
        np.minimum(sun, self._old_sun, out=sun)
        sun[self._returns] = returned
        most = np.where(self._returns & sun.any(axis=1), np.float32(np.inf), np.float32(MOST_GAIN))
        gain = bounded((gain + sun) / self._all_old, most[:, None])
        gain[self._dark] = 1
        return gain

    def _furnish(self, pieces: Sequence[_Piece], lights: Sequence[Floats], rgb: Floats) -> None:
        """Fill the pixels (N, 3) that show furniture, the nearest piece of each."""
        bodies = [piece.body for piece in pieces]
        small, light = _together(self.small, [p.small for p in pieces], lights)
        reach = np.zeros(len(small.label), np.float32)
        for piece in pieces:
            reach[piece.small.pixel] = piece.distance_m
        smooth = Neighbours.of(small, reach).smooth(light.reshape(*small.shape, 3))
        sun = [np.zeros((len(p.large.pixel), 3), np.float32) for p in pieces]
        for one, piece in zip(sun, pieces, strict=True):
            one[piece.sun[1]] = piece.sun[0].under(bodies)
        large = _nearest(self.large, [p.large for p in pieces])
        for number, (piece, bright) in enumerate(zip(pieces, sun, strict=True)):
            mine = large[piece.large.pixel] == number
            seen, pixel = piece.large, piece.large.pixel[mine]
            sight = seen.sight.some(np.flatnonzero(mine))
            sight = replace(sight, label=(sight.label + PARTS * number).astype(np.int32))
            places = self._places._replace(row=self._places.row[pixel], column=self._places.column[pixel])
            found = Steps.of(small, sight, np.ones(len(pixel), bool), places, wraps=True, any_solid=True).apply(smooth)
            rgb[pixel] = piece.albedo[mine] * (found + bright[mine]) / np.float32(math.pi) + piece.emission[mine]


def _nearest(room: Sight, pieces: Sequence[_Seen]) -> Any:
    """Return which piece each pixel (N,) shows; -1: the room."""
    away, which = room.distance_m.copy(), np.full(len(room.label), -1, np.int32)
    for number, one in enumerate(pieces):
        before: Flags = one.sight.distance_m < away[one.pixel]
        away[one.pixel[before]], which[one.pixel[before]] = one.sight.distance_m[before], number
    return which


def _together(room: Sight, pieces: Sequence[_Seen], lights: Sequence[Floats]) -> tuple[Sight, Floats]:
    """Return what the small picture's pixels see of all pieces, nothing where it is the room, and its light (N, 3)."""
    which = _nearest(room, pieces)
    label = np.full(len(which), NOTHING, np.int32)
    point, normal, light = np.zeros((3, len(which), 3), np.float32)
    for number, (one, own) in enumerate(zip(pieces, lights, strict=True)):
        mine = which[one.pixel] == number
        at = one.pixel[mine]
        label[at] = one.sight.label[mine] + PARTS * number
        point[at], normal[at], light[at] = one.sight.point[mine], one.sight.normal[mine], own[mine]
    return replace(room, label=label, point=point, normal=normal), light


def style_of(session: Path) -> str:
    """Return the style that the session's first alternative was rendered in."""
    try:
        every: Mapping[str, Any] = json.loads((session / "stages" / "render" / "staged.json").read_bytes())
        return str(every["alternatives"][0]["style"])
    except (OSError, ValueError, LookupError):
        return "scandinavian"

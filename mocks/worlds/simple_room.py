"""The built-in room as a world: what a ray from the camera meets, and how bright that is."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from functools import cached_property, lru_cache

import numpy as np
import numpy.typing as npt

from mocks.worlds.light import BrightDisc, LightDrift, OneLight, Site, Vector, luminance_cd_m2, unit
from mocks.worlds.room_light import GLASS_TRANSMITTANCE, LightMaps, bake
from mocks.worlds.room_plan import CAMERA_HEIGHT_M, RoomPlan, plan_room
from mocks.worlds.room_rays import (
    WINDOW_WALL,
    Faces,
    Hits,
    cast,
    in_window,
    pane_distance_m,
    room_faces,
    sun_visibility,
    through_window,
)
from mocks.worlds.room_surfaces import Surfaces, surfaces_of
from mocks.worlds.sky import SUN_RADIUS_RAD, SimpleSky
from processing.ground.arrays import Floats

_FRAME_ALBEDO = np.float32(0.8)


@dataclass(frozen=True)
class SimpleRoom(OneLight):
    """A furnished room with one window under `SimpleSky`, by analytic ray casting and radiosity.

    The window is ahead (y), the door to the left; the sun shines in. ``seed`` varies measures and floor.
    Luminances run from about 1 to 10 000 cd/m2 and scale with ``gain``.
    """

    seed: int = 0
    sky: SimpleSky = field(default_factory=SimpleSky)
    gain: float = 1.0
    drift: LightDrift = field(default_factory=LightDrift)

    @property
    def key(self) -> str:
        """Return the parameters as text."""
        return f"v1 {self!r}"

    @cached_property
    def plan(self) -> RoomPlan:
        """Where everything stands: the truth that a reconstruction may be compared with."""
        return plan_room(self.seed)

    @property
    def board_direction(self) -> Vector:
        """Direction from the camera to the middle of the white meter board."""
        x, y, z = self.plan.board_centre
        return unit((x, y, z - CAMERA_HEIGHT_M))

    def board_luminance_cd_m2(self, t_s: float = 0.0) -> float:
        """Return the luminance of the white board, the same all over it."""
        here = self.radiance(Site.INDOOR, np.array([self.board_direction], dtype=np.float32))
        return float(luminance_cd_m2(here)[0]) * self.drift.factor(t_s)

    def radiance(self, site: Site, directions: Floats, pixel_rad: float = 0.0, component: int | None = None) -> Floats:
        """Return radiance at time 0 without the sun's disc; see `mocks.worlds.light.World`."""
        if site is Site.OUTDOOR:
            return self.sky.radiance(directions) * np.float32(self.gain)
        flat = np.ascontiguousarray(directions.reshape(-1, 3), dtype=np.float32)
        hits = cast(self.plan, flat)
        out = self._surfaces.albedo(hits, flat, pixel_rad) * self._irradiance(hits) * np.float32(1 / math.pi)
        self._fill_window(out, hits, flat)
        return out.reshape(directions.shape) * np.float32(self.gain)

    def discs(self, site: Site) -> tuple[BrightDisc, ...]:
        """Return the sun."""
        sun = self.sky.sun
        red, green, blue = (self.gain * v for v in sun.radiance_rgb)
        return (BrightDisc(sun.direction, sun.radius_rad, (red, green, blue)),)

    def open_sky(self, site: Site, directions: Floats) -> Floats:
        """Return 1 outdoors; indoors the glass where a ray leaves through a pane, else 0."""
        if site is Site.OUTDOOR:
            return np.ones(directions.shape[:-1], dtype=np.float32)
        flat = np.ascontiguousarray(directions.reshape(-1, 3), dtype=np.float32)
        hits = cast(self.plan, flat)
        out = np.zeros(len(flat), dtype=np.float32)
        leaving = self._at_window(hits)
        x, z, _ = through_window(self.plan, hits.point[leaving], flat[leaving])
        out[leaving] = GLASS_TRANSMITTANCE * (pane_distance_m(self.plan, x, z) > 0)
        return out.reshape(directions.shape[:-1])

    @cached_property
    def _faces(self) -> Faces:
        return room_faces(self.plan)

    @property
    def _surfaces(self) -> Surfaces:
        return surfaces_of(self.seed)

    @property
    def _light(self) -> LightMaps:
        return _light_of(self.seed, self.sky)

    def _irradiance(self, hits: Hits) -> Floats:
        faces, face = self._faces, hits.face
        board = 6 * len(self.plan.solids) + 3
        point = hits.point
        on_board = np.flatnonzero(face == board)
        if on_board.size:
            point = point.copy()
            point[on_board] = self.plan.board_centre
        size = faces.high - faces.low
        relative = (point - faces.low[face]) / np.maximum(size[face], 1e-6)
        axis = faces.axis[face]
        u = np.where(axis == 0, relative[:, 1], relative[:, 0])
        v = np.where(axis == 2, relative[:, 1], relative[:, 2])
        light = self._light.at(face, u, v)
        self._add_sun(light, hits)
        return light

    def _add_sun(self, light: Floats, hits: Hits) -> None:
        sun = np.array(self.sky.sun_direction, dtype=np.float32)
        cos_of_face = np.maximum(sun[self._faces.axis] * self._faces.normal_sign, 0)
        facing = np.flatnonzero(cos_of_face[hits.face] > 0)
        share = sun_visibility(self.plan, hits.point[facing], self.sky.sun_direction, SUN_RADIUS_RAD)
        lit = facing[share > 0]
        strength = share[share > 0] * cos_of_face[hits.face[lit]] * np.float32(GLASS_TRANSMITTANCE)
        light[lit] += strength[:, None] * self.sky.sun_normal_illuminance_rgb

    def _at_window(self, hits: Hits) -> npt.NDArray[np.intp]:
        wall = np.flatnonzero(hits.face == WINDOW_WALL)
        return wall[in_window(self.plan, hits.point[wall, 0], hits.point[wall, 2])]

    def _fill_window(self, out: Floats, hits: Hits, directions: Floats) -> None:
        """Put sky, frame and reveal where rays leave through the window's opening."""
        rays = self._at_window(hits)
        if rays.size == 0:
            return
        x, z, _ = through_window(self.plan, hits.point[rays], directions[rays])
        outside = self.sky.radiance(directions[rays]) * np.float32(GLASS_TRANSMITTANCE)
        window = self.plan.window
        lateral = (x < window.a0) | (x > window.a1) | (z > window.z1) | (z < window.z0)
        white = np.where(lateral, self._reveal_light, 0.4 * self._reveal_light)[:, None] * _FRAME_ALBEDO / math.pi
        glass = pane_distance_m(self.plan, x, z) > 0
        out[rays] = np.where(glass[:, None], outside, white * np.ones(3, dtype=np.float32))

    @cached_property
    def _reveal_light(self) -> float:
        """Illuminance (lx) on the window's reveals: they see about a third of the half space outside."""
        azimuth = np.linspace(-1.2, 1.2, 9)
        elevation = np.linspace(-0.4, 1.2, 9)
        a, e = np.meshgrid(azimuth, elevation)
        ahead = np.stack([np.sin(a) * np.cos(e), np.cos(a) * np.cos(e), np.sin(e)], axis=-1).astype(np.float32)
        mean = float(luminance_cd_m2(self.sky.radiance(ahead)).mean())
        return math.pi * mean / 3


@lru_cache(maxsize=4)
def _light_of(seed: int, sky: SimpleSky) -> LightMaps:
    """Return the light maps; kept by the process, so that a worker bakes once and not for every band of rows."""
    plan = plan_room(seed)
    return bake(plan, room_faces(plan), surfaces_of(seed).mean_albedo, sky)

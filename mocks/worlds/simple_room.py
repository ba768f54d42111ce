"""The built-in room, `--simulate room`: blocks in a box with one window, lit by formulas instead of a renderer.

It runs wherever NumPy runs and bakes nothing. Direct skylight is the contour integral of the window (Lambert, 1760),
bounced light the even light of an integrating sphere; the sun has sharp shadows, skylight has none. What must be right
for the instruments is: units, range (1 to 10 000 cd/m2), an even white board, the sky seen through clear panes.
World axes and units are those of `mocks.worlds.light`; the camera stands at x = y = 0, `CAMERA_HEIGHT_M` high.
"""

import itertools
import math
from dataclasses import dataclass, field, replace
from functools import cached_property, lru_cache
from typing import NamedTuple

import numpy as np

from mocks.worlds.light import SUN_RADIUS_RAD, BrightDisc, LightDrift, OneLight, Site, Vector, unit, vector_of
from mocks.worlds.sky import SimpleSky
from processing.ground.arrays import Doubles, Flags, Floats, Indices

CAMERA_HEIGHT_M = 1.6  # the paper's tripod
GLASS_TRANSMITTANCE = 0.65  # of double glazing with a coat against heat: 0.6 to 0.8 in makers' tables; chosen
_WALL_M, _FRAME_M = 0.24, 0.055
_DOOR_WALL, _SOFA_WALL, _WINDOW_WALL, _FLOOR = 0, 1, 3, 4
"""Numbers of faces: ``2 axis + side`` for the room itself (side 0 low, 1 high), then six more for each block."""
_WHITE, _TRIM, _WOOD, _GAP = (0.78, 0.77, 0.74), (0.82, 0.81, 0.78), (0.32, 0.20, 0.12), (0.05, 0.045, 0.04)
_WALLS = ((0.30, 0.39, 0.375), *[(0.62, 0.595, 0.54)] * 3, (0.45, 0.325, 0.215), _WHITE)
"""Albedo of door wall, three walls, floor, ceiling."""
_IN_PLANE = ((1, 2), (0, 2), (0, 1))
_PLANK_M, _PLANK_LONG_M, _PLANKS = 0.12, 1.2, 64


class Block(NamedTuple):
    """A block with sides along the axes."""

    low: Vector
    high: Vector
    albedo: Vector


class Patch(NamedTuple):
    """A painted rectangle of a face: from (u0, v0) to (u1, v1) in metres along its two axes, in their order."""

    face: int
    u0: float
    v0: float
    u1: float
    v1: float
    albedo: Vector


class RoomPlan(NamedTuple):
    """Where everything stands; the last of the blocks is the white board, which faces +y."""

    low: Vector
    high: Vector
    window: tuple[float, float, float, float]
    """x0, z0, x1, z1 in the wall at ``high[1]``."""
    blocks: tuple[Block, ...]
    patches: tuple[Patch, ...]


@lru_cache(maxsize=8)
def plan_room(seed: int) -> RoomPlan:
    """Return a living room whose measures vary with ``seed``; the camera stands free by at least 0.8 m."""
    rng = np.random.default_rng(seed)

    def about(low: float, high: float) -> float:
        return round(float(rng.uniform(low, high)), 3)

    left, right, back, ahead = about(-2.5, -2.1), about(2.2, 2.8), about(-2.4, -2.1), about(2.3, 2.8)
    top, window_x, sofa_y, board_x = about(2.5, 2.8), about(-0.9, -0.5), about(-0.5, -0.2), about(-1.1, -0.8)
    window = (window_x, about(0.75, 0.9), window_x + about(1.7, 2.0), about(2.1, 2.3))
    cloth, cushion = (0.16, 0.22, 0.30), (0.62, 0.42, 0.14)
    seat, table_x, table_y = right - 0.9, about(0.95, 1.1), about(0.9, 1.1)
    blocks = (
        Block((0.2, back, 0.08), (1.9, back + 0.45, about(0.75, 0.95)), _WOOD),
        Block((seat, sofa_y, 0.05), (right, sofa_y + 1.6, 0.42), cloth),
        Block((right - 0.22, sofa_y, 0.42), (right, sofa_y + 1.6, 0.85), cloth),
        Block((seat, sofa_y - 0.16, 0.05), (right, sofa_y, 0.62), cloth),
        Block((seat, sofa_y + 1.6, 0.05), (right, sofa_y + 1.76, 0.62), cloth),
        Block((right - 0.36, sofa_y + 0.12, 0.43), (right - 0.22, sofa_y + 0.52, 0.74), cushion),
        Block((table_x, table_y, 0.40), (table_x + 0.55, table_y + 0.8, 0.44), (0.42, 0.28, 0.17)),
        Block((table_x + 0.1, table_y + 0.1, 0.0), (table_x + 0.45, table_y + 0.7, 0.40), _WOOD),
        Block((left, ahead - 0.5, 0.0), (left + 0.45, ahead - 0.05, 1.85), (0.70, 0.68, 0.62)),
        Block((board_x - 0.25, -1.52, 1.05), (board_x + 0.25, -1.5, 1.55), (0.90, 0.90, 0.90)),
    )
    patches = _painted(about(-0.8, -0.5), sofa_y + 0.35, ahead - 0.45)
    return RoomPlan((left, back, 0.0), (right, ahead, top), window, blocks, patches)


def _painted(door0: float, picture: float, rug_end: float) -> tuple[Patch, ...]:
    """Return skirting, door, picture, rug and the gaps between the cabinet's doors, later ones over earlier ones."""
    door1 = 0.35
    skirting = [Patch(w, -9.0, 0.0, 9.0, 0.09, _TRIM) for w in range(4)]
    gaps = [Patch(9, x - 0.004, 0.08, x + 0.004, 2.0, _GAP) for x in (0.625, 1.05, 1.475)]
    return (
        *skirting,
        Patch(_DOOR_WALL, door0 - 0.07, 0.0, door1 + 0.07, 2.12, _TRIM),
        Patch(_DOOR_WALL, door0, 0.0, door1, 2.05, _GAP),
        Patch(_DOOR_WALL, door0 + 0.006, 0.0, door1 - 0.006, 2.044, (0.62, 0.57, 0.48)),
        Patch(_DOOR_WALL, door0 + 0.14, 0.25, door1 - 0.14, 0.95, (0.40, 0.36, 0.30)),
        Patch(_DOOR_WALL, door0 + 0.14, 1.10, door1 - 0.14, 1.85, (0.40, 0.36, 0.30)),
        Patch(_DOOR_WALL, door0 + 0.03, 1.018, door0 + 0.15, 1.042, (0.45, 0.34, 0.12)),
        Patch(_SOFA_WALL, picture, 1.35, picture + 0.9, 1.95, _GAP),
        Patch(_SOFA_WALL, picture + 0.04, 1.39, picture + 0.86, 1.91, (0.45, 0.48, 0.40)),
        Patch(_SOFA_WALL, picture + 0.25, 1.45, picture + 0.6, 1.7, (0.50, 0.22, 0.10)),
        Patch(_FLOOR, -0.9, 0.35, 1.3, rug_end, (0.42, 0.15, 0.12)),
        *gaps,
    )


def _slab(way: Floats, start: Floats, low: Vector, high: Vector) -> tuple[Floats, Floats]:
    """Return, per axis (3, N), how far along rays (3, N) they enter and leave the slabs of a block."""
    with np.errstate(divide="ignore", invalid="ignore"):
        a, b = ((np.array(corner, np.float32)[:, None] - start) / way for corner in (low, high))
    return np.fmin(a, b), np.fmax(a, b)


def cast(plan: RoomPlan, directions: Floats) -> tuple[Indices, Floats]:
    """Return the face number (N,) and the point (N, 3), metres, that rays (N, 3) from the camera meet first."""
    # Axis by axis: NumPy is several times slower when it reduces over a last axis of three.
    ways = np.ascontiguousarray(directions.T)
    eye = np.array(((0,), (0,), (CAMERA_HEIGHT_M,)), np.float32)
    rays = np.arange(len(directions))
    _, leave = _slab(ways, eye, plan.low, plan.high)
    axis = np.nanargmin(leave, axis=0)
    reach, face = leave[axis, rays], 2 * axis + (ways[axis, rays] > 0)
    for number, block in enumerate(plan.blocks):
        # Only rays within a cone around the block can meet it.
        corners = np.array([(x, y, z) for x, y, z in itertools.product(*zip(block.low, block.high, strict=True))])
        corners = (corners - eye.T) / np.linalg.norm(corners - eye.T, axis=1, keepdims=True)
        middle = np.array(unit(corners.mean(axis=0)), np.float32)
        near = np.flatnonzero(middle @ ways > float((corners @ middle).min()) - 1e-3)
        enter, leave = _slab(ways[:, near], eye, block.low, block.high)
        first, last = enter.max(axis=0), leave.min(axis=0)
        hit = (first > 0) & (first < last) & (first < reach[near])
        axis, some = enter[:, hit].argmax(axis=0), near[hit]
        reach[some], face[some] = first[hit], 6 * (number + 1) + 2 * axis + (ways[axis, some] < 0)
    return face, (eye + ways * reach).T


def at_pane(plan: RoomPlan, point: Floats, direction: Floats) -> tuple[Floats, Floats]:
    """Follow rays (N, 3) that go outwards (y > 0) to the panes.

    Returns (N,) how many metres inside a pane each passes (negative: the inner opening is missed, or frame, bar or
    reveal is met), and the way there in metres.
    """
    x0, z0, x1, z1 = plan.window
    inner = point + direction * ((plan.high[1] - point[:, 1]) / direction[:, 1])[:, None]
    way = (plan.high[1] + _WALL_M - point[:, 1]) / direction[:, 1]
    outer = point + direction * way[:, None]
    opening, pane = (
        np.minimum(np.minimum(p[:, 0] - x0, x1 - p[:, 0]), np.minimum(p[:, 2] - z0, z1 - p[:, 2]))
        for p in (inner, outer)
    )
    bar = np.abs(outer[:, 0] - (x0 + x1) / 2) - _FRAME_M / 2
    return np.where(opening > 0, np.minimum(pane - _FRAME_M, bar), -1.0).astype(np.float32), way


def window_form_factor(corners: Doubles, point: Floats, axis: int, sign: float) -> Floats:
    """Return the form factors (N,), 0 to 1, of a polygon (K, 3) seen from points (N, 3) of a face.

    Lambert's contour integral, for a face whose normal is ``sign`` along ``axis``; the part of a polygon below a face's
    horizon counts negative, so a polygon that crosses it gives a little too little.
    """
    to = corners[:, None, :] - point[None].astype(np.float64)
    to /= np.maximum(np.linalg.norm(to, axis=-1, keepdims=True), 1e-9)
    total = np.zeros(len(point))
    u, v = (axis + 1) % 3, (axis + 2) % 3
    for a, b in zip(to, np.roll(to, -1, axis=0), strict=True):
        cosine = np.clip(np.einsum("ij,ij->i", a, b), -1, 1)
        angle_over_sine = np.arccos(cosine) / np.sqrt(np.maximum(1 - cosine**2, 1e-12))
        total += angle_over_sine * (a[:, u] * b[:, v] - a[:, v] * b[:, u])
    return np.maximum(sign * total / (2 * math.pi), 0).astype(np.float32)


@dataclass(frozen=True)
class SimpleRoom(OneLight):
    """A furnished room with one window ahead (y) and the door to the left, under `SimpleSky`; the sun shines in.

    ``seed`` varies the measures; all light scales with ``gain``.
    """

    seed: int = 0
    sky: SimpleSky = field(default_factory=SimpleSky)
    gain: float = 1.0
    drift: LightDrift = field(default_factory=LightDrift)

    @property
    def key(self) -> str:
        """Return the parameters as text."""
        return f"v2 {self!r}"

    @property
    def plan(self) -> RoomPlan:
        """Where everything stands: the truth that a reconstruction may be compared with."""
        return plan_room(self.seed)

    @property
    def board_centre(self) -> Vector:
        """Middle of the white board's face, metres."""
        low, high, _ = self.plan.blocks[-1]
        return ((low[0] + high[0]) / 2, high[1], (low[2] + high[2]) / 2)

    @property
    def board_direction(self) -> Vector:
        """Direction from the camera to the middle of the white meter board."""
        x, y, z = self.board_centre
        return unit((x, y, z - CAMERA_HEIGHT_M))

    def radiance(self, site: Site, directions: Floats, pixel_rad: float = 0.0, component: int | None = None) -> Floats:
        """Return radiance (..., 3) at time 0 without the sun's disc; shape and units as `mocks.worlds.light.World`."""
        if site is Site.OUTDOOR:
            return self.sky.radiance(directions) * np.float32(self.gain)
        flat = np.ascontiguousarray(directions.reshape(-1, 3), dtype=np.float32)
        out = np.empty_like(flat)
        face, point = cast(self.plan, flat)
        for number in np.unique(face):
            rays = np.flatnonzero(face == number)
            albedo = self._albedo(int(number), point[rays], pixel_rad)
            out[rays] = albedo * self._irradiance(int(number), point[rays]) * np.float32(1 / math.pi)
        rays = np.flatnonzero(self._in_window(face, point))
        glass = at_pane(self.plan, point[rays], flat[rays])[0][:, None] > 0
        reveal = np.float32(0.8 / math.pi) * math.pi / 3 * self._window_light[0]
        out[rays] = np.where(glass, self.sky.radiance(flat[rays]) * np.float32(GLASS_TRANSMITTANCE), reveal)
        return out.reshape(directions.shape) * np.float32(self.gain)

    def discs(self, site: Site) -> tuple[BrightDisc, ...]:
        """Return the sun."""
        sun = self.sky.sun
        return (replace(sun, radiance_rgb=vector_of(self.gain * v for v in sun.radiance_rgb)),)

    def open_sky(self, site: Site, directions: Floats) -> Floats:
        """Return 1 outdoors; indoors the glass where a ray leaves through a pane, else 0; shapes as `World`."""
        if site is Site.OUTDOOR:
            return np.ones(directions.shape[:-1], dtype=np.float32)
        flat = np.ascontiguousarray(directions.reshape(-1, 3), dtype=np.float32)
        face, point = cast(self.plan, flat)
        out = np.zeros(len(flat), dtype=np.float32)
        rays = np.flatnonzero(self._in_window(face, point))
        out[rays] = GLASS_TRANSMITTANCE * (at_pane(self.plan, point[rays], flat[rays])[0] > 0)
        return out.reshape(directions.shape[:-1])

    def _in_window(self, face: Indices, point: Floats) -> Flags:
        x0, z0, x1, z1 = self.plan.window
        x, z = point[:, 0], point[:, 2]
        inside: Flags = (face == _WINDOW_WALL) & (x > x0) & (x < x1) & (z > z0) & (z < z1)
        return inside

    def _albedo(self, face: int, point: Floats, pixel_rad: float) -> Floats:
        """Return the albedo (N, 3) of points of one face; planks fade where a pixel covers them."""
        base = _WALLS[face] if face < 6 else self.plan.blocks[face // 6 - 1].albedo
        out = np.tile(np.array(base, np.float32), (len(point), 1))
        if face == _FLOOR:
            table = np.random.default_rng(self.seed).normal(1.0, 0.09, (_PLANKS, _PLANKS)).astype(np.float32)
            column = np.floor(point[:, 0] / _PLANK_M).astype(int)
            row = np.floor(point[:, 1] / _PLANK_LONG_M + 0.37 * column).astype(int)
            side = np.abs(point[:, 0] / _PLANK_M - column - 0.5)
            tone = table[column % _PLANKS, row % _PLANKS] * np.where(side > 0.483, 0.35, 1.0)
            seen_m = pixel_rad * np.linalg.norm(point - (0, 0, CAMERA_HEIGHT_M), axis=1) ** 2 / CAMERA_HEIGHT_M
            out *= (1 + (tone - 1) * np.clip(1 - seen_m / _PLANK_M, 0, 1)).astype(np.float32)[:, None]
        u, v = (point[:, k] for k in _IN_PLANE[face % 6 // 2])
        for patch in self.plan.patches:
            if patch.face == face:
                out[(u > patch.u0) & (u < patch.u1) & (v > patch.v0) & (v < patch.v1)] = patch.albedo
        return out

    def _irradiance(self, face: int, point: Floats) -> Floats:
        """Return the irradiance (N, 3) of points of one face, lx as RGB: window, bounces, sun."""
        axis, side = divmod(face % 6, 2)
        sign = float(2 * side - 1) * (-1 if face < 6 else 1)
        if face == 6 * len(self.plan.blocks) + _WINDOW_WALL:
            point = np.tile(np.array(self.board_centre, np.float32), (len(point), 1))
        x0, z0, x1, z1 = self.plan.window
        corners = np.array([(x, self.plan.high[1], z) for x, z in ((x0, z0), (x0, z1), (x1, z1), (x1, z0))])
        sky, ground = self._window_light
        # What looks up sees the sky through the window, what looks down the ground.
        upwards = sign * (axis == 2)
        mean = (sky * (1 + upwards) + ground * (1 - upwards)) / 2
        form = window_form_factor(corners, point, axis, sign)
        light: Floats = form[:, None] * mean.astype(np.float32) * np.float32(math.pi * GLASS_TRANSMITTANCE)
        light += self._bounced
        cosine = sign * self.sky.sun_direction[axis]
        if cosine > 0:
            seen = self._sunlit(point) * np.float32(cosine * GLASS_TRANSMITTANCE)
            light += seen[:, None] * self.sky.sun_normal_illuminance_rgb
        return light

    def _sunlit(self, point: Floats) -> Floats:
        """Return the fraction (N,) of the sun's disc that points see through the panes, softly edged."""
        sun = np.array(self.sky.sun_direction, dtype=np.float32)
        if sun[1] <= 0:
            return np.zeros(len(point), np.float32)
        inside, way = at_pane(self.plan, point, np.broadcast_to(sun, point.shape))
        lit: Floats = np.clip(inside / np.maximum(way * math.tan(SUN_RADIUS_RAD), 1e-4) * 0.5 + 0.5, 0, 1)
        some = np.flatnonzero(lit)
        for block in self.plan.blocks:
            enter, leave = _slab(sun[:, None], point[some].T, block.low, block.high)
            # The margin keeps a point on a block's own face from shadowing itself.
            lit[some[(enter.max(axis=0) < leave.min(axis=0)) & (leave.min(axis=0) > 1e-3)]] = 0
        return lit

    @cached_property
    def _window_light(self) -> tuple[Floats, Floats]:
        """Mean radiance (3,) of what is above and below the horizon outside the window."""
        azimuth, elevation = np.meshgrid(np.linspace(-1.2, 1.2, 9), np.linspace(0.1, 1.2, 9))
        flat, up = np.cos(elevation), np.sin(elevation)
        ways = np.stack([np.sin(azimuth) * flat, np.cos(azimuth) * flat, up], axis=-1).astype(np.float32)
        above, below = (self.sky.radiance(ways * np.array((1, 1, s), np.float32)).mean(axis=(0, 1)) for s in (1, -1))
        return above, below

    @cached_property
    def _bounced(self) -> Floats:
        """Even irradiance (3,) of all bounces by the integrating sphere's formula; 0.5, chosen, is for furniture."""
        x0, z0, x1, z1 = self.plan.window
        sides = np.array(self.plan.high) - self.plan.low
        areas = np.repeat(sides.prod() / sides, 2)
        mean = np.average(np.array(_WALLS), axis=0, weights=areas)
        sky, ground = self._window_light
        normal = math.pi / 2 * (sky + ground) + max(self.sky.sun_direction[1], 0) * self.sky.sun_normal_illuminance_rgb
        flux = (x1 - x0) * (z1 - z0) * GLASS_TRANSMITTANCE * normal
        return np.asarray(0.5 * flux * mean / (1 - mean) / areas.sum(), dtype=np.float32)

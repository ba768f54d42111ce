"""Ground and skyline as seen from a room, lit by the sky and the sun that stand over them."""

import math
from collections.abc import Callable
from dataclasses import dataclass
from functools import lru_cache
from typing import Literal, TypeAlias

import cv2
import numpy as np

from mocks.rooms.noise import fractal, rough
from mocks.rooms.sky import backdrop, street
from mocks.rooms.sky.street import House, Tree, draw_street
from mocks.worlds.light import Vector, vector_of
from processing.ground.arrays import Bytes, Doubles, Floats, Halves, Reals

# The shadows that houses and trees of the street cast on the ground, as a map from above.

HALF_M = 96.0  # chosen: what windows see of the ground
TEXEL_M = 0.1875  # chosen: 1024 texels across
SIZE = int(2 * HALF_M / TEXEL_M)


@lru_cache(maxsize=2)
def shadow_map(seed: int, sun_direction: Vector) -> Bytes:
    """Return the share of sunlight (H, W), 0..255, that reaches the ground, rows from -y to y, columns from -x to x."""
    shade = np.zeros((SIZE, SIZE), np.uint8)
    leafy = np.zeros((SIZE, SIZE), np.uint8)
    # The shift per metre of height; a sun near the horizon is cut off, where all is shadow anyway.
    shift = -np.array(sun_direction[:2]) / max(sun_direction[2], 0.12)
    for thing in draw_street(seed).things:
        if isinstance(thing, House):
            front = np.array((math.sin(thing.turn_rad), math.cos(thing.turn_rad)))
            side = np.array((front[1], -front[0]))
            w, d = side * thing.width_m / 2, front * thing.depth_m / 2
            corners = np.array((thing.x, thing.y)) + np.array([w + d, w - d, -w - d, -w + d])
            ridge = np.array((thing.x, thing.y)) + np.array([w, -w]) + shift * (thing.eaves_m + thing.rise_m)
            _fill(shade, np.concatenate([corners, corners + shift * thing.eaves_m, ridge]))
        else:
            _tree(shade, leafy, thing, shift)
    row, column = np.mgrid[:SIZE, :SIZE].astype(np.float32) * np.float32(TEXEL_M / 0.9)
    gaps = np.clip(0.78 + 1.1 * rough(column, row, TEXEL_M / 0.9), 0.15, 1)
    dark = np.maximum(shade / np.float32(255), gaps * cv2.GaussianBlur(leafy, (0, 0), 2.0) / np.float32(255))
    return np.asarray(np.round(255 * (1 - dark)), dtype=np.uint8)


def sunlit(seed: int, sun_direction: Vector, x: Floats, y: Floats) -> Floats:
    """Return the share of sunlight at ground points x, y (metres, any shape); all of it beyond the map."""
    light = shadow_map(seed, sun_direction)
    column = ((x + np.float32(HALF_M)) / np.float32(TEXEL_M) - np.float32(0.5)).reshape(-1)
    row = ((y + np.float32(HALF_M)) / np.float32(TEXEL_M) - np.float32(0.5)).reshape(-1)
    found = np.ones(column.shape, np.float32)
    inside = (column > 0) & (column < SIZE - 1) & (row > 0) & (row < SIZE - 1)
    u, v = column[inside], row[inside]
    i, j = u.astype(np.int64), v.astype(np.int64)
    fu, fv = u - i, v - j
    low = light[j, i] * (1 - fu) + light[j, i + 1] * fu
    high = light[j + 1, i] * (1 - fu) + light[j + 1, i + 1] * fu
    found[inside] = (low * (1 - fv) + high * fv) / 255
    return found.reshape(x.shape)


def _fill(image: Bytes, points_m: Doubles) -> None:
    hull = cv2.convexHull(points_m.astype(np.float32))
    corners = np.round(((hull + HALF_M) / TEXEL_M - 0.5) * 16).astype(np.int32)
    cv2.fillConvexPoly(image, corners, 255, cv2.LINE_AA, 4)


def _tree(shade: Bytes, leafy: Bytes, tree: Tree, shift: Doubles) -> None:
    foot = np.array((tree.x, tree.y))
    turn = np.linspace(0, 2 * math.pi, 20, endpoint=False)
    circle = np.stack([np.cos(turn), np.sin(turn)], axis=-1) * tree.crown_m / 2
    rings = [
        foot + shift * (tree.trunk_m + level * (tree.height_m - tree.trunk_m)) + circle * math.sin(math.pi * wide)
        for level, wide in ((0.1, 0.25), (0.4, 0.5), (0.7, 0.68), (0.95, 0.85))
    ]
    _fill(leafy, np.concatenate(rings))
    if tree.trunk_m > 0:
        aside = np.array((shift[1], -shift[0])) / max(float(np.hypot(*shift)), 1e-6) * 0.025 * tree.height_m
        end = foot + shift * (tree.trunk_m + 1)
        _fill(shade, np.stack([foot - aside, foot + aside, end + aside, end - aside]))


Component: TypeAlias = Literal["sky", "sun"]

ASPHALT = (0.085, 0.085, 0.088)
PAVING = (0.30, 0.29, 0.27)


@dataclass(frozen=True)
class Surroundings:
    """What lies below the sky: a plain of an albedo, with a ``skyline`` a street with houses and gardens."""

    seed: int
    eye_height_m: float
    ground_albedo: Vector
    skyline: bool


@dataclass(frozen=True)
class Lit:
    """Light of one origin at the place: mean radiance over all directions and its first moment, that of level ground,
    and of the air at the horizon."""

    mean: Vector
    moment: tuple[Vector, Vector, Vector]
    level_lx: Vector
    air: Vector

    def irradiance(self, normal: Floats) -> Floats:
        """Return the irradiance (lx) by normals of shape (..., 3), to first order in spherical harmonics."""
        moment = np.array(self.moment, np.float32)
        light = np.float32(math.pi) * np.array(self.mean, np.float32) + np.float32(2 * math.pi) * (normal @ moment)
        return np.maximum(light, np.float32(0))


@dataclass(frozen=True)
class Ambient:
    """The light that ground and skyline stand in: from the sky, from the sun by way of the ground, and the beam."""

    sky: Lit
    sun: Lit
    beam: Vector
    sun_direction: Vector

    def lit(self, component: Component) -> Lit:
        """Return the light of one origin."""
        return self.sky if component == "sky" else self.sun


def directions_at(azimuth_rad: Reals, elevation_rad: Reals) -> Floats:
    """Return unit vectors, shape (..., 3), at azimuths from +y towards +x and elevations (broadcast together)."""
    azimuth, elevation = np.broadcast_arrays(azimuth_rad, elevation_rad)
    flat = np.cos(elevation)
    return np.stack([flat * np.sin(azimuth), flat * np.cos(azimuth), np.sin(elevation)], axis=-1).astype(np.float32)


def cosine_grid(rows: int = 128) -> Floats:
    """Return directions over the upper half (H, 2 H, 3), each for the same horizontal illuminance.

    The mean of the luminance over them, times pi, is the horizontal illuminance.
    """
    sine = np.sqrt((np.arange(rows) + 0.5) / rows)
    azimuth = (np.arange(2 * rows) + 0.5) * (math.pi / rows) - math.pi
    return directions_at(azimuth[None, :], np.arcsin(sine)[:, None])


def ambient(dome: Callable[[Floats, float], Floats], beam: Floats, towards: Vector, ground_albedo: Vector) -> Ambient:
    """Return the light under a dome (its radiance by direction and pixel size) and a sun's beam (lx, shape (3,))."""
    rows = 64
    sine = (np.arange(rows) + 0.5) / rows
    azimuth = (np.arange(2 * rows) + 0.5) * (math.pi / rows)
    upper = directions_at(azimuth[None, :], np.arcsin(sine)[:, None])
    pixel_rad = math.pi / 2 / rows
    light = dome(upper, pixel_rad)
    level = dome(cosine_grid(rows), pixel_rad).mean(axis=(0, 1), dtype=np.float64) * math.pi
    # The geometric mean, so that the glow around a low sun does not stand for the air all around.
    air = np.exp(np.log(np.maximum(light[: rows // 8], 1e-3)).mean(axis=(0, 1)))
    mean = light.mean(axis=(0, 1), dtype=np.float64) / 2
    moment = np.einsum("ija,ijb->ab", upper.astype(np.float64), light) / (2 * rows * rows * 2)
    from_sun = np.asarray(beam, dtype=np.float64) * max(towards[2], 0.0)
    sky = _over_ground(mean, moment, level, air, ground_albedo)
    sun = _over_ground(np.zeros(3), np.zeros((3, 3)), from_sun, np.zeros(3), ground_albedo)
    return Ambient(sky, sun, vector_of(beam), towards)


def _over_ground(mean: Reals, moment: Reals, level: Reals, air: Reals, albedo: Vector) -> Lit:
    """Return the light with what the ground gives back: uniform from below, whose first moment is -1/4 upwards."""
    ground = level * np.array(albedo) / math.pi
    whole = np.array(moment, dtype=np.float64)
    whole[2] -= ground / 4
    rows = vector_of(whole[0]), vector_of(whole[1]), vector_of(whole[2])
    return Lit(vector_of(mean + ground / 2), rows, vector_of(level), vector_of(air))


def over(
    behind: Floats, rays: Floats, pixel_rad: float, around: Surroundings, light: Ambient, component: Component | None
) -> Floats:
    """Return ``behind`` (the dome's radiance (N, 3) in directions (N, 3)) with ground and skyline before it."""
    out = behind
    below = rays[..., 2] <= 0
    wanted: tuple[Component, ...] = ("sky", "sun") if component is None else (component,)
    if np.any(below):
        out[below] = _ground(rays[below], pixel_rad, around, light, wanted)
    if not around.skyline:
        return out
    band = (rays[..., 2] < math.sin(backdrop.TOP_RAD)) & (rays[..., 2] > math.sin(backdrop.BOTTOM_RAD))
    if np.any(band):
        pyramids = [_lit_band(around.seed, around.eye_height_m, light, c) for c in wanted]
        level_number = int(np.clip(math.log2(max(pixel_rad / backdrop.PIXEL_RAD, 1.0)), 0, len(pyramids[0]) - 1))
        shown = [_sample(pyramid[level_number], rays[band]) for pyramid in pyramids]
        coverage = shown[0][..., 3:]
        out[band] = out[band] * (1 - coverage) + sum(s[..., :3] for s in shown)
    return out


def _ground(
    directions: Floats, pixel_rad: float, surroundings: Surroundings, light: Ambient, wanted: tuple[Component, ...]
) -> Floats:
    """Return the radiance of the ground in directions (N, 3) below the horizon."""
    sine = np.maximum(-directions[:, 2], np.float32(2e-3))
    way = np.asarray(np.float32(surroundings.eye_height_m) / sine, dtype=np.float32)
    x = np.asarray(directions[:, 0] * way, dtype=np.float32)
    y = np.asarray(directions[:, 1] * way, dtype=np.float32)
    albedo = np.broadcast_to(np.array(surroundings.ground_albedo, np.float32), directions.shape)
    if surroundings.skyline:
        footprint = np.asarray(way * np.float32(pixel_rad) / np.sqrt(sine), dtype=np.float32)
        albedo = _lawn_and_street(x, y, footprint, surroundings)
    received = np.zeros_like(directions)
    for component in wanted:
        level = np.array(light.lit(component).level_lx, np.float32)
        if component == "sun" and surroundings.skyline and level.any():
            received += sunlit(surroundings.seed, light.sun_direction, x, y)[:, None] * level
        else:
            received += level
    return np.asarray(albedo * received / np.float32(math.pi), dtype=np.float32)


def _lawn_and_street(x: Floats, y: Floats, footprint: Floats, surroundings: Surroundings) -> Floats:
    """Return the albedo of ground points (m), averaged over ``footprint``."""
    plain = np.array(surroundings.ground_albedo, dtype=np.float32)
    seed = surroundings.seed
    blades = fractal(seed + 41, x / np.float32(0.25), y / np.float32(0.25), footprint / np.float32(0.25), 5)
    patches = fractal(seed + 42, x / np.float32(2.5), y / np.float32(2.5), footprint / np.float32(2.5), 4)
    tufts = fractal(seed + 43, x / np.float32(0.07), y / np.float32(0.07), footprint / np.float32(0.07), 3)
    grass = plain * (1 + 0.28 * blades + 0.24 * tufts + 0.22 * patches)[:, None]
    grass = grass * (1 + patches[:, None] * np.array((0.10, 0.0, -0.06), np.float32))
    place = street.draw_street(seed)
    s, c = math.sin(place.across_rad), math.cos(place.across_rad)
    across = np.abs(x * np.float32(s) + y * np.float32(c) - np.float32(place.offset_m))
    soft = np.maximum(footprint, np.float32(0.04))
    rough = (1 + 0.18 * blades + 0.12 * patches)[:, None]
    paved = np.clip((street.PAVEMENT_M - across) / soft + 0.5, 0, 1)[:, None]
    road = np.clip((street.ROAD_M - across) / soft + 0.5, 0, 1)[:, None]
    albedo = grass + paved * (np.array(PAVING, np.float32) * rough - grass)
    albedo += road * (np.array(ASPHALT, np.float32) * rough - albedo)
    return np.asarray(np.clip(albedo, 0.01, 0.8), dtype=np.float32)


@lru_cache(maxsize=2)
def _lit_band(seed: int, eye_height_m: float, light: Ambient, component: Component) -> tuple[Halves, ...]:
    """Return the skyline's radiance times coverage, and coverage, (H, W, 4), at ever coarser levels."""
    albedo, normal, mirror, haze, coverage = np.split(backdrop.paint(seed, eye_height_m).layers, (3, 6, 7, 8), axis=-1)
    lit = light.lit(component)
    received = lit.irradiance(normal)
    if component == "sun":
        facing = np.maximum(normal @ np.array(light.sun_direction, np.float32), 0)
        received = received + facing[..., None] * np.array(light.beam, np.float32)
    air = np.array(lit.air, np.float32)
    radiance = albedo * received / np.float32(math.pi) + mirror * air
    radiance += haze * (air - radiance)
    radiance = np.minimum(radiance, np.float32(6e4))
    levels = [np.concatenate([radiance * coverage, coverage], axis=-1)]
    while len(levels) < 6:
        rows, columns = levels[-1].shape[:2]
        levels.append(cv2.resize(levels[-1], (columns // 2, rows // 2), interpolation=cv2.INTER_AREA))
    # Half precision keeps the band small; 6e4 cd/m2 is more than any sunlit wall has.
    return tuple(part.astype(np.float16) for part in levels)


def _sample(band: Halves, directions: Floats) -> Floats:
    """Return the band's values by linear interpolation for directions (N, 3)."""
    rows, columns = band.shape[:2]
    azimuth = np.arctan2(directions[:, 0], directions[:, 1])
    elevation = np.arcsin(np.clip(directions[:, 2], -1, 1))
    span = backdrop.ROWS * backdrop.PIXEL_RAD
    u = (azimuth + math.pi) * (columns / (2 * math.pi)) - 0.5
    v = np.clip((backdrop.TOP_RAD - elevation) * (rows / span) - 0.5, 0, rows - 1)
    u0, v0 = np.floor(u), np.floor(v)
    fu, fv = (u - u0).astype(np.float32)[:, None], (v - v0).astype(np.float32)[:, None]
    i, j = u0.astype(np.int64) % columns, v0.astype(np.int64)
    i1, row, next_row = (i + 1) % columns, j * columns, np.minimum(j + 1, rows - 1) * columns
    flat = band.reshape(rows * columns, -1)
    high = flat.take(row + i, axis=0) * (1 - fu) + flat.take(row + i1, axis=0) * fu
    low = flat.take(next_row + i, axis=0) * (1 - fu) + flat.take(next_row + i1, axis=0) * fu
    return np.asarray(high * (1 - fv) + low * fv, dtype=np.float32)

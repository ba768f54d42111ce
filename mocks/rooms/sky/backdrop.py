"""The skyline painted once per seed: houses, trees and far woods in a band around the horizon, each with its normals.

The band is equirectangular (azimuth from +y towards +x, centre column +y); `outdoors` lights it.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache

import cv2
import numpy as np

from mocks.rooms.noise import fractal, rough, smoothstep
from mocks.rooms.sky.street import LEAVES, House, Tree, draw_street
from mocks.worlds.light import Vector
from processing.ground.arrays import Doubles, Floats, Reals

# Trees and bushes for the skyline: crowns of leafy balls on trunks.

BARK = (0.095, 0.075, 0.055)
LEAVES_M = 0.55  # size of a bunch of leaves
LEAVES_A_BUNCH = 5  # chosen: across it


def paint_tree(band: "Backdrop", tree: Tree, eye_height_m: float) -> None:
    """Paint a tree as seen from ``eye_height_m`` over the ground at the origin."""
    rng = np.random.default_rng([tree.seed, 7305])
    distance_m, azimuth = math.hypot(tree.x, tree.y), math.atan2(tree.x, tree.y)
    if tree.trunk_m > 0:
        across = np.array((math.cos(azimuth), -math.sin(azimuth), 0.0)) * 0.018 * tree.height_m
        foot = np.array((tree.x, tree.y, -eye_height_m))
        top = foot + np.array((0, 0, tree.trunk_m + 0.3 * tree.height_m)) + across * float(rng.uniform(-1.5, 1.5))
        to_eye = np.array((-math.sin(azimuth), -math.cos(azimuth), 0.0))
        band.polygon([foot - 1.3 * across, foot + 1.3 * across, top + across * 0.5, top - across * 0.5], to_eye, BARK)
    near = tree.height_m * 9 > distance_m
    count = (5 if near else 2) if tree.trunk_m == 0 else (34 if near else 14)
    for _ in range(count):
        # Balls fill an egg, wider below.
        turn, reach = float(rng.uniform(0, 2 * math.pi)), math.sqrt(float(rng.uniform(0, 1)))
        level = float(rng.beta(1.5, 1.7))
        girth = math.sin(math.pi * (0.2 + 0.72 * level))
        radius_m = tree.crown_m * float(rng.uniform(0.11, 0.2) if tree.trunk_m else rng.uniform(0.2, 0.3))
        aside_m = (tree.crown_m / 2 - 0.8 * radius_m) * reach * girth * math.cos(turn)
        rise_m = max(tree.height_m - tree.trunk_m - 1.8 * radius_m, 0.0)
        height_m = tree.trunk_m + 0.8 * radius_m + level * rise_m
        openness = (0.5 + 0.5 * reach * girth) * (0.55 + 0.45 * level)
        _ball(band, tree, aside_m, height_m - eye_height_m, radius_m, openness)


def _ball(band: "Backdrop", tree: Tree, aside_m: float, over_eye_m: float, radius_m: float, openness: float) -> None:
    """Paint a ball of leaves; ``openness`` (0..1) is how far outside in the crown it lies."""
    distance_m, azimuth = math.hypot(tree.x, tree.y), math.atan2(tree.x, tree.y)
    pixel_m = distance_m * PIXEL_RAD
    size = max(math.ceil(1.5 * radius_m / pixel_m), 2)
    y, x = (one.astype(np.float32) for one in np.ogrid[-size : size + 1, -size : size + 1])
    u, v = x * np.float32(pixel_m / radius_m), -y * np.float32(pixel_m / radius_m)
    place = np.float32(5 * aside_m + 3 * over_eye_m)
    scale = np.float32(radius_m / LEAVES_M)
    leaves = rough(u * scale + place, v * scale + place, pixel_m / LEAVES_M)
    # Single leaves, down to half a pixel: the sky shows through between them.
    single = rough(
        LEAVES_A_BUNCH * (v * scale + place), LEAVES_A_BUNCH * u * scale, 0.5 * LEAVES_A_BUNCH * pixel_m / LEAVES_M
    )
    rho = np.sqrt(u * u + v * v)
    alpha = smoothstep(-0.10, 0.10, 0.85 - rho + 0.75 * leaves + 0.5 * single)
    facing = np.sqrt(np.clip(1 - np.minimum(rho, 1) ** 2, 0.05, 1))
    s, c = math.sin(azimuth), math.cos(azimuth)
    tilt = 1.4 * rough(v * scale + place, u * scale, pixel_m / LEAVES_M)
    normal = np.stack([(u + tilt) * c - facing * s, -(u + tilt) * s - facing * c, v + 0.35 + 0.8 * leaves], axis=-1)
    normal /= np.linalg.norm(normal, axis=-1, keepdims=True)
    shade = (0.45 + 0.55 * openness) * (0.95 + 0.2 * v + 0.9 * leaves + 0.9 * single)
    albedo = np.array(tree.leaves, np.float32) * (1.5 * np.clip(shade, 0.12, 2.0))[..., None]
    row = row_of(np.arctan2(over_eye_m, distance_m))
    at = column_of(np.asarray(azimuth + math.atan2(aside_m, distance_m)))
    band.put(round(float(row)) - size, round(float(at)) - size, alpha, Coat(albedo, normal, 0.0, haze_of(distance_m)))


COLUMNS = 4096  # chosen: 0.09 degrees
PIXEL_RAD = 2 * math.pi / COLUMNS
TOP_RAD = math.radians(26)
BOTTOM_RAD = math.radians(-30)
ROWS = round((TOP_RAD - BOTTOM_RAD) / PIXEL_RAD)
HAZE_M = 1500.0  # chosen: distance at which contrast falls to 1/e
GLASS = (0.02, 0.024, 0.028)
TRIM = (0.66, 0.66, 0.63)
DOORS: tuple[Vector, ...] = ((0.20, 0.05, 0.04), (0.05, 0.09, 0.07), (0.16, 0.09, 0.05), (0.07, 0.09, 0.15))


@dataclass(frozen=True)
class Coat:
    """What a patch is painted with: albedo, unit normal (both (..., 3)), share of the sky mirrored, haze before it."""

    albedo: Reals
    normal: Reals
    mirror: float
    haze: float


@dataclass(frozen=True)
class Backdrop:
    """The band: ``layers`` (ROWS, COLUMNS, 9) hold albedo (3), unit normal (3), mirror, haze and coverage, 0 to 1.

    Mirror is the share of the sky's light near the horizon that is mirrored, haze that of air light before the surface.
    """

    layers: Floats

    def put(self, row: int, column: int, alpha: Reals, coat: Coat) -> None:
        """Lay a patch over the band, wrapping around; ``alpha`` (H, W) is its coverage, 0 to 1."""
        top, bottom = max(row, 0), min(row + alpha.shape[0], ROWS)
        if top >= bottom:
            return
        flat = (coat.mirror, coat.haze, 1.0)
        paint = np.empty((*alpha.shape, 9), np.float32)
        paint[..., 0:3], paint[..., 3:6], paint[..., 6:9] = coat.albedo, coat.normal, flat
        start, done = column % COLUMNS, 0
        while done < alpha.shape[1]:
            width = min(COLUMNS - start, alpha.shape[1] - done)
            part = np.s_[top - row : bottom - row, done : done + width]
            under = self.layers[top:bottom, start : start + width]
            under += alpha[part][..., None].astype(np.float32) * (paint[part] - under)
            start, done = 0, done + width

    def polygon(self, points: Sequence[Doubles], normal: Doubles, colour: Vector, mirror: float = 0.0) -> None:
        """Paint a flat polygon; corners, shape (3,), are metres from the eye; edges are divided, as lines bend."""
        steps = np.linspace(0, 1, 8, endpoint=False)[:, None]
        ends = [*points[1:], points[0]]
        outline = np.concatenate([a + (b - a) * steps for a, b in zip(points, ends, strict=True)])
        columns = column_of(np.unwrap(np.arctan2(outline[:, 0], outline[:, 1])))
        rows = row_of(np.arctan2(outline[:, 2], np.hypot(outline[:, 0], outline[:, 1])))
        left, top = math.floor(columns.min()) - 1, math.floor(rows.min()) - 1
        mask = np.zeros((math.ceil(rows.max()) + 2 - top, math.ceil(columns.max()) + 2 - left), np.uint8)
        corners = np.round(np.stack([columns - left, rows - top], axis=-1) * 16).astype(np.int32)
        cv2.fillPoly(mask, [corners], 255, cv2.LINE_AA, 4)
        y, x = (one.astype(np.float32) for one in np.ogrid[: mask.shape[0], : mask.shape[1]])
        grain = 1 + 0.16 * rough(x / 7 + left, y / 3)[..., None]
        haze = haze_of(float(np.hypot(outline[:, 0], outline[:, 1]).mean()))
        self.put(top, left, mask / np.float32(255), Coat(np.array(colour, np.float32) * grain, normal, mirror, haze))


def haze_of(distance_m: float) -> float:
    """Return the share of air light at a distance."""
    return 1 - math.exp(-distance_m / HAZE_M)


def row_of(elevation_rad: Doubles) -> Doubles:
    """Return the band's row, in pixels, whole numbers at pixel centres; the shape of ``elevation_rad``."""
    return np.asarray((TOP_RAD - elevation_rad) / PIXEL_RAD - 0.5, dtype=np.float64)


def column_of(azimuth_rad: Doubles) -> Doubles:
    """Return the band's column, in pixels, whole numbers at pixel centres; the shape of ``azimuth_rad``."""
    return np.asarray((azimuth_rad + math.pi) / PIXEL_RAD - 0.5, dtype=np.float64)


@lru_cache(maxsize=1)
def paint(seed: int, eye_height_m: float) -> Backdrop:
    """Return the band of a seed's street, seen from ``eye_height_m`` over the ground."""
    band = Backdrop(np.zeros((ROWS, COLUMNS, 9), np.float32))
    _woods(band, seed, eye_height_m)
    for thing in draw_street(seed).things:
        if isinstance(thing, House):
            _house(band, thing, eye_height_m)
        else:
            paint_tree(band, thing, eye_height_m)
    return band


def _woods(band: Backdrop, seed: int, eye_height_m: float) -> None:
    """Paint three belts of far trees, each nearer one clearer; a tree is a ball of leaves, lit as others are."""
    rng = np.random.default_rng([seed, 7307])
    for distance_m, height_m in ((900.0, 42.0), (380.0, 15.0), (170.0, 9.0)):
        spacing_m, radius_m = 0.4 * height_m, 0.3 * height_m  # chosen by looking, as is all below
        azimuth = np.arange(0.0, 2 * math.pi, spacing_m / distance_m)
        at = azimuth.astype(np.float32) * np.float32(distance_m / 80)
        relief = 1 + 0.45 * fractal(seed + 11 + round(distance_m), at, at, 0.0, 3)
        for row in (1.0, 0.7, 0.4):
            turns = azimuth + rng.uniform(-1, 1, azimuth.size) * spacing_m / distance_m
            tops = height_m * relief * row * rng.uniform(0.85, 1.1, azimuth.size)
            kinds = rng.integers(len(LEAVES), size=azimuth.size)
            for turn, top_m, kind in zip(turns.tolist(), tops.tolist(), kinds.tolist(), strict=True):
                tree = Tree(distance_m * math.sin(turn), distance_m * math.cos(turn), top_m, 0.0, 0.0, LEAVES[kind], 0)
                _ball(band, tree, 0.0, top_m - radius_m - eye_height_m, radius_m, 0.8)


def _house(band: Backdrop, house: House, eye_height_m: float) -> None:
    rng = np.random.default_rng([house.seed, 7304])
    front = np.array((math.sin(house.turn_rad), math.cos(house.turn_rad), 0.0))
    side = np.array((front[1], -front[0], 0.0))
    up = np.array((0.0, 0.0, 1.0))
    base = np.array((house.x, house.y, -eye_height_m))
    half_w, half_d = house.width_m / 2, house.depth_m / 2
    for n, t, out_m, half_m in (
        (front, -side, half_d, half_w),
        (-front, side, half_d, half_w),
        (side, front, half_w, half_d),
        (-side, -front, half_w, half_d),
    ):
        foot = base + n * out_m
        if np.dot(n, foot) < 0:
            gabled = out_m == half_w
            peak = [foot + up * (house.eaves_m + house.rise_m)] if gabled else []
            a, b = foot - t * half_m, foot + t * half_m
            band.polygon([a, b, b + up * house.eaves_m, *peak, a + up * house.eaves_m], n, house.wall)
            _openings(band, rng, (foot - t * half_m, t, n), 2 * half_m, house.eaves_m)
    for n in (front, -front):
        _roof(band, house, base, n, side)


def _roof(band: Backdrop, house: House, base: Doubles, n: Doubles, side: Doubles) -> None:
    """Paint one slope with its fascia board, and the chimney on the ridge behind the slope that is seen."""
    up = np.array((0.0, 0.0, 1.0))
    half_d = house.depth_m / 2
    eave = base + up * house.eaves_m + n * (half_d + 0.45) - up * house.rise_m * 0.45 / half_d
    ridge = base + up * (house.eaves_m + house.rise_m)
    normal = n * house.rise_m + up * half_d
    out = side * (house.width_m / 2 + 0.3)
    if np.dot(n, eave) < 0:
        band.polygon([eave - out, eave + out, eave + out - up * 0.22, eave - out - up * 0.22], n, TRIM)
    if np.dot(normal, eave) < 0:
        band.polygon([eave - out, eave + out, ridge + out, ridge - out], normal / np.linalg.norm(normal), house.roof)


def _openings(
    band: Backdrop, rng: np.random.Generator, frame: tuple[Doubles, Doubles, Doubles], length_m: float, eaves_m: float
) -> None:
    """Paint a wall's windows and its door. ``frame`` is the wall's foot, the way along it, and its normal."""
    foot, t, n = frame
    up = np.array((0.0, 0.0, 1.0))
    columns = max(int(length_m / 2.7), 1)
    width_m, height_m = float(rng.uniform(1.0, 1.6)), float(rng.uniform(1.2, 1.5))
    door_at = int(rng.integers(columns)) if rng.random() < 0.7 else -1

    def pane(along_m: float, sill_m: float, wide_m: float, high_m: float, colour: Vector, mirror: float = 0.0) -> None:
        corner = foot + t * (along_m - wide_m / 2) + up * sill_m
        across, rise = t * wide_m, up * high_m
        band.polygon([corner, corner + across, corner + across + rise, corner + rise], n, colour, mirror)

    for storey in range(int(eaves_m / 2.7)):
        for column in range(columns):
            along_m, sill_m = (column + 0.5) * length_m / columns, 1.25 + 2.7 * storey
            if storey == 0 and column == door_at:
                pane(along_m, 0.2, 1.25, 2.35, TRIM)
                pane(along_m, 0.2, 1.0, 2.2, DOORS[int(rng.integers(len(DOORS)))])
            elif rng.random() < 0.85:
                pane(along_m, sill_m - 0.1, width_m + 0.2, height_m + 0.2, TRIM)
                mirror = float(rng.uniform(0.08, 0.35))
                for half in (-1, 1):
                    pane(along_m + half * width_m / 4, sill_m, width_m / 2 - 0.06, height_m, GLASS, mirror)

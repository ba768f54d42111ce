"""Trees and bushes for the skyline: crowns of leafy balls on trunks."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np

from mocks.rooms.noise import rough, smoothstep
from mocks.rooms.street import Tree

if TYPE_CHECKING:
    from mocks.rooms.backdrop import Backdrop

BARK = (0.095, 0.075, 0.055)
LEAVES_M = 0.55
"""Size of a bunch of leaves."""


def paint_tree(band: Backdrop, tree: Tree, eye_height_m: float) -> None:
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


def _ball(band: Backdrop, tree: Tree, aside_m: float, over_eye_m: float, radius_m: float, openness: float) -> None:
    """Paint a ball of leaves; ``openness`` (0..1) is how far outside in the crown it lies."""
    from mocks.rooms.backdrop import PIXEL_RAD, Coat, column_of, haze_of, row_of

    distance_m, azimuth = math.hypot(tree.x, tree.y), math.atan2(tree.x, tree.y)
    pixel_m = distance_m * PIXEL_RAD
    size = max(math.ceil(1.5 * radius_m / pixel_m), 2)
    y, x = np.mgrid[-size : size + 1, -size : size + 1].astype(np.float32)
    u, v = x * np.float32(pixel_m / radius_m), -y * np.float32(pixel_m / radius_m)
    place = np.float32(5 * aside_m + 3 * over_eye_m)
    scale = np.float32(radius_m / LEAVES_M)
    leaves = rough(u * scale + place, v * scale + place, pixel_m / LEAVES_M)
    rho = np.sqrt(u * u + v * v)
    alpha = smoothstep(-0.10, 0.10, 0.85 - rho + 0.75 * leaves)
    facing = np.sqrt(np.clip(1 - np.minimum(rho, 1) ** 2, 0.05, 1))
    s, c = math.sin(azimuth), math.cos(azimuth)
    tilt = 1.4 * rough(v * scale + place, u * scale, pixel_m / LEAVES_M)
    normal = np.stack([(u + tilt) * c - facing * s, -(u + tilt) * s - facing * c, v + 0.35 + 0.8 * leaves], axis=-1)
    normal /= np.linalg.norm(normal, axis=-1, keepdims=True)
    shade = (0.45 + 0.55 * openness) * (0.95 + 0.2 * v + 1.1 * leaves)
    albedo = np.array(tree.leaves, np.float32) * (1.5 * np.clip(shade, 0.12, 2.0))[..., None]
    row = row_of(np.arctan2(over_eye_m, distance_m))
    column = column_of(np.asarray(azimuth + math.atan2(aside_m, distance_m)))
    band.put(
        round(float(row)) - size, round(float(column)) - size, alpha, Coat(albedo, normal, 0.0, haze_of(distance_m))
    )

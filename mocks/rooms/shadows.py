"""The shadows that houses and trees of the street cast on the ground, as a map from above."""

from __future__ import annotations

from processing.ground.arrays import Floats

import math
from functools import lru_cache

import cv2
import numpy as np
import numpy.typing as npt

from mocks.light import Vector
from mocks.rooms.noise import rough
from mocks.rooms.street import House, Tree, draw_street

HALF_M = 96.0
TEXEL_M = 0.1875
SIZE = int(2 * HALF_M / TEXEL_M)


@lru_cache(maxsize=2)
def shadow_map(seed: int, sun_direction: Vector) -> npt.NDArray[np.uint8]:
    """Return the share of sunlight (0..255) that reaches the ground, rows from -y to y, columns from -x to x."""
    shade = np.zeros((SIZE, SIZE), np.uint8)
    leafy = np.zeros((SIZE, SIZE), np.uint8)
    # The shift per metre of height; a sun near the horizon is cut off, where all is shadow anyway.
    shift = -np.array(sun_direction[:2]) / max(sun_direction[2], 0.12)
    for thing in draw_street(seed).things:
        if isinstance(thing, House):
            _fill(shade, _house_points(thing, shift))
        else:
            _tree(shade, leafy, thing, shift)
    row, column = np.mgrid[:SIZE, :SIZE].astype(np.float32) * np.float32(TEXEL_M / 0.9)
    gaps = np.clip(0.78 + 1.1 * rough(column, row, TEXEL_M / 0.9), 0.15, 1)
    dark = np.maximum(shade / np.float32(255), gaps * cv2.GaussianBlur(leafy, (0, 0), 2.0) / np.float32(255))
    return np.asarray(np.round(255 * (1 - dark)), dtype=np.uint8)


def sunlit(seed: int, sun_direction: Vector, x: Floats, y: Floats) -> Floats:
    """Return the share of sunlight that reaches ground points (m); all of it beyond the map."""
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


def _fill(image: npt.NDArray[np.uint8], points_m: npt.NDArray[np.float64]) -> None:
    hull = cv2.convexHull(points_m.astype(np.float32))
    corners = np.round(((hull + HALF_M) / TEXEL_M - 0.5) * 16).astype(np.int32)
    cv2.fillConvexPoly(image, corners, 255, cv2.LINE_AA, 4)


def _house_points(house: House, shift: npt.NDArray[np.float64]) -> npt.NDArray[np.float64]:
    front = np.array((math.sin(house.turn_rad), math.cos(house.turn_rad)))
    side = np.array((front[1], -front[0]))
    w, d = side * house.width_m / 2, front * house.depth_m / 2
    corners = np.array((house.x, house.y)) + np.array([w + d, w - d, -w - d, -w + d])
    ridge = np.array((house.x, house.y)) + np.array([w, -w]) + shift * (house.eaves_m + house.rise_m)
    return np.concatenate([corners, corners + shift * house.eaves_m, ridge])


def _tree(
    shade: npt.NDArray[np.uint8], leafy: npt.NDArray[np.uint8], tree: Tree, shift: npt.NDArray[np.float64]
) -> None:
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

"""Patterns of floors, walls, cloth and wood: the tile of each `Texture`, always the same for the same parameters.

Row 0 of a tile is v = 0, rows run along v and columns along u. Tiles repeat without a seam. The first colour of a
texture is its mean where the kind is one tone with variation (`KEEPS_MEAN`); the modules say what the others are.
The option ``turned`` (1) swaps u and v: boards lie along v, turned ones along u.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import lru_cache

import cv2
import numpy as np

from mocks.light import Vector
from mocks.rooms import textures_wood
from mocks.rooms.model import Texture
from mocks.rooms.textures_base import HIGHEST_ALBEDO, LOWEST_ALBEDO, Tile, with_mean
from mocks.textures import MipTexture

_MAKERS: dict[str, Callable[[Texture], Tile]] = {
    "planks": textures_wood.planks,
}
KEEPS_MEAN = frozenset({"planks"})
"""Kinds whose tile has the first colour as its mean."""


def tile(texture: Texture) -> Tile:
    """Return one repeat of a texture; albedo lies between 0.02 and 0.92."""
    made = _MAKERS[texture.kind](texture)
    if texture.kind in KEEPS_MEAN:
        albedo = with_mean(made.albedo, texture.colours[0])
    else:
        albedo = np.clip(made.albedo, LOWEST_ALBEDO, HIGHEST_ALBEDO)
    if texture.option("turned", 0.0):
        return Tile(np.ascontiguousarray(albedo.transpose(1, 0, 2)), made.size_m[::-1])
    return Tile(albedo, made.size_m)


@lru_cache(maxsize=24)
def mip(texture: Texture) -> MipTexture:
    """Return a texture's tile with its coarser levels."""
    return MipTexture.tiled(tile(texture).albedo)


@lru_cache(maxsize=1024)
def mean_albedo(texture: Texture) -> Vector:
    """Return the mean of a texture's tile."""
    if texture.kind in KEEPS_MEAN:
        return texture.colours[0]
    red, green, blue = cv2.mean(tile(texture).albedo)[:3]
    return (float(red), float(green), float(blue))

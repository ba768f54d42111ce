"""Patterns of floors, walls, cloth and wood: the tile of each `Texture`, always the same for the same parameters.

Row 0 of a tile is v = 0, rows run along v and columns along u. Tiles repeat without a seam. The first colour of a
texture is its mean where the kind is one tone with variation; the modules say what the other colours are.
The option ``turned`` (1) swaps u and v: boards lie along v, turned ones along u.
"""

from collections.abc import Callable
from functools import lru_cache
from types import ModuleType

import cv2
import numpy as np

from mocks.rooms.model import Texture
from mocks.rooms.textures import cloth, tiles, wood
from mocks.rooms.textures.base import HIGHEST_ALBEDO, LOWEST_ALBEDO, Tile, with_mean
from mocks.worlds.hdr_world import MipTexture
from mocks.worlds.light import Vector, vector_of


def _of(patterns: ModuleType, *kinds: str) -> dict[str, Callable[[Texture], Tile]]:
    """Return the functions of a module that are named as kinds of pattern are."""
    return {kind: getattr(patterns, kind.replace(" ", "_")) for kind in kinds}


_ONE_TONE = {
    **_of(wood, "planks", "veneer", "laminate", "herringbone", "blocks"),
    **_of(tiles, "concrete", "paint", "plaster"),
    **_of(cloth, "carpet loop", "carpet pile", "woven", "boucle", "knit", "leather"),
}
_PATTERNED = {
    **_of(tiles, "tiles", "hexagons", "terrazzo"),
    **_of(cloth, "striped"),
    **_of(tiles, "wallpaper stripes", "wallpaper motifs", "wallpaper damask"),
    **_of(cloth, "rug medallions", "rug lozenges", "rug bands"),
}
KINDS = (*_ONE_TONE, *_PATTERNED)
"""All kinds of pattern. The mean of those up to leather is their first colour; the others have several colours."""


def tile(texture: Texture) -> Tile:
    """Return one repeat of a texture; albedo lies between 0.02 and 0.92."""
    if texture.kind in _ONE_TONE:
        made = _ONE_TONE[texture.kind](texture)
        albedo = with_mean(made.albedo, texture.colours[0])
    else:
        made = _PATTERNED[texture.kind](texture)
        albedo = np.clip(made.albedo, LOWEST_ALBEDO, HIGHEST_ALBEDO)
    if texture.option("turned", 0.0):
        return Tile(np.ascontiguousarray(albedo.transpose(1, 0, 2)), made.size_m[::-1])
    return Tile(albedo, made.size_m)


# About those of two rooms, some 20 MB each.
@lru_cache(maxsize=24)
def pattern(texture: Texture) -> tuple[MipTexture, tuple[float, float]]:
    """Return a texture's tile with its coarser levels, and its size in metres along u and v."""
    made = tile(texture)
    return MipTexture.tiled(made.albedo), made.size_m


@lru_cache(maxsize=1024)
def mean_albedo(texture: Texture) -> Vector:
    """Return the mean of a texture's tile."""
    if texture.kind in _ONE_TONE:
        return texture.colours[0]
    return vector_of(cv2.mean(tile(texture).albedo)[:3])

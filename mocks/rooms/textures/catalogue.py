"""Patterns of floors, walls, cloth and wood: the tile of each `Texture`, always the same for the same parameters.

Row 0 of a tile is v = 0, rows run along v and columns along u. Tiles repeat without a seam. The first colour of a
texture is its mean where the kind is one tone with variation; the modules say what the other colours are.
The option ``turned`` (1) swaps u and v: boards lie along v, turned ones along u.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import lru_cache

import cv2
import numpy as np

from mocks.rooms.model import Texture
from mocks.rooms.textures import (
    cloth as textures_cloth,
)
from mocks.rooms.textures import (
    cloth as textures_rugs,
)
from mocks.rooms.textures import (
    pictures as textures_pictures,
)
from mocks.rooms.textures import (
    tiles as textures_tiles,
)
from mocks.rooms.textures import (
    tiles as textures_walls,
)
from mocks.rooms.textures import (
    wood as textures_parquet,
)
from mocks.rooms.textures import (
    wood as textures_wood,
)
from mocks.rooms.textures.base import HIGHEST_ALBEDO, LOWEST_ALBEDO, Tile, with_mean
from mocks.worlds.hdr_world import MipTexture
from mocks.worlds.light import Vector

_ONE_TONE: dict[str, Callable[[Texture], Tile]] = {
    "planks": textures_wood.planks,
    "veneer": textures_wood.veneer,
    "laminate": textures_parquet.laminate,
    "herringbone": textures_parquet.herringbone,
    "blocks": textures_parquet.blocks,
    "concrete": textures_tiles.concrete,
    "paint": textures_walls.paint,
    "plaster": textures_walls.plaster,
    "carpet loop": textures_cloth.carpet_loop,
    "carpet pile": textures_cloth.carpet_pile,
    "woven": textures_cloth.woven,
    "boucle": textures_cloth.boucle,
    "knit": textures_cloth.knit,
    "leather": textures_cloth.leather,
    "rattan": textures_cloth.rattan,
}
_PATTERNED: dict[str, Callable[[Texture], Tile]] = {
    "tiles": textures_tiles.tiles,
    "hexagons": textures_tiles.hexagons,
    "terrazzo": textures_tiles.terrazzo,
    "striped": textures_cloth.striped,
    "wallpaper stripes": textures_walls.wallpaper_stripes,
    "wallpaper motifs": textures_walls.wallpaper_motifs,
    "wallpaper damask": textures_walls.wallpaper_damask,
    "rug medallions": textures_rugs.medallions,
    "rug lozenges": textures_rugs.lozenges,
    "rug bands": textures_rugs.bands,
    "picture fields": textures_pictures.fields,
    "picture hills": textures_pictures.hills,
    "picture shapes": textures_pictures.shapes,
    "picture leaves": textures_pictures.leaves,
}
KINDS = (*_ONE_TONE, *_PATTERNED)
"""All kinds of pattern. The mean of those up to rattan is their first colour; the others have several colours."""


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
    red, green, blue = cv2.mean(tile(texture).albedo)[:3]
    return (float(red), float(green), float(blue))

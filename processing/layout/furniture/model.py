"""A piece of furniture as triangles with materials: what the catalogue gives and the rendering stage takes.

The frame is the item's (`processing.layout.items`): origin on the floor in the middle of the footprint, x along the
width, +y to the front, z up, metres. Triangles wind counter-clockwise seen from outside.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property, lru_cache
from typing import TypeAlias

import numpy as np
import numpy.typing as npt

from processing.ground.arrays import Bytes, Floats, Int32s

Colour: TypeAlias = tuple[float, float, float]
Size: TypeAlias = tuple[float, float, float]


@dataclass(frozen=True, eq=False)
class Material:
    """A surface's look, in the terms of glTF's metallic-roughness model."""

    name: str
    base_colour: Colour
    """Linear Rec. 709, 0 to 1; the albedo of what is no metal. Multiplied with the texture where there is one."""
    roughness: float = 0.6
    metallic: float = 0.0
    texture: Bytes | None = None
    """(h, w, 3) uint8, sRGB-encoded, repeats; its first row is the top."""
    texture_m: tuple[float, float] | None = None
    """Width and height of the texture in metres where UVs are metres; None: UVs count textures (0 to 1)."""
    opacity: float = 1.0
    """1 solid; less for glass."""
    two_sided: bool = False
    """Also seen from behind (loaded surfaces that are not closed)."""

    @cached_property
    def albedo(self) -> Colour:
        """Return the mean base colour, for those who draw no textures."""
        if self.texture is None:
            return self.base_colour
        mean = linear_of_srgb(self.texture[:: max(1, len(self.texture) // 64)]).mean(axis=(0, 1))
        r, g, b = (float(m * c) for m, c in zip(mean, self.base_colour, strict=True))
        return r, g, b


def linear_of_srgb(values: Bytes) -> Floats:
    """Return linear values in [0, 1] of sRGB bytes."""
    table = np.arange(256) / 255.0
    table = np.where(table <= 0.04045, table / 12.92, ((table + 0.055) / 1.055) ** 2.4).astype(np.float32)
    return np.asarray(table[values], dtype=np.float32)


def srgb_of_linear(values: npt.ArrayLike) -> Bytes:
    """Return sRGB bytes of linear values, clipped to [0, 1]; to the nearest of 65,536 levels."""
    v = np.clip(np.asarray(values, dtype=np.float32), 0.0, 1.0)
    return np.asarray(_srgb_table()[np.rint(65535 * v).astype(np.uint16)], dtype=np.uint8)


@lru_cache(maxsize=1)
def _srgb_table() -> Bytes:
    v = np.arange(65536) / 65535
    coded = np.where(v <= 0.0031308, 12.92 * v, 1.055 * v ** (1 / 2.4) - 0.055)
    return np.asarray(np.rint(255 * coded), dtype=np.uint8)


@dataclass(frozen=True, eq=False)
class Part:
    """The triangles of one material."""

    vertices: Floats
    """(n, 3), metres."""
    faces: Int32s
    """(m, 3)."""
    normals: Floats
    """(n, 3), unit length."""
    uv: Floats | None
    """(n, 2), u to the right and v upwards in the texture; None where the material has no texture."""
    material: Material

    def texture_coordinates(self) -> Floats | None:
        """Return UVs that count textures, whatever the unit of `uv`."""
        if self.uv is None or self.material.texture_m is None:
            return self.uv
        return np.asarray(self.uv / np.array(self.material.texture_m, dtype=np.float32), dtype=np.float32)


@dataclass(frozen=True, eq=False)
class FurnitureModel:
    """A piece of furniture."""

    model_id: str
    category: str
    parts: tuple[Part, ...]
    size_m: Size
    """Width, depth, height of its bounds."""
    licence: str
    closed: bool = True
    """Whether every surface encloses a volume."""
    notes: tuple[str, ...] = ()
    """What was corrected or guessed, in words."""

    @property
    def triangles(self) -> int:
        """Return the number of triangles."""
        return sum(len(part.faces) for part in self.parts)

    def bounds(self) -> tuple[Floats, Floats]:
        """Return the lowest and highest corner."""
        return bounds_of([part.vertices for part in self.parts])


def bounds_of(sets: Sequence[Floats]) -> tuple[Floats, Floats]:
    """Return the lowest and highest corner of several sets of points."""
    low = np.min([v.min(axis=0) for v in sets], axis=0)
    high = np.max([v.max(axis=0) for v in sets], axis=0)
    return low, high

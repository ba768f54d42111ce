"""A piece of furniture as triangles with materials: what the catalogue gives and the rendering stage takes.

The frame is the item's (`processing.layout.items`): origin on the floor in the middle of the footprint, x along the
width, +y to the front, z up, metres. Triangles wind counter-clockwise seen from outside.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import TypeAlias

import numpy as np

from processing.ground.arrays import Bytes, Floats, Int32s
from processing.ground.colour import linear_of_srgb

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

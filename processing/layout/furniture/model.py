"""A piece of furniture as triangles with materials, and procedural surfaces: what catalogue and rendering share.

The frame is the item's (`processing.layout.items`): origin on the floor in the middle of the footprint, x along the
width, +y to the front, z up, metres. Triangles wind counter-clockwise seen from outside.
"""

from dataclasses import dataclass
from functools import cached_property, lru_cache
from typing import TypeAlias

import numpy as np
from scipy import fft

from processing.ground.arrays import Bytes, Doubles, Floats, Int32s, Rgb, Vector
from processing.ground.colour import linear_of_srgb, srgb_of_linear

Colour: TypeAlias = Rgb
Size: TypeAlias = Vector


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
    lumen: float = 0.0
    """Luminous flux that it sends out while its lamp is switched on."""

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
        """Return UVs (N, 2) that count textures, whatever the unit of `uv`."""
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
        """Return the lowest and highest corner, each of shape (3,), metres."""
        sets = [part.vertices for part in self.parts]
        low = np.min([v.min(axis=0) for v in sets], axis=0)
        high = np.max([v.max(axis=0) for v in sets], axis=0)
        return low, high


# Procedural surfaces as pictures that repeat without a seam: wood, woven cloth, boucle, leather.

SIDE = 384  # chosen: texels; wood takes three times as many
WOOD_M = (0.72, 1.44)  # four planks of 0.18 m side by side (chosen: veneer is laid so), each with its own figure
PLANKS = 4  # chosen: boards across a picture
CLOTH_M = (0.16, 0.16)
LEATHER_M = (0.30, 0.30)


def noise(shape: tuple[int, int], wave: tuple[float, float], seed: int) -> Doubles:
    """Return periodic Gaussian noise of unit deviation, of the given shape; `wave`: grain in pixels, down, across."""
    rng = np.random.default_rng(seed)
    fy, fx = np.fft.fftfreq(shape[0])[:, None], np.fft.rfftfreq(shape[1])[None, :]
    keep = np.exp(-2 * np.pi**2 * ((fy * wave[0] / 2.4) ** 2 + (fx * wave[1] / 2.4) ** 2))
    keep[0, 0] = 0.0
    keep = keep.astype(np.float32)
    field = fft.irfft2(fft.rfft2(rng.standard_normal(shape, dtype=np.float32)) * keep, s=shape)
    return np.asarray(field / max(float(field.std()), 1e-12))


def _coloured(tone: Doubles, colour: Colour, tint: Colour = (0.0, 0.0, 0.0)) -> Bytes:
    """Return colour x exp(tone), each channel's tone weighed by 1 + tint; the mean colour stays."""
    channels = []
    for c, t in zip(colour, tint, strict=True):
        layer = np.exp((tone * (1 + t)).astype(np.float32))
        channels.append(c * layer / layer.mean())
    return srgb_of_linear(np.stack(channels, axis=-1))


@lru_cache(maxsize=16)
def wood(colour: Colour, figure: float = 1.0, seed: int = 3) -> Bytes:
    """Return a picture (H, W, 3), sRGB, of wood of a mean colour, the grain running down the picture; `figure` 0 is
    nearly plain.

    Growth rings 3 to 12 mm apart, as quarter- and flat-sawn boards of 0.18 m show them; pores 1 to 2 mm wide.
    """
    tall, wide = 3 * SIDE, 3 * SIDE // 2
    mm = wide / (1000 * WOOD_M[0])
    rng = np.random.default_rng(seed)
    plank = np.arange(wide) * PLANKS // wide
    u = (np.arange(wide) * PLANKS / wide) % 1.0
    heart = rng.uniform(-0.6, 1.6, PLANKS)[plank]
    shift = rng.permutation(PLANKS)[plank] * 3.7
    sway = noise((tall, wide), (700 * mm, 120 * mm), seed)
    along = np.cos(2 * np.pi * (np.arange(tall)[:, None] / tall + rng.uniform(0, 1, PLANKS)[plank][None, :]))
    # Flat-sawn boards cut the rings at a low angle about the heart: wide there, narrow at the edges.
    away = np.sqrt((u - heart) ** 2 + 0.03 + 0.02 * along)
    rings = 17 * away + 0.30 * sway + shift
    phase = rings - np.floor(rings)
    late = np.exp(-(((phase - 0.80) / 0.18) ** 2)) + 0.30 * phase
    pores = noise((tall, wide), (26 * mm, 1.6 * mm), seed + 2)
    fibres = noise((tall, wide), (200 * mm, 2.6 * mm), seed + 3)
    board = rng.normal(0, 0.05, PLANKS)[plank][None, :]
    tone = -0.15 * late - 0.06 * np.clip(pores, 0.3, None) + 0.03 * fibres + board
    return _coloured(figure * tone, colour, (-0.12, 0.05, 0.35))


@lru_cache(maxsize=16)
def cloth(colour: Colour, contrast: float = 1.0, seed: int = 5) -> Bytes:
    """Return a picture (H, W, 3), sRGB, of a plain weave of slightly uneven threads, 2.5 mm apart."""
    threads = 64
    cell = SIDE // threads
    y, x = np.meshgrid(np.arange(SIDE), np.arange(SIDE), indexing="ij")
    over = ((y // cell + x // cell) % 2).astype(np.float64)
    round_x = np.sin(np.pi * ((x % cell) + 0.5) / cell) ** 0.7
    round_y = np.sin(np.pi * ((y % cell) + 0.5) / cell) ** 0.7
    rng = np.random.default_rng(seed)
    warp, weft = rng.normal(size=threads), rng.normal(size=threads)
    slub_x = noise((SIDE, SIDE), (70, 5), seed)
    slub_y = noise((SIDE, SIDE), (5, 70), seed + 1)
    across = weft[y // cell] * 0.4 + slub_y * 0.4
    along = warp[x // cell] * 0.4 + slub_x * 0.4
    tone = np.where(over > 0, 0.10 * along + 0.32 * round_x, 0.10 * across + 0.32 * round_y)
    tone = tone + 0.02 * noise((SIDE, SIDE), (60, 60), seed + 2)
    return _coloured(0.8 * contrast * tone, colour)


@lru_cache(maxsize=16)
def boucle(colour: Colour, seed: int = 11) -> Bytes:
    """Return a picture (H, W, 3), sRGB, of looped yarn: soft knots of several sizes."""
    knots = noise((SIDE, SIDE), (15, 15), seed) + 0.6 * noise((SIDE, SIDE), (7, 7), seed + 1)
    tone = 0.15 * np.tanh(knots) + 0.015 * noise((SIDE, SIDE), (110, 110), seed + 2)
    return _coloured(tone, colour)


@lru_cache(maxsize=8)
def leather(colour: Colour, seed: int = 17) -> Bytes:
    """Return a picture (H, W, 3), sRGB, of smooth leather: faint pores, cloudy dye."""
    pores = np.abs(noise((SIDE, SIDE), (7, 7), seed))
    tone = -0.05 * np.exp(-4 * pores) + 0.07 * noise((SIDE, SIDE), (150, 150), seed + 1)
    return _coloured(tone, colour, (-0.1, 0.05, 0.1))

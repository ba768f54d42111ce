"""A piece of furniture as triangles with materials: what the catalogue gives and the rendering stage takes; its styles.

The frame is the item's (`processing.layout.items`): origin on the floor in the middle of the footprint, x along the
width, +y to the front, z up, metres. Triangles wind counter-clockwise seen from outside.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property, lru_cache
from typing import Literal, TypeAlias

import numpy as np
from scipy import fft

from processing.errors import ItemError
from processing.ground.arrays import Bytes, Doubles, Floats, Int32s
from processing.ground.colour import linear_of_srgb, srgb_of_linear

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

SIDE = 384
WOOD_M = (0.40, 1.20)
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
    """
    tall, wide = 2 * SIDE, SIDE
    x = np.arange(wide)[None, :] / wide
    warp = 0.10 * noise((tall, wide), (420, 130), seed) + 0.014 * noise((tall, wide), (90, 26), seed + 1)
    rings = (x + warp) * 9
    phase = rings - np.floor(rings)
    late = np.exp(-(((phase - 0.82) / 0.16) ** 2)) + 0.35 * phase
    pores = noise((tall, wide), (70, 1.6), seed + 2)
    fibres = noise((tall, wide), (260, 3.0), seed + 3)
    broad = noise((tall, wide), (600, 90), seed + 4)
    tone = -0.20 * late - 0.055 * np.clip(pores, 0.2, None) + 0.035 * fibres + 0.06 * broad
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


Legs: TypeAlias = Literal["round", "square", "metal"]
Handles: TypeAlias = Literal["knob", "bar", "grip"]
Head: TypeAlias = Literal["slats", "padded", "panel"]


@dataclass(frozen=True)
class Style:
    """Materials and details of a set."""

    name: str
    timber: Material
    front: Material
    """Doors and drawers."""
    second_timber: Material
    """Insides, table legs."""
    fabric: Material
    second_fabric: Material
    accent: Material
    """Cushions, throw."""
    bedding: Material
    metal: Material
    legs: Legs
    handles: Handles
    head: Head
    rug: tuple[Colour, Colour, Colour]
    """Ground, pattern, lines."""
    pot: Material


def _wood(name: str, colour: Colour, figure: float = 1.0, roughness: float = 0.5) -> Material:
    return Material(name, (1.0, 1.0, 1.0), roughness, texture=wood(colour, figure), texture_m=WOOD_M)


def _cloth(name: str, colour: Colour, contrast: float = 1.0) -> Material:
    return Material(name, (1.0, 1.0, 1.0), 0.92, texture=cloth(colour, contrast), texture_m=CLOTH_M)


def _boucle(name: str, colour: Colour) -> Material:
    return Material(name, (1.0, 1.0, 1.0), 0.95, texture=boucle(colour), texture_m=CLOTH_M)


def _leather(name: str, colour: Colour) -> Material:
    return Material(name, (1.0, 1.0, 1.0), 0.42, texture=leather(colour), texture_m=LEATHER_M)


BLACK_STEEL = Material("black steel", (0.03, 0.03, 0.032), 0.45)
BRASS = Material("brass", (0.78, 0.56, 0.26), 0.28, 1.0)
NICKEL = Material("nickel", (0.62, 0.60, 0.57), 0.30, 1.0)


@lru_cache(maxsize=1)
def _oak() -> Style:
    oak = _wood("oak", (0.50, 0.335, 0.185))
    return Style(
        "oak", oak, oak, oak, _cloth("linen, natural", (0.56, 0.51, 0.43)),
        _boucle("boucle, cream", (0.68, 0.63, 0.55)),
        _cloth("linen, sage", (0.24, 0.28, 0.19)), _cloth("cotton, white", (0.80, 0.79, 0.76), 0.35), BLACK_STEEL,
        "round", "knob", "slats", ((0.62, 0.57, 0.48), (0.36, 0.33, 0.26), (0.20, 0.20, 0.16)),
        Material("clay", (0.46, 0.24, 0.14), 0.8),
    )  # fmt: skip


@lru_cache(maxsize=1)
def _walnut() -> Style:
    walnut = _wood("walnut", (0.165, 0.088, 0.046), 1.25, 0.42)
    return Style(
        "walnut", walnut, walnut, walnut, _cloth("wool, charcoal", (0.085, 0.09, 0.10)),
        _leather("leather, cognac", (0.30, 0.125, 0.045)), _cloth("velvet, rust", (0.36, 0.13, 0.055), 0.6),
        _cloth("percale, grey", (0.55, 0.55, 0.55), 0.35), BRASS, "metal", "bar", "padded",
        ((0.17, 0.17, 0.18), (0.42, 0.38, 0.32), (0.30, 0.13, 0.07)), Material("stoneware", (0.09, 0.09, 0.095), 0.35),
    )  # fmt: skip


@lru_cache(maxsize=1)
def _white() -> Style:
    white = Material("white lacquer", (0.76, 0.75, 0.72), 0.45)
    birch = _wood("birch", (0.64, 0.50, 0.33), 0.55)
    return Style(
        "white", white, white, birch, _cloth("cotton, blue", (0.115, 0.19, 0.315)),
        _cloth("cotton, pale blue", (0.46, 0.54, 0.62)), _cloth("cotton, mustard", (0.56, 0.36, 0.08)),
        _cloth("cotton, ivory", (0.77, 0.75, 0.69), 0.35), NICKEL, "square", "knob", "panel",
        ((0.70, 0.69, 0.66), (0.13, 0.21, 0.34), (0.42, 0.50, 0.60)), Material("glaze, white", (0.74, 0.73, 0.70), 0.2),
    )  # fmt: skip


@lru_cache(maxsize=1)
def _black() -> Style:
    black = _wood("black ash", (0.040, 0.037, 0.035), 0.9, 0.55)
    ash = _wood("ash", (0.60, 0.46, 0.30), 0.8)
    return Style(
        "black", black, black, ash, _cloth("wool, forest", (0.075, 0.135, 0.085)),
        _cloth("wool, sand", (0.50, 0.41, 0.29)), _cloth("linen, ochre", (0.52, 0.31, 0.10)),
        _cloth("linen, flax", (0.66, 0.60, 0.50), 0.5), BLACK_STEEL, "metal", "grip", "padded",
        ((0.55, 0.47, 0.35), (0.07, 0.07, 0.07), (0.33, 0.25, 0.15)), Material("concrete", (0.38, 0.37, 0.35), 0.85),
    )  # fmt: skip


STYLES = {"oak": _oak, "walnut": _walnut, "white": _white, "black": _black}


def style_named(name: str) -> Style:
    """Return a style; raise `ItemError` naming those there are."""
    if name not in STYLES:
        raise ItemError(f"no style '{name[:40]}'; there are: {', '.join(STYLES)}")
    return STYLES[name]()

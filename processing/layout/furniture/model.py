"""A piece of furniture as triangles with materials, and procedural surfaces: what catalogue and rendering share.

The frame is the item's (`processing.layout.items`): origin on the floor in the middle of the footprint, x along the
width, +y to the front, z up, metres. Triangles wind counter-clockwise seen from outside.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache
from typing import TypeAlias

import numpy as np
from scipy import fft

from processing.ground.arrays import Bytes, Doubles, Floats, Int32s, Rgb, Vector
from processing.ground.colour import srgb_of_linear

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
    creases: float = 0.0
    """Slope of creases in cloth that the mesh does not have (rms), drawn into pictures; a GLB goes without."""


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


def bounds(sets: Sequence[Floats | Doubles]) -> tuple[Doubles, Doubles]:
    """Return the lowest and highest corner, each of shape (3,), of sets of vertices (N, 3), metres."""
    return np.min([v.min(axis=0) for v in sets], axis=0), np.max([v.max(axis=0) for v in sets], axis=0)


# Procedural surfaces as pictures that repeat without a seam: wood, woven cloth, boucle, marble, leather.

SIDE = 384  # chosen: texels; wood takes three times as many
WOOD_M = (0.72, 1.44)  # four planks of 0.18 m side by side (chosen: veneer is laid so), each with its own figure
PLANKS = 4  # chosen: boards across a picture
CLOTH_M = (0.16, 0.16)
LEATHER_M = (0.30, 0.30)
MARBLE_M = (1.2, 1.2)  # chosen by looking


@lru_cache(maxsize=12)  # the same grain in several colours: 30 MB at most
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
    """Return a picture (H, W, 3), sRGB, of a plain weave of uneven threads, 2.5 mm apart, their slubs 6 cm long."""
    threads = 64
    cell = SIDE // threads
    y, x = np.meshgrid(np.arange(SIDE), np.arange(SIDE), indexing="ij")
    over = ((y // cell + x // cell) % 2).astype(np.float64)
    round_x = np.sin(np.pi * ((x % cell) + 0.5) / cell) ** 0.7
    round_y = np.sin(np.pi * ((y % cell) + 0.5) / cell) ** 0.7
    rng = np.random.default_rng(seed)
    warp, weft = rng.normal(size=threads), rng.normal(size=threads)
    # Slubs are what is left of cloth a few metres away, where a pixel averages several threads.
    slub_x = noise((SIDE, SIDE), (150, 8), seed)
    slub_y = noise((SIDE, SIDE), (8, 150), seed + 1)
    across = weft[y // cell] * 0.4 + slub_y * 0.8
    along = warp[x // cell] * 0.4 + slub_x * 0.8
    tone = np.where(over > 0, 0.10 * along + 0.32 * round_x, 0.10 * across + 0.32 * round_y)
    tone = tone + 0.02 * noise((SIDE, SIDE), (60, 60), seed + 2)
    return _coloured(0.8 * contrast * tone, colour)


@lru_cache(maxsize=16)
def boucle(colour: Colour, seed: int = 11) -> Bytes:
    """Return a picture (H, W, 3), sRGB, of looped yarn: soft knots of several sizes."""
    knots = noise((SIDE, SIDE), (15, 15), seed) + 0.6 * noise((SIDE, SIDE), (7, 7), seed + 1)
    return _coloured(0.09 * np.tanh(knots) + 0.015 * noise((SIDE, SIDE), (110, 110), seed + 2), colour)


@lru_cache(maxsize=4)
def marble(colour: Colour, seed: int = 23) -> Bytes:
    """Return a picture (H, W, 3), sRGB, of polished marble: clouds, and grey veins that branch, fine and broad."""
    shape = (2 * SIDE, 2 * SIDE)
    astray = noise(shape, (220, 220), seed)
    tone = 0.05 * noise(shape, (130, 130), seed + 1) + 0.015 * noise(shape, (6, 6), seed + 2)
    for k, (wave, deep, sharp) in enumerate(((200, 0.55, 16.0), (90, 0.25, 11.0))):
        field = noise(shape, (wave, 0.6 * wave), seed + 3 + k) + 0.5 * astray
        there = np.clip(0.5 + 0.8 * noise(shape, (160, 160), seed + 7 + k), 0, 1)
        tone = tone - deep * there * np.exp(-sharp * np.abs(field))
    return _coloured(tone, colour, (0.1, 0.0, -0.1))


@lru_cache(maxsize=8)
def leather(colour: Colour, seed: int = 17) -> Bytes:
    """Return a picture (H, W, 3), sRGB, of smooth leather: faint pores, cloudy dye."""
    pores = np.abs(noise((SIDE, SIDE), (7, 7), seed))
    tone = -0.05 * np.exp(-4 * pores) + 0.07 * noise((SIDE, SIDE), (150, 150), seed + 1)
    return _coloured(tone, colour, (-0.1, 0.05, 0.1))


# Flat pictures: rugs and prints, drawn in the style's colours.


def _grid(width_m: float, depth_m: float, scale: float) -> tuple[Doubles, Doubles]:
    cols, rows = max(16, round(width_m * scale)), max(16, round(depth_m * scale))
    y, x = np.meshgrid((np.arange(rows) + 0.5) / scale, (np.arange(cols) + 0.5) / scale, indexing="ij")
    return x, y


def rug_pattern(kind: str, colours: tuple[Colour, Colour, Colour], width_m: float, depth_m: float) -> Bytes:
    """Return a rug's picture (H, W, 3), sRGB: lozenges in a border, a plain border, bands, or a berber's grid."""
    x, y = _grid(width_m, depth_m, min(400.0, 900.0 / max(width_m, depth_m)))
    shape = (x.shape[0], x.shape[1])
    wobble = 0.006 * noise(shape, (40, 40), 2)
    edge = np.minimum(np.minimum(x, width_m - x), np.minimum(y, depth_m - y)) + wobble
    ground, figure, line = (np.array(c) for c in colours)
    picture = np.broadcast_to(ground, (*shape, 3)).copy()
    n = [max(2, round((size - 0.3) / 0.34)) for size in (width_m, depth_m)]
    u, v = ((a - 0.15) / max(s - 0.3, 0.1) * k + 2 * wobble for a, s, k in ((x, width_m, n[0]), (y, depth_m, n[1])))
    lozenge = np.abs(u % 1 - 0.5) + np.abs(v % 1 - 0.5)
    if kind == "lozenge":
        inside = edge > 0.15
        picture[inside & (np.abs(lozenge - 0.5) < 0.045)] = line
        picture[inside & (lozenge < 0.20)] = figure
        picture[(edge > 0.06) & (edge < 0.115)] = figure
    elif kind == "border":
        picture[(edge > 0.05) & (edge < 0.15)] = figure
        picture[(np.abs(edge - 0.19) < 0.012) | (edge < 0.012)] = figure
        picture[(edge > 0.26) & (np.abs(lozenge - 0.5) < 0.03)] = line
    elif kind == "bands":
        t = (x + 3 * wobble) / width_m
        picture[np.abs(t - 0.30) < 0.11] = figure
        picture[np.abs(t - 0.66) < 0.035] = line
        picture[(np.abs(t - 0.80) < 0.05) | (np.abs(t - 0.47) < 0.012)] = figure
    else:
        picture[(np.abs(lozenge - 0.5) < 0.035) & (edge > 0.06)] = line
    wool = 1 + 0.05 * noise(shape, (3, 9), 4) + 0.04 * noise(shape, (60, 60), 5)
    return srgb_of_linear(picture * np.clip(wool, 0.6, 1.4)[..., None])[::-1]


def print_picture(kind: str, colours: tuple[Colour, Colour, Colour], size: tuple[float, float], seed: int) -> Bytes:
    """Return a print (H, W, 3), sRGB: overlapping shapes, arches, or a horizon, in a style's colours on paper."""
    x, y = _grid(*size, 420 / max(size))
    u, v = x / size[0], 1 - y / size[1]
    rng = np.random.default_rng(seed)
    paper = np.array([0.72, 0.69, 0.62])
    inks = [np.array(c) for c in colours] + [0.5 * (np.array(colours[1]) + paper)]
    picture = np.broadcast_to(paper, (*x.shape, 3)).copy()
    wobble = 0.012 * noise((x.shape[0], x.shape[1]), (50, 50), seed)
    if kind == "horizon":
        levels = np.sort(rng.uniform(0.15, 0.7, 5))[::-1]
        picture = picture * np.clip(1.2 - 0.5 * v, 0.5, 1)[..., None]
        for k, level in enumerate(levels):
            hills = level + 0.05 * np.sin(5 * u + rng.uniform(0, 6)) + 0.02 * np.sin(13 * u + k) + wobble
            picture[v < hills] = (0.75 - 0.13 * k) * inks[2 if k < 3 else 1] + 0.05 * (4 - k)
    elif kind == "arches":
        cx, order, wide = rng.uniform(0.4, 0.6), rng.permutation(3), rng.uniform(0.28, 0.38)
        for k, r in enumerate((wide, 0.7 * wide, 0.4 * wide)):
            top = np.hypot((u - cx) / r, (v - 0.5) * size[1] / size[0] / r) + wobble < 1
            picture[(top & (v >= 0.5)) | ((np.abs(u - cx) + wobble < r) & (v < 0.5) & (v > 0.12))] = inks[order[k]]
        sun = np.hypot(u - cx - rng.choice([-0.25, 0.25]), (v - 0.86) * size[1] / size[0])
        picture[sun < rng.uniform(0.05, 0.09)] = inks[order[1]]
    else:
        for k in range(5):
            cx, cy, r, s = rng.uniform(0.2, 0.8), rng.uniform(0.2, 0.8), rng.uniform(0.13, 0.3), rng.uniform(0.7, 1.5)
            blob = np.hypot((u - cx) * s, (v - cy) * size[1] / size[0]) * (1 + 3 * wobble) < r
            picture[blob] = inks[k % 4]
        picture[np.abs(v - 0.5 - 0.18 * np.sin(4 * u + rng.uniform(0, 6))) < 0.006] = inks[2]
    grain = 1 + 0.03 * noise((x.shape[0], x.shape[1]), (3, 3), 6)
    return srgb_of_linear(np.clip(picture * grain[..., None], 0, 0.85))

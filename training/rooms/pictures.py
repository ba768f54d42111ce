"""Pictures for walls: colour fields, landscapes, round shapes, leaves. Colours: margin, background, then the motifs'.

Row 0, v = 0, is the picture's lower edge. The plain margin all round lets even a picture repeat without a seam.
"""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np

from mocks.rooms.finish import a_seed, linear, pick
from mocks.rooms.model import Texture
from mocks.rooms.textures.base import HIGHEST_ALBEDO, LOWEST_ALBEDO, Tile, clouds, generator, mixed, noise
from processing.ground.arrays import Floats

_PIXELS = 512
_GRID = (_PIXELS, _PIXELS)
_COLOURS = (
    ("#f6f4ee", "#e9e2d3", "#b1584a", "#2f4a55", "#d9a441", "#8fa3a0"),
    ("#f6f4ee", "#d9dfe2", "#e7a26a", "#6f8a95", "#3c5560", "#22333a"),
    ("#f2efe8", "#f0dcc0", "#f6efe0", "#c98a6a", "#7a4a4a", "#3a2b35"),
    ("#f7f6f2", "#f2ede2", "#4f6b4a", "#7d9a6a", "#2f4636", "#b9a06a"),
    ("#fafafa", "#ececea", "#2b2b2d", "#8a8a88", "#c9c7c2", "#55565a"),
    ("#f4f2ec", "#22304d", "#d9a441", "#e9e0cc", "#b5533c", "#6f8fa8"),
)


def draw_picture(rng: np.random.Generator) -> Texture:
    """Return a picture that just fills 0.8 m x 0.6 m of texture coordinates from 0."""
    colours = tuple(linear(c) for c in _COLOURS[int(rng.integers(len(_COLOURS)))])
    margin = 0.015 if rng.random() < 0.4 else rng.uniform(0.06, 0.14)
    options = (("width_m", 0.8), ("height_m", 0.6), ("margin", margin))
    return Texture(pick(rng, tuple(_PAINTERS)), a_seed(rng), colours, options)


def picture_tile(texture: Texture) -> Tile:
    """Return the picture of a texture of `draw_picture`."""
    made = _PAINTERS[texture.kind](texture)
    return replace(made, albedo=np.clip(made.albedo, LOWEST_ALBEDO, HIGHEST_ALBEDO))


def _size_m(texture: Texture) -> tuple[float, float]:
    return texture.option("width_m", 0.8), texture.option("height_m", 0.6)


def _axes(texture: Texture) -> tuple[Floats, Floats]:
    """Return u and v of the pixels in units of the picture's height."""
    width_m, height_m = _size_m(texture)
    line = (np.arange(_PIXELS, dtype=np.float32) + np.float32(0.5)) / np.float32(_PIXELS)
    return (line * np.float32(width_m / height_m))[None, :], line[:, None]


def _framed(texture: Texture, rng: np.random.Generator, picture: Floats) -> Tile:
    """Return the picture on its margin, with the grain of paper or canvas. Option: margin (share of the height)."""
    u, v = _axes(texture)
    width = u.max() + u.min()
    edge = np.minimum(np.minimum(u, width - u), np.minimum(v, 1 - v))
    inside = np.clip((edge - np.float32(texture.option("margin", 0.06))) * _PIXELS + 0.5, 0, 1)
    grain = 1 + np.float32(0.015) * noise(rng, _GRID, (256, 256))
    albedo = mixed(texture.colours[0], np.clip(picture * grain[..., None], 0.02, 0.9), inside)
    return Tile(np.asarray(albedo, dtype=np.float32), _size_m(texture))


def _motif(texture: Texture, number: int) -> Floats:
    motifs = texture.colours[2:] or texture.colours[1:]
    return np.array(motifs[number % len(motifs)], dtype=np.float32)


def fields(texture: Texture) -> Tile:
    """Return a few soft-edged rectangles above and beside each other."""
    rng = generator(texture.seed)
    u, v = _axes(texture)
    width = float(u.max())
    ragged = np.float32(0.012) * clouds(rng, _GRID, 8, 4)
    brush = np.float32(0.06) * noise(rng, _GRID, (256, 4)) + np.float32(0.05) * clouds(rng, _GRID, 4, 3)
    picture = np.broadcast_to(np.array(texture.colours[1], dtype=np.float32), (*_GRID, 3))
    cuts = np.sort(rng.uniform(0.2, 0.8, int(rng.integers(1, 3))))
    for number, (low, high) in enumerate(zip([0.08, *cuts], [*cuts, 0.92], strict=True)):
        side = 0.08 * width, width * rng.uniform(0.55, 0.92)
        if rng.random() < 0.5:
            side = width - side[1], width - side[0]
        edge = np.minimum(np.minimum(u - side[0], side[1] - u), np.minimum(v - low - 0.02, high - 0.02 - v))
        picture = mixed(picture, _motif(texture, number), np.clip((edge + ragged) * 60, 0, 0.95))
    return _framed(texture, rng, picture * (1 + brush)[..., None])


def hills(texture: Texture) -> Tile:
    """Return a landscape: sky, a sun or moon, and rows of hills that pale with distance."""
    rng = generator(texture.seed)
    u, v = _axes(texture)
    sky = np.array(texture.colours[1], dtype=np.float32)
    glow = np.clip(1.25 - v, 0.3, 1)[..., None]
    picture = (
        np.broadcast_to(sky * (0.65 + 0.35 * glow), (*_GRID, 3)) * (1 + 0.05 * noise(rng, _GRID, (16, 4)))[..., None]
    )
    sun = np.hypot(u - rng.uniform(0.25, 0.75) * u.max(), v - rng.uniform(0.6, 0.8))
    picture = mixed(picture, _motif(texture, 0), np.clip((rng.uniform(0.06, 0.12) - sun) * _PIXELS, 0, 1))
    rows = int(rng.integers(3, 6))
    for row in range(rows):
        near = row / (rows - 1)
        ridge = 0.55 - 0.42 * near + 0.05 * noise(rng, (1, _PIXELS), (1, 4)) + 0.015 * noise(rng, (1, _PIXELS), (1, 16))
        colour = sky + (0.35 + 0.65 * near) * (_motif(texture, 1 + row // 2) - sky)
        brush = 1 + np.float32(0.08) * noise(rng, _GRID, (64, 16))
        picture = mixed(picture, colour * brush[..., None], np.clip((ridge - v) * _PIXELS, 0, 1))
    return _framed(texture, rng, np.asarray(picture, dtype=np.float32))


def shapes(texture: Texture) -> Tile:
    """Return overlapping discs, arches and rings on a plain ground."""
    rng = generator(texture.seed)
    u, v = _axes(texture)
    width = float(u.max())
    picture = np.broadcast_to(np.array(texture.colours[1], dtype=np.float32), (*_GRID, 3))
    for number in range(int(rng.integers(3, 7))):
        x, y = rng.uniform(0.25, 0.75) * width, rng.uniform(0.25, 0.75)
        size = rng.uniform(0.08, 0.26)
        radius = np.hypot(u - x, v - y)
        inside = size - radius
        kind = int(rng.integers(3))
        if kind == 1:
            inside = 0.02 - np.abs(radius - size)
        elif kind == 2:
            inside = np.where(v > y, inside, np.minimum(size - np.abs(u - x), v - y + size))
        picture = mixed(picture, _motif(texture, number), np.clip(inside * _PIXELS, 0, 1))
    return _framed(texture, rng, picture)


def leaves(texture: Texture) -> Tile:
    """Return a botanical print: a stem with pairs of leaves."""
    rng = generator(texture.seed)
    u, v = _axes(texture)
    middle = float(u.max()) / 2
    lean = rng.uniform(-0.08, 0.08)
    stem_u = middle + lean * np.sin(math.pi * v)
    cover = np.clip((0.006 - np.abs(u - stem_u)) * _PIXELS, 0, 1) * ((v > 0.14) & (v < 0.86))
    picture = mixed(texture.colours[1], _motif(texture, 1), cover.astype(np.float32))
    pairs = int(rng.integers(5, 9))
    for pair in range(pairs):
        for side in (-1.0, 1.0):
            base = 0.2 + 0.62 * (pair + 0.25 * (side > 0)) / pairs
            length = 0.24 * math.sin(math.pi * (0.25 + 0.7 * (pair + 0.5) / pairs))
            angle = math.pi / 2 - side * rng.uniform(0.75, 1.05)
            x, y = u - (middle + lean * math.sin(math.pi * base)), v - base
            along = (x * math.cos(angle) + y * math.sin(angle)) / length
            across = np.abs(y * math.cos(angle) - x * math.sin(angle))
            outline = 0.17 * length * np.abs(np.sin(math.pi * np.clip(along, 0, 1))) ** 0.8
            inside = np.clip((outline - across) * _PIXELS, 0, 1) * ((along > 0) & (along < 1))
            picture = mixed(picture, _motif(texture, pair % 2), inside.astype(np.float32))
    return _framed(texture, rng, picture)


_PAINTERS = {"picture fields": fields, "picture hills": hills, "picture shapes": shapes, "picture leaves": leaves}

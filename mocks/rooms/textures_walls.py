"""Walls: plaster, paint, wallpaper. First colour: the whole; of wallpaper the ground, then the motifs'."""

from __future__ import annotations

from processing.ground.arrays import Floats

import math

import numpy as np

from mocks.rooms.model import Texture
from mocks.rooms.textures_base import (
    Tile,
    blurred,
    centres,
    clouds,
    generator,
    mixed,
    noise,
    repeated,
    to_nearest,
    toned,
)

_PIXELS = 1024
_GRID = (_PIXELS, _PIXELS)
_CELL = 256


def paint(texture: Texture) -> Tile:
    """Return rolled paint: almost plain, with the roller's stipple."""
    rng, grid = generator(texture.seed), (512, 512)
    stipple = blurred(rng.standard_normal(grid, dtype=np.float32), 1.2)
    tone = 1 + np.float32(0.007) * stipple / stipple.std() + np.float32(0.004) * noise(rng, grid, (4, 8))
    return Tile(toned(tone, texture.colours[0]), (1.6, 1.6))


def plaster(texture: Texture) -> Tile:
    """Return smoothed plaster: fine mottling, and here and there the mark of the trowel. Options: mottling."""
    rng = generator(texture.seed)
    tone = np.float32(texture.option("mottling", 0.018)) * clouds(rng, _GRID, 8, 6, fade=0.65)
    strokes = noise(rng, _GRID, (64, 8)) + noise(rng, _GRID, (8, 64))
    tone += np.float32(0.012) * np.clip(np.abs(strokes) - np.float32(2.4), 0, 1.5)
    return Tile(toned(1 + tone, texture.colours[0], 0.1), (3.2, 3.2))


def wallpaper_stripes(texture: Texture) -> Tile:
    """Return stripes along v. Options: period_m, share."""
    rng = generator(texture.seed)
    period_m, share = texture.option("period_m", 0.10), texture.option("share", 0.5)
    repeats = max(2, round(1.2 / period_m))
    inside = np.abs(centres(_PIXELS, repeats) % 1 - np.float32(0.5))
    cover = np.clip((share / 2 - inside) * _PIXELS / repeats + 0.5, 0, 1).astype(np.float32)
    return Tile(_printed(rng, texture, [np.broadcast_to(cover, _GRID)]), (repeats * period_m,) * 2)


def wallpaper_motifs(texture: Texture) -> Tile:
    """Return sprigs in offset rows: a four-leaved motif and a dot between. Options: period_m, leaves."""
    rng = generator(texture.seed)
    period_m, leaves = texture.option("period_m", 0.16), texture.option("leaves", 4)
    repeats = max(2, round(1.2 / period_m))
    u, v = centres(_CELL)[None, :], centres(_CELL)[:, None]
    motif, dot = (np.zeros((_CELL, _CELL), dtype=np.float32) for _ in range(2))
    for shift in (0.0, 0.5):
        x, y = to_nearest(u - np.float32(shift), 1.0), to_nearest(v - np.float32(shift), 1.0)
        radius, angle = np.hypot(x, y), np.arctan2(y, x)
        leaf = 0.27 * np.abs(np.cos(angle * leaves / 2)) ** 0.6
        motif += np.clip((leaf - radius) * _CELL + 0.5, 0, 1) * np.clip((radius - 0.05) * _CELL + 0.5, 0, 1)
        y = to_nearest(v - np.float32(shift + 0.5), 1.0)
        dot += np.clip((0.06 - np.hypot(x, y)) * _CELL + 0.5, 0, 1)
    covers = repeated(np.stack([motif, dot, dot], axis=2), repeats, _PIXELS)
    return Tile(_printed(rng, texture, [covers[..., 0], covers[..., 1]]), (repeats * period_m,) * 2)


def _printed(rng: np.random.Generator, texture: Texture, covers: list[Floats]) -> Floats:
    """Return paper with the motifs printed on it, the n-th in colour n + 1 (the last colour serves all further)."""
    albedo = toned(1 + np.float32(0.006) * noise(rng, _GRID, (512, 512)), texture.colours[0])
    for number, cover in enumerate(covers, 1):
        colour = texture.colours[min(number, len(texture.colours) - 1)]
        albedo = mixed(albedo, colour, np.minimum(cover, 1))
    return albedo


def wallpaper_damask(texture: Texture) -> Tile:
    """Return large curved ornaments, tone in tone. Options: period_m."""
    rng = generator(texture.seed)
    period_m = texture.option("period_m", 0.4)
    repeats = max(2, round(1.2 / period_m))
    u, v = centres(_PIXELS, repeats)[None, :] * 2 * math.pi, centres(_PIXELS, repeats)[:, None] * 2 * math.pi
    ogee = np.cos(u) + np.cos(v + 0.6 * np.sin(2 * u) * np.sin(v)) * 0.8
    curls = np.sin(3 * u + 2 * np.sin(v)) * np.sin(3 * v) * 0.9
    field = np.abs(ogee + 0.35 * curls)
    slope = 2 * math.pi * repeats / _PIXELS * 1.6
    band = np.clip((0.22 - field) / slope + 0.5, 0, 1) + np.clip((field - 1.15) / slope + 0.5, 0, 1)
    return Tile(_printed(rng, texture, [band.astype(np.float32)]), (repeats * period_m,) * 2)

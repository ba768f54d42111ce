"""Rugs: knotted ornaments that repeat without a border. First colour: the field, then those of the ornaments."""

from __future__ import annotations

from processing.ground.arrays import Floats

import math

import numpy as np

from mocks.light import Vector
from mocks.rooms.model import Texture
from mocks.rooms.textures_base import Tile, centres, clouds, generator, mixed, noise, repeated, to_nearest

_PIXELS = 1024
_GRID = (_PIXELS, _PIXELS)
_CELL = 384


def _ramp(inside: Floats, pixel: float) -> Floats:
    """Return 1 where ``inside`` (a signed distance) is positive, with an edge of a pixel."""
    return np.asarray(np.clip(inside / pixel + 0.5, 0, 1), dtype=np.float32)


def _knotted(rng: np.random.Generator, albedo: Floats) -> Floats:
    """Return the pattern as wool: knots, and the bands that dye lots leave across a rug."""
    wool = 1 + np.float32(0.05) * noise(rng, _GRID, (512, 512)) + np.float32(0.03) * noise(rng, _GRID, (64, 2))
    wool += np.float32(0.02) * clouds(rng, _GRID, 4, 3)
    return np.asarray(albedo * wool[..., None], dtype=np.float32)


def _colour(texture: Texture, number: int) -> Vector:
    return texture.colours[min(number, len(texture.colours) - 1)]


def medallions(texture: Texture) -> Tile:
    """Return rows of octagonal medallions with stars, and small diamonds between them. Options: period_m."""
    rng = generator(texture.seed)
    period_m = texture.option("period_m", 0.4)
    repeats = max(2, round(1.6 / period_m))
    wobble = np.float32(0.006) * noise(rng, _GRID, (128, 128))
    albedo = repeated(_medallion(texture), repeats, _PIXELS, wobble)
    return Tile(_knotted(rng, albedo), (repeats * period_m,) * 2)


def _medallion(texture: Texture) -> Floats:
    """Return one period: the medallion about the corners, the diamond in the middle."""
    u, v = centres(_CELL)[None, :], centres(_CELL)[:, None]
    x, y = to_nearest(u, 1.0), to_nearest(v, 1.0)
    octagon = np.maximum(np.maximum(np.abs(x), np.abs(y)), (np.abs(x) + np.abs(y)) * np.float32(math.sqrt(0.5)))
    star = np.hypot(x, y) * (1 + np.float32(0.22) * np.cos(8 * np.arctan2(y, x)))
    steps = np.round((np.abs(u - np.float32(0.5)) + np.abs(v - np.float32(0.5))) * 24) / 24
    albedo = np.broadcast_to(np.array(texture.colours[0], dtype=np.float32), (_CELL, _CELL, 3))
    rings = (
        (octagon, ((0.40, 1), (0.37, 2), (0.335, 3), (0.30, 1))),
        (star, ((0.27, 2), (0.20, 3), (0.13, 0), (0.07, 2))),
        (steps, ((0.24, 2), (0.20, 3), (0.12, 1), (0.06, 2))),
    )
    for distance, sizes in rings:
        for size, number in sizes:
            albedo = mixed(albedo, _colour(texture, number), _ramp(np.float32(size) - distance, 1 / _CELL))
    return np.asarray(albedo, dtype=np.float32)


def lozenges(texture: Texture) -> Tile:
    """Return the thin lozenges of Berber rugs, drawn by hand. Options: period_m (across; twice that along), line_m."""
    rng = generator(texture.seed)
    period_m, line_m = texture.option("period_m", 0.32), texture.option("line_m", 0.018)
    repeats = max(2, round(1.6 / period_m))
    size_m = repeats * period_m
    u, v = centres(_PIXELS, repeats)[None, :], centres(_PIXELS, max(1, repeats // 2))[:, None]
    shake = np.float32(0.035) * noise(rng, _GRID, (16, 16)) + np.float32(0.012) * noise(rng, _GRID, (128, 128))
    pixel, line = repeats / _PIXELS, line_m / period_m
    lines = np.minimum(np.abs(to_nearest(u + v + shake, 1.0)), np.abs(to_nearest(u - v + shake, 1.0)))
    cover = _ramp(np.float32(line / 2) - lines, pixel)
    x, y = to_nearest(u - np.float32(0.5), 1.0) + shake, to_nearest(v, 1.0)
    cover = np.maximum(cover, _ramp(np.float32(0.11) - np.abs(x) - np.abs(y), pixel))
    albedo = mixed(texture.colours[0], _colour(texture, 1), cover)
    shaggy = 1 + np.float32(0.07) * noise(rng, _GRID, (256, 256))
    return Tile(_knotted(rng, albedo * shaggy[..., None]), (size_m, size_m * max(1, repeats // 2) * 2 / repeats))


def bands(texture: Texture) -> Tile:
    """Return a flat weave: bands of uneven width across v, the broad ones with a row of zigzags. Options: bands."""
    rng, size_m = generator(texture.seed), 1.6
    count, fine = int(texture.option("bands", 14)), 4 * _PIXELS
    shares = rng.uniform(0.3, 1.7, count)
    stops = np.cumsum(shares) / shares.sum()
    starts = np.concatenate([[0.0], stops[:-1]])
    number = rng.integers(0, len(texture.colours), count)
    colours = np.array(texture.colours, dtype=np.float32)
    place = centres(_PIXELS)[:, None] + np.float32(stops[0] / 2) + np.float32(0.0012) * noise(rng, _GRID, (32, 64))
    line = (place * fine).astype(np.int32) % fine
    band = np.minimum(np.searchsorted(stops, centres(fine)), count - 1)
    middle, half = ((starts + stops) / 2)[band], ((stops - starts) / 2)[band]
    beside = np.where(half > 0.035, (centres(fine) - middle) / half, np.inf).astype(np.float32)
    zigzag = 2 * np.abs(centres(_PIXELS, 24.0) % 1 - np.float32(0.5)) - np.float32(0.5)
    cover = _ramp(np.float32(0.15) - np.abs(beside[line] - zigzag[None, :]), 2 / 60)
    albedo = mixed(colours[number[band]][line], colours[(number[band] + 1) % len(colours)][line], cover)
    return Tile(_knotted(rng, albedo), (size_m, size_m))

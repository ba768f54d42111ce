"""Carpets, cloths, leather, and rugs: knotted ornaments that repeat without a border.

First colour: the whole; a second, where used, is mixed in thread by thread; of rugs the field, then the ornaments'.
"""

import math

import numpy as np

from mocks.rooms.model import Texture
from mocks.rooms.textures.base import Tile, blurred, centres, clouds, generator, mixed, noise, offset, repeated, toned
from mocks.worlds.light import Vector
from processing.ground.arrays import Floats

_PIXELS = 1024  # chosen, as for all textures
_GRID = (_PIXELS, _PIXELS)


def _grains(rng: np.random.Generator, sigma_px: float) -> Floats:
    """Return noise of one grain size (a band of frequencies), variance 1."""
    white = rng.standard_normal(_GRID, dtype=np.float32)
    band = blurred(white, sigma_px) - blurred(white, 2 * sigma_px)
    return np.asarray(band / band.std(), dtype=np.float32)


def _two_toned(texture: Texture, tone: Floats, share: Floats) -> Floats:
    """Return the first colour, with the second where ``share`` is 1 if there is one, all times ``tone``."""
    if len(texture.colours) == 1:
        return toned(tone, texture.colours[0])
    return mixed(toned(tone, texture.colours[0]), toned(tone, texture.colours[1]), share)


def carpet_loop(texture: Texture) -> Tile:
    """Return loops of some 5 mm without order. Options: contrast."""
    rng = generator(texture.seed)
    tone = np.float32(texture.option("contrast", 0.15)) * _grains(rng, 1.8)
    tone += np.float32(0.02) * clouds(rng, _GRID, 8, 3)
    share = np.clip(_grains(rng, 2.0) - np.float32(0.6), 0, 1)
    return Tile(_two_toned(texture, np.clip(1 + tone, 0.45, 1.5), share), (1.6, 1.6))


def carpet_pile(texture: Texture) -> Tile:
    """Return cut pile: fine tufts, and soft shading where feet and the vacuum cleaner have brushed it."""
    rng = generator(texture.seed)
    tone = np.float32(texture.option("contrast", 0.16)) * _grains(rng, 1.6)
    tone += np.float32(texture.option("brushed", 0.025)) * np.tanh(clouds(rng, _GRID, 8, 3))
    share = np.clip(_grains(rng, 1.0) - np.float32(0.6), 0, 1)
    return Tile(_two_toned(texture, np.clip(1 + tone, 0.5, 1.5), share), (2.0, 2.0))


def woven(texture: Texture) -> Tile:
    """Return a plain weave with uneven yarns; a second colour makes it heathered. Options: thread_m."""
    rng = generator(texture.seed)
    size_m = 0.6
    threads = 2 * max(8, round(size_m / texture.option("thread_m", 0.003) / 2))
    # The tone of a plain weave, and the share of the second yarn, for an even number of threads a side
    place = centres(_PIXELS, threads)
    thread = place.astype(np.int32)
    bulge = np.sin(math.pi * (place - thread)).astype(np.float32)
    over = (thread[:, None] + thread[None, :]) % 2 == 0
    warp = bulge[None, :] * (0.6 + 0.4 * bulge[:, None])
    weft = bulge[:, None] * (0.6 + 0.4 * bulge[None, :])
    yarn = rng.normal(0, 1, (2, threads)).astype(np.float32)
    along = noise(rng, _GRID, (16, _PIXELS)), noise(rng, _GRID, (_PIXELS, 16))
    slubs = np.where(over, yarn[0][thread][None, :] + along[0], yarn[1][thread][:, None] + along[1])
    tone = 0.72 + 0.45 * np.where(over, warp, weft) + 0.035 * slubs
    share = np.clip(2 * slubs - 0.8, 0, 1)
    tone, share = tone.astype(np.float32), share.astype(np.float32)
    return Tile(_two_toned(texture, np.clip(tone, 0.4, 1.4), share), (size_m, size_m))


def boucle(texture: Texture) -> Tile:
    """Return curled yarn: soft knots of about a centimetre."""
    rng = generator(texture.seed)
    curls = np.tanh(1.5 * _grains(rng, 4.0)) - np.float32(0.5) * np.exp(-8 * np.abs(_grains(rng, 4.0)))
    tone = 1 + np.float32(0.10) * curls + np.float32(0.05) * _grains(rng, 1.2)
    return Tile(_two_toned(texture, np.clip(tone, 0.4, 1.4), np.clip(_grains(rng, 3.0), 0, 1)), (0.8, 0.8))


def knit(texture: Texture) -> Tile:
    """Return a knitted cloth: columns of stitches, each a V. Options: stitch_m."""
    rng, size_m = generator(texture.seed), 0.64
    columns = max(4, round(size_m / texture.option("stitch_m", 0.012)))
    rows = 2 * columns
    across = centres(_PIXELS, columns)[None, :] % 1 - np.float32(0.5)
    up = centres(_PIXELS, rows)[:, None] + np.float32(1.6) * np.abs(across)
    leg = np.sin(math.pi * (up % 1)) * (1 - (2 * np.abs(np.abs(across) - 0.25)) ** 2)
    groove = np.exp(-((np.abs(across) / 0.06) ** 2)) + np.exp(-(((0.5 - np.abs(across)) / 0.06) ** 2))
    tone = (0.75 + 0.35 * leg - 0.15 * groove + 0.04 * _grains(rng, 1.5)).astype(np.float32)
    return Tile(_two_toned(texture, np.clip(tone, 0.4, 1.4), np.zeros(_GRID, np.float32)), (size_m,) * 2)


def striped(texture: Texture) -> Tile:
    """Return stripes along v on a fine cloth; with ``checks`` 1, checks. Colours: ground, then the stripes'.

    Options: period_m (of the whole sequence), share (of each band that the stripe takes), checks.
    """
    rng = generator(texture.seed)
    period_m = texture.option("period_m", 0.16)
    repeats = max(1, round(0.8 / period_m))
    colours = np.array(texture.colours, dtype=np.float32)
    bands = len(colours) - 1
    place = centres(_PIXELS, repeats * bands)
    stripe = place.astype(np.int32) % bands
    inside = np.abs(place % 1 - np.float32(0.5))
    pixel = repeats * bands / _PIXELS
    cover = np.clip((texture.option("share", 0.4) / 2 - inside) / pixel + 0.5, 0, 1).astype(np.float32)
    warp = mixed(texture.colours[0], colours[1 + stripe], cover)
    ground = np.broadcast_to(warp[None], (*_GRID, 3))
    if texture.option("checks", 0):
        ground = 0.5 * (ground + warp[:, None])
    threads = (
        1 + np.float32(0.03) * noise(rng, _GRID, (16, _PIXELS)) + np.float32(0.03) * noise(rng, _GRID, (_PIXELS, 16))
    )
    return Tile(np.asarray(ground * threads[..., None], dtype=np.float32), (repeats * period_m,) * 2)


def leather(texture: Texture) -> Tile:
    """Return leather: fine creases between small cells, and wear."""
    rng = generator(texture.seed)
    creases = np.exp(-6 * np.abs(_grains(rng, 2.5))) + np.float32(0.6) * np.exp(-10 * np.abs(clouds(rng, _GRID, 16, 3)))
    tone = 1 - np.float32(0.10) * creases + np.float32(0.025) * clouds(rng, _GRID, 8, 3)
    return Tile(toned(np.clip(tone, 0.4, 1.4).astype(np.float32), texture.colours[0], 0.3), (0.8, 0.8))


_CELL = 384  # chosen: pixels of one repeat


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


def rug_medallions(texture: Texture) -> Tile:
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
    x, y = offset(u, 1.0), offset(v, 1.0)
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


def rug_lozenges(texture: Texture) -> Tile:
    """Return the thin lozenges of Berber rugs, drawn by hand. Options: period_m (across; twice that along), line_m."""
    rng = generator(texture.seed)
    period_m, line_m = texture.option("period_m", 0.32), texture.option("line_m", 0.018)
    repeats = max(2, round(1.6 / period_m))
    size_m = repeats * period_m
    u, v = centres(_PIXELS, repeats)[None, :], centres(_PIXELS, max(1, repeats // 2))[:, None]
    shake = np.float32(0.035) * noise(rng, _GRID, (16, 16)) + np.float32(0.012) * noise(rng, _GRID, (128, 128))
    pixel, line = repeats / _PIXELS, line_m / period_m
    lines = np.minimum(np.abs(offset(u + v + shake, 1.0)), np.abs(offset(u - v + shake, 1.0)))
    cover = _ramp(np.float32(line / 2) - lines, pixel)
    x, y = offset(u - np.float32(0.5), 1.0) + shake, offset(v, 1.0)
    cover = np.maximum(cover, _ramp(np.float32(0.11) - np.abs(x) - np.abs(y), pixel))
    albedo = mixed(texture.colours[0], _colour(texture, 1), cover)
    shaggy = 1 + np.float32(0.07) * noise(rng, _GRID, (256, 256))
    return Tile(_knotted(rng, albedo * shaggy[..., None]), (size_m, size_m * max(1, repeats // 2) * 2 / repeats))


def rug_bands(texture: Texture) -> Tile:
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

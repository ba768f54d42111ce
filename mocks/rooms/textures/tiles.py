"""Ceramic tiles, marble, terrazzo, concrete; plaster, paint and wallpaper.

Colours of tiles: tile, grout; of a chequered floor, the other tile third. Of walls: the whole; of wallpaper the ground,
then the motifs'.
"""

import math

import cv2
import numpy as np

from mocks.rooms.model import Texture
from mocks.rooms.textures import base
from mocks.rooms.textures.base import Tile
from processing.ground.arrays import Floats, Int32s

_PIXELS = 1024  # chosen, as for all textures
_GRID = (_PIXELS, _PIXELS)
_ROUGHLY_M = 2.4  # chosen: a texture's width, rounded to whole tiles


def tiles(texture: Texture) -> Tile:
    """Return rectangular tiles. Options: tile_u_m, tile_v_m, offset (share of a tile, every other row), gap_m.

    Further: variation (between tiles), clouding (within a tile), veins (of marble), chequered (1).
    """
    rng = base.generator(texture.seed)
    tile_u, tile_v = texture.option("tile_u_m", 0.3), texture.option("tile_v_m", 0.3)
    count_u, count_v = (2 * max(1, round(_ROUGHLY_M / side / 2)) for side in (tile_u, tile_v))
    row_place = base.centres(_PIXELS, count_v)
    row = row_place.astype(np.int32)
    offset = np.float32(texture.option("offset", 0.0)) * (row % 2).astype(np.float32)
    place = (base.centres(_PIXELS, count_u)[None, :] + offset[:, None]) % np.float32(count_u)
    column = np.minimum(place.astype(np.int32), count_u - 1)
    from_side = np.abs(place - np.round(place)) * np.float32(tile_u)
    from_end = (np.abs(row_place - np.round(row_place)) * np.float32(tile_v))[:, None]
    gap_m = texture.option("gap_m", 0.003)
    cover_u = base.line_cover(from_side, gap_m, count_u * tile_u / _PIXELS)
    cover_v = base.line_cover(from_end, gap_m, count_v * tile_v / _PIXELS)
    number = row[:, None] * count_u + column
    second = ((row[:, None] + column) % 2).astype(np.float32) if texture.option("chequered", 0) else None
    albedo = _ceramic(rng, texture, number, second, np.maximum(cover_u, cover_v))
    return Tile(albedo, (count_u * tile_u, count_v * tile_v))


def hexagons(texture: Texture) -> Tile:
    """Return six-sided tiles, a corner along v. Options: side_m, gap_m, variation, clouding."""
    rng = base.generator(texture.seed)
    side = texture.option("side_m", 0.12)
    width, height = math.sqrt(3) * side, 3 * side
    count_u, count_v = max(2, round(_ROUGHLY_M / width)), max(2, round(_ROUGHLY_M / height))
    u, v = base.centres(_PIXELS, count_u * width)[None, :], base.centres(_PIXELS, count_v * height)[:, None]
    best, number = np.full(_GRID, np.inf, dtype=np.float32), np.zeros(_GRID, dtype=np.int32)
    for lattice, (shift_u, shift_v) in enumerate(((0.0, 0.0), (width / 2, height / 2))):
        i, j = np.round((u - np.float32(shift_u)) / width), np.round((v - np.float32(shift_v)) / height)
        du, dv = np.abs(u - shift_u - i * width), np.abs(v - shift_v - j * height)
        reach = np.maximum(du, 0.5 * du + math.sqrt(0.75) * dv)
        nearer = reach < best
        best = np.where(nearer, reach, best).astype(np.float32)
        own = ((j % count_v) * count_u + i % count_u) * 2 + lattice
        number = np.where(nearer, own, number).astype(np.int32)
    pixel = max(count_u * width, count_v * height) / _PIXELS
    gaps = base.line_cover(np.float32(width / 2) - best, texture.option("gap_m", 0.003), pixel)
    return Tile(_ceramic(rng, texture, number, None, gaps), (count_u * width, count_v * height))


def _ceramic(rng: np.random.Generator, texture: Texture, number: Int32s, second: Floats | None, gaps: Floats) -> Floats:
    """Return tiles by number with their clouding, ``second`` of them in the third colour, and the grout."""
    count = int(number.max()) + 1
    cloud = np.float32(texture.option("clouding", 0.025)) * base.clouds(rng, _GRID, 4, 5)
    if veins := texture.option("veins", 0.0):
        # Dark lines where noise changes sign, some strong and most faint, as in marble
        total = np.zeros(_GRID, dtype=np.float32)
        strength = np.clip(base.clouds(rng, _GRID, 4, 2) + 0.8, 0, None)
        for coarsest, weight, sharpness in ((4, 0.6, 30.0), (8, 0.35, 14.0)):
            total += np.float32(weight) * np.exp(-np.float32(sharpness) * np.abs(base.clouds(rng, _GRID, coarsest, 5)))
        cloud -= np.float32(veins) * np.asarray(total * strength, dtype=np.float32)
    shifts = rng.integers(_PIXELS, size=(2, count), dtype=np.int32)
    grid = np.arange(_PIXELS, dtype=np.int32)
    down = (grid[:, None] + shifts[0][number]) & (_PIXELS - 1)
    right = (grid[None, :] + shifts[1][number]) & (_PIXELS - 1)
    tint = rng.normal(1, texture.option("variation", 0.025), count).astype(np.float32)
    tone = np.clip(tint[number] * (1 + cloud[down, right]), 0.3, 1.5)
    face = base.toned(tone, texture.colours[0])
    if second is not None:
        face = base.mixed(face, base.toned(tone, texture.colours[2]), second)
    grout = base.toned(1 + np.float32(0.06) * base.noise(rng, _GRID, (64, 64)), texture.colours[1])
    return base.mixed(face, grout, gaps)


def terrazzo(texture: Texture) -> Tile:
    """Return stone chips in cement. Colours: cement, then one for each sort of chip. Options: chip_m, density."""
    rng, size_m = base.generator(texture.seed), 1.6
    chip_px = texture.option("chip_m", 0.012) / size_m * _PIXELS
    albedo = base.toned(1 + np.float32(0.03) * base.clouds(rng, _GRID, 8, 5), texture.colours[0])
    sorts = texture.colours[1:]
    count = int(texture.option("density", 0.35) * _PIXELS**2 / (2.0 * chip_px**2) / len(sorts))
    for colour in sorts:
        albedo = base.mixed(albedo, colour, _chips(rng, count, chip_px))
    return Tile(albedo, (size_m, size_m))


def _chips(rng: np.random.Generator, count: int, chip_px: float) -> Floats:
    """Return where broken stones of four to seven corners lie. What crosses an edge comes in at the other side."""
    border = int(4 * chip_px)
    wide = np.zeros((_PIXELS + 2 * border,) * 2, dtype=np.uint8)
    for _ in range(count):
        corners = int(rng.integers(4, 8))
        angle = np.sort(rng.uniform(0, 2 * math.pi, corners))
        radius = chip_px * min(rng.lognormal(-0.25, 0.45), 3.0) * rng.uniform(0.7, 1.1, corners)
        shape = np.stack([radius * np.cos(angle), radius * np.sin(angle)], axis=1) + rng.uniform(0, _PIXELS, 2) + border
        cv2.fillConvexPoly(wide, np.round(shape * 16).astype(np.int32), 255, cv2.LINE_AA, shift=4)
    for _ in range(2):
        np.maximum(wide[border : 2 * border], wide[-border:], out=wide[border : 2 * border])
        np.maximum(wide[-2 * border : -border], wide[:border], out=wide[-2 * border : -border])
        wide = wide.T
    return wide[border:-border, border:-border].astype(np.float32) / np.float32(255)


def concrete(texture: Texture) -> Tile:
    """Return power-floated concrete: clouds, faint sweeps of the trowel, pores. Options: clouding."""
    rng = base.generator(texture.seed)
    tone = np.float32(texture.option("clouding", 0.05)) * base.clouds(rng, _GRID, 4, 6, fade=0.8)
    tone += np.float32(0.012) * base.blurred(rng.standard_normal(_GRID, dtype=np.float32), 0.8) * 3
    pores = base.blurred((rng.random(_GRID, dtype=np.float32) < 0.0006).astype(np.float32), 0.7)
    tone -= np.minimum(pores * np.float32(1.2), 0.4)
    return Tile(base.toned(np.clip(1 + tone, 0.4, 1.5), texture.colours[0], 0.1), (3.2, 3.2))


_CELL = 256  # chosen: pixels of one tile's motif


def paint(texture: Texture) -> Tile:
    """Return rolled paint: almost plain, with the roller's stipple."""
    rng, grid = base.generator(texture.seed), (512, 512)
    stipple = base.blurred(rng.standard_normal(grid, dtype=np.float32), 1.2)
    tone = 1 + np.float32(0.007) * stipple / stipple.std() + np.float32(0.004) * base.noise(rng, grid, (4, 8))
    return Tile(base.toned(tone, texture.colours[0]), (1.6, 1.6))


def plaster(texture: Texture) -> Tile:
    """Return smoothed plaster: fine mottling, and here and there the mark of the trowel. Options: mottling."""
    rng = base.generator(texture.seed)
    tone = np.float32(texture.option("mottling", 0.018)) * base.clouds(rng, _GRID, 8, 6, fade=0.65)
    strokes = base.noise(rng, _GRID, (64, 8)) + base.noise(rng, _GRID, (8, 64))
    tone += np.float32(0.012) * np.clip(np.abs(strokes) - np.float32(2.4), 0, 1.5)
    return Tile(base.toned(1 + tone, texture.colours[0], 0.1), (3.2, 3.2))


def wallpaper_stripes(texture: Texture) -> Tile:
    """Return stripes along v. Options: period_m, share."""
    rng = base.generator(texture.seed)
    period_m, share = texture.option("period_m", 0.10), texture.option("share", 0.5)
    repeats = max(2, round(1.2 / period_m))
    inside = np.abs(base.centres(_PIXELS, repeats) % 1 - np.float32(0.5))
    cover = np.clip((share / 2 - inside) * _PIXELS / repeats + 0.5, 0, 1).astype(np.float32)
    return Tile(_printed(rng, texture, [np.broadcast_to(cover, _GRID)]), (repeats * period_m,) * 2)


def wallpaper_motifs(texture: Texture) -> Tile:
    """Return sprigs in offset rows: a four-leaved motif and a dot between. Options: period_m, leaves."""
    rng = base.generator(texture.seed)
    period_m, leaves = texture.option("period_m", 0.16), texture.option("leaves", 4)
    repeats = max(2, round(1.2 / period_m))
    u, v = base.centres(_CELL)[None, :], base.centres(_CELL)[:, None]
    motif, dot = (np.zeros((_CELL, _CELL), dtype=np.float32) for _ in range(2))
    for shift in (0.0, 0.5):
        x, y = base.offset(u - np.float32(shift), 1.0), base.offset(v - np.float32(shift), 1.0)
        radius, angle = np.hypot(x, y), np.arctan2(y, x)
        leaf = 0.27 * np.abs(np.cos(angle * leaves / 2)) ** 0.6
        motif += np.clip((leaf - radius) * _CELL + 0.5, 0, 1) * np.clip((radius - 0.05) * _CELL + 0.5, 0, 1)
        y = base.offset(v - np.float32(shift + 0.5), 1.0)
        dot += np.clip((0.06 - np.hypot(x, y)) * _CELL + 0.5, 0, 1)
    covers = base.repeated(np.stack([motif, dot, dot], axis=2), repeats, _PIXELS)
    return Tile(_printed(rng, texture, [covers[..., 0], covers[..., 1]]), (repeats * period_m,) * 2)


def _printed(rng: np.random.Generator, texture: Texture, covers: list[Floats]) -> Floats:
    """Return paper with the motifs printed on it, the n-th in colour n + 1 (the last colour serves all further)."""
    albedo = base.toned(1 + np.float32(0.006) * base.noise(rng, _GRID, (512, 512)), texture.colours[0])
    for number, cover in enumerate(covers, 1):
        albedo = base.mixed(albedo, texture.colours[min(number, len(texture.colours) - 1)], np.minimum(cover, 1))
    return albedo


def wallpaper_damask(texture: Texture) -> Tile:
    """Return large curved ornaments, tone in tone. Options: period_m."""
    rng = base.generator(texture.seed)
    period_m = texture.option("period_m", 0.4)
    repeats = max(2, round(1.2 / period_m))
    u, v = base.centres(_PIXELS, repeats)[None, :] * 2 * math.pi, base.centres(_PIXELS, repeats)[:, None] * 2 * math.pi
    ogee = np.cos(u) + np.cos(v + 0.6 * np.sin(2 * u) * np.sin(v)) * 0.8
    curls = np.sin(3 * u + 2 * np.sin(v)) * np.sin(3 * v) * 0.9
    field = np.abs(ogee + 0.35 * curls)
    slope = 2 * math.pi * repeats / _PIXELS * 1.6
    band = np.clip((0.22 - field) / slope + 0.5, 0, 1) + np.clip((field - 1.15) / slope + 0.5, 0, 1)
    return Tile(_printed(rng, texture, [band.astype(np.float32)]), (repeats * period_m,) * 2)

"""Wood: boards cut from a log, random planks, furniture's straight grain; laminate, herringbone, blocks.

A board shows where it was cut: the growth rings are cylinders about the pith, so a board that passes near the pith
shows nested arches along its middle and one far from it shows straight lines. Colours: wood, gap.
"""

import itertools
import math
from dataclasses import dataclass, replace
from typing import Self

import cv2
import numpy as np
import numpy.typing as npt

from mocks.rooms.model import Texture
from mocks.rooms.textures.base import Tile, centres, generator, line_cover, mixed, noise, offset, toned
from processing.ground.arrays import Floats, Int32s, Reals

WARMTH = 0.3  # how much redder the dark grain is than the light
_RINGS, _PER_RING = 256, 16
_PLANK_PIXELS, _PLANK_TILE_M = 2048, 4.8


def ring_tones(rng: np.random.Generator, rings: int) -> Floats:
    """Return darkness (N,) across ``rings`` growth rings, 16 samples each, that wraps; each darkens, then ends."""
    dark = rng.gamma(2.0, 0.5, rings).astype(np.float32)
    rise = (np.arange(_PER_RING, dtype=np.float32) / _PER_RING) ** 2
    tones = np.pad((dark[:, None] * rise[None, :]).ravel(), 2, mode="wrap")
    soft = np.convolve(tones, np.full(5, 0.2, dtype=np.float32), mode="valid")
    return np.asarray((soft - soft.mean()) / soft.std(), dtype=np.float32)


@dataclass(frozen=True)
class Timber:
    """What all boards of a floor have in common: rings by number, fibres, and how strong the figure is."""

    rings: Floats
    fibres: Floats
    pixel_m: float
    ring_m: float
    figure: float
    knots_per_m: float

    @classmethod
    def of(cls, rng: np.random.Generator, texture: Texture, pixel_m: float) -> Self:
        """Return the timber of a texture. Options: ring_m, figure, knots (per metre of board)."""
        return cls(
            rings=ring_tones(rng, _RINGS),
            fibres=0.6 * noise(rng, (512, 512), (8, 512)) + 0.5 * noise(rng, (512, 512), (32, 256)),
            pixel_m=pixel_m,
            ring_m=texture.option("ring_m", max(0.006, 2.2 * pixel_m)),
            figure=texture.option("figure", 0.10),
            knots_per_m=texture.option("knots", 0.06),
        )

    def board(self, rng: np.random.Generator, rows: int, columns: int) -> Floats:
        """Return the tone (H, W), about 1, of a new board, its grain along the rows."""
        across = (np.arange(columns, dtype=np.float32) - np.float32(columns / 2)) * np.float32(self.pixel_m)
        along = np.arange(rows, dtype=np.float32) * np.float32(self.pixel_m)
        sway = np.float32(0.008) * _wander(rng, rows, self.pixel_m) - np.float32(rng.normal(0, 0.05))
        slope = float(rng.choice([-1, 1]) * rng.uniform(0.01, 0.05))
        height = rng.uniform(0.01, 0.09) + slope * along + 0.006 * _wander(rng, rows, self.pixel_m)
        x = across[None, :] + sway[:, None]
        radius = np.sqrt(x * x + (height * height).astype(np.float32)[:, None])
        side = len(self.fibres)
        turned = np.roll(self.fibres, rng.integers(side, size=2), (0, 1))
        repeats = (-(-rows // side), -(-columns // side))
        fibres = turned if repeats == (1, 1) else np.tile(turned, repeats)
        tone = np.asarray(1 + np.float32(0.5 * self.figure) * fibres[:rows, :columns], dtype=np.float32)
        if rng.random() < self.knots_per_m * rows * self.pixel_m:
            self._add_knot(rng, radius, tone)
        ring = (radius * np.float32(_PER_RING / self.ring_m)).astype(np.int32) + rng.integers(1 << 12, dtype=np.int32)
        tone -= np.float32(self.figure) * np.take(self.rings, ring, mode="wrap")
        return np.clip(tone, 0.35, 1.5, out=tone)

    def _add_knot(self, rng: np.random.Generator, radius: Floats, tone: Floats) -> None:
        rows, columns = radius.shape
        row, column = rng.uniform(0.15, 0.85) * rows, rng.uniform(0.2, 0.8) * columns
        size_px = rng.uniform(0.006, 0.014) / self.pixel_m
        down = ((np.arange(rows, dtype=np.float32) - np.float32(row)) / np.float32(1.4 * size_px)) ** 2
        right = ((np.arange(columns, dtype=np.float32) - np.float32(column)) / np.float32(size_px)) ** 2
        radius += np.float32(0.03) * np.outer(np.exp(-down / 8), np.exp(-right / 8))
        tone -= np.float32(0.5) * np.outer(np.exp(-1.3 * down), np.exp(-1.3 * right))


def _wander(rng: np.random.Generator, length: int, pixel_m: float) -> Floats:
    """Return a smooth random curve along a board, a turn every 0.3 m or so."""
    knots = rng.standard_normal(max(4, int(length * pixel_m / 0.3) + 4), dtype=np.float32)
    return np.asarray(cv2.resize(knots[None, :], (length, 1), interpolation=cv2.INTER_CUBIC)[0])


def board_tint(rng: np.random.Generator, texture: Texture, usual: float = 0.09) -> np.float32:
    """Return the tone of one board among others. Option: variation."""
    return np.float32(np.clip(rng.normal(1.0, texture.option("variation", usual)), 0.6, 1.4))


def gapped(texture: Texture, tone: Floats, gaps: Floats, size_m: tuple[float, float]) -> Tile:
    """Return wood of a tone (H, W), with gaps where ``gaps`` (H, W) is 1."""
    return Tile(mixed(toned(tone, texture.colours[0], WARMTH), texture.colours[1], gaps), size_m)


def planks(texture: Texture) -> Tile:
    """Return boards along v with random joints. Options: board_m, length_m, gap_m, variation, and the timber's."""
    rng = generator(texture.seed)
    board_m, gap_m = texture.option("board_m", 0.14), texture.option("gap_m", 0.003)
    boards = max(8, round(_PLANK_TILE_M / board_m))
    width_m, pixel_m = boards * board_m, _PLANK_TILE_M / _PLANK_PIXELS
    timber = Timber.of(rng, texture, pixel_m)
    tone = np.empty((_PLANK_PIXELS, _PLANK_PIXELS), dtype=np.float32)
    ends = np.zeros((_PLANK_PIXELS, boards), dtype=np.float32)
    edges = np.round(np.arange(boards + 1) * (_PLANK_PIXELS / boards)).astype(int)
    for board, (left, right) in enumerate(itertools.pairwise(edges)):
        tone[:, left:right], joints_m = _run(rng, timber, texture, right - left)
        for joint_m in joints_m:
            distance = offset(centres(_PLANK_PIXELS, _PLANK_TILE_M) - np.float32(joint_m), _PLANK_TILE_M)
            ends[:, board] += line_cover(distance, gap_m, pixel_m)
    sides = line_cover(offset(centres(_PLANK_PIXELS, width_m), board_m), gap_m, width_m / _PLANK_PIXELS)
    gaps = np.maximum(np.repeat(ends, np.diff(edges), axis=1), sides[None, :])
    return gapped(texture, tone, gaps, (width_m, _PLANK_TILE_M))


def _run(rng: np.random.Generator, timber: Timber, texture: Texture, columns: int) -> tuple[Floats, list[float]]:
    """Return one row of boards end to end that wraps, and where its joints are in metres."""
    shares = rng.uniform(0.6, 1.4, max(2, round(_PLANK_TILE_M / texture.option("length_m", 1.4))))
    stops = [0, *(int(s) for s in np.round(np.cumsum(shares) / shares.sum() * _PLANK_PIXELS))]
    run = np.empty((_PLANK_PIXELS, columns), dtype=np.float32)
    for low, high in itertools.pairwise(stops):
        run[low:high] = timber.board(rng, high - low, columns) * board_tint(rng, texture)
    turn = int(rng.integers(_PLANK_PIXELS))
    return np.roll(run, turn, axis=0), [(stop + turn) % _PLANK_PIXELS * timber.pixel_m for stop in stops[1:]]


def veneer(texture: Texture) -> Tile:
    """Return the calm grain of furniture along v, a metre and a bit of it. Options: figure, arches."""
    rng, pixels, rings = generator(texture.seed), (1024, 1024), 140
    figure = texture.option("figure", 0.10)
    phase = np.float32(rings) * centres(1024)[None, :] + np.float32(0.15) * noise(rng, pixels, (8, 32))
    phase += np.float32(texture.option("arches", 2.4)) * noise(rng, pixels, (2, 8))
    ring = (phase * np.float32(_PER_RING)).astype(np.int32)
    tone = 1 - np.float32(figure) * np.take(ring_tones(rng, rings), ring, mode="wrap")
    tone += np.float32(0.35 * figure) * noise(rng, pixels, (16, 1024)) + np.float32(0.03) * noise(rng, pixels, (2, 8))
    return Tile(toned(np.clip(tone, 0.4, 1.5), texture.colours[0], WARMTH), (1.2, 1.2))


_PIXELS = 1024  # chosen, as for all textures


@dataclass(frozen=True)
class Layout:
    """Which block each pixel lies on (any whole number), and where on it: along and across, in metres."""

    number: Int32s
    along_m: Floats
    across_m: Floats
    length_m: float
    width_m: float

    @classmethod
    def of(
        cls, number: npt.NDArray[np.signedinteger], along_m: Reals, across_m: Reals, size_m: tuple[float, float]
    ) -> Self:
        """Return a layout of blocks of length and width ``size_m``: per pixel (H, W) the block and the place in it."""
        return cls(number.astype(np.int32), along_m.astype(np.float32), across_m.astype(np.float32), *size_m)

    def gaps(self, gap_m: float, pixel_m: float) -> Floats:
        """Return how much of each pixel (H, W) is gap between blocks."""
        ends = np.minimum(self.along_m, np.float32(self.length_m) - self.along_m)
        sides = np.minimum(self.across_m, np.float32(self.width_m) - self.across_m)
        return line_cover(np.minimum(ends, sides), gap_m, pixel_m)

    def shown(self, bank: Floats, pixel_m: float) -> Floats:
        """Return the tones of blocks out of ``bank`` (N, H, W), each with its grain along it."""
        blocks, rows, columns = bank.shape
        sheet = np.ascontiguousarray(bank.transpose(1, 0, 2).reshape(rows, blocks * columns))
        scale = np.float32(1 / pixel_m)
        right = np.clip(self.across_m * scale - np.float32(0.5), 0, columns - 1)
        right += ((self.number % blocks) * columns).astype(np.float32)
        return np.asarray(cv2.remap(sheet, right, self.along_m * scale - np.float32(0.5), cv2.INTER_LINEAR))


def _bank(rng: np.random.Generator, texture: Texture, pixel_m: float, many: int, size_m: tuple[float, float]) -> Floats:
    """Return the tones of ``many`` blocks of length and width ``size_m``."""
    timber = Timber.of(rng, texture, pixel_m)
    rows, columns = (math.ceil(s / pixel_m) for s in size_m)
    return np.stack([timber.board(rng, rows, columns) * board_tint(rng, texture) for _ in range(many)])


def _shuffled(rng: np.random.Generator, number: Int32s, blocks: int) -> Int32s:
    """Return, for the numbers of places, the numbers of the blocks that lie there."""
    return rng.integers(blocks, size=int(number.max()) + 1, dtype=np.int32)[number]


def laminate(texture: Texture) -> Tile:
    """Return boards along v, each a third further than the last; few prints return again and again.

    Options: board_m, length_m, gap_m, strips (to a board), prints, variation, and the timber's.
    """
    rng = generator(texture.seed)
    board_m, length_m = texture.option("board_m", 0.194), texture.option("length_m", 1.29)
    columns, size_m = 12, (12 * board_m, 2 * length_m)
    pixel_m = size_m[1] / _PIXELS
    u = centres(_PIXELS, size_m[0])
    column = np.minimum((u / np.float32(board_m)).astype(np.int32), columns - 1)
    v = (centres(_PIXELS, size_m[1])[:, None] + column % 3 * np.float32(length_m / 3)) % np.float32(size_m[1])
    row = np.minimum((v / np.float32(length_m)).astype(np.int32), 1)
    across = np.broadcast_to(u - column * board_m, v.shape)
    place = row * columns + column[None, :]
    prints = _prints(rng, texture, pixel_m, (length_m, board_m))
    layout = Layout.of(_shuffled(rng, place, len(prints)), v - row * length_m, across, (length_m, board_m))
    gaps = layout.gaps(texture.option("gap_m", 0.0015), pixel_m)
    return gapped(texture, layout.shown(prints, pixel_m), gaps, size_m)


def _prints(rng: np.random.Generator, texture: Texture, pixel_m: float, size_m: tuple[float, float]) -> Floats:
    """Return the few pictures that a laminate is printed with, each of one board or of strips with joints."""
    strips = int(texture.option("strips", 1))
    timber = Timber.of(rng, texture, pixel_m)
    usual = 0.03 if strips == 1 else 0.07
    rows, columns = (math.ceil(s / pixel_m) for s in size_m)
    prints = np.empty((int(texture.option("prints", 4)), rows, columns), dtype=np.float32)
    for picture in prints:
        for strip in range(strips):
            left, right = columns * strip // strips, columns * (strip + 1) // strips
            cut = rows if strips == 1 else int(rows * rng.uniform(0.25, 0.75))
            for low, high in ((0, cut), (cut, rows)) if cut < rows else ((0, rows),):
                board = timber.board(rng, high - low, right - left)
                picture[low:high, left:right] = board * board_tint(rng, texture, usual)
                picture[low : low + 1, left:right] *= 0.75
            picture[:, left] *= 0.75
    return prints


def herringbone(texture: Texture) -> Tile:
    """Return a herringbone whose zigzags run along u. Options: block_m (width), ratio, gap_m, variation."""
    rng = generator(texture.seed)
    width_m, ratio = texture.option("block_m", 0.07), int(texture.option("ratio", 5))
    step_u, step_v = math.sqrt(2) * width_m, math.sqrt(2) * ratio * width_m
    count = (round(2.4 / step_u), max(2, round(2.4 / step_v)))
    size_m = (count[0] * step_u, count[1] * step_v)
    pixel_m = max(size_m) / _PIXELS
    # x and y run along the two directions of blocks and count block widths.
    p = centres(_PIXELS, size_m[0] / step_u)[None, :]
    q = np.float32(ratio) * centres(_PIXELS, size_m[1] / step_v)[:, None]
    layout = _zigzag(p + q, p - q, ratio, width_m, count)
    bank = _bank(rng, texture, pixel_m, 96, (ratio * width_m, width_m))
    tone = replace(layout, number=_shuffled(rng, layout.number, len(bank))).shown(bank, pixel_m)
    return gapped(texture, tone, layout.gaps(texture.option("gap_m", 0.002), pixel_m), size_m)


def _zigzag(x: Floats, y: Floats, ratio: int, width_m: float, count: tuple[int, int]) -> Layout:
    """Return the herringbone: blocks along x and along y, all one step (1, 1) or (ratio, -ratio) from the next."""
    cell_x, cell_y = np.floor(x).astype(np.int32), np.floor(y).astype(np.int32)
    place = (cell_x - cell_y) % (2 * ratio)
    along_x = place < ratio
    start = np.where(along_x, cell_x - place, cell_y + place - 2 * ratio + 1)
    far = np.where(along_x, start - cell_y, cell_x - start - 2 * ratio + 1) // (2 * ratio)
    near = np.where(along_x, start, cell_x) - far * ratio
    number = ((near % count[0]) * count[1] + far % count[1]) * 2 + along_x
    along = np.where(along_x, x, y) - start
    across = np.where(along_x, y - cell_y, x - cell_x)
    return Layout.of(number, along * width_m, across * width_m, (ratio * width_m, width_m))


def blocks(texture: Texture) -> Tile:
    """Return squares of strips whose direction alternates, as in a basket weave. Options: block_m, ratio, gap_m."""
    rng = generator(texture.seed)
    side_m, strips = texture.option("block_m", 0.14), int(texture.option("ratio", 4))
    count = 2 * max(1, round(1.2 / side_m))
    size_m, width_m = count * side_m, side_m / strips
    pixel_m = size_m / _PIXELS
    place = centres(_PIXELS, count)
    cell = place.astype(np.int32)
    inside = (place - cell) * np.float32(side_m)
    upright = (cell[:, None] + cell[None, :]) % 2 == 0
    along = np.where(upright, inside[:, None], inside[None, :])
    sideways = np.where(upright, inside[None, :], inside[:, None])
    strip = np.minimum((sideways / np.float32(width_m)).astype(np.int32), strips - 1)
    number = (cell[:, None] * count + cell[None, :]) * strips + strip
    layout = Layout.of(number, along, sideways - strip * width_m, (side_m, width_m))
    bank = _bank(rng, texture, pixel_m, 128, (side_m, width_m))
    tone = replace(layout, number=_shuffled(rng, number, len(bank))).shown(bank, pixel_m)
    return gapped(texture, tone, layout.gaps(texture.option("gap_m", 0.0012), pixel_m), (size_m, size_m))

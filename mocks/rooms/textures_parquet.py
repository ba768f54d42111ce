"""Wood laid in a regular order: laminate, herringbone and blocks. Colours: wood, gap."""

from __future__ import annotations

from processing.ground.arrays import Floats

import math
from dataclasses import dataclass, replace

import cv2
import numpy as np
import numpy.typing as npt

from mocks.light import Reals
from mocks.rooms.model import Texture
from mocks.rooms.textures_base import Tile, centres, generator, line_cover
from mocks.rooms.textures_wood import Timber, board_tint, gapped

_PIXELS = 1024


@dataclass(frozen=True)
class Layout:
    """Which block each pixel lies on (any whole number), and where on it: along and across, in metres."""

    number: npt.NDArray[np.int32]
    along_m: Floats
    across_m: Floats
    length_m: float
    width_m: float

    @classmethod
    def of(
        cls, number: npt.NDArray[np.signedinteger], along_m: Reals, across_m: Reals, size_m: tuple[float, float]
    ) -> Layout:
        """Return a layout of blocks of length and width ``size_m``."""
        return cls(number.astype(np.int32), along_m.astype(np.float32), across_m.astype(np.float32), *size_m)

    def gaps(self, gap_m: float, pixel_m: float) -> Floats:
        """Return how much of each pixel is gap between blocks."""
        ends = np.minimum(self.along_m, np.float32(self.length_m) - self.along_m)
        sides = np.minimum(self.across_m, np.float32(self.width_m) - self.across_m)
        return line_cover(np.minimum(ends, sides), gap_m, pixel_m)

    def shown(self, bank: Floats, pixel_m: float) -> Floats:
        """Return the tones of blocks out of ``bank`` (blocks, rows, columns), each with its grain along it."""
        blocks, rows, columns = bank.shape
        sheet = np.ascontiguousarray(bank.transpose(1, 0, 2).reshape(rows, blocks * columns))
        scale = np.float32(1 / pixel_m)
        right = np.clip(self.across_m * scale - np.float32(0.5), 0, columns - 1)
        right += ((self.number % blocks) * columns).astype(np.float32)
        return np.asarray(cv2.remap(sheet, right, self.along_m * scale - np.float32(0.5), cv2.INTER_LINEAR))


def _bank(
    rng: np.random.Generator, texture: Texture, pixel_m: float, blocks: int, size_m: tuple[float, float]
) -> Floats:
    """Return the tones of ``blocks`` blocks of length and width ``size_m``."""
    timber = Timber.of(rng, texture, pixel_m)
    rows, columns = (math.ceil(s / pixel_m) for s in size_m)
    return np.stack([timber.board(rng, rows, columns) * board_tint(rng, texture) for _ in range(blocks)])


def _shuffled(rng: np.random.Generator, number: npt.NDArray[np.int32], blocks: int) -> npt.NDArray[np.int32]:
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
    v = (centres(_PIXELS, size_m[1])[:, None] + (column % 3 * np.float32(length_m / 3))[None, :]) % np.float32(
        size_m[1]
    )
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
                picture[low:high, left:right] = timber.board(rng, high - low, right - left) * board_tint(
                    rng, texture, usual
                )
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

"""Pictures that are looked up by coordinate, at the coarseness a pixel needs, and the floor made of planks."""

from __future__ import annotations

import math
from dataclasses import dataclass

import cv2
import numpy as np

from mocks.worlds.light import Reals
from processing.ground.arrays import Floats

# cv2.remap refuses more than 32767 rows or columns.
_REMAP_WIDTH = 8192


@dataclass(frozen=True)
class MipTexture:
    """A picture and its halvings; every level carries a border of one pixel, so that lookups never leave it."""

    levels: tuple[Floats, ...]

    @classmethod
    def equirectangular(cls, pixels: Floats) -> MipTexture:
        """Return the texture of a panorama: the columns wrap, and over a pole lies the other half."""
        return cls(tuple(_sphere_border(level) for level in _halvings(pixels)))

    @classmethod
    def tiled(cls, pixels: Floats) -> MipTexture:
        """Return the texture of a tile that repeats in both directions."""
        return cls(tuple(np.pad(level, ((1, 1), (1, 1), (0, 0)), mode="wrap") for level in _halvings(pixels)))

    @property
    def shape(self) -> tuple[int, int]:
        """Height and width of the finest level."""
        return self.levels[0].shape[0] - 2, self.levels[0].shape[1] - 2

    def level_for(self, footprint_px: float) -> int:
        """Return the level whose pixels are just not coarser than ``footprint_px`` finest pixels."""
        level = math.floor(math.log2(max(footprint_px, 1.0)))
        return min(level, len(self.levels) - 1)

    def sample(self, column: Reals, row: Reals, level: int = 0) -> Floats:
        """Return bilinear values at finest-level coordinates (0 is the centre of the first pixel).

        Coordinates must lie within half a pixel of the picture; tiles are wrapped by the caller.
        """
        image = self.levels[level]
        scale = 0.5**level
        x = np.asarray((column + 0.5) * scale + 0.5, dtype=np.float32)
        y = np.asarray((row + 0.5) * scale + 0.5, dtype=np.float32)
        if x.ndim == 2 and max(x.shape) < 32767:
            return np.asarray(_remap(image, x, y))
        flat_x, flat_y = _blocks(x), _blocks(y)
        return np.asarray(_remap(image, flat_x, flat_y).reshape(-1, 3)[: x.size].reshape(*x.shape, 3))


def _remap(image: Floats, x: Floats, y: Floats) -> Floats:
    out = cv2.remap(image, x, y, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)
    return np.asarray(out, dtype=np.float32)


def _blocks(values: Floats) -> Floats:
    rows = max(1, -(-values.size // _REMAP_WIDTH))
    block = np.zeros(rows * _REMAP_WIDTH, dtype=np.float32)
    block[: values.size] = values.ravel()
    return block.reshape(rows, _REMAP_WIDTH)


def _halvings(pixels: Floats) -> list[Floats]:
    levels = [pixels]
    while min(levels[-1].shape[:2]) >= 8 and all(n % 2 == 0 for n in levels[-1].shape[:2]):
        last = levels[-1]
        levels.append(0.25 * (last[::2, ::2] + last[1::2, ::2] + last[::2, 1::2] + last[1::2, 1::2]))
    return levels


def _sphere_border(pixels: Floats) -> Floats:
    half = pixels.shape[1] // 2
    tall = np.concatenate([np.roll(pixels[:1], half, 1), pixels, np.roll(pixels[-1:], half, 1)])
    return np.ascontiguousarray(np.concatenate([tall[:, -1:], tall, tall[:, :1]], axis=1))


@dataclass(frozen=True)
class PlankFloor:
    """Boards of oak along y, each of its own tint, with grain and dark gaps; repeats every ``tile_m``."""

    seed: int = 0
    tile_m: float = 4.8
    tile_px: int = 1536
    board_width_m: float = 0.12
    board_length_m: float = 1.2
    gap_m: float = 0.004

    def tile(self) -> Floats:
        """Return the albedo tile (tile_px, tile_px, 3); rows run along y, columns along x."""
        rng = np.random.default_rng(self.seed)
        centre_m = (np.arange(self.tile_px, dtype=np.float32) + 0.5) * (self.tile_m / self.tile_px)
        column = (centre_m / self.board_width_m).astype(int)
        shift_m = rng.uniform(0, self.board_length_m, column.max() + 1).astype(np.float32)[column]
        along_m = (centre_m[:, None] + shift_m[None, :]) % self.tile_m
        board = (along_m / self.board_length_m).astype(int)
        boards = int(self.tile_m / self.board_length_m + 0.5)
        tint = rng.normal(1.0, 0.09, (column.max() + 1, boards)).astype(np.float32)[column[None, :], board % boards]
        warmth = rng.normal(0.0, 0.03, (column.max() + 1, boards)).astype(np.float32)[column[None, :], board % boards]
        value = tint * (1 + self._grain(rng)) * (1 - 0.65 * self._gaps(centre_m, along_m))
        albedo = np.empty((*value.shape, 3), dtype=np.float32)
        albedo[..., 0] = 0.46 * value * (1 + warmth)
        albedo[..., 1] = 0.33 * value
        albedo[..., 2] = 0.22 * value * (1 - warmth)
        return np.clip(albedo, 0.02, 0.9, out=albedo)

    def _grain(self, rng: np.random.Generator) -> Floats:
        """Return streaks along the boards that join where the tile repeats."""
        fine = rng.normal(0, 0.06, (24, self.tile_px))
        broad = rng.normal(0, 0.05, (12, self.tile_px // 6))
        return self._stretched(fine) + self._stretched(broad)

    def _stretched(self, noise: Reals) -> Floats:
        wrapped = np.pad(noise, ((2, 2), (0, 0)), mode="wrap").astype(np.float32)
        step_px = self.tile_px // len(noise)
        tall = cv2.resize(wrapped, (self.tile_px, step_px * len(wrapped)))
        return np.asarray(tall[2 * step_px : 2 * step_px + self.tile_px], dtype=np.float32)

    def _gaps(self, centre_m: Reals, along_m: Reals) -> Floats:
        """Return how much of each pixel is gap, so that a gap thinner than a pixel keeps its weight."""
        pixel_m = self.tile_m / self.tile_px
        side = np.minimum(centre_m % self.board_width_m, -centre_m % self.board_width_m)
        end = np.minimum(along_m % self.board_length_m, -along_m % self.board_length_m)
        cover_side = np.clip((self.gap_m / 2 - side) / pixel_m + 0.5, 0, 1)[None, :]
        cover_end = np.clip((self.gap_m / 2 - end) / pixel_m + 0.5, 0, 1)
        return np.asarray(np.maximum(cover_side, cover_end), dtype=np.float32)

"""Wood: boards cut from a log, laid as planks, laminate, herringbone and blocks, and the straight grain of furniture.

A board shows where it was cut: the growth rings are cylinders about the pith, so a board that passes near the pith
shows nested arches along its middle and one far from it shows straight lines. Colours: wood, gap.
"""

from __future__ import annotations

import itertools
from dataclasses import dataclass

import cv2
import numpy as np

from mocks.light import Floats
from mocks.rooms.model import Texture
from mocks.rooms.textures_base import Tile, centres, generator, line_cover, mixed, noise, to_nearest, toned

_TABLE = 4096
_PER_RING = 16
_WARMTH = 0.3


@dataclass(frozen=True)
class Timber:
    """What all boards of a floor have in common: rings by number, fibres, and how strong the figure is."""

    rings: Floats
    fibres: Floats
    pixel_m: float
    ring_m: float
    figure: float
    knots: float

    @classmethod
    def of(cls, rng: np.random.Generator, texture: Texture, pixel_m: float) -> Timber:
        """Return the timber of a texture."""
        dark = rng.gamma(2.0, 0.5, _TABLE // _PER_RING).astype(np.float32)
        rise = (np.arange(_PER_RING, dtype=np.float32) / _PER_RING) ** 2
        rings = (dark[:, None] * rise[None, :]).ravel()
        rings = np.convolve(np.pad(rings, 2, mode="wrap"), np.ones(5) / 5, mode="valid").astype(np.float32)
        fibres = 0.6 * noise(rng, (1024, 1024), (16, 1024)) + 0.5 * noise(rng, (1024, 1024), (64, 512))
        return cls(
            rings=(rings - rings.mean()) / rings.std(),
            fibres=fibres,
            pixel_m=pixel_m,
            ring_m=texture.option("ring_m", max(0.006, 2.2 * pixel_m)),
            figure=texture.option("figure", 0.10),
            knots=texture.option("knots", 0.08),
        )

    def board(self, rng: np.random.Generator, rows: int, columns: int) -> Floats:
        """Return the tone (about 1) of a new board, its grain along the rows."""
        across = (np.arange(columns, dtype=np.float32) - np.float32(columns / 2)) * np.float32(self.pixel_m)
        along = np.arange(rows, dtype=np.float32) * np.float32(self.pixel_m)
        sway = _wander(rng, rows, self.pixel_m)
        x = across[None, :] - np.float32(rng.normal(0, 0.05)) + np.float32(0.008) * sway[:, None]
        slope = rng.choice([-1, 1]) * rng.uniform(0.01, 0.05)
        height = rng.uniform(0.01, 0.09) + slope * along + 0.006 * _wander(rng, rows, self.pixel_m)
        radius = np.sqrt(x * x + (height * height)[:, None].astype(np.float32))
        tone = np.zeros((rows, columns), dtype=np.float32)
        if rng.random() < self.knots * rows * self.pixel_m:
            self._add_knot(rng, radius, tone)
        ring = (radius * np.float32(_PER_RING / self.ring_m)).astype(np.int32) + rng.integers(_TABLE)
        tone -= np.float32(self.figure) * self.rings[ring & (_TABLE - 1)]
        r0, c0 = rng.integers(1024, size=2)
        at = np.ix_((np.arange(rows) + r0) % 1024, (np.arange(columns) + c0) % 1024)
        tone += np.float32(0.5 * self.figure) * self.fibres[at]
        return np.clip(1 + tone, 0.35, 1.5, out=tone)

    def _add_knot(self, rng: np.random.Generator, radius: Floats, tone: Floats) -> None:
        rows, columns = radius.shape
        row, column = rng.uniform(0.15, 0.85) * rows, rng.uniform(0.2, 0.8) * columns
        size_px = rng.uniform(0.006, 0.014) / self.pixel_m
        down = ((np.arange(rows, dtype=np.float32) - np.float32(row)) / np.float32(1.4 * size_px))[:, None]
        right = ((np.arange(columns, dtype=np.float32) - np.float32(column)) / np.float32(size_px))[None, :]
        square = down * down + right * right
        radius += np.float32(0.03) * np.exp(-square / 8)
        tone -= np.float32(0.45) * np.exp(-square * square)


def _wander(rng: np.random.Generator, length: int, pixel_m: float) -> Floats:
    """Return a smooth random walk along a board, a turn every 0.3 m or so."""
    knots = rng.standard_normal(max(4, int(length * pixel_m / 0.3) + 4), dtype=np.float32)
    return np.asarray(cv2.resize(knots[None, :], (length, 1), interpolation=cv2.INTER_CUBIC)[0])


def planks(texture: Texture) -> Tile:
    """Return boards along v with random joints. Options: board_m, length_m, gap_m, variation, figure, knots."""
    rng, pixels, height_m = generator(texture.seed), 2048, 4.8
    board_m = texture.option("board_m", 0.14)
    boards = max(8, round(4.8 / board_m))
    pixel_m = height_m / pixels
    width_m = boards * board_m
    timber = Timber.of(rng, texture, pixel_m)
    tone, ends = np.ones((pixels, pixels), dtype=np.float32), np.zeros((pixels, pixels), dtype=np.float32)
    gap_m = texture.option("gap_m", 0.003)
    edges = np.round(np.arange(boards + 1) * (pixels / boards)).astype(int)
    for left, right in itertools.pairwise(edges):
        column, joints_m = _run(rng, timber, texture, right - left)
        tone[:, left:right] = column
        for joint_m in joints_m:
            distance = to_nearest(centres(pixels, height_m) - np.float32(joint_m), height_m)
            ends[:, left:right] += line_cover(distance, gap_m, pixel_m)[:, None]
    sides = line_cover(to_nearest(centres(pixels, width_m), board_m), gap_m, width_m / pixels)
    return _gapped(texture, tone, np.maximum(ends, sides[None, :]), (width_m, height_m))


def _run(rng: np.random.Generator, timber: Timber, texture: Texture, columns: int) -> tuple[Floats, list[float]]:
    """Return one row of boards end to end that wraps, and where its joints are in metres."""
    pixels = 2048
    length_m = texture.option("length_m", 1.4)
    count = max(2, round(pixels * timber.pixel_m / length_m))
    shares = rng.uniform(0.6, 1.4, count)
    starts = np.round(np.cumsum(shares) / shares.sum() * pixels).astype(int)
    run = np.empty((pixels, columns), dtype=np.float32)
    for low, high in zip([0, *starts[:-1]], starts, strict=True):
        run[low:high] = timber.board(rng, high - low, columns) * _tint(rng, texture)
    turn = int(rng.integers(pixels))
    return np.roll(run, turn, axis=0), [float((s + turn) % pixels) * timber.pixel_m for s in starts]


def _tint(rng: np.random.Generator, texture: Texture) -> np.float32:
    return np.float32(np.clip(rng.normal(1.0, texture.option("variation", 0.09)), 0.6, 1.4))


def _gapped(texture: Texture, tone: Floats, gaps: Floats, size_m: tuple[float, float]) -> Tile:
    wood = toned(tone, texture.colours[0], _WARMTH)
    return Tile(mixed(wood, texture.colours[1], np.minimum(gaps, 1)), size_m)

"""Seeded fractal noise whose detail stops at the pixel."""

from functools import lru_cache

import cv2
import numpy as np

from processing.ground.arrays import Floats, Reals

CELLS = 64  # lattice cells after which an octave repeats; a power of two


def fractal(seed: int, x: Floats, y: Floats, footprint: Floats | float = 0.0, octaves: int = 6) -> Floats:
    """Return noise, about -1..1, in the shape of x and y; features of size 1 and finer, each octave half as strong.

    Octaves finer than ``footprint`` (the size of a pixel in the units of x and y) fade out.
    """
    total = np.zeros(np.broadcast(x, y).shape, dtype=np.float32)
    for k, lattice in enumerate(_lattices(seed, octaves)):
        kept = np.clip(2.0 - 3.0 * np.asarray(footprint, dtype=np.float32) * 2.0**k, 0, 1)
        if not np.any(kept):
            break
        # Each octave is turned against the last, so that lattices do not line up.
        c, s = np.float32(np.cos(1.1 * k)), np.float32(np.sin(1.1 * k))
        scale = np.float32(2.0**k)
        u, v = (c * x - s * y) * scale + np.float32(7.3 * k), (s * x + c * y) * scale
        total += np.float32(0.5**k) * kept * _smooth(lattice, u, v)
    return total


def _smooth(lattice: Floats, x: Floats, y: Floats) -> Floats:
    x0, y0 = np.floor(x), np.floor(y)
    u, v = x - x0, y - y0
    u, v = (t * t * (3 - 2 * t) for t in (u, v))
    i, j = x0.astype(np.int32) & (CELLS - 1), y0.astype(np.int32) & (CELLS - 1)
    i1, row, next_row = (i + 1) & (CELLS - 1), j * CELLS, ((j + 1) & (CELLS - 1)) * CELLS
    flat, rest = lattice.ravel(), 1 - u
    low = flat.take(row + i) * rest + flat.take(row + i1) * u
    high = flat.take(next_row + i) * rest + flat.take(next_row + i1) * u
    return np.asarray(low * (1 - v) + high * v, dtype=np.float32)


@lru_cache(maxsize=32)
def _lattices(seed: int, octaves: int) -> Floats:
    return np.asarray(np.random.default_rng([seed, 7301]).uniform(-1, 1, (octaves, CELLS, CELLS)), dtype=np.float32)


def smoothstep(low: float, high: float, x: Floats) -> Floats:
    """Return 0 below ``low``, 1 above ``high``, smooth between; the shape of ``x``."""
    t = np.clip((x - np.float32(low)) / np.float32(high - low), 0, 1)
    return np.asarray(t * t * (3 - 2 * t), dtype=np.float32)


TILE = 512  # chosen: texels; a power of two
TILE_PERIOD = 16.0  # chosen: cells of the coarsest octave


def rough(x: Reals, y: Reals, footprint: float = 0.0) -> Floats:
    """Return quick noise around 0 (about -1..1) for pictures (H, W): rougher than `fractal`, from one tile.

    ``x``, ``y``: what makes (H, W) together, such as (1, W) and (H, 1). Features are of size 1 and finer; the pattern
    repeats after 16.
    """
    levels = _tiles()
    pixels = footprint * TILE / TILE_PERIOD
    tile = levels[int(np.clip(np.ceil(np.log2(max(pixels, 1.0))), 0, len(levels) - 1))]
    scale = np.float32(tile.shape[0] / TILE_PERIOD)
    places = np.broadcast_arrays(*(np.mod(one * scale, tile.shape[0]).astype(np.float32) for one in (x, y)))
    u, v = (np.ascontiguousarray(one) for one in places)
    found = cv2.remap(tile, u, v, cv2.INTER_LINEAR, borderMode=cv2.BORDER_WRAP)
    return np.asarray(found, dtype=np.float32)


@lru_cache(maxsize=1)
def _tiles() -> tuple[Floats, ...]:
    rng = np.random.default_rng([7306])
    total = np.zeros((TILE, TILE), dtype=np.float32)
    for k in range(6):
        cells = int(TILE_PERIOD) * 2**k
        lattice = np.pad(rng.uniform(-1, 1, (cells, cells)).astype(np.float32), 2, mode="wrap")
        grain = TILE // cells
        fine = cv2.resize(lattice, None, fx=grain, fy=grain, interpolation=cv2.INTER_CUBIC)
        total += np.float32(0.72**k) * fine[2 * grain : -2 * grain, 2 * grain : -2 * grain]
    total /= np.float32(3 * total.std())
    levels = [total]
    while levels[-1].shape[0] > 8:
        half = levels[-1].shape[0] // 2
        levels.append(np.asarray(cv2.resize(levels[-1], (half, half), interpolation=cv2.INTER_AREA), dtype=np.float32))
    return tuple(levels)

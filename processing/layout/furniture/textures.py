"""Procedural surfaces as pictures that repeat without a seam: wood, woven cloth, boucle, leather."""

from __future__ import annotations

from processing.ground.arrays import Bytes, Doubles

from functools import lru_cache

import numpy as np
import numpy.typing as npt
from scipy import fft

from processing.layout.furniture.model import Colour, srgb_of_linear

SIDE = 384
WOOD_M = (0.40, 1.20)
CLOTH_M = (0.16, 0.16)
LEATHER_M = (0.30, 0.30)


def noise(shape: tuple[int, int], wave: tuple[float, float], seed: int) -> Doubles:
    """Return periodic Gaussian noise of unit deviation; `wave` is its grain in pixels down and across."""
    rng = np.random.default_rng(seed)
    fy, fx = np.fft.fftfreq(shape[0])[:, None], np.fft.rfftfreq(shape[1])[None, :]
    keep = np.exp(-2 * np.pi**2 * ((fy * wave[0] / 2.4) ** 2 + (fx * wave[1] / 2.4) ** 2))
    keep[0, 0] = 0.0
    keep = keep.astype(np.float32)
    field = fft.irfft2(fft.rfft2(rng.standard_normal(shape, dtype=np.float32)) * keep, s=shape)
    return np.asarray(field / max(float(field.std()), 1e-12))


def _coloured(tone: Doubles, colour: Colour, tint: Colour = (0.0, 0.0, 0.0)) -> Bytes:
    """Return colour x exp(tone), each channel's tone weighed by 1 + tint; the mean colour stays."""
    channels = []
    for c, t in zip(colour, tint, strict=True):
        layer = np.exp((tone * (1 + t)).astype(np.float32))
        channels.append(c * layer / layer.mean())
    return srgb_of_linear(np.stack(channels, axis=-1))


@lru_cache(maxsize=16)
def wood(colour: Colour, figure: float = 1.0, seed: int = 3) -> Bytes:
    """Return wood of a mean colour, the grain running down the picture; `figure` 0 is nearly plain."""
    tall, wide = 2 * SIDE, SIDE
    x = np.arange(wide)[None, :] / wide
    warp = 0.10 * noise((tall, wide), (420, 130), seed) + 0.014 * noise((tall, wide), (90, 26), seed + 1)
    rings = (x + warp) * 9
    phase = rings - np.floor(rings)
    late = np.exp(-(((phase - 0.82) / 0.16) ** 2)) + 0.35 * phase
    pores = noise((tall, wide), (70, 1.6), seed + 2)
    fibres = noise((tall, wide), (260, 3.0), seed + 3)
    broad = noise((tall, wide), (600, 90), seed + 4)
    tone = -0.20 * late - 0.055 * np.clip(pores, 0.2, None) + 0.035 * fibres + 0.06 * broad
    return _coloured(figure * tone, colour, (-0.12, 0.05, 0.35))


@lru_cache(maxsize=16)
def cloth(colour: Colour, contrast: float = 1.0, seed: int = 5) -> Bytes:
    """Return a plain weave of slightly uneven threads, 2.5 mm apart."""
    threads = 64
    cell = SIDE // threads
    y, x = np.meshgrid(np.arange(SIDE), np.arange(SIDE), indexing="ij")
    over = ((y // cell + x // cell) % 2).astype(np.float64)
    round_x = np.sin(np.pi * ((x % cell) + 0.5) / cell) ** 0.7
    round_y = np.sin(np.pi * ((y % cell) + 0.5) / cell) ** 0.7
    rng = np.random.default_rng(seed)
    warp, weft = rng.normal(size=threads), rng.normal(size=threads)
    slub_x = noise((SIDE, SIDE), (70, 5), seed)
    slub_y = noise((SIDE, SIDE), (5, 70), seed + 1)
    across = weft[y // cell] * 0.4 + slub_y * 0.4
    along = warp[x // cell] * 0.4 + slub_x * 0.4
    tone = np.where(over > 0, 0.10 * along + 0.32 * round_x, 0.10 * across + 0.32 * round_y)
    tone = tone + 0.02 * noise((SIDE, SIDE), (60, 60), seed + 2)
    return _coloured(0.8 * contrast * tone, colour)


@lru_cache(maxsize=16)
def boucle(colour: Colour, seed: int = 11) -> Bytes:
    """Return looped yarn: soft knots of several sizes."""
    knots = noise((SIDE, SIDE), (15, 15), seed) + 0.6 * noise((SIDE, SIDE), (7, 7), seed + 1)
    tone = 0.15 * np.tanh(knots) + 0.015 * noise((SIDE, SIDE), (110, 110), seed + 2)
    return _coloured(tone, colour)


@lru_cache(maxsize=8)
def leather(colour: Colour, seed: int = 17) -> Bytes:
    """Return smooth leather: faint pores, cloudy dye."""
    pores = np.abs(noise((SIDE, SIDE), (7, 7), seed))
    tone = -0.05 * np.exp(-4 * pores) + 0.07 * noise((SIDE, SIDE), (150, 150), seed + 1)
    return _coloured(tone, colour, (-0.1, 0.05, 0.1))

"""What every generated pattern is made with: noise that wraps, soft edges, and colour.

Patterns are arrays (H, W) over a tile that repeats in both directions. Row 0 is v = 0 and rows run along v;
columns run along u. Pixel centres lie at half pixels.
"""

from dataclasses import dataclass

import cv2
import numpy as np

from mocks.worlds.light import Vector
from processing.ground.arrays import Floats

LOWEST_ALBEDO, HIGHEST_ALBEDO = 0.02, 0.92


@dataclass(frozen=True)
class Tile:
    """One repeat of a pattern: linear albedo (H, W, 3), row 0 at v = 0, and its width (u) and height (v)."""

    albedo: Floats
    size_m: tuple[float, float]


def generator(seed: int, number: int = 0) -> np.random.Generator:
    """Return the generator of one pattern."""
    return np.random.default_rng([seed, 7001, number])


def noise(rng: np.random.Generator, pixels: tuple[int, int], cells: tuple[int, int]) -> Floats:
    """Return smooth noise of variance about 1 that wraps: ``cells`` (H, W) knots, both divide ``pixels``."""
    knots = rng.standard_normal(cells, dtype=np.float32)
    step = (pixels[0] // cells[0], pixels[1] // cells[1])
    wide = np.pad(knots, 2, mode="wrap")
    tall = cv2.resize(wide, (step[1] * wide.shape[1], step[0] * wide.shape[0]), interpolation=cv2.INTER_CUBIC)
    inner = tall[2 * step[0] : 2 * step[0] + pixels[0], 2 * step[1] : 2 * step[1] + pixels[1]]
    return np.asarray(inner / max(float(inner.std()), 1e-6), dtype=np.float32)


def clouds(rng: np.random.Generator, pixels: tuple[int, int], coarsest: int, octaves: int, fade: float = 0.5) -> Floats:
    """Return noise (H, W) of several octaves, variance 1, ``coarsest`` knots a side to ``2**(octaves-1)`` as many."""
    total = np.zeros(pixels, dtype=np.float32)
    for octave in range(octaves):
        cells = coarsest << octave
        total += np.float32(fade**octave) * noise(rng, pixels, (cells, cells))
    return np.asarray(total / total.std(), dtype=np.float32)


def blurred(picture: Floats, sigma_px: float) -> Floats:
    """Return a picture (H, W) or (H, W, 3) blurred by a Gaussian across its wrapping edges."""
    border = int(3 * sigma_px) + 1
    wide = cv2.copyMakeBorder(picture, border, border, border, border, cv2.BORDER_WRAP)
    return np.asarray(cv2.GaussianBlur(wide, (0, 0), sigma_px)[border:-border, border:-border], dtype=np.float32)


def repeated(cell: Floats, repeats: int, pixels: int, wobble: Floats | None = None) -> Floats:
    """Return a square tile of ``repeats`` cells a side; ``wobble`` (S, S) moves it sideways, in cells."""
    side = len(cell)
    wide = np.pad(cell, ((1, 1), (1, 1), (0, 0)), mode="wrap")
    place = centres(pixels, repeats)
    u = np.broadcast_to(place[None, :], (pixels, pixels)) if wobble is None else place[None, :] + wobble
    v = np.broadcast_to(place[:, None], (pixels, pixels))
    right, down = (np.asarray(p % 1 * np.float32(side) + np.float32(0.5), dtype=np.float32) for p in (u, v))
    return np.asarray(cv2.remap(wide, right, down, cv2.INTER_LINEAR), dtype=np.float32)


def centres(pixels: int, length: float = 1.0) -> Floats:
    """Return the pixel centres (N,) of a side that is ``length`` long."""
    return (np.arange(pixels, dtype=np.float32) + np.float32(0.5)) * np.float32(length / pixels)


def line_cover(distance: Floats, width: float, pixel: float) -> Floats:
    """Return how much of each pixel a line covers, so that one thinner than a pixel keeps its weight.

    ``distance`` (any shape) is from the line's middle, all in one unit.
    """
    low = np.maximum(np.abs(distance) - pixel / 2, -width / 2)
    high = np.minimum(np.abs(distance) + pixel / 2, width / 2)
    return np.asarray(np.clip((high - low) / pixel, 0, 1), dtype=np.float32)


def offset(position: Floats, period: float) -> Floats:
    """Return the signed distance to the nearest multiple of ``period``; any shape."""
    return np.asarray((position + period / 2) % period - period / 2, dtype=np.float32)


def toned(value: Floats, colour: Vector, warmth: float = 0.0) -> Floats:
    """Return ``value`` (H, W) times a colour; with ``warmth`` darker places are also redder, as in wood."""
    shift = np.float32(warmth) * (value - 1)
    out = np.empty((*value.shape, 3), dtype=np.float32)
    out[..., 0] = value * (np.float32(colour[0]) * (1 - shift))
    out[..., 1] = value * np.float32(colour[1])
    out[..., 2] = value * (np.float32(colour[2]) * (1 + shift))
    return out


def mixed(under: Floats | Vector, over: Floats | Vector, cover: Floats) -> Floats:
    """Return ``over`` laid on ``under`` where ``cover`` (H, W) is 1."""
    first, second = (np.asarray(c, dtype=np.float32) for c in (under, over))
    return np.asarray(first + (second - first) * cover[..., None], dtype=np.float32)


def with_mean(albedo: Floats, mean: Vector) -> Floats:
    """Return the pattern (H, W, 3) scaled so that its mean is ``mean``, within the limits of albedo."""
    wanted = np.array(mean, dtype=np.float32)
    for _ in range(6):
        ratio = wanted / np.array(cv2.mean(albedo)[:3], dtype=np.float32)
        if np.all(np.abs(ratio - 1) < 1e-4):
            break
        albedo = np.clip(albedo * ratio, LOWEST_ALBEDO, HIGHEST_ALBEDO)
    return albedo

"""Materials of a plain colour or of a pattern, and the colours of things that rooms are full of."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from mocks.light import Vector
from mocks.rooms.model import Material, Texture
from mocks.rooms.textures import mean_albedo

WOODS: dict[str, Vector] = {
    "oak": (0.38, 0.245, 0.135),
    "pale oak": (0.50, 0.37, 0.245),
    "smoked oak": (0.19, 0.12, 0.072),
    "grey oak": (0.33, 0.275, 0.215),
    "walnut": (0.135, 0.078, 0.046),
    "beech": (0.47, 0.305, 0.185),
    "pine": (0.52, 0.345, 0.175),
    "ash": (0.53, 0.42, 0.30),
    "teak": (0.27, 0.145, 0.068),
    "cherry": (0.29, 0.135, 0.068),
    "black wood": (0.045, 0.040, 0.036),
    "white wood": (0.70, 0.68, 0.63),
}
"""Linear albedo of finished woods."""

_BOOK_COLOURS = (
    "#f2efe6", "#e3dccb", "#2b2b2f", "#1d3a5f", "#7a1f22", "#2f5d50", "#c9a227", "#d9d4c7", "#b8432f", "#3f6e8f",
    "#6b4a35", "#efe9d8", "#8a8f94", "#d98c5f", "#404a3a", "#f5f5f2",
)  # fmt: skip


def linear(colour: str | Vector) -> Vector:
    """Return linear albedo of ``#rrggbb`` (sRGB, IEC 61966-2-1); a vector is linear already."""
    if not isinstance(colour, str):
        return colour
    red, green, blue = (_decoded(int(colour[i : i + 2], 16) / 255) for i in (1, 3, 5))
    return (red, green, blue)


def _decoded(value: float) -> float:
    straight = value / 12.92 if value <= 0.04045 else ((value + 0.055) / 1.055) ** 2.4
    return float(min(max(straight, 0.02), 0.9))


def scaled(colour: str | Vector, factor: float) -> Vector:
    """Return a colour made lighter or darker, within 0.02 to 0.9."""
    red, green, blue = (min(max(c * factor, 0.02), 0.9) for c in linear(colour))
    return (red, green, blue)


def of_luminance(colour: str | Vector, reflectance: float) -> Vector:
    """Return the colour's hue at a given luminous reflectance."""
    red, green, blue = linear(colour)
    return scaled((red, green, blue), reflectance / (0.2127 * red + 0.7151 * green + 0.0722 * blue))


def plain(name: str, colour: str | Vector, roughness: float | None = None) -> Material:
    """Return a material of one colour, ``#rrggbb`` in sRGB or linear albedo."""
    return Material(name, linear(colour), roughness=roughness)


def textured(name: str, texture: Texture, roughness: float | None = None) -> Material:
    """Return a material with a pattern; its colour is the pattern's mean."""
    return Material(name, mean_albedo(texture), texture, roughness)


def turned(material: Material) -> Material:
    """Return the material with its pattern turned a quarter: grain that ran along v runs along u, and back."""
    texture = material.texture
    if texture is None:
        return material
    options = {**dict(texture.options), "turned": 1.0 - texture.option("turned", 0.0)}
    return replace(material, texture=replace(texture, options=tuple(options.items())))


def a_seed(rng: np.random.Generator) -> int:
    """Return a seed for a pattern."""
    return int(rng.integers(1 << 31))


def pick(rng: np.random.Generator, choices: tuple[str, ...]) -> str:
    """Return one of several."""
    return choices[int(rng.integers(len(choices)))]


def book_colours(rng: np.random.Generator, count: int) -> list[Material]:
    """Return the covers of some books."""
    return [plain("book", scaled(pick(rng, _BOOK_COLOURS), rng.uniform(0.8, 1.2)), 0.35) for _ in range(count)]

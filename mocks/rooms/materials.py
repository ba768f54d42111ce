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

_PICTURES = (
    ("#f6f4ee", "#e9e2d3", "#b1584a", "#2f4a55", "#d9a441", "#8fa3a0"),
    ("#f6f4ee", "#d9dfe2", "#e7a26a", "#6f8a95", "#3c5560", "#22333a"),
    ("#f2efe8", "#f0dcc0", "#f6efe0", "#c98a6a", "#7a4a4a", "#3a2b35"),
    ("#f7f6f2", "#f2ede2", "#4f6b4a", "#7d9a6a", "#2f4636", "#b9a06a"),
    ("#fafafa", "#ececea", "#2b2b2d", "#8a8a88", "#c9c7c2", "#55565a"),
    ("#f4f2ec", "#22304d", "#d9a441", "#e9e0cc", "#b5533c", "#6f8fa8"),
)
_PICTURE_KINDS = ("picture fields", "picture hills", "picture shapes", "picture leaves")


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


def veneer(rng: np.random.Generator, wood: str, roughness: float | None = 0.35) -> Material:
    """Return furniture of a wood, its grain along u (across fronts and tops); white and black wood is painted."""
    if wood in ("white wood", "black wood"):
        return plain(wood, scaled(WOODS[wood], rng.uniform(0.95, 1.1)), roughness)
    options = (("figure", rng.uniform(0.06, 0.12)), ("arches", rng.uniform(1.2, 2.8)), ("turned", 1.0))
    texture = Texture("veneer", a_seed(rng), (scaled(WOODS[wood], rng.uniform(0.85, 1.15)),), options)
    return textured(wood, texture, roughness)


def cloth(rng: np.random.Generator, name: str, colour: str | Vector, kinds: tuple[str, ...] = ("woven",)) -> Material:
    """Return a cloth of a colour, of one of several kinds of texture; leather has a sheen."""
    kind = pick(rng, kinds)
    if kind == "leather":
        return textured("leather", Texture(kind, a_seed(rng), (linear(colour),)), rng.uniform(0.35, 0.5))
    shades: tuple[Vector, ...] = (linear(colour),)
    if kind == "woven" and rng.random() < 0.4:
        shades = (linear(colour), scaled(colour, rng.uniform(1.2, 1.6)))
    options = (("thread_m", rng.uniform(0.002, 0.004)),) if kind == "woven" else ()
    return textured(name, Texture(kind, a_seed(rng), shades, options))


def rattan(rng: np.random.Generator) -> Material:
    """Return the weave of a basket."""
    return textured("rattan", Texture("rattan", a_seed(rng), (scaled((0.42, 0.26, 0.12), rng.uniform(0.7, 1.2)),)))


def picture_material(rng: np.random.Generator, width_m: float = 0.8, height_m: float = 0.6) -> Material:
    """Return a picture for a wall that just fills ``width_m`` x ``height_m`` of texture coordinates from 0."""
    colours = tuple(linear(c) for c in _PICTURES[int(rng.integers(len(_PICTURES)))])
    margin = 0.015 if rng.random() < 0.4 else rng.uniform(0.06, 0.14)
    options = (("width_m", width_m), ("height_m", height_m), ("margin", margin))
    return textured("picture", Texture(pick(rng, _PICTURE_KINDS), a_seed(rng), colours, options))


def book_colours(rng: np.random.Generator, count: int) -> list[Material]:
    """Return the covers of some books."""
    return [plain("book", scaled(pick(rng, _BOOK_COLOURS), rng.uniform(0.8, 1.2)), 0.35) for _ in range(count)]

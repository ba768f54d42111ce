"""Materials of a plain colour or of a pattern, and the colours of things that rooms are full of."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from mocks.rooms.model import Material, Texture, Use
from mocks.rooms.textures.catalogue import mean_albedo
from mocks.worlds.light import Vector
from processing.ground.colour import LUMINANCE_WEIGHTS, srgb_decoded

# How people furnish: the colours that go together, as sRGB, and woods by name.


@dataclass(frozen=True)
class Style:
    """One taste. Colours are ``#rrggbb``; woods are names of `mocks.rooms.materials.WOODS`."""

    name: str
    walls: tuple[str, ...]
    wall_reflectance: tuple[float, float]
    accents: tuple[str, ...]
    floors: tuple[str, ...]
    woods: tuple[str, ...]
    lacquers: tuple[str, ...]
    fabrics: tuple[str, ...]
    second_fabrics: tuple[str, ...]
    beddings: tuple[str, ...]
    curtains: tuple[str, ...]
    rugs: tuple[str, ...]
    metals: tuple[str, ...] = ("#2a2a2c", "#8d9093", "#b9bbbd")
    frames: tuple[str, ...] = ("#f4f3ef", "#f4f3ef", "#f1efe9")


RENTAL = Style(
    "rental white", walls=("#f5f3ee", "#f2efe8", "#f0f0ee"), wall_reflectance=(0.70, 0.83),
    accents=("#9fb3b8", "#c9b99a", "#8c9aa6", "#b5776a"), floors=("oak", "beech", "pale oak", "grey oak"),
    woods=("beech", "pine", "white wood", "oak", "black wood"), lacquers=("#f2f1ee", "#eceae4", "#3a3b3d"),
    fabrics=("#6d7075", "#a39a8c", "#3f4a5a", "#85796b"), second_fabrics=("#c2a36b", "#8fa3a0", "#b1584a", "#d8d2c4"),
    beddings=("#eeece6", "#c9d2da", "#b9b3a8", "#8497a8"), curtains=("#ece8de", "#cfc6b6", "#aab4ba"),
    rugs=("#8a857c", "#b7ab97", "#5f6d78"),
)  # fmt: skip
SCANDINAVIAN = Style(
    "scandinavian", walls=("#f6f5f1", "#eef0ee", "#e9e7e0"), wall_reflectance=(0.68, 0.85),
    accents=("#a9b7ad", "#d3c0a9", "#c7a79b", "#7f939b"), floors=("pale oak", "ash", "pale oak", "pine", "white wood"),
    woods=("ash", "pale oak", "beech"), lacquers=("#f5f4f0", "#e4e2db", "#9fb0a4"),
    fabrics=("#b4b1aa", "#8f959a", "#d8d2c6", "#5c6870"), second_fabrics=("#d9b65f", "#a8b8ae", "#d9a793", "#e9e4da"),
    beddings=("#f3f1ec", "#dcd7cd", "#b9c1bd", "#d8bfb0"), curtains=("#f3f0e8", "#dcd6ca", "#c5c9c4"),
    rugs=("#d9d3c5", "#b9b4aa", "#e4ddcd"), metals=("#1f1f21", "#bfc1c2", "#c0a062"),
)  # fmt: skip
MID_CENTURY = Style(
    "mid-century", walls=("#f2ebdc", "#ece3d0", "#f4f0e6"), wall_reflectance=(0.60, 0.78),
    accents=("#3f6361", "#c5793b", "#5d6b45", "#a8452f", "#d1a03d"), floors=("oak", "teak", "walnut", "cherry"),
    woods=("walnut", "teak", "teak", "oak"), lacquers=("#f0e9da", "#d9a441", "#44686a"),
    fabrics=("#b9792f", "#5f6e4a", "#35585b", "#8c4a32", "#a89f8d"),
    second_fabrics=("#d29b3a", "#96402c", "#e2d6bd", "#4d7376"), beddings=("#ede6d6", "#c98f4a", "#7f8b6a", "#35585b"),
    curtains=("#e8dcc2", "#b9823f", "#72805c"), rugs=("#a3482f", "#b88b4a", "#5d5a4a"),
    metals=("#b08d4f", "#2a2826", "#8a8a88"),
)  # fmt: skip
DARK = Style(
    "dark and moody", walls=("#a7a9a8", "#b9b2a6", "#94a09f"), wall_reflectance=(0.30, 0.55),
    accents=("#2e3d42", "#3a4a3d", "#4a3440", "#2b3450", "#3b3733"),
    floors=("walnut", "smoked oak", "smoked oak", "teak"), woods=("walnut", "black wood", "smoked oak"),
    lacquers=("#2b2d30", "#3d4a46", "#1f2430"), fabrics=("#2f4a45", "#5a2e33", "#33405c", "#6d5843", "#3a3a3c"),
    second_fabrics=("#b48a44", "#7c3b35", "#8d8f8a", "#c7b79a"), beddings=("#4b5159", "#8d8577", "#d2cdc3", "#3f4c48"),
    curtains=("#3d4449", "#5b4a45", "#7c7568"), rugs=("#5b2f2c", "#3f444c", "#7a6a54"),
    metals=("#b08d4f", "#1c1c1d", "#3a3a3a"), frames=("#f0eee8", "#3a3b3c", "#2b2c2d"),
)  # fmt: skip
FARMHOUSE = Style(
    "farmhouse", walls=("#f3eee2", "#eae4d4", "#e3e6dd"), wall_reflectance=(0.62, 0.80),
    accents=("#8ea08c", "#a9bcc4", "#c9a98a", "#7c8a7a"), floors=("pine", "oak", "oak", "cherry"),
    woods=("pine", "oak", "cherry", "white wood"), lacquers=("#efe9da", "#a7b5a3", "#8fa6b0"),
    fabrics=("#c8b99d", "#8b9a84", "#9a6b53", "#d9cfbd"), second_fabrics=("#a34f43", "#6f8795", "#e5dcc8", "#8e9b73"),
    beddings=("#f0eadd", "#a9b8c2", "#c9a79a", "#b7bfa5"), curtains=("#efe7d6", "#c9b795", "#b9c3b3"),
    rugs=("#96604a", "#c4b08c", "#6f7f80"), metals=("#2b2a29", "#7d7468", "#9a9a98"),
)  # fmt: skip
OFFICE = Style(
    "office grey", walls=("#f0f1f1", "#e8eaeb", "#f4f3f0"), wall_reflectance=(0.65, 0.82),
    accents=("#4f6f8a", "#6d7478", "#5f8d7b", "#c7ccd0"), floors=("grey oak", "beech", "pale oak"),
    woods=("beech", "grey oak", "white wood", "walnut"), lacquers=("#e9eaea", "#9fa3a6", "#46494c"),
    fabrics=("#3b3e42", "#4f6078", "#77797b", "#2f5a5c"), second_fabrics=("#2f3236", "#d07b34", "#5f8d9c", "#8c9a52"),
    beddings=("#e6e8ea", "#9aa5ae"), curtains=("#d9dcdd", "#b2b7ba", "#e9e7e1"),
    rugs=("#5a5f64", "#8d9196", "#3f4f63"), metals=("#1f2022", "#9b9ea1", "#c9cbcc"),
)  # fmt: skip
CHILDREN = Style(
    "colourful children's", walls=("#f6f2e8", "#e6eef2", "#f3e6e3", "#eaf0e0"), wall_reflectance=(0.62, 0.80),
    accents=("#7fb3c8", "#f0c24b", "#e79a8b", "#8fbf8a", "#b39ac9"), floors=("pale oak", "beech", "pine"),
    woods=("beech", "pine", "white wood"), lacquers=("#f5f4f0", "#7fb3c8", "#f0c24b", "#e7857a"),
    fabrics=("#5f9fc0", "#e7b24a", "#d9776b", "#8fb58a"), second_fabrics=("#f0c24b", "#e79a8b", "#6fa8c9", "#9a83bf"),
    beddings=("#a9d0e0", "#f3dd9a", "#f0c1b8", "#f4f2ea"), curtains=("#f3ecd8", "#b9dbe6", "#f2cfc6"),
    rugs=("#6fa8c9", "#e6c15a", "#c9d8c0"),
)  # fmt: skip

_STYLES = (RENTAL, SCANDINAVIAN, MID_CENTURY, DARK, FARMHOUSE, OFFICE, CHILDREN)
_SHARES = {
    Use.BEDROOM: (0.22, 0.22, 0.13, 0.10, 0.15, 0.02, 0.16),
    Use.LIVING: (0.22, 0.24, 0.22, 0.14, 0.16, 0.02, 0.00),
    Use.DINING: (0.20, 0.24, 0.22, 0.12, 0.20, 0.02, 0.00),
    Use.OFFICE: (0.18, 0.16, 0.12, 0.08, 0.04, 0.42, 0.00),
    Use.EMPTY: (0.45, 0.20, 0.10, 0.05, 0.10, 0.10, 0.00),
}


def draw_style(rng: np.random.Generator, use: Use) -> Style:
    """Return a taste that is likely in a room for ``use``."""
    return _STYLES[int(rng.choice(len(_STYLES), p=_SHARES[use]))]


WOODS: dict[str, Vector] = {
    "oak": (0.38, 0.245, 0.135), "pale oak": (0.50, 0.37, 0.245), "smoked oak": (0.19, 0.12, 0.072),
    "grey oak": (0.33, 0.275, 0.215), "walnut": (0.135, 0.078, 0.046), "beech": (0.47, 0.305, 0.185),
    "pine": (0.52, 0.345, 0.175), "ash": (0.53, 0.42, 0.30), "teak": (0.27, 0.145, 0.068),
    "cherry": (0.29, 0.135, 0.068), "black wood": (0.045, 0.040, 0.036), "white wood": (0.70, 0.68, 0.63),
}  # fmt: skip
"""Linear albedo of finished woods."""


def linear(colour: str | Vector) -> Vector:
    """Return linear albedo of ``#rrggbb`` (sRGB, IEC 61966-2-1); a vector is linear already."""
    if not isinstance(colour, str):
        return colour
    red, green, blue = (_decoded(int(colour[i : i + 2], 16) / 255) for i in (1, 3, 5))
    return (red, green, blue)


def _decoded(value: float) -> float:
    return float(np.clip(srgb_decoded(np.asarray(value)), 0.02, 0.9))


def scaled(colour: str | Vector, factor: float) -> Vector:
    """Return a colour made lighter or darker, within 0.02 to 0.9."""
    red, green, blue = (min(max(c * factor, 0.02), 0.9) for c in linear(colour))
    return (red, green, blue)


def of_luminance(colour: str | Vector, reflectance: float) -> Vector:
    """Return the colour's hue at a given luminous reflectance."""
    red, green, blue = linear(colour)
    return scaled((red, green, blue), reflectance / float(np.dot(LUMINANCE_WEIGHTS, (red, green, blue))))


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

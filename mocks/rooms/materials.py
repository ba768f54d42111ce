"""Materials of a plain colour or of a pattern, and the colours of things that rooms are full of."""

from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from mocks.rooms.model import Material, Texture, Use
from mocks.rooms.textures.catalogue import mean_albedo
from mocks.worlds.light import Vector
from processing.ground.colour import LUMINANCE_WEIGHTS, srgb_decoded
from processing.ground.tables import table_of

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


def _style(row: dict[str, Any]) -> Style:
    fields: dict[str, Any] = {name: tuple(value) if isinstance(value, list) else value for name, value in row.items()}
    return Style(**fields)


_TABLES = table_of(__package__, "styles")
STYLES = tuple(map(_style, _TABLES["style"]))
_SHARES = {
    Use.BEDROOM: (0.22, 0.22, 0.13, 0.10, 0.15, 0.02, 0.16),
    Use.LIVING: (0.22, 0.24, 0.22, 0.14, 0.16, 0.02, 0.00),
    Use.DINING: (0.20, 0.24, 0.22, 0.12, 0.20, 0.02, 0.00),
    Use.OFFICE: (0.18, 0.16, 0.12, 0.08, 0.04, 0.42, 0.00),
    Use.EMPTY: (0.45, 0.20, 0.10, 0.05, 0.10, 0.10, 0.00),
}


def draw_style(rng: np.random.Generator, use: Use) -> Style:
    """Return a taste that is likely in a room for ``use``."""
    return STYLES[int(rng.choice(len(STYLES), p=_SHARES[use]))]


WOODS: dict[str, Vector] = {name: (red, green, blue) for name, (red, green, blue) in _TABLES["woods"].items()}
"""Linear albedo of finished woods."""


def linear(colour: str | Vector) -> Vector:
    """Return linear albedo of ``#rrggbb`` (sRGB, IEC 61966-2-1); a vector is linear already."""
    if not isinstance(colour, str):
        return colour
    codes = np.array([int(colour[i : i + 2], 16) / 255 for i in (1, 3, 5)])
    red, green, blue = (float(one) for one in np.clip(srgb_decoded(codes), 0.02, 0.9))
    return (red, green, blue)


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

"""Palettes: the woods, cloths, metals and details that one set of furniture has in common."""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache
from typing import Literal, TypeAlias

from processing.errors import ItemError
from processing.layout.furniture.model import Colour, Material
from processing.layout.furniture.textures import CLOTH_M, LEATHER_M, WOOD_M, boucle, cloth, leather, wood

Legs: TypeAlias = Literal["round", "square", "metal"]
Handles: TypeAlias = Literal["knob", "bar", "grip"]
Head: TypeAlias = Literal["slats", "padded", "panel"]


@dataclass(frozen=True)
class Style:
    """Materials and details of a set."""

    name: str
    timber: Material
    front: Material
    """Doors and drawers."""
    second_timber: Material
    """Insides, table legs."""
    fabric: Material
    second_fabric: Material
    accent: Material
    """Cushions, throw."""
    bedding: Material
    metal: Material
    legs: Legs
    handles: Handles
    head: Head
    rug: tuple[Colour, Colour, Colour]
    """Ground, pattern, lines."""
    pot: Material


def _wood(name: str, colour: Colour, figure: float = 1.0, roughness: float = 0.5) -> Material:
    return Material(name, (1.0, 1.0, 1.0), roughness, texture=wood(colour, figure), texture_m=WOOD_M)


def _cloth(name: str, colour: Colour, contrast: float = 1.0) -> Material:
    return Material(name, (1.0, 1.0, 1.0), 0.92, texture=cloth(colour, contrast), texture_m=CLOTH_M)


def _boucle(name: str, colour: Colour) -> Material:
    return Material(name, (1.0, 1.0, 1.0), 0.95, texture=boucle(colour), texture_m=CLOTH_M)


def _leather(name: str, colour: Colour) -> Material:
    return Material(name, (1.0, 1.0, 1.0), 0.42, texture=leather(colour), texture_m=LEATHER_M)


def _paint(name: str, colour: Colour) -> Material:
    return Material(name, colour, 0.45)


BLACK_STEEL = Material("black steel", (0.03, 0.03, 0.032), 0.45)
BRASS = Material("brass", (0.78, 0.56, 0.26), 0.28, 1.0)
NICKEL = Material("nickel", (0.62, 0.60, 0.57), 0.30, 1.0)


@lru_cache(maxsize=1)
def _oak() -> Style:
    oak = _wood("oak", (0.50, 0.335, 0.185))
    return Style(
        "oak", oak, oak, oak, _cloth("linen, natural", (0.56, 0.51, 0.43)),
        _boucle("boucle, cream", (0.68, 0.63, 0.55)),
        _cloth("linen, sage", (0.24, 0.28, 0.19)), _cloth("cotton, white", (0.80, 0.79, 0.76), 0.35), BLACK_STEEL,
        "round", "knob", "slats", ((0.62, 0.57, 0.48), (0.36, 0.33, 0.26), (0.20, 0.20, 0.16)),
        Material("clay", (0.46, 0.24, 0.14), 0.8),
    )  # fmt: skip


@lru_cache(maxsize=1)
def _walnut() -> Style:
    walnut = _wood("walnut", (0.165, 0.088, 0.046), 1.25, 0.42)
    return Style(
        "walnut", walnut, walnut, walnut, _cloth("wool, charcoal", (0.085, 0.09, 0.10)),
        _leather("leather, cognac", (0.30, 0.125, 0.045)), _cloth("velvet, rust", (0.36, 0.13, 0.055), 0.6),
        _cloth("percale, grey", (0.55, 0.55, 0.55), 0.35), BRASS, "metal", "bar", "padded",
        ((0.17, 0.17, 0.18), (0.42, 0.38, 0.32), (0.30, 0.13, 0.07)), Material("stoneware", (0.09, 0.09, 0.095), 0.35),
    )  # fmt: skip


@lru_cache(maxsize=1)
def _white() -> Style:
    white = _paint("white lacquer", (0.76, 0.75, 0.72))
    birch = _wood("birch", (0.64, 0.50, 0.33), 0.55)
    return Style(
        "white", white, white, birch, _cloth("cotton, blue", (0.115, 0.19, 0.315)),
        _cloth("cotton, pale blue", (0.46, 0.54, 0.62)), _cloth("cotton, mustard", (0.56, 0.36, 0.08)),
        _cloth("cotton, ivory", (0.77, 0.75, 0.69), 0.35), NICKEL, "square", "knob", "panel",
        ((0.70, 0.69, 0.66), (0.13, 0.21, 0.34), (0.42, 0.50, 0.60)), Material("glaze, white", (0.74, 0.73, 0.70), 0.2),
    )  # fmt: skip


@lru_cache(maxsize=1)
def _black() -> Style:
    black = _wood("black ash", (0.040, 0.037, 0.035), 0.9, 0.55)
    ash = _wood("ash", (0.60, 0.46, 0.30), 0.8)
    return Style(
        "black", black, black, ash, _cloth("wool, forest", (0.075, 0.135, 0.085)),
        _cloth("wool, sand", (0.50, 0.41, 0.29)), _cloth("linen, ochre", (0.52, 0.31, 0.10)),
        _cloth("linen, flax", (0.66, 0.60, 0.50), 0.5), BLACK_STEEL, "metal", "grip", "padded",
        ((0.55, 0.47, 0.35), (0.07, 0.07, 0.07), (0.33, 0.25, 0.15)), Material("concrete", (0.38, 0.37, 0.35), 0.85),
    )  # fmt: skip


STYLES = {"oak": _oak, "walnut": _walnut, "white": _white, "black": _black}


def style_named(name: str) -> Style:
    """Return a style; raise `ItemError` naming those there are."""
    if name not in STYLES:
        raise ItemError(f"no style '{name[:40]}'; there are: {', '.join(STYLES)}")
    return STYLES[name]()

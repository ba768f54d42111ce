"""Styles: which material each role of a design gets, and which designs belong together (`styles.toml`)."""

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cache
from typing import Any

from processing.errors import ItemError
from processing.ground.tables import table_of
from processing.layout.furniture import model
from processing.layout.furniture.model import Colour, Material

_PICTURES: dict[str, Any] = {
    # Kind of surface: its picture, the picture's size in metres, its usual roughness.
    "wood": (lambda colour, m: model.wood(colour, m.get("figure", 1.0)), model.WOOD_M, 0.5),
    "cloth": (lambda colour, m: model.cloth(colour, m.get("contrast", 1.0)), model.CLOTH_M, 0.92),
    "boucle": (lambda colour, _: model.boucle(colour), model.CLOTH_M, 0.95),
    "leather": (lambda colour, _: model.leather(colour), model.LEATHER_M, 0.42),
}


@dataclass(frozen=True)
class Style:
    """A set of materials and designs that go together."""

    name: str
    roles: Mapping[str, str]
    """Material of each role: timber, front, fabric, accent, ..."""
    designs: Mapping[str, str]
    """Design of each category."""
    legs: str
    handles: str
    colours: tuple[Colour, Colour, Colour]
    """Of rugs and art: ground, pattern, lines."""

    def material(self, role: str) -> Material:
        """Return the material of a role, or one that all styles share by its name."""
        return material(self.roles.get(role, role))


def _tables() -> dict[str, Any]:
    return table_of(__package__, "styles")


@cache
def material(name: str) -> Material:
    """Return a material of `styles.toml`."""
    row = dict(_tables()["materials"][name])
    for kind, (picture, size_m, roughness) in _PICTURES.items():
        if kind in row:
            texture = picture(tuple(row[kind]), row)
            return Material(name, (1.0, 1.0, 1.0), row.get("roughness", roughness), texture=texture, texture_m=size_m)
    return Material(name, tuple(row["plain"]), row["roughness"], row.get("metallic", 0.0))


STYLES: tuple[str, ...] = tuple(_tables()["styles"])


@cache
def style_named(name: str) -> Style:
    """Return a style; raise `ItemError` naming those there are."""
    if name not in STYLES:
        raise ItemError(f"no style '{name[:40]}'; there are: {', '.join(STYLES)}")
    row = _tables()["styles"][name]
    ground, pattern, lines = (tuple(colour) for colour in row["colours"])
    return Style(name, row["roles"], row["designs"], row["legs"], row["handles"], (ground, pattern, lines))


def differing(one: str, other: str) -> float:
    """Return the share of categories for which two styles have designs of other shapes; 0 to 1."""
    a, b = style_named(one).designs, style_named(other).designs
    return sum(a[key] != b[key] for key in a) / len(a)

"""The bench that models are built on: the size, a style, seeded chance, and what has been made so far."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cache
from typing import Any

import numpy as np

from processing.errors import ItemError
from processing.ground.arrays import Doubles
from processing.ground.tables import table_of
from processing.layout.furniture import model, solids
from processing.layout.furniture.model import Colour, Material, Part, Size
from processing.layout.furniture.solids import Solid, Spot

# Styles: which material each role of a design gets, and which designs belong together (`styles.toml`).

_TABLES = table_of(__package__, "styles")
_PICTURES: dict[str, Any] = {
    # Kind of surface: its picture, the picture's size in metres, its usual roughness.
    "wood": (lambda colour, m: model.wood(colour, m.get("figure", 1.0)), model.WOOD_M, 0.5),
    "cloth": (lambda colour, m: model.cloth(colour, m.get("contrast", 1.0)), model.CLOTH_M, 0.92),
    "boucle": (lambda colour, _: model.boucle(colour), model.CLOTH_M, 0.95),
    "marble": (lambda colour, _: model.marble(colour), model.MARBLE_M, 0.2),
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


@cache
def material(name: str) -> Material:
    """Return a material of `styles.toml`."""
    row = dict(_TABLES["materials"][name])
    for kind, (picture, size_m, roughness) in _PICTURES.items():
        if kind in row:
            texture = picture(tuple(row[kind]), row)
            more = {"texture": texture, "texture_m": size_m, "creases": row.get("creases", 0.0)}
            return Material(name, (1.0, 1.0, 1.0), row.get("roughness", roughness), **more)
    return Material(name, tuple(row["plain"]), row["roughness"], row.get("metallic", 0.0))


STYLES: tuple[str, ...] = tuple(_TABLES["styles"])


@cache
def style_named(name: str) -> Style:
    """Return a style; raise `ItemError` naming those there are."""
    if name not in STYLES:
        raise ItemError(f"no style '{name[:40]}'; there are: {', '.join(STYLES)}")
    row = _TABLES["styles"][name]
    ground, pattern, lines = (tuple(colour) for colour in row["colours"])
    return Style(name, row["roles"], row["designs"], row["legs"], row["handles"], (ground, pattern, lines))


def differing(one: str, other: str) -> float:
    """Return the share of categories for which two styles have designs of other shapes; 0 to 1."""
    a, b = style_named(one).designs, style_named(other).designs
    return sum(a[key] != b[key] for key in a) / len(a)


@dataclass
class Bench:
    """A piece under construction: its footprint's middle at the origin, its front at +y, standing on z = 0."""

    size: Size
    style: Style
    rng: np.random.Generator
    made: dict[tuple[int, float], list[tuple[Solid, Doubles | None]]] = field(default_factory=dict)
    materials: dict[int, Material] = field(default_factory=dict)
    lights: dict[tuple[str, float], Material] = field(default_factory=dict)

    def add(
        self,
        body: Solid | Sequence[Solid],
        material: Material,
        *,
        grain: int = 2,
        uv: Doubles | None = None,
        crease_rad: float = float(solids.CREASE_RAD),
    ) -> None:
        """Add a body; its texture's v runs along axis `grain` of it as made, or `uv` (F, 3, 2) metres is taken."""
        for one in [body] if isinstance(body, Solid) else body:
            place = uv
            if place is None and material.texture is not None:
                place = solids.box_uv(one.rest, one.faces, grain) + self.rng.uniform(0, 3, 2)
            self.materials[id(material)] = material
            self.made.setdefault((id(material), crease_rad), []).append((one, place))

    def block(
        self, low: Spot, high: Spot, of: Material, *, bevel_m: float = 0.003, grain: int | None = None, steps: int = 1
    ) -> None:
        """Add a board or block between two corners; its grain runs along its longest side unless given."""
        if any(h - lo <= 1e-4 for lo, h in zip(low, high, strict=True)):
            return
        run = int(np.argmax(np.subtract(high, low))) if grain is None else grain
        self.add(solids.box(low, high, bevel_m, steps), of, grain=run)

    def glowing(self, material: Material, lumen: float) -> Material:
        """Return a material that sends out light while its lamp is switched on; alike for alike lamps."""
        key = (material.name, lumen)
        return self.lights.setdefault(key, replace(material, name=f"{material.name}, {lumen:g} lm", lumen=lumen))

    def parts(self) -> tuple[Part, ...]:
        """Return what has been made, one part a material and crease; its bounds are the size's exactly."""
        low, high = model.bounds([body.vertices for bodies in self.made.values() for body, _ in bodies])
        scale = np.array(self.size) / (high - low)
        shift = np.array([-self.size[0] / 2, -self.size[1] / 2, 0.0]) - low * scale
        parts = []
        for (key, crease), bodies in self.made.items():
            whole = solids.joined([body for body, _ in bodies])
            fitted = Solid(whole.vertices * scale + shift, whole.faces, whole.rest)
            places = [uv for _, uv in bodies if uv is not None]
            uv = np.concatenate(places) if len(places) == len(bodies) else None
            parts.append(solids.part_of(fitted, self.materials[key], uv, crease))
        return tuple(parts)

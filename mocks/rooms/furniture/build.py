"""The bench that models are built on: size, materials, chance, a list of pieces, and the shapes that designs name."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, fields, replace
from typing import Any

import numpy as np

from mocks.rooms.model import Finish, Item, Material
from mocks.worlds.light import Vector, vector_of
from processing.ground.mesh import Mesh, moved, turned
from processing.ground.shapes import ball, beam, cylinder, lathe, pad, rounded_box, tube
from processing.ground.tables import table_of

_TABLES = table_of(__package__, "materials")
PAPER, CERAMIC, FOLIAGE = (tuple(map(vector_of, _TABLES["colours"][name])) for name in ("paper", "ceramic", "foliage"))
"""Albedos of book covers, boxes and toys; of pots and vases; of leaves."""
MATERIALS = {
    name: Material(row["name"], vector_of(row["colour"]), roughness=row.get("roughness"))
    for name, row in _TABLES["materials"].items()
}
"""What is the same in every room; the meter's board is matte white of albedo 0.90."""
BLACK_PLASTIC, WHITE_PLASTIC, PAGES = (MATERIALS[name] for name in ("black_plastic", "white_plastic", "paper"))
SIZES: dict[str, float] = _TABLES["sizes"]  # metres that designs know by name
BOARD_SIDE_M = SIZES["SIDE"]
CORNERS = ((-1, -1), (-1, 1), (1, -1), (1, 1))  # signs of x and y of the four corners

Span = tuple[float, float]


def vessel(profile: Sequence[Span], wall: float) -> Mesh:
    """Return an open vessel from its outer profile (foot to rim) and the thickness of its wall."""
    inside = [(max(r - wall, 0.001), max(z, wall)) for r, z in reversed(profile)]
    return lathe([(0.0, 0.0), *profile, *inside, (0.0, wall)], 28)


SHAPES: dict[str, Callable[..., Mesh]] = {
    "block": lambda x, y, z, r=0.003, fine=1: rounded_box((x[0], y[0], z[0]), (x[1], y[1], z[1]), r, fine),
    "pad": lambda x, y, z, edge, puff: pad((x[0], y[0], z[0]), (x[1], y[1], z[1]), edge, puff),
    "bar": lambda path, wide, thick, r=0.003: beam(path[0], path[1], wide, thick, r),
    "tube": lambda path, r, sides=10: tube(path, r, sides),
    "leg": lambda foot, top, r: tube([foot, top], r, 12),
    "cylinder": lambda r, h, edge=0.0, sides=24: cylinder((0, 0, 0), r, h, edge, sides),
    "ball": lambda r, sides=20: ball((0, 0, 0), r, sides),
    "lathe": lambda profile, sides=24: lathe(profile, sides),
    "vessel": vessel,
}
"""Shapes by the names that designs have for them; blocks and pads lie between the ends of their spans."""


@dataclass
class Build:
    """An item under construction: unturned, facing -y, its footprint's middle at the origin, standing on z = 0."""

    item: Item
    finish: Finish
    rng: np.random.Generator
    pieces: list[tuple[Mesh, Material, str]] = field(default_factory=list)
    """Mesh, material and, where it differs from the item's, the name of the ADE20K class."""

    @property
    def size(self) -> Vector:
        """Return width, depth and height in metres."""
        return self.item.size_m

    def option(self, name: str, default: float) -> float:
        """Return an option of the item."""
        return dict(self.item.options).get(name, default)

    def add(self, mesh: Mesh, material: Material, ade: str = "") -> None:
        """Add a piece; textures start at a place of its own, as boards cut from a log do.

        What would reach below z = 0 (the foot of a slanting leg) is cut off there, to stand flat.
        """
        if mesh.vertices[:, 2].min() < 0.0:
            mesh = replace(mesh, vertices=np.maximum(mesh.vertices, [-np.inf, -np.inf, 0.0]))
        if material.texture is not None:
            mesh = replace(mesh, uv=mesh.uv + self.rng.uniform(0.0, 2.0, 2))
        self.pieces.append((mesh, material, ade))

    def plain(self, name: str, colours: Sequence[Vector], roughness: float | None = None) -> Material:
        """Return a plain material of one of the colours, a little lighter or darker."""
        colour = np.array(colours[int(self.rng.integers(len(colours)))]) * self.rng.uniform(0.85, 1.1)
        return Material(name, vector_of(np.clip(colour, 0.01, 0.85)), roughness=roughness)

    def timber(self) -> Material:
        """Return the wood of this item: mostly the room's first, sometimes its second or painted."""
        choice = self.item.seed % 10
        return self.finish.second_wood if choice in (3, 7) else self.finish.lacquer if choice == 9 else self.finish.wood

    def pick(self, *materials: Material) -> Material:
        """Return one of the materials, by chance."""
        return materials[int(self.rng.integers(len(materials)))]

    def shape(
        self,
        name: str,
        material: Material,
        *,
        turns: tuple[float, float, float] = (0.0, 0.0, 0.0),
        about: Vector = (0.0, 0.0, 0.0),
        at: Vector | None = None,
        ade: str = "",
        **measures: Any,
    ) -> None:
        """Add a shape, turned by radians about x, y, z, then moved."""
        mesh = SHAPES[name](**measures)
        for axis, angle in zip(((1, 0, 0), (0, 1, 0), (0, 0, 1)), turns, strict=True):
            mesh = turned(mesh, axis, angle, about) if angle else mesh
        self.add(mesh if at is None else moved(mesh, at), material, ade)

    def materials(self) -> dict[str, Material]:
        """Return all materials by their names in designs."""
        own = {one.name: getattr(self.finish, one.name) for one in fields(self.finish)}
        return {**MATERIALS, **own, "timber": self.timber()}

    def names(self) -> dict[str, Any]:
        """Return what designs know besides their measures."""
        rng = self.rng
        own = {"seed": self.item.seed, "CORNERS": CORNERS, "PAPER": PAPER, "CERAMIC": CERAMIC}
        draws = {"option": self.option, "plain": self.plain, "pick": self.pick, "chance": rng.random}
        return {
            **SIZES,
            **self.materials(),
            **own,
            **draws,
            "material": lambda name, colour, roughness=None: Material(name, colour, roughness=roughness),
            "rnd": lambda low, high: float(rng.uniform(low, high)),
            "normal": lambda mean, spread: float(rng.normal(mean, spread)),
        }

"""The bench that models are built on: size, materials, chance, and a list of pieces."""

from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from mocks.rooms.model import Finish, Item, Material
from mocks.worlds.light import Vector
from processing.ground.mesh import Mesh
from processing.ground.shapes import beam, rounded_box, tube

PAPER: tuple[Vector, ...] = (
    *((0.55, 0.12, 0.10), (0.10, 0.19, 0.34), (0.72, 0.66, 0.52), (0.14, 0.27, 0.20), (0.80, 0.78, 0.72)),
    *((0.62, 0.36, 0.12), (0.07, 0.07, 0.08), (0.38, 0.22, 0.30), (0.66, 0.58, 0.20), (0.30, 0.42, 0.50)),
)
"""Albedos of book covers, boxes and toys."""
CERAMIC = ((0.78, 0.76, 0.71), (0.55, 0.30, 0.19), (0.16, 0.22, 0.26), (0.42, 0.50, 0.42), (0.62, 0.52, 0.40))
"""Albedos of pots and vases."""
FOLIAGE = ((0.055, 0.135, 0.035), (0.075, 0.17, 0.05), (0.045, 0.11, 0.05), (0.11, 0.20, 0.06))
BLACK_PLASTIC = Material("black plastic", (0.025, 0.025, 0.027), roughness=0.35)
WHITE_PLASTIC = Material("white plastic", (0.74, 0.74, 0.72), roughness=0.35)
SCREEN = Material("screen", (0.012, 0.012, 0.014), roughness=0.12)
PAGES = Material("paper", (0.76, 0.73, 0.64))
SOIL = Material("soil", (0.055, 0.038, 0.025))
CORNERS = ((-1, -1), (-1, 1), (1, -1), (1, 1))
"""Signs of x and y of the four corners."""
SHADE = Material("lampshade", (0.76, 0.71, 0.60))


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

    def block(self, low: Vector, high: Vector, material: Material, radius_m: float = 0.003) -> None:
        """Add a block with slightly rounded edges."""
        self.add(rounded_box(low, high, radius_m), material)

    def bar(self, start: Vector, end: Vector, width_m: float, thickness_m: float, material: Material) -> None:
        """Add a straight bar."""
        self.add(beam(start, end, width_m, thickness_m), material)

    def leg(self, foot: Vector, top: Vector, foot_m: float, top_m: float, material: Material) -> None:
        """Add a round tapered leg between two places, given its radii."""
        self.add(tube([foot, top], (foot_m, top_m), 12), material)

    def plain(self, name: str, colours: Sequence[Vector], roughness: float | None = None) -> Material:
        """Return a plain material of one of the colours, a little lighter or darker."""
        colour = np.array(colours[int(self.rng.integers(len(colours)))]) * self.rng.uniform(0.85, 1.1)
        r, g, b = (float(c) for c in np.clip(colour, 0.01, 0.85))
        return Material(name, (r, g, b), roughness=roughness)

    def timber(self) -> Material:
        """Return the wood of this item: mostly the room's first, sometimes its second or painted."""
        choice = self.item.seed % 10
        return self.finish.second_wood if choice in (3, 7) else self.finish.lacquer if choice == 9 else self.finish.wood

    def pick(self, *materials: Material) -> Material:
        """Return one of the materials, by chance."""
        return materials[int(self.rng.integers(len(materials)))]

    def legs(self, inset_m: float, height_m: float, thick_m: float, material: Material) -> None:
        """Add four square legs from the floor up to a height."""
        w, d, _ = self.size
        for sx, sy in CORNERS:
            x, y = sx * (w / 2 - inset_m), sy * (d / 2 - inset_m)
            self.bar((x, y, 0.0), (x, y, height_m), thick_m, thick_m, material)

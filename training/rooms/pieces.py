"""Furniture for training rooms: from simulated rooms, from catalogues of meshes, or random (`training.rooms.forms`)."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from shapely.geometry import Point as Spot
from shapely.geometry import Polygon

from mocks.rooms.model import Item, Part, Role
from mocks.rooms.room import Room
from processing.ground.arrays import Floats, Int16s, Rgb
from processing.ground.colour import linear_of_srgb
from processing.layout.furniture.model import FurnitureModel, Material, bounds

_ON_WALL = ("picture", "wall clock", "wall shelf", "rug", "curtain")
_NOT_STANDING = ("kitchen", "bathroom", "rug", "lamp", "other")
SMALL = ("books", "tv", "pillow", "lamp", "small plant")
"""Kinds that stand on other furniture."""
MOST_TRIANGLES = 24_000


@dataclass(frozen=True)
class Piece:
    """A piece of furniture with what lies on it: unturned, its middle at the origin on the floor, back to +y."""

    kind: str
    size_m: tuple[float, float, float]
    triangles: Floats
    paint_of: Int16s
    colours: tuple[tuple[float, float, float], ...]
    paints: tuple[str, ...] = ()
    """Kind of each paint; `furniture` where none is given."""

    def scaled(self, factors: tuple[float, float, float]) -> Piece:
        """Return it wider, deeper and higher by three factors."""
        w, d, h = (s * f for s, f in zip(self.size_m, factors, strict=True))
        triangles = self.triangles * np.array(factors, np.float32)
        return Piece(self.kind, (w, d, h), triangles, self.paint_of, self.colours, self.paints)

    def paint_kind(self, number: int) -> str:
        """Return the kind of one of its paints."""
        return self.paints[number] if number < len(self.paints) else "furniture"


def joined(kind: str, size_m: tuple[float, float, float], pieces: Iterable[tuple[Piece, Floats]]) -> Piece:
    """Return one piece made of several, each moved by a vector of shape (3,), metres."""
    triangles: list[Floats] = []
    paint_of: list[Int16s] = []
    colours: list[tuple[float, float, float]] = []
    paints: list[str] = []
    for piece, by in pieces:
        triangles.append(piece.triangles + np.asarray(by, np.float32))
        paint_of.append((piece.paint_of + len(colours)).astype(np.int16))
        paints += [piece.paint_kind(k) for k in range(len(piece.colours))]
        colours += piece.colours
    return Piece(kind, size_m, np.concatenate(triangles), np.concatenate(paint_of), tuple(colours), tuple(paints))


def pieces_of(room: Room, parts: list[Part]) -> list[Piece]:
    """Return all furniture of a room (and its ``parts``) that stands on its floor, each with the clutter on it."""
    of_item: dict[int, list[Part]] = {}
    for part in parts:
        of_item.setdefault(part.instance, []).append(part)
    standing = [i for i in room.items if i.position_m[2] < 0.02 and i.kind not in _ON_WALL]
    standing = [i for i in standing if i.role in (Role.FURNITURE, Role.CLUTTER)]
    raised = [i for i in room.items if i.role is Role.CLUTTER and i.position_m[2] >= 0.02 and i.kind not in _ON_WALL]
    return [
        _piece(item, [p for i in (item, *(r for r in raised if _over(item, r))) for p in of_item.get(i.instance, [])])
        for item in standing
    ]


def _over(item: Item, other: Item) -> bool:
    return bool(Polygon(item.corners()).contains(Spot(*other.position_m[:2])))


def _piece(item: Item, parts: list[Part]) -> Piece:
    triangles: list[Floats] = []
    paint_of: list[Int16s] = []
    colours: list[tuple[float, float, float]] = []
    c, s = np.cos(-item.turn_rad), np.sin(-item.turn_rad)
    for part in parts:
        t = part.mesh.vertices[part.mesh.faces] - np.array([*item.position_m[:2], 0.0])
        x, y = t[..., 0] * c - t[..., 1] * s, t[..., 0] * s + t[..., 1] * c
        triangles.append(np.stack([x, y, t[..., 2]], axis=-1).astype(np.float32))
        paint_of.append(np.full(len(t), len(colours), np.int16))
        colours.append(part.material.colour)
    return Piece(item.kind, item.size_m, np.concatenate(triangles), np.concatenate(paint_of), tuple(colours))


def built_in_pieces() -> list[Piece]:
    """Return the furniture that daylit arranges, in its usual sizes, one style of each."""
    from processing.layout.models.catalogue import Catalogue

    catalogue = Catalogue.builtin()
    return [_of_model(catalogue.mesh(name)) for name in catalogue.ids[::3]]


def folder_pieces(folders: Iterable[Path]) -> list[Piece]:
    """Return the standing furniture of folders of model files, those that are not too fine; skips what is unsound."""
    from processing.errors import ModelFileError
    from processing.layout.models.catalogue import Catalogue

    found = []
    for folder in folders:
        catalogue = Catalogue.at(folder)
        for name in catalogue.ids:
            try:
                model = catalogue.mesh(name)
            except ModelFileError:
                continue
            if model.category in _NOT_STANDING or model.triangles > MOST_TRIANGLES:
                continue
            found.append(_of_model(model))
    return found


def _mean_colour(material: Material) -> Rgb:
    """Return the mean base colour of a material, texture included."""
    if material.texture is None:
        return material.base_colour
    mean = linear_of_srgb(material.texture[:: max(1, len(material.texture) // 64)]).mean(axis=(0, 1))
    r, g, b = (float(m * c) for m, c in zip(mean, material.base_colour, strict=True))
    return r, g, b


def _of_model(model: object) -> Piece:
    assert isinstance(model, FurnitureModel)
    low, high = bounds([part.vertices for part in model.parts])
    middle = np.array([*((low + high)[:2] / 2), low[2]])
    triangles, paint_of, colours = [], [], []
    for number, part in enumerate(model.parts):
        # Models look to +y, pieces have their back there.
        t = (part.vertices[part.faces] - middle) * np.array([-1.0, -1.0, 1.0])
        triangles.append(t.astype(np.float32))
        paint_of.append(np.full(len(t), number, np.int16))
        colours.append(_mean_colour(part.material))
    kind = "small plant" if model.category == "plant" and model.size_m[2] < 0.45 else model.category
    return Piece(kind, model.size_m, np.concatenate(triangles), np.concatenate(paint_of), tuple(colours))

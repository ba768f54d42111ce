"""Furniture for training rooms: pieces taken from simulated rooms, blocks of chance form, rugs; placed to fit."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
from shapely import union_all
from shapely.affinity import rotate, translate
from shapely.geometry import Point as Spot
from shapely.geometry import Polygon, box

from mocks.rooms.mesh import Part
from mocks.rooms.model import Item, Role
from mocks.rooms.room import Room
from processing.segmentation.classes import SceneClass
from training.house import House
from training.soup import WORLD, Frame, Soup

Floats = npt.NDArray[np.float32]
_ON_WALL = ("picture", "wall clock", "wall shelf", "rug", "curtain")
_FREE = ("dining table", "coffee table", "chair", "swivel chair", "ottoman", "plant", "box", "armchair", "basket")


@dataclass(frozen=True)
class Piece:
    """A piece of furniture with what lies on it: unturned, its middle at the origin on the floor, back to +y."""

    kind: str
    size_m: tuple[float, float, float]
    triangles: Floats
    paint_of: npt.NDArray[np.int16]
    colours: tuple[tuple[float, float, float], ...]


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
    paint_of: list[npt.NDArray[np.int16]] = []
    colours: list[tuple[float, float, float]] = []
    c, s = np.cos(-item.turn_rad), np.sin(-item.turn_rad)
    for part in parts:
        t = part.mesh.vertices[part.mesh.faces] - np.array([*item.position_m[:2], 0.0])
        x, y = t[..., 0] * c - t[..., 1] * s, t[..., 0] * s + t[..., 1] * c
        triangles.append(np.stack([x, y, t[..., 2]], axis=-1).astype(np.float32))
        paint_of.append(np.full(len(t), len(colours), np.int16))
        colours.append(part.material.colour)
    return Piece(item.kind, item.size_m, np.concatenate(triangles), np.concatenate(paint_of), tuple(colours))


def furnish_house(rng: np.random.Generator, house: House, bank: list[Piece]) -> None:
    """Put 0 to 10 pieces into a room, where they neither overlap nor stand before doors or cameras."""
    room = Polygon(house.outline)
    wanted = 0 if rng.random() < 0.25 else int(rng.integers(2, 4 + int(min(room.area / 1.5, 12))))
    kept = [Spot(p).buffer(0.42) for p in house.cameras]
    for number, start, end in house.blocked:
        frame, _ = house.wall(number)
        ring = frame.world([(start, 0, 0), (end, 0, 0), (end, 0.7, 0), (start, 0.7, 0)])[:, :2]
        kept.append(Polygon(ring))
    taken = union_all(kept)
    for _ in range(wanted):
        block = rng.random() < 0.22 or not bank
        piece = _block(rng) if block else bank[int(rng.integers(len(bank)))]
        for _try in range(10):
            at, turn = _place(rng, house, piece)
            foot = _foot(piece, at, turn)
            if room.contains(foot) and not taken.intersects(foot):
                taken = taken.union(foot)
                _stand(house, piece, at, turn)
                break
    if rng.random() < 0.25:
        _rug(rng, house, room)


def _foot(piece: Piece, at: tuple[float, float], turn: float) -> Polygon:
    w, d = piece.size_m[0] / 2, piece.size_m[1] / 2
    return translate(rotate(box(-w, -d, w, d), turn, origin=(0, 0), use_radians=True), *at)


def _place(rng: np.random.Generator, house: House, piece: Piece) -> tuple[tuple[float, float], float]:
    """Return a place in the open, or with the back to a wall."""
    if piece.kind in _FREE and rng.random() < 0.7:
        low, high = house.outline.min(axis=0), house.outline.max(axis=0)
        x, y = rng.uniform(low, high)
        return (float(x), float(y)), float(rng.uniform(0, 2 * np.pi))
    number = int(rng.integers(len(house.outline)))
    frame, length = house.wall(number)
    away = piece.size_m[1] / 2 + rng.uniform(0.03, 0.1)
    x, y, _ = frame.world((rng.uniform(0.0, length), away, 0.0))
    # Unturned pieces have their back to +y: it has to look against the wall's inner side.
    return (float(x), float(y)), float(np.arctan2(frame.along[1], frame.along[0]) + np.pi)


def _stand(house: House, piece: Piece, at: tuple[float, float], turn: float) -> None:
    frame = Frame(at, (float(np.cos(turn)), float(np.sin(turn))))
    paints = [house.soup.paint("furniture", colour) for colour in piece.colours]
    world = frame.world(piece.triangles)
    for number, paint in enumerate(paints):
        mine = piece.paint_of == number
        house.soup.add(world[mine], SceneClass.FURNITURE, paint)


def _block(rng: np.random.Generator) -> Piece:
    """Return a cupboard, box or table of chance proportions."""
    w, d, h = rng.uniform(0.25, 1.8), rng.uniform(0.25, 0.8), rng.uniform(0.25, 2.1)
    soup, a, b = Soup(), 0, 1
    if rng.random() < 0.4:
        leg, top = rng.uniform(0.03, 0.08), rng.uniform(0.03, 0.12)
        h = min(h, 1.0)
        soup.box(WORLD, (-w / 2, -d / 2, h - top), (w / 2, d / 2, h), SceneClass.FURNITURE, a)
        for x in (-w / 2, w / 2 - leg):
            for y in (-d / 2, d / 2 - leg):
                soup.box(WORLD, (x, y, 0.0), (x + leg, y + leg, h - top), SceneClass.FURNITURE, b)
    else:
        foot = rng.choice([0.0, 0.12])
        soup.box(WORLD, (-w / 2, -d / 2, foot), (w / 2, d / 2, h), SceneClass.FURNITURE, a)
        if foot:
            soup.box(WORLD, (-w / 2.2, -d / 2.4, 0.0), (w / 2.2, d / 2.4, foot), SceneClass.FURNITURE, b)
        if rng.random() < 0.5:
            soup.box(WORLD, (-w / 3, -d / 3, h), (w / 5, d / 3, h + rng.uniform(0.05, 0.5)), SceneClass.FURNITURE, b)
    triangles, _, paint_of = soup.joined()
    colours = tuple((float(r), float(g), float(k)) for r, g, k in rng.uniform(0.03, 0.8, (2, 3)))
    return Piece("box", (float(w), float(d), float(h)), triangles, paint_of, colours)


def _rug(rng: np.random.Generator, house: House, room: Polygon) -> None:
    low, high = house.outline.min(axis=0), house.outline.max(axis=0)
    x, y = rng.uniform(low, high)
    w, d = rng.uniform(0.6, 2.8), rng.uniform(0.5, 1.9)
    along = house.wall(0)[0].along
    turn = rng.uniform(0, np.pi) if rng.random() < 0.4 else np.arctan2(along[1], along[0])
    frame = Frame((float(x), float(y)), (float(np.cos(turn)), float(np.sin(turn))))
    ring = frame.world([(-w / 2, -d / 2, 0.008), (w / 2, -d / 2, 0.008), (w / 2, d / 2, 0.008), (-w / 2, d / 2, 0.008)])
    if room.contains(Polygon(ring[:, :2])):
        house.soup.quad(WORLD, ring, SceneClass.FIXTURE, house.soup.paint("rug"))

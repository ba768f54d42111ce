"""Furniture placed in training rooms: large pieces first, what belongs to them beside them, rugs and heaps."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from shapely import union_all
from shapely.affinity import rotate, translate
from shapely.geometry import Point as Spot
from shapely.geometry import Polygon, box

from processing.segmentation.evidence import SceneClass
from training.rooms.forms import draw_form, heap, laden
from training.rooms.house import House
from training.rooms.pieces import SMALL, Piece
from training.rooms.soup import Frame

_FREE = (
    "dining table",
    "coffee table",
    "dining chair",
    "chair",
    "swivel chair",
    "desk chair",
    "ottoman",
    "plant",
    "box",
    "armchair",
    "basket",
    "stool",
    "heap",
)
_FLAT = ("dining table", "coffee table", "side table", "nightstand", "chest", "dresser", "desk", "tv stand", "box")
_BESIDE = {
    "bed": ("nightstand", "chest", "lamp", "floor lamp"),
    "single bed": ("nightstand", "desk", "chest"),
    "dining table": ("dining chair", "chair", "stool"),
    "desk": ("desk chair", "swivel chair", "dining chair", "chair"),
    "sofa": ("coffee table", "ottoman", "armchair", "side table", "floor lamp"),
}
"""What stands beside a kind of furniture."""


@dataclass
class _Floor:
    """What is free of a room's floor."""

    house: House
    room: Polygon
    taken: Polygon

    def stand(self, piece: Piece, at: tuple[float, float], turn: float, *, allowed_m: float = 0.0) -> bool:
        """Put a piece down where it fits; it may reach ``allowed_m`` into others. Returns whether it did."""
        foot = _foot(piece, at, turn)
        less = foot.buffer(-allowed_m) if allowed_m else foot
        if not self.room.contains(foot) or self.taken.intersects(less):
            return False
        self.taken = self.taken.union(foot)
        _stand(self.house, piece, at, turn)
        return True


def furnish_house(rng: np.random.Generator, house: House, bank: list[Piece], *, most: int = 24) -> None:
    """Put pieces into a room, where they neither overlap nor stand before doors or cameras; a seventh stay empty.

    ``most`` pieces at most.
    """
    room = Polygon(house.outline)
    floor = _Floor(house, room, _kept_free(rng, house))
    small = [p for p in bank if p.kind in SMALL]
    standing = [p for p in bank if p.kind not in SMALL]
    wanted = 0 if rng.random() < 0.15 else min(int(rng.integers(3, 7 + int(min(room.area, 18)))), most)
    for number in range(wanted):
        piece = _chosen(rng, standing, large=number < 2)
        if piece.kind in _FLAT and rng.random() < 0.6:
            piece = laden(rng, piece, small)
        for _try in range(40):
            at, turn = _place(rng, house, piece)
            if floor.stand(piece, at, turn):
                _beside(rng, floor, standing, piece, (at, turn))
                break
    for _ in range(int(rng.choice([0, 1, 2], p=[0.5, 0.38, 0.12]))):
        _rug(rng, house, room)


def _kept_free(rng: np.random.Generator, house: House) -> Polygon:
    """Return the floor before doors and about cameras, now and then with little room about them."""
    gap = 0.28 if rng.random() < 0.4 else 0.45
    kept = [Spot(p).buffer(gap) for p in house.cameras]
    for number, start, end in house.blocked:
        frame, _ = house.wall(number)
        ring = frame.world([(start, 0, 0), (end, 0, 0), (end, 0.7, 0), (start, 0.7, 0)])[:, :2]
        kept.append(Polygon(ring))
    return union_all(kept)


def _chosen(rng: np.random.Generator, standing: list[Piece], *, large: bool) -> Piece:
    """Return a piece of the bank or of chance form, in other proportions."""
    factors = np.exp(np.clip(rng.normal(0, 0.14, 3), -0.3, 0.3)) * np.exp(rng.normal(0, 0.06))
    for _ in range(6):
        drawn = rng.random() < 0.3 or not standing
        piece = draw_form(rng) if drawn else standing[int(rng.integers(len(standing)))]
        if not large or piece.size_m[0] * piece.size_m[1] > 0.9:
            break
    return piece.scaled((float(factors[0]), float(factors[1]), float(factors[2])))


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
    # Beds with a side to the wall, desks with an end: a quarter is turned.
    quarter = float(rng.choice([0.0, 0.0, 0.0, 0.5, 1.0, -0.5])) * np.pi if rng.random() < 0.5 else 0.0
    deep = piece.size_m[0] if abs(abs(quarter) - np.pi / 2) < 0.1 else piece.size_m[1]
    away = deep / 2 + rng.uniform(0.02, 0.1)
    x, y, _ = frame.world((rng.uniform(0.0, length), away, 0.0))
    # Unturned pieces have their back to +y: it has to look against the wall's inner side.
    return (float(x), float(y)), float(np.arctan2(frame.along[1], frame.along[0]) + np.pi + quarter)


def _beside(
    rng: np.random.Generator,
    floor: _Floor,
    standing: list[Piece],
    anchor: Piece,
    where: tuple[tuple[float, float], float],
) -> None:
    """Put chairs to tables, bedside tables to beds, and heaps anywhere."""
    kinds = _BESIDE.get(anchor.kind, ())
    among = [p for p in standing if p.kind in kinds]
    (x, y), turn = where
    frame = Frame((x, y), (float(np.cos(turn)), float(np.sin(turn))))
    w, d, _ = anchor.size_m
    if among and rng.random() < 0.75:
        piece = among[int(rng.integers(len(among)))]
        for _ in range(int(rng.integers(1, 5))):
            side, shift = int(rng.integers(4)), float(rng.uniform(-0.35, 0.35))
            if anchor.kind in ("bed", "single bed"):
                side, shift = int(rng.choice([1, 3])), 0.4
            if anchor.kind == "sofa":
                side, shift = int(rng.choice([0, 0, 1, 3])), float(rng.uniform(-0.2, 0.2))
            close = -0.25 if "chair" in piece.kind or piece.kind == "stool" else float(rng.uniform(0.03, 0.4))
            reach = piece.size_m[1] / 2 + close
            spot = (
                (shift * w, -d / 2 - reach),
                (w / 2 + reach, shift * d),
                (shift * w, d / 2 + reach),
                (-w / 2 - reach, shift * d),
            )[side]
            own = turn + side * np.pi / 2 + rng.normal(0, 0.25)
            if anchor.kind in ("bed", "single bed"):
                own = turn
            px, py, _ = frame.world((*spot, 0.0))
            floor.stand(piece, (float(px), float(py)), float(own), allowed_m=0.27 if close < 0 else 0.0)
    if rng.random() < 0.2:
        one = heap(rng)
        px, py, _ = frame.world((rng.uniform(-w, w), rng.uniform(-d, d), 0.0))
        floor.stand(one, (float(px), float(py)), float(rng.uniform(0, 6.28)))


def _stand(house: House, piece: Piece, at: tuple[float, float], turn: float) -> None:
    frame = Frame(at, (float(np.cos(turn)), float(np.sin(turn))))
    paints = [house.soup.paint(piece.paint_kind(k), colour) for k, colour in enumerate(piece.colours)]
    world = frame.world(piece.triangles)
    high = house.ceiling_m - 0.01
    world[..., 2] = np.where(world[..., 2] > high, high, world[..., 2])
    for number, paint in enumerate(paints):
        mine = piece.paint_of == number
        if mine.any():
            house.soup.add(world[mine], SceneClass.FURNITURE, paint)


def _rug(rng: np.random.Generator, house: House, room: Polygon) -> None:
    """Lay a rug, round now and then, thin or thick."""
    low, high = house.outline.min(axis=0), house.outline.max(axis=0)
    x, y = rng.uniform(low, high)
    w, d = rng.uniform(0.6, 3.4), rng.uniform(0.5, 2.4)
    along = house.wall(0)[0].along
    turn = rng.uniform(0, np.pi) if rng.random() < 0.3 else np.arctan2(along[1], along[0])
    frame = Frame((float(x), float(y)), (float(np.cos(turn)), float(np.sin(turn))))
    thick, paint = float(rng.choice([0.008, 0.012, 0.035])), house.soup.paint("rug")
    if rng.random() < 0.2:
        round_ = np.arange(24) * (2 * np.pi / 24)
        ring = np.stack([d / 2 * np.cos(round_), d / 2 * np.sin(round_)], axis=1)
    else:
        ring = np.array([(-w / 2, -d / 2), (w / 2, -d / 2), (w / 2, d / 2), (-w / 2, d / 2)])
    top = frame.world(np.column_stack([ring, np.full(len(ring), thick)]))
    if not room.contains(Polygon(top[:, :2])):
        return
    fan = np.stack([np.repeat(top[:1], len(top) - 2, axis=0), top[1:-1], top[2:]], axis=1)
    foot = top * (1.0, 1.0, 0.0)
    sides = np.stack([foot, np.roll(foot, -1, 0), np.roll(top, -1, 0)], axis=1)
    house.soup.add(
        np.concatenate([fan, sides, np.stack([foot, np.roll(top, -1, 0), top], axis=1)]), SceneClass.FIXTURE, paint
    )

"""The recipe of the training pictures: batches of rooms, some from `mocks.rooms`, most of `training.rooms.house`."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from mocks.rooms.model import Part
from mocks.rooms.room import Room, make_room
from processing.ground.arrays import Bytes, Doubles, Floats
from processing.segmentation.embedded import WIDTH_PX
from training.labels import boundary_latitudes, corner_likelihood
from training.rooms.camera import add_foot, photographed, small_labels
from training.rooms.house import draw_cameras, draw_eye_m, draw_house
from training.rooms.paints import Tile
from training.rooms.pieces import Piece, pieces_of
from training.rooms.props import furnish_house
from training.rooms.render import Stage, radiance, see
from training.rooms.soup import room_soup

ROOMS_A_BATCH, HOUSES_A_BATCH = 5, 26
CAMERAS, LOOKS = 2, 2


@dataclass(frozen=True)
class Example:
    """One picture with its truth, at the network's size."""

    picture: Bytes
    """(128, 256, 3): `network_picture` times 255."""
    label: Bytes
    ceiling_rad: Floats
    floor_rad: Floats
    corner: Floats


def batch(first_seed: int, tiles: list[Tile], *, looks: int = LOOKS, pieces: Sequence[Piece] = ()) -> Iterator[Example]:
    """Yield the pictures of a batch; it uses the seeds from ``first_seed`` on, `ROOMS_A_BATCH` of them for rooms.

    ``pieces`` stand in its houses beside the furniture of its rooms.
    """
    bank: list[Piece] = list(pieces)
    for seed in range(first_seed, first_seed + ROOMS_A_BATCH):
        room = make_room(seed)
        parts = room.parts()
        bank += pieces_of(room, parts)
        yield from _of_room(np.random.default_rng([seed, 81]), room, parts, tiles, looks)
    for number in range(HOUSES_A_BATCH):
        yield from _of_house(np.random.default_rng([first_seed, 82, number]), bank, tiles, looks)


def _of_room(
    rng: np.random.Generator, room: Room, parts: list[Part], tiles: list[Tile], looks: int
) -> Iterator[Example]:
    """Yield a simulated room from its own camera, and, without its tripod, from others; furnished or emptied."""
    outline = np.array(room.plan.polygon)
    panes = [tuple(np.array(side, np.float64) for side in (p.corner, p.u, p.v)) for p in room.panes]
    if rng.random() < 0.2:
        own = {item.instance for item in room.items}
        parts = [part for part in parts if part.instance not in own]
    lamps = [_below(part) for part in parts if part.surface == "lamp"][:4]
    for number in range(CAMERAS):
        mine = parts if number == 0 else [p for p in parts if p.surface != "tripod"]
        if number < 2:
            stage = Stage(room_soup(room, mine), panes, lamps=lamps)  # type: ignore[arg-type]
        place, eye_m = (0.0, 0.0), room.plan.camera_height_m
        if number:
            place, eye_m = draw_cameras(rng, outline, 1)[0], draw_eye_m(rng, room.plan.height_m)
        view = Standpoint(outline, room.plan.height_m, place, eye_m)
        yield from looks_of(rng, stage, view, tiles, looks, foot=number > 0)


def _below(part: Part) -> tuple[float, float, float]:
    v = part.mesh.vertices
    return (float(v[:, 0].mean()), float(v[:, 1].mean()), float(v[:, 2].min()) - 0.06)


def _of_house(rng: np.random.Generator, bank: list[Piece], tiles: list[Tile], looks: int) -> Iterator[Example]:
    house = draw_house(rng, CAMERAS)
    furnish_house(rng, house, bank)
    stage = Stage(house.soup, house.panes, house.portals, house.mirrors, house.lamps)
    for place, eye_m in zip(house.cameras, house.eyes_m, strict=True):
        view = Standpoint(house.outline, house.ceiling_m, place, eye_m)
        yield from looks_of(rng, stage, view, tiles, looks, foot=True)


class Standpoint(NamedTuple):
    """A room's outline and height, and where the camera stands in it, metres."""

    outline: Doubles
    """Corners (N, 2), counter-clockwise."""
    ceiling_m: float
    place: tuple[float, float]
    eye_m: float


def looks_of(
    rng: np.random.Generator, stage: Stage, view: Standpoint, tiles: list[Tile], looks: int, *, foot: bool
) -> Iterator[Example]:
    """Yield pictures from one camera; ``foot``: something may stand under it. None from a camera in front of a face."""
    outline, ceiling_m, place, eye_m = view
    seen = see(rng, stage, place, eye_m)
    if np.median(seen.reach_m[seen.reach_m > 0]) < 0.25:
        return
    up, down = boundary_latitudes(outline, place, eye_m, ceiling_m, WIDTH_PX)
    corner = corner_likelihood(outline, place, WIDTH_PX)
    for _ in range(looks):
        light, label = radiance(rng, stage, seen, tiles), seen.label
        if foot:
            light, label = add_foot(rng, light, label, eye_m)
        picture = photographed(rng, np.maximum(light, 0))
        yield Example((picture * 255 + 0.5).astype(np.uint8), small_labels(label), up, down, corner)

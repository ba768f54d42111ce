"""The recipe of the training views: batches of rooms, some from `mocks.rooms`, most of `training.rooms.house`."""

from __future__ import annotations

import time
from collections.abc import Iterator, Sequence
from pathlib import Path

import cv2
import numpy as np

from benchmarks.seeds import TRAIN, VALIDATION
from mocks.rooms.model import Part
from mocks.rooms.room import Room, make_room
from training.rooms.beyond import build_beyond
from training.rooms.house import draw_cameras, draw_eye_m, draw_house
from training.rooms.paints import Tile, bank_of
from training.rooms.pieces import Piece, built_in_pieces, folder_pieces, pieces_of
from training.rooms.props import furnish_house
from training.rooms.render import Stage, Standpoint, View, see
from training.rooms.soup import room_soup
from training.shards import write_shard

ROOMS_A_BATCH, HOUSES_A_BATCH = 2, 26
ROOM_CAMERAS, CAMERAS = 4, 3


def draw_batches(
    out: Path, split: str, numbers: range, *, minutes: float, waiting: int, furniture: tuple[Path, ...]
) -> None:
    """Write the batches of some numbers (batch n begins at seed 20 n of the split) that are not in the folder yet."""
    cv2.setNumThreads(1)
    tiles, pieces = bank_of(out), built_in_pieces() + folder_pieces(furniture)
    among, begun = TRAIN if split == "train" else VALIDATION, time.monotonic()
    for number in numbers:
        seed = among[20 * number]
        while len(list(out.glob("*.npz"))) >= waiting and time.monotonic() - begun < 60 * minutes:
            time.sleep(1)
        if time.monotonic() - begun > 60 * minutes:
            break
        if not (out / f"{seed:06d}.npz").exists():
            count = write_shard(out, seed, batch(seed, tiles, pieces=pieces))
            print(f"{seed}: {count} views, {time.monotonic() - begun:.0f} s", flush=True)  # noqa: T201


def batch(first_seed: int, tiles: list[Tile], *, pieces: Sequence[Piece] = ()) -> Iterator[View]:
    """Yield the views of a batch; it uses the seeds from ``first_seed`` on, `ROOMS_A_BATCH` of them for rooms.

    ``pieces`` stand in its houses beside the furniture of its rooms.
    """
    bank: list[Piece] = list(pieces)
    for seed in range(first_seed, first_seed + ROOMS_A_BATCH):
        room = make_room(seed)
        parts = room.parts()
        bank += pieces_of(room, parts)
        yield from _of_room(np.random.default_rng([seed, 81]), room, parts, tiles)
    for number in range(HOUSES_A_BATCH):
        yield from of_house(np.random.default_rng([first_seed, 82, number]), bank, tiles)


def _of_room(rng: np.random.Generator, room: Room, parts: list[Part], tiles: list[Tile]) -> Iterator[View]:
    """Yield a simulated room from its own camera, and, without its tripod, from others; furnished or emptied."""
    outline = np.array(room.plan.polygon)
    panes = [tuple(np.array(side, np.float64) for side in (p.corner, p.u, p.v)) for p in room.panes]
    if rng.random() < 0.2:
        own = {item.instance for item in room.items}
        parts = [part for part in parts if part.instance not in own]
    lamps = [_below(part) for part in parts if part.surface == "lamp"][:4]
    for number in range(ROOM_CAMERAS):
        mine = parts if number == 0 else [p for p in parts if p.surface != "tripod"]
        if number < 2:
            stage = Stage(room_soup(room, mine), panes, lamps=lamps)  # type: ignore[arg-type]
        place, eye_m = (0.0, 0.0), room.plan.camera_height_m
        if number:
            place, eye_m = draw_cameras(rng, outline, 1)[0], draw_eye_m(rng, room.plan.height_m)
        view = see(rng, stage, Standpoint(outline, room.plan.height_m, place, eye_m), tiles)
        if view is not None:
            yield view


def _below(part: Part) -> tuple[float, float, float]:
    v = part.mesh.vertices
    return (float(v[:, 0].mean()), float(v[:, 1].mean()), float(v[:, 2].min()) - 0.06)


def of_house(rng: np.random.Generator, bank: list[Piece], tiles: list[Tile]) -> Iterator[View]:
    """Yield the views of one drawn room."""
    house = draw_house(rng, CAMERAS)
    furnish_house(rng, house, bank)
    build_beyond(rng, house, bank)
    stage = Stage(house.soup, house.panes, house.portals, house.mirrors, house.lamps)
    for place, eye_m in zip(house.cameras, house.eyes_m, strict=True):
        view = see(rng, stage, Standpoint(house.outline, house.ceiling_m, place, eye_m), tiles)
        if view is not None:
            yield view

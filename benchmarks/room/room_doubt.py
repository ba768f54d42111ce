"""Rooms drawn to be mistaken, on test seeds: what confidence is worth where rooms are wrong often enough.

Rooms of `training.rooms.house` (closets, mirrors, open passages, slanted walls; the network never saw these), 512 x 256
from cameras at ease, beside walls and in doorways; some tilted, dark and noisy, or cropped and padded with black.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass
from functools import lru_cache
from typing import Any

import cv2
import numpy as np

from benchmarks.room.detect_truth import picture_of
from benchmarks.room.room_level import random_turn, tilted
from benchmarks.room.room_run import estimated
from benchmarks.room.room_scores import score_room
from benchmarks.seeds import seeds
from mocks.rooms.room import make_room
from mocks.rooms.truth import equirectangular
from processing.ground.arrays import Doubles, Floats
from processing.ground.room_model import RoomModel
from processing.pictures.images import RelativeImage
from processing.room.level import find_upright
from training.rooms.beyond import build_beyond
from training.rooms.house import House, draw_house
from training.rooms.light import Points, coarse, smoothed
from training.rooms.paints import Tile, make_bank
from training.rooms.pieces import Piece, built_in_pieces, pieces_of
from training.rooms.props import furnish_house
from training.rooms.render import Stage, Standpoint, View, see

HOUSES = 45
TEXTURES, FURNISHED = 4, 3
DARK, TILTED, CROPPED = 0.1, 0.22, 0.3
"""Cumulated shares of the cameras at ease."""


@dataclass(frozen=True)
class Doubtful:
    """A picture with its room."""

    name: str
    kind: str
    """plain, doorway, tilted, dark, cropped."""
    rgb: Floats
    floor: Doubles
    camera_height_m: float
    ceiling_height_m: float
    turn: Doubles
    """Of the camera; identity unless tilted."""


def doubtful(seed: int, number: int) -> Iterator[Doubtful]:
    """Yield the pictures of one room."""
    rng = np.random.default_rng([seeds("test", number + 1, seed)[number], 91])
    house = draw_house(rng, 2)
    furnish_house(rng, house, _pieces(seed))
    build_beyond(rng, house, _pieces(seed))
    stage = Stage(house.soup, house.panes, house.portals, house.mirrors, house.lamps)
    places = [("plain", *one) for one in zip(house.cameras, house.eyes_m, strict=True)]
    if house.portals and rng.random() < 0.5:
        places[1] = ("doorway", _in_doorway(rng, house), 1.5)
    for k, (kind, place, eye_m) in enumerate(places):
        view = see(rng, stage, Standpoint(house.outline, house.ceiling_m, place, eye_m), _tiles())
        if view is None:
            continue
        named, rgb, turn = _spoilt(rng, kind, _radiance(rng, view))
        floor = np.array(house.outline) - np.array(place)
        yield Doubtful(f"{number}-{k}", named, rgb, floor, eye_m, house.ceiling_m, turn)


def _radiance(rng: np.random.Generator, view: View) -> Floats:
    """Return a picture (H, W, 3) of a view: coats with their textures, light of sky, lamps, sun and surroundings."""
    coats, paint = view.coats[int(rng.integers(len(view.coats)))].astype(np.float32), np.maximum(view.paint, 0)
    albedo = coats[paint, :3]
    place = equirectangular(len(paint)) * view.reach_m.astype(np.float32)[..., None]
    flat = np.abs(view.normal[..., 2]) > 90
    along = np.where(np.abs(view.normal[..., 0]) > np.abs(view.normal[..., 1]), place[..., 1], place[..., 0])
    uv = np.stack([np.where(flat, place[..., 0], along), np.where(flat, place[..., 1], place[..., 2])], axis=-1)
    for number in np.unique(paint[(coats[paint, 3] >= 0) & (view.paint >= 0)]):
        mine, coat = paint == number, coats[number]
        footprint = view.reach_m[mine].astype(np.float32) * np.float32(np.pi / len(paint) / coat[4])
        relative = _tiles()[int(coat[3])].at(uv[mine] / coat[4], footprint)
        albedo[mine] *= np.maximum(1 + (relative - 1) * coat[6], 0.05)
    shares = rng.uniform((0.3, 0.0, 0.2), (1.0, 0.5, 1.0))
    parts = [one.astype(np.float32) for one in (view.sky, view.lamps, view.openness)]
    light = sum(s * part / max(float(part.mean()), 1e-6) for s, part in zip(shares, parts, strict=True))
    few = coarse(Points(place, view.normal.astype(np.float32) / 127, view.paint >= 0))
    even = smoothed(few, smoothed(few, np.asarray(light, np.float32)[..., None], reach=3), reach=3)[..., 0]
    wide = cv2.resize(even, paint.shape[::-1], interpolation=cv2.INTER_LINEAR)
    if rng.random() < 0.5:
        facing = np.maximum(view.normal.astype(np.float32) @ view.suns[0] / 127, 0)
        wide = wide + (view.sun & 1) * facing * np.float32(rng.uniform(1.5, 15))
    out = albedo * wide[..., None] + coats[paint, 8:] * np.float32(rng.uniform(2, 12))
    out[view.paint < 0] = rng.uniform(2, 20)
    # A tripod's foot, or the blurred disc in its place.
    down = np.arccos(np.clip(-equirectangular(len(paint))[..., 2], -1, 1))
    out[down < np.radians(rng.uniform(0, 9))] = rng.uniform(0, 1) * float(np.median(out))
    return np.asarray(out, np.float32)


def _in_doorway(rng: np.random.Generator, house: House) -> tuple[float, float]:
    portal = house.portals[int(rng.integers(len(house.portals)))]
    x0, _, x1, _ = portal.rect
    x, y = portal.frame.world([((x0 + x1) / 2, float(rng.uniform(0.02, 0.35)), 0.0)])[0][:2]
    return float(x), float(y)


def _spoilt(rng: np.random.Generator, kind: str, light: Floats) -> tuple[str, Floats, Doubles]:
    chance, upright = rng.random(), np.eye(3)
    if kind != "plain" or chance >= CROPPED:
        return kind, light, upright
    if chance < DARK:
        counts = light / np.median(light) * float(rng.uniform(1, 5))
        noisy = rng.poisson(counts * 8) / 8 + rng.normal(0, 0.4, counts.shape)
        return "dark", np.maximum(noisy, 0).astype(np.float32), upright
    if chance < TILTED:
        turn = random_turn(rng)
        return "tilted", tilted(light, turn), turn
    cut, rows = light.copy(), int(rng.uniform(16, 50))
    cut[:rows] = cut[-rows:] = 0
    return "cropped", cut, upright


@lru_cache(maxsize=1)
def _tiles() -> list[Tile]:
    return make_bank(TEXTURES)


@lru_cache(maxsize=2)
def _pieces(seed: int) -> list[Piece]:
    rooms = [make_room(number) for number in seeds("test", FURNISHED, seed + 1)]
    return built_in_pieces() + [piece for room in rooms for piece in pieces_of(room, room.parts())]


def doubt_rows(seed: int, number: int) -> list[dict[str, Any]]:
    """Return kind, stated confidence and 3D IoU (0 where refused) of one room's pictures."""
    rows = []
    for one in doubtful(seed, number):
        image = picture_of(one.rgb)
        found = estimated(image, with_openings=False)
        iou = score_room(found.estimate.room, _true(one, image)).iou3d if found.estimate else 0.0
        rows.append({"kind": one.kind, "confidence": found.confidence, "iou3d": iou, "refusal": found.refusal})
    return rows


def _true(one: Doubtful, image: RelativeImage) -> RoomModel:
    """Return the room in the axes of the upright picture, which a tilted camera turns about the vertical."""
    turn = find_upright(image).rotation @ one.turn.T if one.kind == "tilted" else np.eye(3)
    ahead = math.atan2(turn[0, 1], turn[1, 1])
    c, s = math.cos(ahead), math.sin(ahead)
    floor = one.floor @ np.array([[c, -s], [s, c]])
    return RoomModel.model_construct(
        floor=tuple((float(x), float(y)) for x, y in floor),
        camera_height_m=one.camera_height_m,
        ceiling_height_m=one.ceiling_height_m,
        openings=(),
    )

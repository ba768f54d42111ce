"""Masks that miss some: filling with the rests of things standing beside the hole.

``python -m benchmarks.removal.rests [ROOMS]``: simulated rooms of validation seeds; furniture's mask is eroded, so
that a rim of everything stays, and of rugs every other half metre is in it. What is filled on the floor is compared
with the truly emptied room, with the check of sources (`plane_sources`) and without.
"""

from __future__ import annotations

import sys
from unittest.mock import patch

import cv2
import numpy as np

from benchmarks.removal.real import encoded, image_of
from benchmarks.removal.rooms import MIDDLE
from benchmarks.removal.scores import scored
from benchmarks.room.detect_truth import LYING
from benchmarks.truth_rooms import kept_list, room_model_of, truth_of
from mocks.rooms.room import Room
from mocks.rooms.truth import TruthPictures
from processing.ground.arrays import Flags
from processing.pictures.images import luminance_cd_m2
from processing.removal import plane_fill
from processing.removal.fill import empty_room
from processing.surfaces.maps import FLOOR, surface_maps

ERODED_PX = 7
HALF_M = 0.5
SHARD = 0.15
"""Natural logarithm of red over blue, from which a place has another colour than the floor."""


def careless_mask(room: Room, truth: TruthPictures) -> Flags:
    """Return a target that leaves a rim of all furniture and halves of rugs."""
    kernel = np.ones((ERODED_PX, ERODED_PX), np.uint8)
    things = cv2.erode((truth.furniture | truth.tripod).astype(np.uint8), kernel).astype(bool)
    model, geometry = room_model_of(room), image_of(truth.empty_rgb).geometry
    maps = surface_maps(model, geometry)
    height, width = truth.furniture.shape
    longitude = ((np.arange(width) + 0.5) / width - 0.5) * 2 * np.pi
    latitude = (0.5 - (np.arange(height) + 0.5) / height) * np.pi
    x = maps.depth_m * np.cos(latitude)[:, None] * np.sin(longitude)[None]
    rugs = np.isin(truth.instance, [item.instance for item in room.items if item.kind in LYING])
    return np.asarray(things | (rugs & (np.floor(x / HALF_M) % 2 > 0)))


def measured(room: Room, truth: TruthPictures) -> list[tuple[float, ...]]:
    """Return for the filling without and with the check: median and 95 % error, texture distance, share of shards."""
    target, model = careless_mask(room, truth), room_model_of(room)
    floor = target & (surface_maps(model, image_of(truth.empty_rgb).geometry).plane == FLOOR)
    true = luminance_cd_m2(truth.empty_rgb)
    scale = MIDDLE / float(np.median(true))
    rows = []
    for check in (lambda values, sources, px_per_m: sources, plane_fill.plane_sources):
        with patch.object(plane_fill, "plane_sources", check):
            found = empty_room(image_of(truth.luminance_rgb), target, model).image.rgb
        off = np.abs(luminance_cd_m2(found) / true - 1)[floor]
        tints = [np.log(np.maximum(p[..., 0], 1e-6) / np.maximum(p[..., 2], 1e-6)) for p in (found, truth.empty_rgb)]
        shards = np.abs(tints[0] - np.median(tints[0][floor]) - tints[1] + np.median(tints[1][floor]))[floor] > SHARD
        texture = scored(encoded(found * scale), encoded(truth.empty_rgb * scale), floor, 0).texture
        rows.append((100 * np.median(off), 100 * np.percentile(off, 95), texture, 100 * shards.mean()))
    return rows


def main(count: int) -> None:
    """Print a line a room and the means."""
    every = []
    for number, use in kept_list("validation", 16)[:count]:
        room, truth = truth_of(number, use)
        every.append(measured(room, truth))
        print(room.name, *(" / ".join(f"{v:.2f}" for v in row) for row in every[-1]), sep="  ", flush=True)
    print("mean", *(" / ".join(f"{v:.2f}" for v in row) for row in np.mean(every, axis=0)), sep="  ")


if __name__ == "__main__":
    main(int(sys.argv[1]) if len(sys.argv) > 1 else 8)

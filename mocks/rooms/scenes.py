"""Rooms by the name of a scene: the same name is the same room, whenever it is photographed."""

from __future__ import annotations

import hashlib
import math
from dataclasses import replace
from functools import lru_cache

import numpy as np

from mocks.rooms.model import Use
from mocks.rooms.room import Room, make_room
from mocks.rooms.sky.daylight import Moment
from mocks.rooms.sky.sky import SHARES, CloudDrift, Kind, Sky, draw_sky

_DOMAIN = 5100  # parts these random numbers from all others of a seed
_SEEDS = 10**9
_WORDS = (
    (Use.BEDROOM, ("bed", "guest", "nursery")),
    (Use.DINING, ("kitchen", "dining")),
    (Use.LIVING, ("living", "front", "lounge", "basement", "family")),
    (Use.OFFICE, ("office", "coda", "study", "lab")),
)
CLOUD_AMPLITUDE: dict[Kind, float] = {"clear": 0.3, "intermediate": 0.9, "overcast": 0.0}
"""How much of the sun passing clouds take, by sky; a closed cover does not change within minutes."""


def use_of(scene: str) -> Use:
    """Return what a room of that name is for; any other name is a living room or an office by its digest."""
    lower = scene.lower()
    for use, words in _WORDS:
        if any(word in lower for word in words):
            return use
    return (Use.LIVING, Use.OFFICE, Use.BEDROOM, Use.DINING)[_digest(lower) % 4]


def seed_of(scene: str, seed: int = 0) -> int:
    """Return the seed of a scene's room, among the rooms of a data set's ``seed``."""
    return _digest(f"{seed} {scene.lower()}") % _SEEDS


def scene_room(
    scene: str,
    moment: Moment,
    *,
    use: Use | str | None = None,
    seed: int = 0,
    lamps_on: bool = False,
    illuminance_lux: float | None = None,
) -> Room:
    """Return the room of a scene at a moment.

    What stands in it and what it looks out on follow from ``scene``, ``use`` and ``seed`` alone; the sky is drawn
    for the moment, of the kind whose open horizontal illuminance is nearest to ``illuminance_lux``.
    """
    number = seed_of(scene, seed)
    room = _scene(number, Use(use) if use is not None else use_of(scene), lamps_on)
    minute = int(moment.utc.timestamp()) // 60
    skies = {kind: draw_sky(np.random.default_rng([number, _DOMAIN, minute]), moment, kind) for kind in SHARES}
    kind = _drawn_kind(number, minute) if illuminance_lux is None else nearest_kind(skies, illuminance_lux)
    sky = replace(skies[kind], seed=room.sky.seed, eye_height_m=room.sky.eye_height_m)
    return replace(room, moment=moment, sky=sky)


def nearest_kind(skies: dict[Kind, Sky], illuminance_lux: float) -> Kind:
    """Return the kind of sky whose open horizontal illuminance is nearest, as a ratio; ValueError unless above 0."""
    if not illuminance_lux > 0:
        raise ValueError(f"an illuminance of {illuminance_lux} lx says nothing of the sky")
    return min(skies, key=lambda kind: abs(math.log(sum(skies[kind].horizontal_illuminance_lx()) / illuminance_lux)))


def clouds_of(room: Room) -> CloudDrift:
    """Return the clouds that pass during a session in this room."""
    seed = int(room.moment.utc.timestamp()) // 60 + room.seed
    return CloudDrift(amplitude=CLOUD_AMPLITUDE[room.sky.kind], seed=seed)


@lru_cache(maxsize=16)
def _scene(seed: int, use: Use, lamps_on: bool) -> Room:
    return make_room(seed, use, lamps_on=lamps_on)


def _drawn_kind(seed: int, minute: int) -> Kind:
    rng = np.random.default_rng([seed, _DOMAIN, minute, 1])
    return tuple(SHARES)[int(rng.choice(len(SHARES), p=tuple(SHARES.values())))]


def _digest(text: str) -> int:
    return int.from_bytes(hashlib.sha256(text.encode()).digest()[:8], "big")

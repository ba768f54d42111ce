"""Real empty rooms into which rendered furniture with its shadows is put: the untouched picture is the exact truth.

ZInD rooms with their drawn layouts, and an HDR panorama of an empty flat (CC0) with the room that we estimate from it.
Furniture is arranged and rendered by the program (`processing.light.picture.composite.differential`), which plays no
part in what is measured: filling sees the composed picture and the mask alone. Composites are kept in the cache.
"""

from __future__ import annotations

import hashlib
import json
from collections.abc import Iterator
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np

from benchmarks.removal.real import DATA, WHITE_CD_M2, image_of
from benchmarks.room.detect_truth import photograph, picture_of
from mocks.optics.picture_cache import default_folder
from processing.errors import DaylitError
from processing.ground.arrays import Flags, Floats
from processing.ground.room_model import RoomModel
from processing.pictures.images import luminance_cd_m2
from processing.room.readers import zind_pictures, zind_room

ROWS = 512
VERSION = 1
HDR_ROOM = "lebombo_1k"
SETS = ("bedroom", "living", "office", "dining")
LEAST_PIECES = 3
SHADOW = 0.7
"""Of the light that furniture leaves beside it, below which it is its near shadow."""
GROWN_PX = 5


@dataclass(frozen=True)
class Composite:
    """A real room, empty and furnished, in the same unit; everything (H, 2 H)."""

    name: str
    room: RoomModel
    empty: Floats
    furnished: Floats
    target: Flags
    """Furniture, two pixels more, and its near shadow."""


def composites(most: int) -> Iterator[Composite]:
    """Yield up to so many; the HDR room first. Rooms that hold too little furniture are left out."""
    found = 0
    for name, path, room in _rooms():
        if found == most:
            return
        made = _composite(name, path, room)
        if made is not None:
            found += 1
            yield made


def near_shadow(things: Flags, ratio: Floats) -> Flags:
    """Return things, two pixels more, and the dark beside them; ``ratio`` (H, W): which part of the light is left."""
    wide = cv2.dilate(things.astype(np.uint8), np.ones((GROWN_PX,) * 2, np.uint8)).astype(bool)
    left = cv2.blur(ratio.astype(np.float32), (3, 3))
    near = cv2.dilate(wide.astype(np.uint8), np.ones((25, 25), np.uint8)).astype(bool)
    return np.asarray(wide | (near & (left < SHADOW * np.median(left[~wide]))))


def _rooms() -> Iterator[tuple[str, Path, RoomModel | None]]:
    """Yield name, file and layout; None: to be estimated."""
    hdr = DATA / "panoramas" / "hdr" / f"{HDR_ROOM}.hdr"
    if hdr.exists():
        yield HDR_ROOM, hdr, None
    folder = DATA / "panoramas" / "zind"
    if not folder.exists():
        return
    drawn = zind_pictures(json.loads((folder / "zind_data.json").read_text("utf-8")))
    for path in sorted(folder.glob("*.jpg")):
        with suppress(DaylitError):
            yield path.stem, path, zind_room(drawn[path.stem])


def _composite(name: str, path: Path, room: RoomModel | None) -> Composite | None:
    empty = _light(path)
    try:
        known = _estimated(empty) if room is None else room
    except ValueError:
        return None
    kept = _place(path)
    if not kept.exists():
        made = _furnished(empty, known)
        kept.parent.mkdir(parents=True, exist_ok=True)
        rgb, furniture = (np.zeros((0, 0, 3), np.float32), np.zeros((0, 0), bool)) if made is None else made
        part = kept.with_suffix(".part.npz")
        np.savez_compressed(part, rgb=rgb.astype(np.float32), furniture=furniture)
        part.replace(kept)
    with np.load(kept) as file:
        rgb, furniture = file["rgb"], file["furniture"]
    if not rgb.size:
        return None
    ratio = luminance_cd_m2(rgb) / np.maximum(luminance_cd_m2(empty), 1e-6)
    return Composite(name, known, empty, rgb, near_shadow(furniture, ratio))


def _place(path: Path) -> Path:
    key = hashlib.sha256(path.read_bytes() + f"{VERSION} {ROWS}".encode()).hexdigest()
    return default_folder().parent / "composites" / f"{path.stem}-{key[:12]}.npz"


def _light(path: Path) -> Floats:
    """Return the panorama's light (H, 2 H, 3); its middle of brightness as a room's."""
    if path.suffix == ".hdr":
        light = cv2.imread(str(path), cv2.IMREAD_UNCHANGED)[..., ::-1].astype(np.float32)
        light = light * np.float32(0.18 / float(np.median(luminance_cd_m2(np.ascontiguousarray(light)))))
    else:
        light = photograph(path).rgb
    small = cv2.resize(np.ascontiguousarray(light), (2 * ROWS, ROWS), interpolation=cv2.INTER_AREA)
    return np.asarray(small * np.float32(WHITE_CD_M2), np.float32)


def _estimated(light: Floats) -> RoomModel:
    from benchmarks.room.room_run import estimated

    found = estimated(picture_of(light))
    if found.estimate is None:
        raise ValueError(found.refusal)
    return found.estimate.room.model_copy(update={"openings": found.openings})


def _furnished(empty: Floats, room: RoomModel) -> tuple[Floats, Flags] | None:
    """Return the room with furniture, and where that is seen; None where hardly any fits."""
    from processing.layout.models.catalogue import Catalogue
    from processing.light.picture.composite import differential
    from processing.light.scene.albedo import albedo_of_room
    from processing.light.solver.irradiance import EFFORTS
    from processing.stages.furnishing import furniture_parts

    items = _arranged(room)
    if len(items) < LEAST_PIECES:
        return None
    scene = albedo_of_room(image_of(empty), room, None, rows=256, effort=EFFORTS["draft"]).scene
    parts = furniture_parts(items, Catalogue.builtin())
    made = differential(empty, scene, parts, (0.0, 0.0, room.camera_height_m), effort=EFFORTS["draft"])
    return made.rgb, np.asarray(made.furniture, bool)


def _arranged(room: RoomModel) -> tuple:  # type: ignore[type-arg]
    """Return the placed items of the set of which the room holds most."""
    from processing.layout.arrange import arrange
    from processing.layout.assumed import with_door
    from processing.layout.items import set_items
    from processing.layout.plan import from_room_model

    best: tuple = ()  # type: ignore[type-arg]
    for name in SETS:
        try:
            plan = from_room_model(with_door(room)[0], name=name, keep_camera_free=True)
            found = arrange(plan, set_items(name), n=1, seed=1).arrangements
        except DaylitError:
            continue
        if found and len(found[0].items) > len(best):
            best = found[0].items
    return best

"""Simulated rooms with all their truth, made once and kept: what room, removal and rendering are measured by.

The truth of a room is kept in ``$DAYLIT_CACHE/truth`` (a folder a room, about 20 MB at 512 rows). As a program,
``python -m benchmarks.truth_rooms validation 16`` fills it: some ten CPU seconds a room.
"""

from __future__ import annotations

import os
import shutil
import sys
import tempfile
import time
from contextlib import suppress
from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.seeds import Split, seeds
from benchmarks.truth_files import load_truth
from mocks.optics.picture_cache import content_key, default_folder
from mocks.rooms.model import Use
from mocks.rooms.room import Room, make_room
from mocks.rooms.truth import TruthFileError, TruthPictures, save_truth, truth_pictures
from mocks.rooms.world import RoomWorld
from processing.ground.room_model import Opening, OpeningKind, RoomModel

USES = (Use.BEDROOM, Use.LIVING, Use.OFFICE, Use.DINING)
ROWS, QUALITY = 512, "sketch"
LIGHT_QUALITY = "draft"
"""Where light is judged: furnished and emptied rooms of `sketch` are each 4 to 7 % off `standard`, of `draft` 2.5 %
(one room measured: docs/measurements/emptying.md)."""
LIGHT_TRUTH: Any = {"rows": 420, "quality": LIGHT_QUALITY}
"""What `emptying` makes of all 24 test rooms: what is judged by it too has as many rooms at no further cost."""
TRUTH_VERSION = 1


def truth_folder(room: Room, rows: int, quality: str) -> Path:
    """Return where a room's truth is kept, or would be."""
    key = content_key("truth pictures", TRUTH_VERSION, RoomWorld(room, quality).key, rows)
    return default_folder().parent / "truth" / f"{room.name}-{key[:12]}"


def truth_of(
    seed: int, use: Use | str | None = None, rows: int = ROWS, quality: str = QUALITY
) -> tuple[Room, TruthPictures]:
    """Return a room, furnished and emptied, with its truth; from the cache, or made now. ``use`` None draws one."""
    room = make_room(seed, use)
    folder = truth_folder(room, rows, quality)
    with suppress(TruthFileError):
        kept = load_truth(folder).pictures
        if np.isfinite(kept.luminance_rgb).all() and np.isfinite(kept.empty_rgb).all():
            return room, kept
    pictures = truth_pictures(RoomWorld(room, quality), rows)
    _keep(folder, room, pictures)
    return room, pictures


def _keep(folder: Path, room: Room, pictures: TruthPictures) -> None:
    """Put a truth in its place; of two processes that made the same, either's stays."""
    folder.parent.mkdir(parents=True, exist_ok=True)
    making = Path(tempfile.mkdtemp(dir=folder.parent, prefix=".making-"))
    try:
        save_truth(making / "truth", room, pictures, [])
        if folder.exists():
            # It was not whole, or it would have been taken.
            shutil.rmtree(folder, ignore_errors=True)
        with suppress(OSError):
            os.replace(making / "truth", folder)  # noqa: PTH105
    finally:
        shutil.rmtree(making, ignore_errors=True)


def truth_list(split: Split, count: int, seed: int = 0) -> list[tuple[int, Use]]:
    """Return seeds and uses of ``count`` rooms; bedrooms, living rooms, offices and dining rooms in turn."""
    return [(number, USES[i % len(USES)]) for i, number in enumerate(seeds(split, count, seed))]


@lru_cache(maxsize=512)
def is_kept(seed: int, use: Use | str | None = None, rows: int = ROWS, quality: str = QUALITY) -> bool:
    """Return whether a room's truth is in the cache."""
    return truth_folder(make_room(seed, use), rows, quality).is_dir()


def kept_list(
    split: Split, count: int, seed: int = 0, rows: int = ROWS, quality: str = QUALITY
) -> list[tuple[int, Use]]:
    """Return those of `truth_list` that are in the cache; where none is, the first one (it will be made)."""
    listed = truth_list(split, count, seed)
    return [one for one in listed if is_kept(*one, rows=rows, quality=quality)] or listed[:1]


def room_model_of(room: Room) -> RoomModel:
    """Return the true room: floor, heights, windows and doors (a glass door is a window down to the floor)."""
    plan = room.plan
    windows = [
        Opening(
            kind=OpeningKind.WINDOW,
            wall=w.wall,
            start_m=w.start_m,
            end_m=w.start_m + w.width_m,
            sill_m=w.sill_m,
            head_m=w.sill_m + w.height_m,
        )
        for w in plan.windows
    ]
    doors = [
        Opening(
            kind=OpeningKind.DOOR,
            wall=d.wall,
            start_m=d.start_m,
            end_m=d.start_m + d.width_m,
            sill_m=0.0,
            head_m=d.height_m,
        )
        for d in plan.doors
    ]
    return RoomModel(
        source="given",
        floor=plan.polygon,
        camera_height_m=plan.camera_height_m,
        ceiling_height_m=plan.height_m,
        openings=(*windows, *doors),
    )


def main(split: Split, count: int) -> None:
    """Fill the cache, one room after the other, saying what each took."""
    for number, use in truth_list(split, count):
        start_s = time.process_time()
        room, _ = truth_of(number, use)
        print(f"{split} {room.name}: {time.process_time() - start_s:.1f} CPU s", flush=True)


if __name__ == "__main__":
    asked = sys.argv[1]
    if asked not in ("train", "validation", "test"):
        sys.exit("give validation or test, and how many")
    main(asked, int(sys.argv[2]))  # type: ignore[arg-type]

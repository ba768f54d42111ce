"""Real panoramas with true layouts: which half may be looked at and which is only scored, and their truth."""

from __future__ import annotations

import json
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

import numpy as np
import shapely

from benchmarks.room.detect_truth import photograph
from benchmarks.shared_data import DATA
from processing.ground.room_model import RoomModel
from processing.pictures.images import RelativeImage
from processing.room.readers import panoannotator_room, zind_pictures

Half = Literal["looked at", "scored"]


@dataclass(frozen=True)
class RealRoom:
    """A panorama with its layouts: ``raw`` is the room as drawn, ``visible`` all that is seen through openings."""

    name: str
    path: Path
    raw: RoomModel
    visible: RoomModel | None

    @property
    def picture(self) -> RelativeImage:
        """Return the panorama as linear light."""
        return photograph(self.path)


def real_rooms(half: Half) -> list[RealRoom]:
    """Return the ZInD pictures of a half, by name: every second, beginning with the first, may be looked at."""
    folder = DATA / "panoramas" / "zind"
    if not folder.exists():
        return []
    pictures = zind_pictures(json.loads((folder / "zind_data.json").read_text("utf-8")))
    names = sorted(path.stem for path in folder.glob("*.jpg"))
    return [
        RealRoom(
            name, folder / f"{name}.jpg", *(_drawn(pictures[name], key) for key in ("layout_raw", "layout_visible"))
        )
        for number, name in enumerate(names)
        if (number % 2 == 0) == (half == "looked at")
    ]


def camera_inside(room: RoomModel) -> bool:
    """Return whether the camera stands inside of a room as drawn, not in a doorway beside it."""
    return bool(shapely.Polygon(room.floor).contains(shapely.Point(0, 0)))


def labelled_rooms(half: Half) -> list[RealRoom]:
    """Return the pictures of ``layout_gt``: the first may be looked at, the others are only scored."""
    folder = DATA / "panoramas" / "layout_gt"
    if not folder.exists():
        return []
    files = sorted(folder.glob("*.json"))
    chosen = files[:1] if half == "looked at" else files[1:]
    found = []
    for file in chosen:
        room = panoannotator_room(json.loads(file.read_text("utf-8")), camera_height_m=1.6)
        picture = next(p for p in sorted(folder.glob(f"{file.stem}.*")) if p.suffix in (".jpg", ".png"))
        found.append(RealRoom(file.stem, picture, room, None))
    return found


def _drawn(picture: dict[str, Any], layout: str) -> RoomModel | None:
    """Return a ZInD layout as drawn, unchecked: cameras in doorways stand outside of theirs."""
    if layout not in picture:
        return None
    corners = np.array(picture[layout]["vertices"]) * (-1.6, 1.6)
    following = np.roll(corners, -1, axis=0)
    if (corners[:, 0] * following[:, 1] - corners[:, 1] * following[:, 0]).sum() < 0:
        corners = corners[::-1]
    return RoomModel.model_construct(
        floor=tuple((float(x), float(y)) for x, y in corners),
        camera_height_m=1.6,
        ceiling_height_m=1.6 * picture["ceiling_height"] / picture["camera_height"],
        openings=(),
    )

"""How a session's pictures are shown: its one display, and where its pictures look out of a window."""

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np

from processing.errors import ProcessingError, ResultFileError
from processing.exchange.jpeg_files import FURNITURE, PHOTOGRAPH, STAGED, Made, lit_by, removed_by
from processing.ground.arrays import Bytes, Floats
from processing.ground.finished import Finished
from processing.ground.room_model import RoomModel, read_json, read_room
from processing.light.scene.scene import REVEAL_M
from processing.pictures.display import AS_GIVEN, LEAST_VIEW, Display, display_of, spot_colour
from processing.pictures.exr import read_exr
from processing.pictures.images import LuminanceImage, luminance_cd_m2
from processing.sphere import Equirectangular, Geometry
from processing.surfaces.maps import opening_map
from station.session.store import load_manifest

SASH_M = 0.06  # width of a sash's frame, seen within its opening; chosen
VIEW_OF_IT = 0.05  # share of an opening that is as bright as a view, from which it shows one; chosen
DISPLAY_FILE = Path("stages", "stills", "display.json")
"""Of a session: the display that its stills were made with, which all else follows."""


@dataclass(frozen=True)
class Shown:
    """How a session is shown."""

    display: Display
    room: RoomModel | None
    """None: no windows are known."""

    def rgb8(self, rgb: Floats, geometry: Geometry) -> Bytes:
        """Return a picture (H, W, 3) from the camera's place, linear, in the session's unit, as sRGB codes."""
        panes = panes_of(self.room, geometry, self.display.views)
        return self.display.shown(rgb, panes, around=isinstance(geometry, Equirectangular))


@lru_cache(maxsize=2)
def panes_of(room: RoomModel | None, geometry: Geometry, views: tuple[int, ...] | None = None) -> Bytes | None:
    """Return where an upright panorama shows windows and doors (H, W), since doors may be glazed; None: none known.

    1: an opening's reveal and frame, as deep and wide as they usually are; 2: its glass. ``views``: see `Display`.
    """
    if room is None or not isinstance(geometry, Equirectangular) or not room.openings:
        return None
    if views is not None:  # as the room was when its stills were made: it may have been corrected since
        room = room.model_copy(update={"openings": tuple(o for i, o in enumerate(room.openings) if i in views)})
    glass = opening_map(room, geometry, REVEAL_M, SASH_M) >= 0
    return np.add(opening_map(room, geometry) >= 0, glass, dtype=np.uint8)


def shown_as(
    photograph: LuminanceImage, indoor: LuminanceImage, measured: Mapping[str, Any], room: RoomModel | None, mode: str
) -> Shown:
    """Return how a session is shown.

    ``photograph``: the upright panorama; ``indoor``: as it was calibrated, in which ``measured`` (the JSON of the
    stage's side indoor) says where the board is; ``mode``: of the session's bracket ("panorama": a picture as some
    camera balanced it).
    """
    target, board = measured.get("target") or {}, None
    if "longitude_deg" in target and isinstance(indoor.geometry, Equirectangular):
        longitude = math.radians(target["longitude_deg"]) - indoor.geometry.yaw_rad
        board = spot_colour(indoor.rgb, longitude, math.radians(target["latitude_deg"]))
    panes = panes_of(room, photograph.geometry)
    display = display_of(photograph.rgb, board_rgb=board, panes=panes, balanced=mode == "panorama")
    return Shown(display if room is None else replace(display, views=_views(display, photograph, room)), room)


def _views(display: Display, photograph: LuminanceImage, room: RoomModel) -> tuple[int, ...]:
    """Return the openings in which the photograph shows something bright: not a wardrobe that was taken for a door, in
    whose place there will be a bright wall."""
    step = max(1, photograph.rgb.shape[1] // 1024)
    sample = np.ascontiguousarray(photograph.rgb[step // 2 :: step, step // 2 :: step])
    level = luminance_cd_m2(display.balanced(sample))
    opening = opening_map(room, Equirectangular(level.shape[1], level.shape[0]))
    every = [level[opening == number] for number in range(len(room.openings))]
    return tuple(number for number, own in enumerate(every) if (own > LEAST_VIEW).sum() > VIEW_OF_IT * own.size)


def session_shown(session: Path) -> Shown:
    """Return how a processed session is shown: as its stills are, else from its pictures."""
    stages = session / "stages"
    try:
        room = read_room(stages / "room" / "room.json")
    except (ProcessingError, OSError):
        room = None
    if (session / DISPLAY_FILE).is_file():
        return Shown(Display.read(read_json(session / DISPLAY_FILE, ProcessingError)), room)
    indoor = _picture(stages / "calibrate" / "indoor.exr")
    photograph = photograph_of(session)
    if indoor is None or photograph is None:
        return Shown(AS_GIVEN, room)
    facts_file = stages / "calibrate" / "calibration.json"
    facts = read_json(facts_file, ProcessingError) if facts_file.is_file() else {}
    return shown_as(photograph, indoor, facts.get("indoor") or {}, room, load_manifest(session).bracket.mode)


def made_of(session: Path, name: str, **more: Any) -> Made:
    """Return what a session's picture of a name (empty, staged-2) is, by what its stages did; ``more``: see `Made`."""
    try:
        done = Finished(session, "remove")
        removed = removed_by(done.facts) if "empty.exr" in done else ""
        lit = lit_by(name, lambda stage: Finished(session, stage).facts)
    except ResultFileError:
        removed, lit = FURNITURE, True  # nobody knows: nothing is said to be unchanged
    made = Made.of(name, removed=removed, lit=lit, **more)
    return made if removed or made.state == STAGED else made._replace(state=PHOTOGRAPH)


def standing_sha256(session: Path, name: str) -> str:
    """Return the SHA-256 of a session's picture of a name (empty, staged-2), as its stage has it; empty: none."""
    stage, file = ("remove", "empty.exr") if name == "empty" else ("render", f"{name}.exr")
    try:
        return str(Finished(session, stage).facts["files"][file]["sha256"])
    except (ResultFileError, KeyError):
        return ""


def photograph_of(session: Path) -> LuminanceImage | None:
    """Return the room's panorama as it was calibrated, upright where it was made so; None: there is none."""
    stages = session / "stages"
    return _picture(stages / "room" / "panorama.exr") or _picture(stages / "calibrate" / "indoor.exr")


def _picture(path: Path) -> LuminanceImage | None:
    found = read_exr(path) if path.is_file() else None
    return found if isinstance(found, LuminanceImage) else None

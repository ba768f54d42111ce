"""A session's room estimated again around what somebody has placed, from what the stage room has kept."""

import math
from pathlib import Path

from processing.errors import ParameterError
from processing.ground.finished import RESULT_NAME
from processing.ground.room_model import RoomModel, read_json, read_room
from processing.pictures.exr import read_exr
from processing.pictures.images import LuminanceImage
from processing.room.estimate import estimate_room
from processing.room.held import Held
from processing.room.opening_sun import find_openings_in_sun
from processing.running.screens import picture_of
from processing.segmentation.evidence import read_evidence
from processing.stages.upright import sun_direction
from station.session.store import load_manifest

MOST_BYTES = 1 << 22  # of a stage's result; chosen


def room_around(session: Path, room: RoomModel) -> RoomModel:
    """Return the room with what ``room`` holds (`RoomModel.held`; else all in which it differs from the estimate).

    Raises `ParameterError` where the stage room has not run, `NoRoomError` where no room fits around what is held.
    """
    stages = session / "stages"
    evidence_path, picture = stages / "room" / "evidence.npz", picture_of(session, "Photograph")
    if picture is None or not evidence_path.is_file():
        raise ParameterError("no estimate yet", where=session.name, advice="process it until room, not --room")
    image, evidence = read_exr(picture), read_evidence(evidence_path)
    assert isinstance(image, LuminanceImage)
    facts = read_json(stages / "room" / RESULT_NAME, most_bytes=MOST_BYTES)
    azimuth = facts.get("metrics", {}).get("walls_azimuth_deg")
    held = Held.of(room, read_room(stages / "room" / "room.json"))
    manhattan_rad = None if azimuth is None else math.radians(azimuth)
    found = estimate_room(image, evidence, camera_height_m=room.camera_height_m, manhattan_rad=manhattan_rad, held=held)
    sky = stages / "calibrate" / "outdoor.exr"
    outdoor = read_exr(sky) if sky.is_file() else None
    sun = sun_direction(load_manifest(session))
    openings = find_openings_in_sun(image, evidence, found.room, sun, outdoor=outdoor)  # type: ignore[arg-type]
    made = found.room.model_copy(update={"openings": held.openings(found.room, openings)})
    return RoomModel.model_validate_json(made.model_dump_json())

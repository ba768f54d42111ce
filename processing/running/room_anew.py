"""A session's room estimated again around what somebody has placed, from what the stage room has kept."""

import math
from dataclasses import replace
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
from processing.stages.room import LEAST_SQUARE
from processing.stages.upright import sky_shows_sun, sun_direction
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
    own = evidence if evidence.own is None else replace(evidence, probabilities=evidence.own, own=None)
    facts = read_json(stages / "room" / RESULT_NAME, most_bytes=MOST_BYTES).get("metrics", {})
    square = facts.get("walls_square", LEAST_SQUARE) >= LEAST_SQUARE and "walls_azimuth_deg" in facts
    held = Held.of(room, read_room(stages / "room" / "room.json"))
    manhattan_rad = math.radians(facts["walls_azimuth_deg"]) if square else None
    found = estimate_room(image, own, camera_height_m=room.camera_height_m, manhattan_rad=manhattan_rad, held=held)
    sky = stages / "calibrate" / "outdoor.exr"
    outdoor = read_exr(sky) if sky.is_file() else None
    light = stages / "calibrate" / "calibration.json"
    shone = sky_shows_sun(read_json(light, most_bytes=MOST_BYTES) if light.is_file() else None)
    sun = None if shone is False else sun_direction(load_manifest(session))
    seen = evidence if evidence.networks > 1 else own  # a network of yours finds furniture alone
    openings = find_openings_in_sun(image, seen, found.room, sun, outdoor=outdoor)  # type: ignore[arg-type]
    made = found.room.model_copy(update={"openings": held.openings(found.room, openings)})
    return RoomModel.model_validate_json(made.model_dump_json())

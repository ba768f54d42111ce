"""A floor plan from a room's model, and from whatever a user names: a plan, a room file, or a session."""

from __future__ import annotations

from pathlib import Path

from processing.errors import PlanError
from processing.layout.plan import Door, FloorPlan, Window, make_plan
from processing.layout.plan_files import read_plan
from processing.room.model import OpeningKind, RoomModel
from processing.room.model_file import read_json, read_room

IN_A_SESSION = ("room.json", "stages/room/room.json")
"""Where a session keeps its room: corrected by hand first, then as estimated."""


def from_room_model(room: RoomModel, *, keep_camera_free: bool = False, name: str = "room") -> FloorPlan:
    """Return the plan of a room's model; a passage is a door without a leaf."""
    doors = [
        Door(
            opening.wall,
            opening.start_m,
            opening.end_m,
            swing="sliding" if opening.kind is OpeningKind.PASSAGE else "unknown",
        )
        for opening in room.openings
        if opening.kind is not OpeningKind.WINDOW
    ]
    windows = [
        Window(opening.wall, opening.start_m, opening.end_m, opening.sill_m, opening.head_m)
        for opening in room.openings
        if opening.kind is OpeningKind.WINDOW
    ]
    return make_plan(
        room.floor,
        ceiling_height_m=room.ceiling_height_m,
        doors=doors,
        windows=windows,
        keep_free=[(0.0, 0.0)] if keep_camera_free else [],
        name=name,
    )


def find_plan(path: Path, *, keep_camera_free: bool = False) -> FloorPlan:
    """Return the plan of a plan.json, a room.json, or a session's folder.

    Raises `PlanError` or `RoomError` naming what is wrong, and where a session has no room yet.
    """
    if path.is_dir():
        for inner in IN_A_SESSION:
            if (path / inner).is_file():
                return from_room_model(read_room(path / inner), keep_camera_free=keep_camera_free, name=path.name)
        raise PlanError(
            "the session has no room yet",
            where=str(path),
            advice=f"daylit room {path} --edit, or daylit process {path} --until room",
        )
    data = read_json(path)
    if isinstance(data, dict) and "floor" in data:
        return from_room_model(read_room(path), keep_camera_free=keep_camera_free, name=path.stem)
    return read_plan(path)

"""A floor plan from a room's model."""

from __future__ import annotations

from processing.layout.plan import Door, FloorPlan, Window, make_plan
from processing.room.model import OpeningKind, RoomModel


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

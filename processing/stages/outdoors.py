"""The light outside a session's room: what the stages light and materials begin with."""

from __future__ import annotations

import math

from processing.errors import SceneError
from processing.ground.room_model import RoomModel
from processing.light.scene.facing import facing_without_heading
from processing.light.scene.outdoor import outdoors_of
from processing.light.scene.scene import Outdoors
from processing.pictures.images import LuminanceImage
from processing.stages.contract import StageContext

HEADING_ADVICE = "(heading_deg in the rig file, --heading of daylit import)"


def light_outdoors(
    context: StageContext, image: LuminanceImage, room: RoomModel
) -> tuple[Outdoors | None, str, list[str]]:
    """Return the light outside, what it was taken from, and warnings."""
    inside = "windows as seen from inside"
    picture = context.optional_artifact("calibrate", "outdoor")
    if picture is None:
        why = context.summary("calibrate")["left_out"].get("outdoor", "the session has no outdoor picture")
        text = f"the windows light as they look from inside, without direct sun: {why}"
        return None, inside, [text]
    try:
        found = outdoors_of(picture)
    except SceneError as error:
        return None, inside, [f"the windows light as they look from inside: {str(error).split(' | ')[0]}"]
    if context.session.heading_rad is not None:
        return found, "outdoor picture", []
    facing, how = facing_without_heading(found, image, room, _sun_seen(context))
    return facing, "outdoor picture", [f"the panorama's heading is not recorded: {how} {HEADING_ADVICE}"]


def _sun_seen(context: StageContext) -> tuple[float, float] | None:
    """Return azimuth and elevation (rad) of the sun as its light in the room shows it; None where it does not."""
    metrics = context.summary("detect")["metrics"]
    if "sun_azimuth_deg" not in metrics:
        return None
    return math.radians(metrics["sun_azimuth_deg"]), math.radians(metrics["sun_elevation_deg"])

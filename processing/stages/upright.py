"""What stages after the room begin with: the upright panorama and the room."""

import math
from collections.abc import Mapping
from functools import reduce
from typing import Any

import numpy as np

from processing.calibration.outdoor.sun_place import Place, shortest_taken, sun_place
from processing.errors import ParameterError
from processing.ground.arrays import Flags
from processing.ground.room_model import RoomModel
from processing.pictures.images import LuminanceImage, in_blocks, worst_in_blocks
from processing.sphere import Equirectangular
from processing.stages.contract import Quality, StageContext
from processing.surfaces.maps import CEILING, FIRST_WALL, FLOOR
from station.session.session import SessionManifest, Side

LEAST_DRAFT_PX = 1600  # width that a draft's panorama keeps (chosen: a screen's)


def upright_panorama(context: StageContext) -> LuminanceImage:
    """Return the room stage's panorama, or the calibrated one where that is upright already."""
    turned = context.optional_artifact("room", "panorama")
    image = context.artifact("calibrate", "indoor") if turned is None else turned
    assert isinstance(image, LuminanceImage)
    return image


def working_panorama(context: StageContext) -> LuminanceImage:
    """Return the upright panorama in the size that is worked in: a draft's is a half or a quarter."""
    image = upright_panorama(context)
    return image if context.quality is not Quality.DRAFT else in_size(image, draft_width_px(image.rgb.shape[1]))


def draft_width_px(width_px: int) -> int:
    """Return the width of a draft's pictures."""
    whole = (factor for factor in (4, 2) if width_px % (2 * factor) == 0 and width_px // factor >= LEAST_DRAFT_PX)
    return width_px // next(whole, 1)


def in_size(image: LuminanceImage, width_px: int) -> LuminanceImage:
    """Return a panorama in a width that divides its own: means of whole blocks, with the worst validity in each."""
    factor = image.rgb.shape[1] // width_px
    return image if factor <= 1 or not isinstance(image.geometry, Equirectangular) else in_blocks(image, factor)


def mask_in_size(mask: Flags, width_px: int) -> Flags:
    """Return a mask (H, W) in a width that divides its own: a block is in it where any of its pixels is."""
    return mask if mask.shape[1] == width_px else worst_in_blocks(mask, mask.shape[1] // width_px)


def detected(context: StageContext, name: str, width_px: int) -> Flags | None:
    """Return a mask (H, W) that the stage detect made, in a width that divides its own; None: it left it out."""
    mask = context.optional_artifact("detect", name)
    return None if mask is None else mask_in_size(np.asarray(mask, bool), width_px)


def things(context: StageContext, shape: tuple[int, ...]) -> Flags:
    """Return where (H, W), of a ``shape``, furniture, equipment or the shadow of furniture was found."""
    found = [detected(context, name, shape[1]) for name in ("furniture", "tripod", "shadow")]
    return reduce(np.logical_or, (mask for mask in found if mask is not None), np.zeros(shape, bool))


def known_room(context: StageContext) -> RoomModel:
    """Return the room; `ProcessingError` where the stage room left it out."""
    room: RoomModel = context.artifact("room", "room")
    return room


LEAST_CONFIDENCE = 0.3
"""Of an estimated room, below which it is emptied and staged on request only (chosen: where confidence is from .02 to
.3, walls of real rooms stood across open space)."""
LEAST_OF_PART = 0.5  # of a wall or the ceiling, from which it is said to stand (chosen: more likely right than wrong)
UNTRUSTED = "what touches other walls"  # of a doubtful room emptied in part: not done, and why
NO_ROOM = "the room stage found no room; give one (--room)"


def why_no_room(context: StageContext, otherwise: str = NO_ROOM) -> str:
    """Return why no room was looked for; else what was not found, ``otherwise``."""
    return context.summary("room").get("skipped") or otherwise


def why_unfit(context: StageContext, *, asked: bool) -> str | None:
    """Return why nothing is built on the room, and which parts of it stand; None where it may be, or is asked."""
    room: RoomModel | None = context.optional_artifact("room", "room")
    if room is None:
        return why_no_room(context)
    if asked or room.source == "given" or room.confidence >= LEAST_CONFIDENCE:
        return None
    return (
        f"the room's shape is doubtful (confidence {room.confidence:.2f}, below {LEAST_CONFIDENCE:g}); "
        f"{trusted_parts(context)} can be trusted, and the masks do not depend on it: correct it "
        "(daylit room SESSION --edit), remove only furniture that touches no other wall (--trusted-walls), or accept "
        "it anyway (--doubtful-room)"
    )


def trusted_planes(context: StageContext) -> tuple[int, ...]:
    """Return the surfaces (`processing.surfaces.maps`) of an estimated room that stand though it may be doubtful.

    The floor does: it is the camera's height below the camera, whatever the walls.
    """
    facts: dict[str, Any] = context.summary("room").get("metrics", {})
    walls = [FIRST_WALL + k for k, sure in enumerate(facts.get("wall_confidences", ())) if sure >= LEAST_OF_PART]
    return (FLOOR, *[CEILING] * (facts.get("ceiling_confidence", 0) >= LEAST_OF_PART), *walls)


def trusted_parts(context: StageContext) -> str:
    """Return in words which walls, numbered from 1, and whether the ceiling's height can be trusted."""
    planes = trusted_planes(context)
    walls = [str(plane - FIRST_WALL + 1) for plane in planes if plane >= FIRST_WALL]
    parts = [f"wall{'s' * (len(walls) > 1)} {', '.join(walls)}"] if walls else []
    return " and ".join([*parts, *["the ceiling's height"] * (CEILING in planes)]) or "no part"


def check_mask_size(mask: Flags, context: StageContext) -> None:
    """Raise `ParameterError` naming both sizes unless a mask (H, W) has the panorama's."""
    panorama = upright_panorama(context).rgb.shape[:2]
    if mask.shape != panorama:
        raise ParameterError(
            f"the target is {mask.shape[1]} x {mask.shape[0]}, the panorama {panorama[1]} x {panorama[0]}",
            likely="a mask of another picture, or one that an image editor has resized",
            advice="give a mask of the panorama's size: stages/detect/target.png has it",
        )


# What a session records of the sun: where it stood when the panorama was taken, and whether the sky had one.


def sun_direction(session: SessionManifest) -> tuple[float, float] | None:
    """Return the sun's azimuth (from the panorama's +y towards +x) and elevation; None where not all is recorded.

    Both are of the upright world, so a panorama that was levelled shows the sun just there.
    """
    moment, place = shortest_taken(session, Side.INDOOR), Place.of(session.site)
    if moment is None or place is None or session.heading_rad is None:
        return None
    there = sun_place(moment, place)
    return math.remainder(there.azimuth_rad - session.heading_rad, 2 * math.pi), there.elevation_rad


def sky_shows_sun(facts: Mapping[str, Any] | None) -> bool | None:
    """Return whether the sun shone, as the outdoor picture shows it by calibration.json; None: there is none to ask."""
    outdoor = facts.get("outdoor") if facts else None
    found = "" if outdoor is None else str(outdoor["sun"]["found"])
    return True if found.startswith("yes") else False if found.startswith("no") else None

"""What stages after the room begin with: the upright panorama and the room."""

from __future__ import annotations

import json

import numpy as np
import numpy.typing as npt

from processing.errors import ParameterError
from processing.images import LuminanceImage
from processing.room.model import RoomModel
from processing.stages.contract import StageContext


def upright_panorama(context: StageContext) -> LuminanceImage:
    """Return the room stage's panorama, or the calibrated one where that is upright already."""
    turned = context.optional_artifact("room", "panorama")
    image = context.artifact("calibrate", "indoor") if turned is None else turned
    assert isinstance(image, LuminanceImage)
    return image


def known_room(context: StageContext) -> RoomModel:
    """Return the room; `ProcessingError` where the stage room left it out."""
    return RoomModel.model_validate_json(json.dumps(context.artifact("room", "room")))


def check_mask_size(mask: npt.NDArray[np.bool_], context: StageContext) -> None:
    """Raise `ParameterError` naming both sizes unless a mask has the panorama's."""
    panorama = upright_panorama(context).rgb.shape[:2]
    if mask.shape != panorama:
        raise ParameterError(
            f"the target is {mask.shape[1]} x {mask.shape[0]}, the panorama {panorama[1]} x {panorama[0]}",
            likely="a mask of another picture, or one that a drawing program has made smaller",
            advice="give a mask of the panorama's size: stages/detect/target.png has it",
        )

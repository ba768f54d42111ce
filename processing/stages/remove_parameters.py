"""Parameters of the stage remove."""

from __future__ import annotations

from typing import Literal

from processing.stages.contract import StageParameters


class RemoveParameters(StageParameters):
    """What a user may say about removal."""

    keep_sunlight: bool = False
    """Direct sunlight stays where it is: not for relighting."""
    filler_channels: Literal["rgb", "bgr"] = "rgb"
    """Channel order of the user's filling network."""

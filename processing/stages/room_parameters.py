"""Parameters of the stage room."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import Field

from processing.stages.contract import StageParameters


class RoomParameters(StageParameters):
    """What a user may say about the room; everything has a default."""

    camera_height_m: Annotated[float, Field(ge=0.1, lt=20)] | None = None
    """Height of the panorama camera's lens: it sets the scale. None: the session's."""
    level: Literal["auto", "off"] = "auto"
    """Whether a tilted panorama is made upright."""

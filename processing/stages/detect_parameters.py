"""Parameters of the stage detect."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import Field

from processing.stages.contract import StageParameters


class DetectParameters(StageParameters):
    """What a user may say about masks."""

    margin_deg: Annotated[float, Field(ge=0, le=10)] = 0.6
    """By which the target reaches over what was found."""
    sunlight: Literal["auto", "off"] = "auto"
    """off: direct sunlight stays in the picture."""

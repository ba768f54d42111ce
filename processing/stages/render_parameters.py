"""Parameters of the stage render."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import Field

from processing.stages.contract import StageParameters


class RenderParameters(StageParameters):
    """How furniture is put into the picture."""

    method: Literal["differential", "global", "ibl"] = "differential"
    style: str | None = None
    """Of the built-in furniture; None: another one for each alternative."""
    seed: Annotated[int, Field(ge=0)] = 0
    """Of the arrangement and of chance."""

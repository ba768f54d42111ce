"""Parameters of the stage materials."""

from __future__ import annotations

from typing import Annotated

from pydantic import Field

from processing.stages.contract import StageParameters


class MaterialsParameters(StageParameters):
    """What a user may say about what the room is made of, and whether it is to be staged at all."""

    set: str = "auto"
    """Of furniture; "none": no staging."""
    items: str | None = None
    """A list of furniture of the user's own."""
    reveal_m: Annotated[float, Field(ge=0, le=2)] | None = None
    """Depth of the windows' niches; None: a common one."""

    @property
    def asked(self) -> bool:
        """Tell whether the room is to be staged."""
        return self.items is not None or self.set != "none"

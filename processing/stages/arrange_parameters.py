"""Parameters of the stage arrange."""

from __future__ import annotations

from typing import Annotated

from pydantic import Field

from processing.stages.contract import StageParameters

MOST_STAGED = 7
"""Alternatives: as many as the paper shows."""

NO_SUCH = "no such alternative"
"""Why an artifact of an alternative that nobody asked for is left out."""


class ArrangeParameters(StageParameters):
    """What is to stand in the room."""

    set: str = "auto"
    """A built-in set, "auto", or "none"."""
    items: str | None = None
    """A list of one's own instead: "bed, 2 nightstand"."""
    rules: str = "standard"
    alternatives: Annotated[int, Field(ge=1, le=MOST_STAGED)] = 3
    seed: Annotated[int, Field(ge=0)] = 0

    @property
    def asked(self) -> bool:
        """Tell whether furniture is asked for."""
        return self.items is not None or self.set != "none"

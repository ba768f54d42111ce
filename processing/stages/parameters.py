"""Parameters of the stages, apart from their code: they are needed to see whether a stage has to run at all."""

from __future__ import annotations

from typing import Literal

from processing.stages.contract import StageParameters


class MergeParameters(StageParameters):
    """Of the stage merge."""

    response_method: Literal["daylit", "debevec-malik", "mitsunaga-nayar", "robertson"] = "daylit"
    """How a response curve is recovered where no profile has one."""
    side: Literal["both", "indoor", "outdoor"] = "both"
    """Which brackets are merged."""

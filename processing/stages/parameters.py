"""Parameters of the stages, apart from their code: they are needed to see whether a stage has to run at all."""

from __future__ import annotations

from processing.stages.contract import StageParameters


class MergeParameters(StageParameters):
    """Of the stage merge; what can be given is the camera's profile (a file) and --max-error (common)."""

    response_method: str = "daylit"
    """As `recover_response` knows them."""

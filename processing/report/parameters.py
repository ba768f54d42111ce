"""Parameters of the stage report."""

from __future__ import annotations

from processing.stages.contract import StageParameters


class ReportParameters(StageParameters):
    """What a user may say about the page."""

    no_staged_label: bool = False
    """Staged pictures go without their visible label; their metadata keep saying what they are."""

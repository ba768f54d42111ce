"""What a run says while it goes and at its end: small types for terminals, logs, programs and tests alike."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import asdict, dataclass, field
from enum import StrEnum
from typing import Any

from processing.running.cost import Cost


class Action(StrEnum):
    """What became of a stage."""

    RAN = "ran"
    SKIPPED = "skipped"
    """Same ingredients, intact files."""
    NOTHING_TO_DO = "nothing to do"
    """Its own skip rule said so."""
    GIVEN = "given"
    """The user gave the answer."""
    WOULD_RUN = "would run"
    DEPENDS = "depends"
    """Dry run: known only when an earlier stage has run."""


Change = tuple[str, Any, Any]
"""Path of an ingredient, old value, new value (None: absent)."""


@dataclass(frozen=True)
class StageReport:
    """One line of the summary."""

    stage: str
    action: Action
    reason: str
    changes: tuple[Change, ...] = ()
    cost: Cost | None = None
    """Of this run; None where nothing ran."""
    summary: dict[str, Any] = field(default_factory=dict)
    """Metrics, warnings, left_out, honoured, skipped and given of the result."""

    def to_dict(self) -> dict[str, Any]:
        """Return the report as JSON-able values."""
        changes = [{"what": path, "old": old, "new": new} for path, old, new in self.changes]
        return {**asdict(self), "action": self.action.value, "changes": changes}


@dataclass(frozen=True)
class RunReport:
    """The whole run."""

    session: str
    stages: tuple[StageReport, ...]
    cost: Cost

    def to_dict(self) -> dict[str, Any]:
        """Return the report as JSON-able values."""
        return {"session": self.session, "stages": [s.to_dict() for s in self.stages], **asdict(self.cost)}


class RunEventKind(StrEnum):
    """What is going on."""

    STARTED = "started"
    PROGRESS = "progress"
    FINISHED = "finished"
    FAILED = "failed"


@dataclass(frozen=True)
class RunEvent:
    """One event of a run."""

    kind: RunEventKind
    stage: str
    text: str
    fraction: float = 0.0
    left_s: float | None = None
    """Of the whole run; None: not known."""
    report: StageReport | None = None
    """With FINISHED."""


OnEvent = Callable[[RunEvent], None]

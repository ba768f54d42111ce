"""What a capture tells while it runs: one small type, JSON-able, for terminals, logs and tests alike."""

from __future__ import annotations

from dataclasses import dataclass, field
from enum import StrEnum
from typing import Any


class EventKind(StrEnum):
    """What happened. `PROGRESS` is frequent and goes to the screen only; the rest goes to the journal too."""

    STARTED = "started"
    CHECK = "check"
    READING = "reading"
    STOP = "stop"
    RELEASED = "released"
    EXPOSED = "exposed"
    PROGRESS = "progress"
    SAVED = "saved"
    REJECTED = "rejected"
    SKIPPED = "skipped"
    RECOVERING = "recovering"
    WARNING = "warning"
    FAILED = "failed"
    FINISHED = "finished"


@dataclass(frozen=True)
class CaptureEvent:
    """One event; ``text`` is for people, ``data`` for programs, ``at_s`` the monotonic time."""

    kind: EventKind
    text: str
    at_s: float
    data: dict[str, Any] = field(default_factory=dict)

    def to_dict(self) -> dict[str, Any]:
        """Return the event as one flat JSON object."""
        return {"event": str(self.kind), "text": self.text, "at_s": round(self.at_s, 4), **self.data}

"""What a capture reports while it runs (one small type, JSON-able, for terminals, logs and tests alike), and what its
threads say to each other: orders to a camera, and notices back to the conductor.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from enum import StrEnum
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from datetime import datetime

    from drivers.camera import FrameRef, ShutterReadback
    from drivers.errors import DaylitError, DeviceError
    from station.session.session import FrameRecord, ReferenceRecord, RejectedFrame, Side


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
    PAUSED = "paused"
    CONTINUED = "continued"
    WAITING = "waiting"
    MISSED = "missed"
    REFERENCE = "reference"
    NOISE = "noise"


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


@dataclass(frozen=True)
class SetUp:
    """Order: make the camera ready for a stop; answered by Ready or Broken."""

    stop: int
    shutter_s: float
    retakes: int = 0
    repeats: bool = False
    """Not for the bracket: to be compared with its frame of the stop."""
    number: int = 0
    """Of the order: an answer to an earlier one is out of date."""


@dataclass(frozen=True)
class Fire:
    """Order: open the shutter at this monotonic time; answered by Released and Exposed, or Broken."""

    open_at_s: float


@dataclass(frozen=True)
class StandDown:
    """Order: the partner is not ready, forget the stop and let go of the button."""


@dataclass(frozen=True)
class Safe:
    """Order, from the intake: the frame is here for good; the camera may forget it, if it counts (``acknowledged``)."""

    frame: FrameRef
    acknowledged: bool = True


@dataclass(frozen=True)
class Leave:
    """Order: fetch what is left (unless ``at_once``), then end the thread; answered by Left."""

    at_once: bool = False


Order = SetUp | Fire | StandDown | Safe | Leave


@dataclass(frozen=True)
class Shot:
    """One frame on its way from a camera to the disk."""

    side: Side
    stop: int
    frame: FrameRef
    asked_s: float
    shutter: ShutterReadback
    released_utc: datetime
    released_s: float
    announced_utc: datetime
    retakes: int
    repeats: bool = False


@dataclass(frozen=True)
class OfStop:
    """What all that happens at one stop of one side says first."""

    side: Side
    stop: int


@dataclass(frozen=True)
class Ready(OfStop):
    """Armed, as the set-up of this ``number`` has it."""

    number: int


@dataclass(frozen=True)
class Released(OfStop):
    """The shutter was asked to open at ``at_s``."""

    at_s: float


@dataclass(frozen=True)
class Exposed(OfStop):
    """The exposure is over; ``n_frames`` are announced and will be fetched, behind later exposures if ``overlaps``."""

    n_frames: int
    overlaps: bool


@dataclass(frozen=True)
class Progress(OfStop):
    """Bytes of a frame fetched so far."""

    done_bytes: int
    total_bytes: int


@dataclass(frozen=True)
class Saved(OfStop):
    """A frame is acknowledged: on disk, digested, checked, journalled."""

    record: FrameRecord


@dataclass(frozen=True)
class Rejected(OfStop):
    """A frame arrived and does not count."""

    record: RejectedFrame


@dataclass(frozen=True)
class Repeated(OfStop):
    """A repeated frame is compared with that of the bracket (None: it could not be)."""

    record: ReferenceRecord | None


@dataclass(frozen=True)
class Lost(OfStop):
    """A frame was exposed but could not be fetched."""

    error: DeviceError


@dataclass(frozen=True)
class Breaking:
    """A device error (at a stop, or between stops): the camera is being recovered; answered by itself with Broken."""

    side: Side
    stop: int | None
    error: DeviceError


@dataclass(frozen=True)
class Broken:
    """The end of a recovery after a device error; ``recovered``: the camera can go on."""

    side: Side
    stop: int | None
    error: DeviceError
    recovered: bool


@dataclass(frozen=True)
class Fatal:
    """Something no retake can mend: a full disk, or a fault of our own."""

    side: Side
    error: DaylitError | Exception


@dataclass(frozen=True)
class Left:
    """The camera's thread is over."""

    side: Side


Notice = Ready | Released | Exposed | Progress | Saved | Rejected | Repeated | Lost | Breaking | Broken | Fatal | Left

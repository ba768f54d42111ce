"""One exposure of the Theta Z1 from its release until all its frames are announced.

Announcements come as events on the interrupt pipe, which may be lost, doubled, late, in either order, or about
other objects; so the camera's store has the last word once the events are overdue.
"""

from contextlib import suppress
from dataclasses import dataclass

from drivers.camera import ExposureProgress, FrameFormat
from drivers.camera_link import CameraLink, ExpectedFrames, FrameStore
from drivers.clock import Clock
from drivers.errors import DeviceBusyError, ExposureFailedError, StoreFullError
from drivers.ptp.codes import Event
from drivers.ptp.session import PtpEvent
from drivers.theta_z1.codes import RicohProp
from drivers.theta_z1.settings import ThetaProperties, error_texts

# A poll stays under the 50 ms of `drivers.camera.Camera` (chosen).
EVENT_WAIT_S = 0.02
MAX_EVENTS_A_POLL = 8  # chosen: the other camera waits for its turn
COMPLETE_GRACE_S = 1.0  # some of the events of a capture are there, but not all: ask the camera after this time
ANNOUNCE_GRACE_S = 8.0
"""Stitching and saving take a few seconds (6 s is Ricoh's shortest interval for JPEG, 10 s for RAW+)."""
ANNOUNCE_GRACE_RAW_S = 12.0  # Ricoh's interval for RAW+, and 2 s
ASK_PERIOD_S = 1.0  # chosen: a question a second does not slow the camera
FAIL_AFTER_S = 25.0  # after the shutter has closed; then there will be no picture any more
NO_SPACE_BITS = 0x00000001 | 0x00000004


@dataclass(frozen=True)
class ThetaShot:
    """What was released; ``earlier_ids`` are transactions of captures before it, whose events may come late."""

    shutter_s: float
    formats: tuple[FrameFormat, ...]
    transaction_id: int
    earlier_ids: frozenset[int]


class ThetaExposure:
    """Collects the frames of one exposure; `poll` it until it is done."""

    def __init__(self, link: CameraLink, store: FrameStore, clock: Clock, shot: ThetaShot) -> None:
        self._link = link
        self._store = store
        self._clock = clock
        self._properties = ThetaProperties(link, clock)
        self._shot = shot
        self._expected = ExpectedFrames(shot.formats)
        self._pending: list[int] = []
        self._complete = False
        self._store_full = False
        now_s = clock.monotonic_s()
        grace_s = ANNOUNCE_GRACE_S if len(shot.formats) == 1 else ANNOUNCE_GRACE_RAW_S
        self._ask_at_s = now_s + shot.shutter_s + grace_s
        self._fail_at_s = now_s + shot.shutter_s + FAIL_AFTER_S

    def poll(self, *, wait: bool) -> ExposureProgress:
        """Take in what the camera has announced; with ``wait`` for up to `EVENT_WAIT_S` of time.

        Raises `ExposureFailedError, StoreFullError`: no picture long after the shutter has closed.
        """
        for number in range(MAX_EVENTS_A_POLL):
            event = self._link.session.poll_event(EVENT_WAIT_S if wait and number == 0 else 0.0)
            if event is None:
                break
            self._note(event)
        self._look_at_pending()
        if not self._done and self._clock.monotonic_s() >= self._ask_at_s:
            self._ask_the_camera()
        return ExposureProgress(self._done, self._expected.frames)

    @property
    def _done(self) -> bool:
        return self._complete and self._expected.complete

    def _note(self, event: PtpEvent) -> None:
        first = event.params[0] if event.params else None
        if event.code == Event.OBJECT_ADDED and first is not None:
            if event.transaction_id in self._shot.earlier_ids:
                self._store.known.add(first)
            elif first not in self._store.known and first not in self._pending:
                self._pending.append(first)
        elif event.code == Event.CAPTURE_COMPLETE and first in (None, self._shot.transaction_id):
            self._complete = True
            self._ask_by(COMPLETE_GRACE_S)
        elif event.code == Event.STORE_FULL:
            self._store_full = True
            self._ask_by(COMPLETE_GRACE_S)

    def _ask_by(self, wait_s: float) -> None:
        self._ask_at_s = min(self._ask_at_s, self._clock.monotonic_s() + wait_s)

    def _look_at_pending(self) -> None:
        while self._pending:
            try:
                frame = self._store.look_at(self._pending[0])
            except DeviceBusyError:
                return
            handle = self._pending.pop(0)
            if frame is not None:  # no folder, nor a picture that is not written yet: that one the store shows later
                self._store.known.add(handle)
                if self._expected.add(frame) and self._expected.complete:
                    self._ask_by(COMPLETE_GRACE_S)

    def _ask_the_camera(self) -> None:
        now_s = self._clock.monotonic_s()
        self._ask_at_s = now_s + ASK_PERIOD_S
        if self._expected.complete:
            self._complete = self._complete or is_ready(self._properties)
            return
        with suppress(DeviceBusyError):  # it works still; the limit below holds
            self._pending += [h for h in self._store.new_handles() if h not in self._pending]
        self._look_at_pending()
        # A store that is full may have taken this picture as its last, and the camera works on it still
        late = now_s >= self._fail_at_s
        if not self._expected.complete and (late or (self._store_full and is_ready(self._properties))):
            raise self._failure()

    def _failure(self) -> ExposureFailedError | StoreFullError:
        error_info = self._properties.number_or_none(RicohProp.ERROR_INFO) or 0
        problems, warnings = error_texts(error_info)
        reported = "; ".join((*problems, *warnings))
        facts = {"error_info": error_info, "frames": [f.name for f in self._expected.frames]}
        if self._store_full or error_info & NO_SPACE_BITS:
            text = "the camera's memory is full: the picture was not saved"
            advice = "delete pictures from the camera, then resume"
            return StoreFullError(text, where=self._link.name, likely=reported, advice=advice, **facts)
        text = f"no picture {FAIL_AFTER_S:g} s after the shutter closed"
        likely = reported or "the camera fell asleep or its shooting stopped"
        advice = "resume; if it recurs, switch the camera off and on"
        return ExposureFailedError(text, where=self._link.name, likely=likely, advice=advice, **facts)


def is_ready(properties: ThetaProperties) -> bool:
    """Whether the camera is neither shooting nor processing, as far as its firmware reports."""
    with suppress(DeviceBusyError):
        status = properties.number(RicohProp.CAPTURE_STATUS)
        if properties.has(RicohProp.EXPOSURE_STATUS):
            status = status or properties.number(RicohProp.EXPOSURE_STATUS)
        return status == 0
    return False

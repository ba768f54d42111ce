"""One exposure of an EOS camera from its release until all its frames are announced and the button is let go."""

from contextlib import suppress
from dataclasses import dataclass

from drivers.camera import ExposureProgress, FrameFormat, FrameRef
from drivers.camera_link import CameraLink, ExpectedFrames, FrameStore
from drivers.canon_5d2.operations import ObjectRecord
from drivers.canon_5d2.remote import FIRST_PAUSE_S, LONGEST_PAUSE_S, CanonRemote
from drivers.clock import Clock
from drivers.errors import DeviceBusyError, ExposureFailedError, OperationRefusedError
from drivers.ptp.codes import ObjectFormat

FORMATS: dict[int, FrameFormat] = {
    ObjectFormat.EXIF_JPEG: FrameFormat.JPEG,
    ObjectFormat.CANON_CR2: FrameFormat.CR2,
    ObjectFormat.CANON_CRW: FrameFormat.CR2,
}
"""Sources disagree which of two codes a raw picture carries; this camera makes one kind only."""
ANNOUNCE_GRACE_S = 5.0  # after the shutter has closed; then the card is asked what is new on it
ASK_PERIOD_S = 1.0  # chosen: a question a second does not slow the card
FAIL_AFTER_S = 25.0  # on top of twice the exposure time: the camera may take a dark frame as long as the exposure


@dataclass(frozen=True)
class CanonShot:
    """What was released, and where its pictures go."""

    shutter_s: float
    formats: tuple[FrameFormat, ...]
    to_card: bool


class CanonExposure:
    """Collects the frames of one exposure; `poll` it until it is done."""

    def __init__(
        self, link: CameraLink, remote: CanonRemote, store: FrameStore | None, clock: Clock, shot: CanonShot
    ) -> None:
        self._link = link
        self._remote = remote
        self._store = store
        self._clock = clock
        self._shot = shot
        self._expected = ExpectedFrames(shot.formats)
        self._seen: set[int] = set()
        now_s = clock.monotonic_s()
        self._closes_at_s = now_s + shot.shutter_s
        self._poll_at_s = now_s
        self._ask_at_s = self._closes_at_s + ANNOUNCE_GRACE_S
        self._fail_at_s = now_s + 2 * shot.shutter_s + FAIL_AFTER_S

    def poll(self, *, wait: bool) -> ExposureProgress:
        """Let go of the button step by step, and take in what the camera reports; waits for at most 50 ms.

        Raises `ExposureFailedError`: no picture long after the shutter has closed.
        """
        now_s = self._clock.monotonic_s()
        if now_s < self._poll_at_s:
            if wait:
                self._clock.sleep(min(self._poll_at_s - now_s, FIRST_PAUSE_S))
            if self._clock.monotonic_s() < self._poll_at_s:
                return ExposureProgress(False, self._expected.frames)
        self._poll_once()
        if not self._done and self._clock.monotonic_s() >= self._ask_at_s:
            self._ask_the_camera()
        return ExposureProgress(self._done, self._expected.frames)

    @property
    def _done(self) -> bool:
        return self._expected.complete and not self._remote.pressed

    def _poll_once(self) -> None:
        news = False
        with suppress(DeviceBusyError):  # it exposes; the button and the events wait
            self._remote.let_go_a_little()
            news = bool(self._remote.poll())
        self._take_announced()
        now_s = self._clock.monotonic_s()
        soon = news or self._remote.pressed or now_s > self._closes_at_s - LONGEST_PAUSE_S
        self._poll_at_s = now_s + (FIRST_PAUSE_S if soon else LONGEST_PAUSE_S)

    def _take_announced(self) -> None:
        """Take over the objects that the camera has announced."""
        announced, self._remote.announced = self._remote.announced, []
        while announced:
            try:
                self._take(announced[0])
            except DeviceBusyError:
                self._remote.announced = announced + self._remote.announced  # looked at again with the next poll
                return
            announced.pop(0)

    def _take(self, record: ObjectRecord) -> None:
        known = self._store.known if self._store is not None else set()
        frame_format = FORMATS.get(record.object_format)
        if frame_format is None or record.handle in known or record.handle in self._seen:
            return
        if record.size_bytes == 0:
            return  # announced again (C187) once it is written, or found on the card when it is overdue
        if record.wants_transfer is self._shot.to_card:
            return
        frame = FrameRef(record.handle, record.name, frame_format, record.size_bytes, record.storage_id)
        if self._store is None or self._is_on_the_card(frame, self._store):
            self._add(frame)

    @staticmethod
    def _is_on_the_card(frame: FrameRef, store: FrameStore) -> bool:
        """Whether the card has under this handle what was announced: a picture of another exposure is never taken."""
        with suppress(OperationRefusedError):
            return store.holds(frame)
        return True  # a camera that does not describe its pictures; what comes is checked when it is here

    def _add(self, frame: FrameRef) -> None:
        self._seen.add(frame.handle)
        if self._store is not None:
            self._store.known.add(frame.handle)
        self._expected.add(frame)

    def _ask_the_camera(self) -> None:
        now_s = self._clock.monotonic_s()
        self._ask_at_s = now_s + ASK_PERIOD_S
        if self._store is not None and not self._expected.complete:
            with suppress(DeviceBusyError, OperationRefusedError):  # asked again in a second; the limit holds
                for handle in self._store.new_handles():
                    frame = self._store.look_at(handle)
                    if frame is not None:
                        self._add(frame)
        if not self._done and now_s >= self._fail_at_s:
            text = f"no picture {FAIL_AFTER_S:g} s after the exposure"
            likely = "the camera did not focus, or its card refused the picture"
            advice = "switch the lens to MF, check the card, then resume"
            facts = {"frames": [f.name for f in self._expected.frames], "button_held": self._remote.pressed}
            raise ExposureFailedError(text, where=self._link.name, likely=likely, advice=advice, **facts)

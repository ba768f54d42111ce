"""What comes in from the instruments: meter readings, and frames from bytes to acknowledged (written, digested,
checked, journalled, and only then called safe).

One intake a side. The camera's thread writes chunks; a thread of the intake checks and commits whole frames, so that
checking never delays a shutter.
"""

import queue
import threading
from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import Future, ThreadPoolExecutor, wait
from dataclasses import replace
from typing import Literal

from drivers.camera import FrameFormat
from drivers.meter.interface import MeterReading, ReadingStatus
from station.capture.events import Fatal, Notice, Rejected, Repeated, Safe, Saved, Shot
from station.capture.reference import compare
from station.capture.rig import Rig
from station.capture.rig_file import CameraTable
from station.errors import FrameRejectedError, UsageError
from station.frames.check import FrameChecker
from station.frames.facts import ExpectedFrame, FrameFacts
from station.frames.problems import Reason
from station.frames.rules import check_not_too_dark, check_order, judge, rejection
from station.session.session import FrameRecord, ReadingRecord, RejectedFrame, Side, shutter_label
from station.session.store import FramePart, SessionStore, StoredFrame

When = Literal["before", "after", "extra"]
TYPED_RANGE_CD_M2 = (1e-3, 1e7)
"""What a luminance meter of this family can show (LS-150/160 data sheets, rounded outwards)."""
IDLE_LIMIT_S = 120.0  # a frame that is being checked and committed is through by then, even on a slow disk


def record_reading(when: When, reading: MeterReading) -> ReadingRecord:
    """Return the record of a reading, whatever its status; it has all of a reading's fields."""
    texts = {"status": str(reading.status), "raw": reading.raw[:500], "detail": reading.detail[:500]}
    return ReadingRecord(when=when, **(vars(reading) | texts))


def check_typed(typed_cd_m2: Sequence[float]) -> None:
    """Accept up to two numbers that a meter of the family can show, 0.001 .. 1e7 cd/m2; raises `UsageError` else."""
    if len(typed_cd_m2) > 2:
        raise UsageError("give at most two readings", where="--reading", advice="before, and after")
    low, high = TYPED_RANGE_CD_M2
    for luminance_cd_m2 in typed_cd_m2:
        if not low <= luminance_cd_m2 <= high:
            text = f"{luminance_cd_m2} cd/m2 is outside the meter's range"
            advice = f"type the number on the display, in cd/m2, between {low:g} and {high:g}"
            raise UsageError(text, where="--reading", advice=advice)


def drift_frac(readings: tuple[ReadingRecord, ...]) -> float | None:
    """Return the change from the last "before" to the last "after", relative to before; None without both."""
    found = {r.when: r.luminance_cd_m2 for r in readings if r.luminance_cd_m2 is not None}
    before, after = found.get("before"), found.get("after")
    return (after - before) / before if before and after is not None else None


class ReadingTaker:
    """Takes the readings of one capture from the meter, or from what a person typed: each number once.

    Of two the first is the one before; a single one is the first that is wanted.
    """

    def __init__(self, rig: Rig, typed_cd_m2: tuple[float, ...]) -> None:
        check_typed(typed_cd_m2)
        self._rig = rig
        self._typed, self._left_cd_m2 = tuple(typed_cd_m2), list(typed_cd_m2)
        self._pool = ThreadPoolExecutor(max_workers=1, thread_name_prefix="meter")
        self._running: Future[ReadingRecord] | None = None

    def end_earlier(self) -> None:
        """Wait, bounded, for a reading that another capture of this rig left running, and give its line back.

        A process that is started while the line is open holds its lock for a moment, and it could not be opened anew.
        """
        if self._rig.reading is not None and self._rig.meter is not None:
            wait([self._rig.reading], IDLE_LIMIT_S)
            self._rig.meter.close()

    @property
    def planned(self) -> Literal[0, 1, 2]:
        """How many readings a new session is to have: 2 with a meter, else as many as were typed."""
        if not self._typed:
            return 0 if self._rig.meter is None else 2
        return 1 if len(self._typed) == 1 else 2

    def can_take(self, when: When) -> bool:
        """Whether there is anything to take the reading from."""
        return self._rig.meter is not None if not self._typed else when != "extra" and bool(self._left_cd_m2)

    def start(self, when: When) -> None:
        """Begin a reading in the background, behind one that runs; that is dropped as stale, errors and all."""
        if self._running is not None:
            self._running.cancel()
        self._running = self._rig.reading = self._pool.submit(self._take, when)

    def collect(self) -> ReadingRecord | None:
        """Wait for the reading begun last and return it; None if none was begun."""
        running, self._running = self._running, None
        return running.result() if running is not None else None

    def close(self, *, wait: bool = True) -> None:
        """End the background thread; a running reading ends by its own time limit, waited for or not."""
        self._pool.shutdown(wait=wait, cancel_futures=True)

    def _take(self, when: When) -> ReadingRecord:
        if self._typed:
            luminance_cd_m2 = self._left_cd_m2.pop(0 if when == "before" else -1)
            moment = self._rig.clock.utc_now(), self._rig.clock.monotonic_s()
            typed = MeterReading(ReadingStatus.TYPED, luminance_cd_m2, f"{luminance_cd_m2:g}", *moment, "typed", True)
            return record_reading(when, replace(typed, detail="typed from the display"))
        meter, table = self._rig.meter, self._rig.file.meter
        if meter is None or table is None:
            raise UsageError("the rig has no meter", where="meter", advice="add [meter] to the rig file")
        return record_reading(when, meter.measure(n_samples=table.samples, timeout_s=table.timeout_s))


class Intake:
    """Receives the frames of one camera."""

    def __init__(
        self,
        side: Side,
        store: SessionStore,
        checker: FrameChecker,
        table: CameraTable,
        notices: queue.SimpleQueue[Notice],
        *,
        exact: bool,
        clock_offset_s: float | None,
    ) -> None:
        self.side = side
        self.notices = notices
        self.on_safe: Callable[[Safe], None] = lambda _safe: None
        self._store = store
        self._checker = checker
        self._table = table
        self._exact = exact
        self._clock_offset_s = clock_offset_s
        self.facts: dict[int, FrameFacts] = {}
        """Of the JPEGs that counted, by stop."""
        self._parts: dict[Shot, FramePart] = {}
        self._whole: queue.SimpleQueue[tuple[Shot, FramePart] | None] = queue.SimpleQueue()
        self._idle = threading.Condition()
        self._n_open = 0
        self._thread = threading.Thread(target=self._run, name=f"intake-{side}", daemon=True)
        self._thread.start()

    def write(self, shot: Shot, data: bytes) -> None:
        """Append bytes of a frame (its first bytes open a new temporary file)."""
        part = self._parts.get(shot)  # not by handle: a camera may use one again after a reset
        if part is None:
            part = self._store.begin_frame(shot.side, shot.stop, shot.asked_s, shot.frame.format)
            self._parts[shot] = part
        part.write(data)

    def abort(self, shot: Shot) -> None:
        """Forget a frame that will not be completed; its temporary file goes."""
        part = self._parts.pop(shot, None)
        if part is not None:
            part.abort()

    def complete(self, shot: Shot) -> None:
        """All bytes are there: check and commit in the background."""
        part = self._parts.pop(shot)
        with self._idle:
            self._n_open += 1
        self._whole.put((shot, part))

    def wait_idle(self, timeout_s: float = IDLE_LIMIT_S) -> bool:
        """Wait until every completed frame is saved or rejected; returns whether that came true."""
        with self._idle:
            return self._idle.wait_for(lambda: self._n_open == 0, timeout_s)

    def close(self) -> None:
        """Finish what is queued and end the thread."""
        self._whole.put(None)
        self._thread.join(IDLE_LIMIT_S)

    def _run(self) -> None:
        while (whole := self._whole.get()) is not None:
            try:
                self._take(*whole)
            except Exception as error:  # noqa: BLE001 (the conductor must hear of it, whatever it is)
                self.notices.put(Fatal(self.side, error))
            finally:
                with self._idle:
                    self._n_open -= 1
                    self._idle.notify_all()

    def _take(self, shot: Shot, part: FramePart) -> None:
        if shot.repeats:
            self._repeated(shot, part)
            return
        counts = True
        try:
            facts = self._check(shot, part)
        except FrameRejectedError as error:
            counts = False
            file = part.reject(error.message)
            record = RejectedFrame(side=self.side, stop=shot.stop, file=file, reason=error.message[:500])
            self._store.add(record)
            self.notices.put(Rejected(self.side, shot.stop, record))
        else:
            stored = part.commit()
            # Let the frames of an earlier exposure of this stop make room: JPEG and raw file are of one exposure
            for frame in self._store.manifest.frames:
                if (frame.side, frame.stop) == (shot.side, shot.stop) and frame.taken_utc != shot.released_utc:
                    self._store.withdraw_frame(frame.side, frame.stop, frame.format, "taken anew")
            frame = _frame_record(shot, facts, stored)
            self._store.add_frame(frame)
            self.notices.put(Saved(self.side, shot.stop, frame))
        self.on_safe(Safe(shot.frame, acknowledged=counts))

    def _repeated(self, shot: Shot, part: FramePart) -> None:
        """Compare a repeated frame with the bracket's, and keep it aside; what is wrong with it costs nothing."""
        record, reason = None, "repeated at the end, to compare"
        before, frame = self.facts.get(shot.stop), self._store.manifest.frame(shot.side, shot.stop)
        if shot.frame.format is FrameFormat.JPEG and before is not None and frame is not None:
            name, after_s = f"{self.side} repeated", shot.released_s - (frame.release_monotonic_s or shot.released_s)
            try:
                after = self._checker.check(part.path, self._expected(shot), exact=self._exact, earlier=[], name=name)
                record = compare(shot, before, after, None, max(after_s, 0.0))
            except FrameRejectedError as error:
                reason = error.message
        file = part.reject(reason)
        self._store.add(RejectedFrame(side=self.side, stop=shot.stop, file=file, reason=reason[:500]))
        if record is not None:
            record = record.model_copy(update={"file": file})
            self._store.update(references=(*self._store.manifest.references, record))
        self.notices.put(Repeated(self.side, shot.stop, record))
        self.on_safe(Safe(shot.frame))

    def _check(self, shot: Shot, part: FramePart) -> FrameFacts:
        """Return what the frame is known by; raises `FrameRejectedError` with the reason if it does not count."""
        name = f"{self.side} {shutter_label(shot.asked_s)}"
        if part.size_bytes != shot.frame.size_bytes:
            text = f"{part.size_bytes} bytes came, the camera announced {shot.frame.size_bytes}"
            raise FrameRejectedError(text, where=part.path.name)
        if shot.frame.format is not FrameFormat.JPEG:
            # Refuse a raw file whose JPEG does not count: that comes first, and alone has the exposure
            jpeg = self._store.manifest.frame(shot.side, shot.stop)
            if jpeg is None or jpeg.taken_utc != shot.released_utc:
                raise FrameRejectedError("the JPEG of its exposure was rejected", where=name)
            raw: Literal["cr2", "dng"] = "cr2" if shot.frame.format is FrameFormat.CR2 else "dng"
            facts = self._checker.check_raw(part.path, raw, name=name)
            # One that came late is an earlier exposure's: of another time or moment, or there already
            whole = replace(self._expected(shot), iso=None, f_number=None, width_px=None, height_px=None)
            judge(facts, replace(whole, require_exif=False, light_expected=False))
            if there := next((f for f in self._store.manifest.frames if f.sha256 == facts.sha256), None):
                raise rejection(name, Reason.REPEATED, f"the same bytes as {there.file}", "take the frame again")
            return facts
        earlier = [facts for stop, facts in self.facts.items() if stop != shot.stop]
        facts = self._checker.check(part.path, self._expected(shot), exact=self._exact, earlier=earlier, name=name)
        self.facts[shot.stop] = facts
        return facts

    def _expected(self, shot: Shot) -> ExpectedFrame:
        width_px, height_px = self._table.size_px
        return ExpectedFrame(
            exposure_s=shot.shutter.nominal_s,
            iso=self._table.iso,
            f_number=self._table.f_number,
            width_px=width_px,
            height_px=height_px,
            taken_after_utc=shot.released_utc,
            taken_before_utc=shot.announced_utc,
            clock_offset_s=self._clock_offset_s,
            light_expected=self.side is Side.INDOOR and not self._table.nd_filter,
            image_circle=self._table.image_circle,
        )


def _frame_record(shot: Shot, facts: FrameFacts, stored: StoredFrame) -> FrameRecord:
    return FrameRecord(
        side=shot.side,
        stop=shot.stop,
        file=stored.file,
        format=shot.frame.format.value,
        size_bytes=stored.size_bytes,
        sha256=stored.sha256,
        asked_s=shot.asked_s,
        camera_s=shot.shutter.nominal_s,
        exif_s=facts.exif.exposure_s,
        iso=facts.exif.iso,
        f_number=facts.exif.f_number,
        width_px=facts.width_px,
        height_px=facts.height_px,
        taken_utc=shot.released_utc,
        release_monotonic_s=shot.released_s,
        camera_name=shot.frame.name[:200],
        statistics=facts.statistics if shot.frame.format is FrameFormat.JPEG else None,
        retakes=shot.retakes,
    )


def doubts(intakes: Mapping[Side, Intake], stops_s: Sequence[float]) -> dict[tuple[Side, int], str]:
    """Return the frames whose brightness does not fit: the light jumped, or the camera did not do as it said."""
    found: dict[tuple[Side, int], str] = {}
    for side, intake in intakes.items():
        for check in (check_order, check_not_too_dark):
            try:
                check(intake.facts, stops_s)
            except FrameRejectedError as error:
                found |= {(side, stop): f"{error.where}: {error.message}" for stop in error.details["stops"]}
    return found

"""One capture from preflight to manifest, as a stream of events; and the completion of a partial one.

::

    preflight ── reading ── bracket ──────────────── reading ── manifest
                            pairs, fetched behind    (while the last frames come in)

Everything that counts is durable before it is reported: a capture that ends at any instant leaves a session that
`Capture.resume` completes.
"""

import math
import queue
import threading
from collections.abc import Generator, Iterator, Mapping
from contextlib import closing, suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Self
from uuid import uuid4

from drivers.errors import DeviceError, DeviceNotFoundError
from station.capture.bracket import BracketPlan, Mode, plan_bracket, plan_of, typical_cost, unavailable_stops
from station.capture.camera_worker import CameraWorker
from station.capture.conductor import Conductor, Doubts, Hooks
from station.capture.events import CaptureEvent, EventKind, Notice
from station.capture.intake import Intake, ReadingTaker, When, doubts, drift_frac
from station.capture.preflight import Check, Findings, Level, check_rig, require
from station.capture.reference import LONGEST_FURTHER_S, MOST_FURTHER, MOST_FURTHER_S, error_by_noise, further_time_s
from station.capture.rig import Rig, require_same_camera
from station.errors import ResourceError, SessionError, UsageError, software_versions
from station.frames.check import FrameChecker
from station.session.manifest import require_names
from station.session.session import (
    BracketRecord,
    DeviceRecord,
    FrameRecord,
    MeterTarget,
    ReadingRecord,
    SessionManifest,
    SessionStatus,
    Side,
    WarningRecord,
)
from station.session.store import SessionStore
from station.session.verify import damaged_frames


@dataclass(frozen=True)
class CaptureRequest:
    """What to capture and where; empty fields mean "as the rig file says".

    ``typed_readings`` (cd/m2) stand for the meter: the first before, the second after the bracket. ``noise_frac``: take
    further exposures until noise leaves 95 % of each picture right to this.
    """

    room: str
    into: Path
    mode: Mode | None = None
    stops_s: tuple[float, ...] = ()
    typed_readings: tuple[float, ...] = ()
    target: MeterTarget | None = None
    noise_frac: float | None = None
    address: str = ""


class Capture:
    """A capture that is about to run: iterate `events`, then look at ``store.manifest``; `ask_stop` ends it early.

    ``resumed`` is the partial session to complete, or None; use `new` and `resume` to make one.
    """

    def __init__(
        self, rig: Rig, plan: BracketPlan, readings: ReadingTaker, request: CaptureRequest, resumed: SessionStore | None
    ) -> None:
        self._rig = rig
        self._plan = plan
        self._readings = readings
        self._request = request
        self._store = resumed
        self._conductor: Conductor | None = None
        self._stop_asked = self._paused = False
        self._errors: dict[Side, float] = {}
        self._damaged: tuple[FrameRecord, ...] = ()
        self._checkers = rig.checkers or {side: FrameChecker() for side in plan.sides}

    @classmethod
    def new(cls, rig: Rig, request: CaptureRequest) -> Self:
        """Return the capture of a new session.

        Raises `UsageError`: no camera, stops out of range, names that no session can hold, or more than two readings.
        """
        require_names(request.room, request.address, where="capture")
        if not rig.cameras:
            raise UsageError("the rig has no camera", where="rig", advice="give [indoor] or [outdoor]")
        plan = plan_of(rig.file, request.stops_s, request.mode, request.noise_frac)
        return cls(rig, plan, ReadingTaker(rig, request.typed_readings), request, None)

    @classmethod
    def resume(cls, rig: Rig, store: SessionStore, *, typed_readings: tuple[float, ...] = ()) -> Self:
        """Return the capture that completes a partial session.

        Raises `SessionError`: the session was imported, or needs a camera that the rig lacks or has set otherwise.
        """
        bracket, where = store.manifest.bracket, str(store.path)
        if bracket.mode not in ("full", "adaptive"):
            raise SessionError("an imported session cannot be resumed", where=where, advice="import it again")
        damaged = damaged_frames(store.path, store.manifest)
        needed = {side for side in bracket.sides if store.manifest.missing_stops(side)} | {f.side for f in damaged}
        if lacking := needed - set(rig.cameras):
            names = " or ".join(sorted(lacking))
            raise SessionError(f"the rig has no {names} camera", where=where, advice="use the rig it was made with")
        for side in sorted(needed):
            require_same_camera(rig, store.manifest, side, where)
        plan = plan_bracket(bracket.stops_s[: len(bracket.order) or None], bracket.mode, bracket.sides)
        request = CaptureRequest(room=store.manifest.name, into=store.path.parent)
        job = cls(rig, plan, ReadingTaker(rig, typed_readings), request, store)
        job._damaged = damaged
        return job

    @property
    def n_stops(self) -> int:
        """How many stops the bracket has."""
        return len(self._plan.stops_s)

    @property
    def store(self) -> SessionStore:
        """The session on disk; of a new capture, once preflight has passed."""
        if self._store is None:
            raise SessionError("the session does not exist yet", likely="preflight has not passed")
        return self._store

    def ask_stop(self) -> None:
        """End after the running pair; what is exposed is still saved. Safe in a signal handler."""
        self._stop_asked = True
        if self._conductor is not None:
            self._conductor.ask_stop()

    def ask_pause(self, *, paused: bool) -> None:
        """Take no further pair until asked to continue; cameras are kept awake. Safe in a signal handler."""
        self._paused = paused
        if self._conductor is not None:
            self._conductor.paused = paused

    @property
    def has_store(self) -> bool:
        """Whether the session exists."""
        return self._store is not None

    def events(self) -> Iterator[CaptureEvent]:
        """Run the capture. Raises `DaylitError` kinds; what was acknowledged until then is kept and resumable."""
        self._readings.end_earlier()
        starters = [threading.Thread(target=_start_quietly, args=(c,)) for c in self._checkers.values()]
        for starter in starters:
            starter.start()  # behind preflight
        whole = False
        self._rig.clock.rebase()
        try:
            with closing(self._steps()) as steps:
                for event in steps:
                    yield event
                    if event.kind is not EventKind.FINISHED:  # which is written
                        yield from self._clock_step()
            whole = True
        finally:
            self._readings.close(wait=whole)
            for starter in starters:
                starter.join()  # bounded by the checker's own limit; one that starts after its close would stay
            for checker in self._checkers.values() if self._rig.checkers is None else ():
                checker.close()
            if not whole and self._store is not None:
                self._store.close()  # gives the lock back, so that the session can be resumed

    def _steps(self) -> Generator[CaptureEvent]:
        yield from self._preflight()
        yield from self._collect_reading()
        yield from self._bracket()
        yield from self._collect_reading()
        yield from self._end()

    def _clock_step(self) -> Iterator[CaptureEvent]:
        """Note that the computer's clock was set (by NTP after a sleep, say): no time of the session follows it."""
        if self._store is not None and (step_s := self._rig.clock.new_step_s()) is not None:
            self._store.event("clock_step", step_s=step_s)
            text = f"the computer's clock was set by {step_s:+.1f} s meanwhile; times keep the clock of the start"
            yield self._warn("clock_step", text)

    def _preflight(self) -> Iterator[CaptureEvent]:
        yield self._say(EventKind.STARTED, "preflight")
        # Which reading to begin with: "before" where it is missing, one more when the capture goes on later
        lacks = self._store is None or "before" in self._store.manifest.missing_readings()
        when: When = "before" if lacks else "extra"
        first = when if self._readings.can_take(when) else None
        if first is not None and self._rig.meter is None:
            self._readings.start(first)
        tables = (t for s, t in self._rig.file.cameras().items() if s in self._plan.sides)
        exposure_bytes = sum(typical_cost(t.kind, keep_raw=t.keep_raw).frame_bytes for t in tables)
        findings = check_rig(
            self._rig,
            self._request.into,
            bytes_needed=exposure_bytes * self.n_stops,
            n_stops=self.n_stops,
            on_meter_ready=lambda: self._readings.start(first) if first is not None else None,
        )
        findings = Findings((*findings.checks, *self._stop_checks()), findings.devices)
        for check in findings.checks:
            yield self._say(EventKind.CHECK, f"{check.name}: {check.text}", **check.to_dict())
        require(findings)
        if self._store is None:
            self._store = SessionStore.create(self._request.into, self._manifest(findings), clock=self._rig.clock)
            yield from self._opening_warnings()
        else:
            self._store.update(devices=_merged(self._store.manifest, findings.devices))
            yield from self._withdraw_damaged(self._store)
            text = "the session was completed later: the light may have changed in between"
            if self._store.manifest.rig.get("bracket", {}).get("reference") and not self._store.manifest.references:
                text += "; no stop is repeated to show it, and none is added for --noise"
            yield self._warn("resumed", text)
        for check in findings.checks:
            warning = WarningRecord(code=f"preflight: {check.name}", message=check.text[:500])
            if check.level is Level.WARN and warning not in self._store.manifest.warnings:  # it may be resumed
                self._store.add(warning)

    def _stop_checks(self) -> Iterator[Check]:
        """Refuse stops that a connected camera does not have: it would take the nearest under their name."""
        for side in self._plan.sides:
            camera = self._rig.cameras.get(side)
            lacking = unavailable_stops(self._plan.stops_s, camera.shutter_times_s) if camera else ()
            if lacking:
                text = f"this camera does not have {', '.join(lacking)}"
                yield Check(Level.FAIL, f"{side} stops", text, advice="change --stops, or [bracket] stops of the rig")

    def _withdraw_damaged(self, store: SessionStore) -> Iterator[CaptureEvent]:
        """Planned frames whose file is gone or changed since they were saved are taken anew; it is kept aside."""
        for frame in self._damaged:
            reason = "changed or deleted since it was saved"
            store.withdraw_frame(frame.side, frame.stop, frame.format, reason)
            again = frame.stop in store.manifest.missing_stops(frame.side)
            yield self._warn("damaged", f"{frame.file}: {reason}; " + ("taken again" if again else "left out"))

    def _manifest(self, findings: Findings) -> SessionManifest:
        rig, world = self._rig.file, {"simulate": self._rig.world} if self._rig.world else {}
        used = rig.bracket.model_copy(update={"reference": self._plan.reference})  # which --noise asks for, too
        return SessionManifest(
            session_id=uuid4().hex,
            name=self._request.room,
            created_utc=self._rig.clock.utc_now(),
            software=software_versions(),
            simulated=self._rig.simulated,
            site=rig.site.model_copy(update={"name": self._request.address or rig.site.name}),
            heading_rad=None if rig.heading_deg is None else math.radians(rig.heading_deg),
            camera_height_m=rig.camera_height_m,
            bracket=BracketRecord(
                mode=self._plan.mode,
                stops_s=self._plan.stops_s,
                sides=self._plan.sides,
                order=self._plan.order,
                raw_sides=tuple(s for s in self._plan.sides if rig.cameras()[s].keep_raw),
            ),
            devices=findings.devices,
            target=self._request.target or (rig.meter.target() if rig.meter else None),
            readings_planned=self._readings.planned,
            rig=rig.model_copy(update={"bracket": used}).model_dump(mode="json") | world,
        )

    def _opening_warnings(self) -> Iterator[CaptureEvent]:
        if len(self._plan.sides) == 1:
            yield self._warn("one_side", f"{self._plan.sides[0]} only")
        if self.store.manifest.readings_planned == 0:
            yield self._warn("no_meter", "no meter reading: luminance is relative until one is given")
        elif self.store.manifest.target is None:
            yield self._warn("no_target", "the meter's target is unknown: set target_deg in the rig, or --target")

    def _start_last_reading(self) -> None:
        if "after" in self.store.manifest.missing_readings() and self._readings.can_take("after"):
            self._readings.start("after")

    def _collect_reading(self) -> Iterator[CaptureEvent]:
        try:
            record = self._readings.collect()
        except DeviceError as error:
            if self.store.manifest.frames:  # the frames must not suffer from a meter that died meanwhile
                yield self._warn("meter", f"no reading: {error}")
                return
            raise
        if record is None:
            return
        self.store.add(record)
        text = f"meter {record.when}: {_in_words(record)}"
        yield self._say(EventKind.READING, text, **record.model_dump(mode="json"))
        if record.luminance_cd_m2 is None:
            yield self._warn("reading", f"the reading {record.when} has no value: {_in_words(record)}")

    def _bracket(self) -> Iterator[CaptureEvent]:
        notices: queue.SimpleQueue[Notice] = queue.SimpleQueue()
        sides = [s for s in self._plan.sides if self.store.manifest.missing_stops(s)]
        intakes = {side: self._intake(side, notices) for side in sides}
        try:
            self._conductor = Conductor(
                self._plan,
                {side: self._worker(side, intakes[side]) for side in sides},
                notices,
                self.store,
                self._rig.clock,
                limits=self._rig.file.limits,
                hooks=Hooks(self._start_last_reading, lambda: self._doubts(intakes), lambda a: self._noise(intakes, a)),
            )
            self._conductor.paused = self._paused
            if self._stop_asked:
                self._conductor.ask_stop()
            yield from self._conductor.run()
            for (side, _), why in self._doubts(intakes).items():
                yield self._warn("brightness_order", f"{side}: {why}")
        finally:
            for intake in intakes.values():
                intake.close()

    def _doubts(self, intakes: Mapping[Side, Intake]) -> Doubts:
        return doubts(intakes, self.store.manifest.bracket.stops_s)

    def _noise(self, intakes: Mapping[Side, Intake], asked_frac: float) -> tuple[dict[Side, float], float | None]:
        """Return how noisy each side is, and the exposure that the worst one lacks; None: as asked, or it stays so."""
        bracket, cameras = self.store.manifest.bracket, self._rig.cameras
        errors = {side: error_by_noise(side, intake.facts, bracket.stops_s) for side, intake in intakes.items()}
        longest_s, spent_s = max(bracket.stops_s), bracket.stops_s[len(bracket.order) :]
        most_s = min(LONGEST_FURTHER_S, MOST_FURTHER_S - sum(spent_s)) if len(spent_s) < MOST_FURTHER else 0.0
        offered_s = set[float].intersection(*(set(cameras[side].shutter_times_s) for side in errors))
        times_s = [time_s for time_s in {longest_s, *offered_s} if longest_s <= time_s <= most_s]
        # Give up a side that the last exposure did not help: its worst parts are clipped in longer ones.
        helped = [side for side in errors if not errors[side] >= self._errors.get(side, math.nan)]
        lacks = [errors[side] for side in helped if errors[side] > asked_frac]
        self._errors = errors
        return errors, further_time_s(max(lacks), asked_frac, times_s) if times_s and lacks else None

    def _intake(self, side: Side, notices: queue.SimpleQueue[Notice]) -> Intake:
        table, checker = self._rig.file.cameras()[side], self._checkers[side]
        offset_s = next((d.clock_offset_s for d in self.store.manifest.devices if d.role == side.value), None)
        exact = self._plan.mode == "adaptive" or self._plan.noise_frac is not None
        return Intake(side, self.store, checker, table, notices, exact=exact, clock_offset_s=offset_s)

    def _worker(self, side: Side, intake: Intake) -> CameraWorker:
        camera, table = self._rig.cameras[side], self._rig.file.cameras()[side]
        worker = CameraWorker(
            camera,
            table.settings(),
            intake,
            self._rig.clock,
            release_lag_s=camera.release_lag_s if table.release_lag_s is None else table.release_lag_s,
            delete_after=table.delete_after,
        )
        intake.on_safe = worker.order
        return worker

    def _end(self) -> Iterator[CaptureEvent]:
        drift = drift_frac(self.store.manifest.readings)
        if drift is not None:
            self.store.update(drift_frac=drift)
            if abs(drift) > self._rig.file.limits.max_drift_frac:
                yield self._warn("drift", f"the light changed by {drift:+.1%} between the two readings")
        manifest = self.store.finish()
        text = f"session {manifest.status}: {self.store.path.name}"
        yield self._say(EventKind.FINISHED, text, status=manifest.status, missing=list(manifest.missing))
        dead = self._conductor.dead if self._conductor else {}
        if dead and manifest.status is SessionStatus.PARTIAL:
            raise next(iter(dead.values()))

    def _warn(self, code: str, text: str) -> CaptureEvent:
        self.store.add(WarningRecord(code=code, message=text[:500]))
        return self._say(EventKind.WARNING, text, code=code)

    def _say(self, kind: EventKind, text: str, /, **data: object) -> CaptureEvent:
        return CaptureEvent(kind, text, self._rig.clock.monotonic_s(), data)


def _start_quietly(checker: FrameChecker) -> None:
    """Start a checker; one that does not start says so at its first frame."""
    with suppress(ResourceError):
        checker.start()


def _in_words(record: ReadingRecord) -> str:
    number = "" if record.luminance_cd_m2 is None else f" {record.luminance_cd_m2:g} cd/m2"
    return f"{record.status}{number} {record.detail}".rstrip()


def _merged(manifest: SessionManifest, now: tuple[DeviceRecord, ...]) -> tuple[DeviceRecord, ...]:
    """Return the devices of the session with those of this run in place of earlier ones of the same role.

    Raises `DeviceNotFoundError`: another body than the one whose frames the session has; no two have the same curve.
    """
    roles, taken = {d.role: d for d in now}, {f.side for f in manifest.frames}
    for was in manifest.devices:
        other = roles.get(was.role, was).serial
        if was.role in taken and was.serial not in ("", other):
            text = f"another camera answers: serial number {other}, the session has frames of {was.serial}"
            raise DeviceNotFoundError(text, where=was.role, advice="plug the first one in, or start a new session")
    return (*(d for d in manifest.devices if d.role not in roles), *now)

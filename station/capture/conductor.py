"""The bracket itself: pairs fired together, frames fetched behind, what fails retaken once and then named."""

import math
import queue
from collections import Counter, deque
from collections.abc import Callable, Generator, Iterable, Iterator, Mapping
from dataclasses import replace
from typing import NamedTuple

from drivers.clock import Clock, Deadline
from drivers.errors import BatteryLowError, DaylitError, DeviceClaimedError, DevicePermissionError, StoreFullError
from station.capture import events
from station.capture.bracket import BracketPlan, useless_because
from station.capture.camera_worker import EXPOSURE_GRACE_S, CameraWorker
from station.capture.pairing import Pairing
from station.capture.reference import best_stop, in_words
from station.capture.rig_file import LimitsTable
from station.frames.rules import seconds_text
from station.session.session import FrameStatistics, Side, SkippedStop, WarningRecord, shutter_label
from station.session.store import SessionStore

SET_UP_LIMIT_S = 45.0  # setting one stop; it begins anew when a camera is back from a recovery
LAST_TRANSFERS_LIMIT_S = 300.0  # chosen: for the last frames, raw ones on a slow card
LEAVE_LIMIT_S = 60.0  # for a camera's thread to end an exposure or a recovery when nobody listens any more
MAX_RETAKES = 1  # chosen: what fails twice fails again
MAX_DEVICE_FAILURES = 2  # of one stop: recovered that often, then the stop is named as missing
PUMP_WAIT_S = 0.25  # chosen: how late an interrupt is seen
_KINDS = events.EventKind
JOURNALLED = (_KINDS.RECOVERING, _KINDS.FAILED, _KINDS.PAUSED, _KINDS.CONTINUED, _KINDS.NOISE)
"""What the store's own records do not hold. The rest would only put disk waits between two exposures."""
NEEDS_A_PERSON = (BatteryLowError, StoreFullError, DeviceClaimedError, DevicePermissionError)
"""Errors after which a retake is useless until somebody acts."""

Doubts = dict[tuple[Side, int], str]  # frames that do not fit the others of their bracket, and why


class Hooks(NamedTuple):
    """What a capture wants to be asked: at the last exposure, and when all frames are in."""

    on_last_exposure: Callable[[], None]
    """Called when nothing is left to expose, while the last frames come in."""
    doubts: Callable[[], Doubts]
    """Returns the frames that only the whole bracket shows to be wrong."""
    noise: Callable[[float], tuple[dict[Side, float], float | None]]
    """Returns `station.capture.reference.further_time_s` of what was taken, for what is asked."""


class Conductor:
    """Takes the stops of a plan that are missing; iterate over `run` to make it happen."""

    def __init__(
        self,
        plan: BracketPlan,
        workers: Mapping[Side, CameraWorker],
        notices: queue.SimpleQueue[events.Notice],
        store: SessionStore,
        clock: Clock,
        *,
        limits: LimitsTable,
        hooks: Hooks,
    ) -> None:
        self._plan = plan
        self._workers = workers
        self._notices = notices
        self._store = store
        self._clock = clock
        self._max_start_skew_s, self._max_drift_frac = limits.max_start_skew_s, limits.max_drift_frac
        self._on_last_exposure, self._doubts, self._noise = hooks
        self._todo: deque[tuple[int, tuple[Side, ...]]] = deque()
        self._pairing = Pairing(plan, workers, clock)
        self._retakes = self._pairing.retakes
        self._in_flight: Counter[tuple[Side, int]] = Counter()
        self._rejected: dict[tuple[Side, int], str] = {}
        self._failures: Counter[tuple[Side, int]] = Counter()
        self._statistics: dict[Side, dict[int, FrameStatistics]] = {side: {} for side in plan.sides}
        self._left: set[Side] = set()
        self._stop_asked = False
        self.paused = False
        """Set, at any moment, to take no further pair; cleared, to go on."""
        self.dead: dict[Side, DaylitError] = {}

    def ask_stop(self) -> None:
        """Take no further stop; what is exposed is still fetched. Safe to call from a signal handler."""
        self._stop_asked = True

    def run(self) -> Iterator[events.CaptureEvent]:
        """Take every missing stop; yields events; returns when all frames are saved or given up."""
        manifest = self._store.manifest
        for record in manifest.frames:
            if record.statistics is not None:
                self._statistics[record.side][record.stop] = record.statistics
        self._todo = deque(self._plan.remaining({side: manifest.missing_stops(side) for side in self._plan.sides}))
        for worker in self._workers.values():
            worker.start()
        try:
            try:
                yield from self._take_all()
            except Exception as error:  # noqa: BLE001 (raised again when every camera's thread is over)
                yield from self._dismiss(error)
            else:
                yield from self._dismiss(None)
        except (GeneratorExit, KeyboardInterrupt):
            self._leave_unheard()
            raise

    def _leave_unheard(self) -> None:
        """Nobody listens any more: no event may be yielded, but no camera may be left in use either."""
        for worker in self._workers.values():
            worker.order(events.Leave(at_once=True))
        for worker in self._workers.values():
            worker.join(LEAVE_LIMIT_S)

    def _take_all(self) -> Iterator[events.CaptureEvent]:
        announced = False
        while not (self._stop_asked or self.dead):
            if self.paused:
                yield from self._pause()
            elif self._todo:
                stop, sides = self._todo.popleft()
                sides = yield from self._sides_in_need(stop, sides)
                if sides and not self._stop_asked:
                    announced = False
                    yield from self._take(stop, sides)
            elif not announced and (self._pairing.repeats or not self._plan.reference):
                self._on_last_exposure()
                announced = True
            elif self._in_flight:
                yield from self._pump()
            elif not ((yield from self._retake_doubtful()) or (yield from self._further()) or self._repeat()):
                return

    def _further(self) -> Generator[events.CaptureEvent, None, bool]:
        """Append a stop that brings the noise down to what is asked; False where that is not wanted, or done."""
        asked, bracket = self._plan.noise_frac, self._store.manifest.bracket
        if asked is None or self._pairing.repeats:
            return False
        errors, time_s = self._noise(asked)
        said = {side: error if math.isfinite(error) else None for side, error in errors.items()}  # JSON has no NaN
        found = ", ".join(side + (" unknown" if e is None else f" within {e:.1%}") for side, e in said.items())
        text = f"noise: 95 % {found}; asked {asked:.1%}" + (f": adding {seconds_text(time_s)}" if time_s else "")
        yield self._event(_KINDS.NOISE, text, error_frac=said, asked_frac=asked, next_s=time_s)
        if time_s is None:
            if not all(error <= asked for error in errors.values()):
                yield self._warn("noise", f"{text}, not achieved")
            return False
        self._todo.append((len(bracket.stops_s), tuple(self._workers)))
        self._plan = self._pairing.plan = replace(self._plan, stops_s=(*bracket.stops_s, time_s))
        self._store.update(bracket=bracket.model_copy(update={"stops_s": self._plan.stops_s}))
        return True

    def _repeat(self) -> bool:
        """Put one stop of each side back, once, to be compared with itself; False: not wanted, or it was done."""
        if self._pairing.repeats or not self._plan.reference:
            return False
        self._pairing.repeats = True
        stops = {side: best_stop(self._statistics[side]) for side in self._workers}
        for stop in dict.fromkeys(stops.values()):
            if stop is not None:
                self._todo.append((stop, tuple(side for side, own in stops.items() if own == stop)))
        return True

    def _pause(self) -> Iterator[events.CaptureEvent]:
        """Let both buttons go and take in what comes, until asked to go on; the cameras' threads keep them awake."""
        begun_s = self._clock.monotonic_s()
        self._pairing.stand_down(self._workers)
        yield self._event(_KINDS.PAUSED, "paused")
        while self.paused and not (self._stop_asked or self.dead):
            yield from self._pump()
        yield self._event(_KINDS.CONTINUED, "continued")
        if self._todo:
            text = f"paused for {self._clock.monotonic_s() - begun_s:.0f} s: the light may have changed"
            yield self._warn("paused", text)

    def _retake_doubtful(self) -> Generator[events.CaptureEvent, None, bool]:
        """Put back, once, what only the whole bracket shows to be wrong; frames stay until better ones are saved."""
        doubts = {} if self._pairing.repeats else self._doubts()
        found = {key: why for key, why in doubts.items() if self._retakes[key] < MAX_RETAKES}
        for (side, stop), why in found.items():
            self._retakes[side, stop] += 1
            self._todo.append((stop, (side,)))
            text = f"{side} {self._label(stop)}: {why}; taken again"
            yield self._event(_KINDS.REJECTED, text, side=side, stop=stop, reason=why, retaken=True)
        return bool(found)

    def _dismiss(self, error: Exception | None) -> Iterator[events.CaptureEvent]:
        """Let the workers fetch what is exposed and end, bounded; then raise ``error``, or what goes wrong meanwhile.

        The first error is the one that is raised; a thread of a camera must be over whatever happens, for its camera
        is closed next.
        """
        self._stop_asked = True
        for side, worker in self._workers.items():
            worker.order(events.Leave(at_once=side in self.dead))
        deadline = Deadline.after(self._clock, LAST_TRANSFERS_LIMIT_S)
        while (self._left != set(self._workers) and not deadline.expired) or not self._notices.empty():
            try:
                yield from self._pump()
            except Exception as another:  # noqa: BLE001 (the first is raised below)
                error = error or another
        if self._left != set(self._workers):
            self._leave_unheard()
        if error is not None:
            raise error

    def _sides_in_need(self, stop: int, whom: Iterable[Side]) -> Generator[events.CaptureEvent, None, tuple[Side, ...]]:
        """Return which sides need it; in an adaptive bracket, after the frames that decide it are judged."""
        if self._plan.mode == "full" or stop >= len(self._plan.order):
            return tuple(whom)
        neighbours = [(side, near) for side in whom for near in (stop - 1, stop + 1)]
        while any(self._in_flight[key] for key in neighbours) and not (self.dead or self._stop_asked):
            yield from self._pump()
        needed = []
        for side in whom:
            stops_s = self._store.manifest.bracket.stops_s
            reason = useless_because(stop, self._statistics[side], stops_s)
            if reason is None or self._store.manifest.frame(side, stop):  # a doubtful frame is there, to be replaced
                needed.append(side)
                continue
            self._store.add(SkippedStop(side=side, stop=stop, reason=reason))
            text = f"{side} {self._label(stop)} left out: {reason}"
            yield self._event(_KINDS.SKIPPED, text, side=side, stop=stop, reason=reason)
        return tuple(needed)

    def _take(self, stop: int, sides: tuple[Side, ...]) -> Iterator[events.CaptureEvent]:
        yield self._event(_KINDS.STOP, f"{self._label(stop)}", stop=stop, sides=list(sides))
        self._pairing.set_up(stop, sides)
        yield from self._pump_until(lambda: self._answered(stop, sides), SET_UP_LIMIT_S, "camera ready")
        if not self._pairing.ready(stop, sides) or self.dead:
            self._pairing.stand_down(sides)
            yield from self._again(stop, sides)
            return
        self._pairing.fire(stop, sides)
        limit_s = 2 * self._plan.stops_s[stop] + EXPOSURE_GRACE_S + SET_UP_LIMIT_S
        yield from self._pump_until(lambda: self._answered(stop, sides), limit_s, "exposure finished")
        skew_s = self._pairing.start_skew_s()
        if skew_s > self._max_start_skew_s:
            text = f"{self._label(stop)}: the shutters opened {skew_s * 1000:.0f} ms apart"
            yield self._warn("start_skew", text, stop=stop, skew_s=skew_s)
        if broken := self._pairing.broken(stop, sides):
            yield from self._again(stop, broken)

    def _set_up_ahead(self, notice: events.Exposed) -> None:
        """A camera that is through sets the next stop while its partner still exposes or saves.

        Not in an adaptive bracket, where the frames must say first whether there is a next stop, and not where
        transfers cannot hide behind exposures: a camera that is set up is left alone until it fires.
        """
        if self._plan.mode != "full" or not notice.overlaps or not self._todo or self._stop_asked or self.dead:
            return
        stop, sides = self._todo[0]
        if notice.side in sides:
            self._pairing.set_up_ahead(notice.side, stop)

    def _answered(self, stop: int, sides: Iterable[Side]) -> bool:
        return bool(self.dead) or self._pairing.answered(stop, sides)

    def _again(self, stop: int, sides: tuple[Side, ...]) -> Iterator[events.CaptureEvent]:
        """Put a stop back, unless its camera failed it too often; then it stays missing and is named."""
        for side in self._pairing.broken(stop, sides):
            self._failures[side, stop] += 1
        spent = tuple(s for s in sides if self._failures[s, stop] > MAX_DEVICE_FAILURES)
        for side in spent:
            text = f"{side} {self._label(stop)}: the camera failed {self._failures[side, stop]} times; frame missing"
            yield self._warn("frame_missing", text, side=side, stop=stop)
        if kept := tuple(s for s in sides if s not in spent):
            self._todo.appendleft((stop, kept))

    def _pump_until(self, done: Callable[[], bool], limit_s: float, what: str) -> Iterator[events.CaptureEvent]:
        """Handle notices until ``done``; the limit begins anew when a camera is back from a recovery."""
        deadline = Deadline.after(self._clock, limit_s)
        while not done():
            if self._pairing.recovering():
                deadline = Deadline.after(self._clock, limit_s)
            deadline.check(what, "capture")
            yield from self._pump()

    def _pump(self) -> Iterator[events.CaptureEvent]:
        """Handle one notice, if one comes."""
        try:
            notice = self._notices.get(timeout=PUMP_WAIT_S)
        except queue.Empty:
            return
        match notice:
            case events.Ready():
                self._pairing.take(notice)
            case events.Released() | events.Exposed():
                yield self._opened_or_closed(notice)
            case events.Progress(side, stop, done_bytes, total_bytes):
                data = {"side": side, "stop": stop, "done_bytes": done_bytes, "total_bytes": total_bytes}
                yield events.CaptureEvent(_KINDS.PROGRESS, "", self._clock.monotonic_s(), data)
            case events.Left(side):
                self._left.add(side)
            case _:
                yield from self._outcome(notice)

    def _opened_or_closed(self, notice: events.Released | events.Exposed) -> events.CaptureEvent:
        side, stop = notice.side, notice.stop
        if isinstance(notice, events.Released):
            self._pairing.released_s[side] = notice.at_s
            text = f"{side} {self._label(stop)} released"
            return self._event(_KINDS.RELEASED, text, side=side, stop=stop, release_s=notice.at_s)
        self._pairing.take(notice)
        self._in_flight[side, stop] += notice.n_frames
        self._set_up_ahead(notice)
        return self._event(_KINDS.EXPOSED, f"{side} {self._label(stop)} exposed", side=side, stop=stop)

    def _outcome(self, notice: events.Notice) -> Iterator[events.CaptureEvent]:
        match notice:
            case events.Saved():
                yield from self._saved(notice)
            case events.Rejected(side, stop, record):
                yield from self._frame_failed(side, stop, record.reason)
            case events.Repeated():
                yield from self._repeated(notice)
            case events.Lost(side, stop, error):
                yield from self._frame_failed(side, stop, str(error))
            case events.Breaking() | events.Broken():
                yield self._breaking_or_broken(notice)
            case events.Fatal(_, error):
                raise error

    def _saved(self, notice: events.Saved) -> Iterator[events.CaptureEvent]:
        side, stop, record = notice.side, notice.stop, notice.record
        if record.statistics is not None:
            self._statistics[side][stop] = record.statistics
        data = {"side": side, "stop": stop, "file": record.file, "size_bytes": record.size_bytes}
        yield self._event(_KINDS.SAVED, f"{side} {self._label(stop)} saved: {record.file}", **data)
        yield from self._settle(side, stop)

    def _repeated(self, notice: events.Repeated) -> Iterator[events.CaptureEvent]:
        if (record := notice.record) is not None:
            found = f"light x {record.ratio:.3f}" if record.ratio else "nothing to compare"
            text = f"{record.side} {self._label(record.stop)} repeated: {found}"
            yield self._event(_KINDS.REFERENCE, text, **record.model_dump(mode="json"))
            if moved := in_words(record, self._max_drift_frac):
                yield self._warn("moving_light", moved)
        yield from self._settle(notice.side, notice.stop)

    def _frame_failed(self, side: Side, stop: int, reason: str) -> Iterator[events.CaptureEvent]:
        self._rejected.setdefault((side, stop), reason)
        yield from self._settle(side, stop)

    def _settle(self, side: Side, stop: int) -> Iterator[events.CaptureEvent]:
        """Count a frame that has come to its end; with the last of its exposure, judge the exposure."""
        self._in_flight[side, stop] -= 1
        if self._in_flight[side, stop] > 0:
            return
        del self._in_flight[side, stop]
        reason = self._rejected.pop((side, stop), None)
        if reason is not None:
            yield from self._exposure_failed(side, stop, reason)

    def _exposure_failed(self, side: Side, stop: int, reason: str) -> Iterator[events.CaptureEvent]:
        again = self._retakes[side, stop] < MAX_RETAKES and not (self.dead or self._stop_asked or self._pairing.repeats)
        kept = "the frame saved before is kept" if self._store.manifest.frame(side, stop) else "missing"
        text = f"{side} {self._label(stop)}: {reason}; " + ("taken again" if again else kept)
        yield self._event(_KINDS.REJECTED, text, side=side, stop=stop, reason=reason, retaken=again)
        if again:
            self._retakes[side, stop] += 1
            self._todo.append((stop, (side,)))
        else:
            yield self._warn("frame_missing", text, side=side, stop=stop)

    def _breaking_or_broken(self, notice: events.Breaking | events.Broken) -> events.CaptureEvent:
        side, error = notice.side, notice.error
        self._pairing.take(notice)
        data = {"side": side, "stop": notice.stop, "error": error.to_dict()}
        if isinstance(notice, events.Breaking):
            return self._event(_KINDS.RECOVERING, f"{side}: {error.message}; recovering", **data, recovered=False)
        data["recovered"] = notice.recovered
        if notice.recovered and not isinstance(error, NEEDS_A_PERSON):
            return self._event(_KINDS.RECOVERING, f"{side}: {error.message}; the camera is back", **data)
        self.dead[side] = error
        return self._event(_KINDS.FAILED, f"{side}: {error}", **data)

    def _label(self, stop: int) -> str:
        return shutter_label(self._plan.stops_s[stop])

    def _warn(self, code: str, text: str, /, **data: object) -> events.CaptureEvent:
        self._store.add(WarningRecord(code=code, message=text[:500]))
        return self._event(_KINDS.WARNING, text, code=code, **data)

    def _event(self, kind: events.EventKind, text: str, /, **data: object) -> events.CaptureEvent:
        if kind in JOURNALLED:
            self._store.event(str(kind), **data)
        return events.CaptureEvent(kind, text, self._clock.monotonic_s(), data)

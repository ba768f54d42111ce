"""One sitting with a simulated camera under faults, driven as the station's camera thread does, and judged.

Time is virtual and one thread does everything, so that a sitting is the same each time. The camera's own records (the
pictures it made, its log of exposures) are the truth that every frame handed out is held against.
"""

from __future__ import annotations

from collections import Counter, deque
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from typing import Any

from drivers.camera import CameraSettings, CameraStatus, FrameRef
from drivers.camera_link import TRANSACTION_LIMIT_S
from drivers.clock import Deadline
from drivers.errors import DeviceBusyError, DeviceError, DeviceTimeoutError, ExposureFailedError
from drivers.ptp.resync import DRAIN_LIMIT_S, RESYNC_LIMIT_S
from drivers.ptp.session import OPEN_LIMIT_S
from drivers.theta_z1.camera import READY_LIMIT_S, WAKE_LIMIT_S
from mocks.instruments.faults import Fault, FaultKind, FaultSchedule
from mocks.instruments.usb.bus import SimulatedUsbBackend
from station.capture.conductor import MAX_DEVICE_FAILURES, NEEDS_A_PERSON
from tests.torture.ptp.flavours import CountedClock, EndlessError, Flavour, RecordedShots

SHUTTERS_S = (1 / 60, 1 / 4, 1 / 250)
CHUNK_BYTES = 500
"""Fills one packet with its header, so that every whole chunk needs a zero-length packet behind it."""
EXPOSURE_GRACE_S = 30.0
MAX_TRIES = 6
MAX_TRANSFER_ATTEMPTS = 2
BUSY_LIMIT_S = 60.0
BUSY_PAUSE_S = 0.03
PERSON_S = 10.0
"""What a person needs to mend what no program can, before the capture is resumed."""
SITTING_LIMIT_S = 900.0
SETTINGS = {
    "theta_z1": CameraSettings(100, 5.6, 6500, 6720, 3360),
    "canon_5d2": CameraSettings(200, 16, 6500, 5616, 3744),
}
PATIENCE_S = 5.0
"""For a busy camera, of each property and operation (both drivers)."""
IDLE_S = 15.0
_T, _R, _W = TRANSACTION_LIMIT_S, READY_LIMIT_S, WAKE_LIMIT_S
_OPENING_S = DRAIN_LIMIT_S + OPEN_LIMIT_S + RESYNC_LIMIT_S
LIMITS_S = {
    "theta_z1": {
        "connect": _OPENING_S + _W + 2 * _R + _T,
        "recover": RESYNC_LIMIT_S + _W + 2 * _R + _T,
        "prepare": _W + _R + PATIENCE_S + _T + 3.0,
        "status": 2 * _T,
        "set_shutter": _W + _R + 2 * PATIENCE_S + _T,
        "arm": _R + _T,
        "release": _T,
        "poll_exposure": _T,
        "read_chunk": _T,
        "finish_frame": _T,
        "delete": _T,
        "keep_alive": _W + _T,
        "close": 2 * PATIENCE_S + _T,
    },
    "canon_5d2": {
        "connect": _OPENING_S + 6 * PATIENCE_S + _T,
        "recover": RESYNC_LIMIT_S + 6 * PATIENCE_S + _T,
        "prepare": 3 * PATIENCE_S + IDLE_S + _T,
        "status": 4 * PATIENCE_S + _T,
        "set_shutter": 2 * IDLE_S + 3 * PATIENCE_S + _T,
        "arm": IDLE_S + 4 * PATIENCE_S + 2 * _T,
        "release": 2 * PATIENCE_S + 2 * _T,
        "poll_exposure": _T,
        "read_chunk": _T,
        "finish_frame": PATIENCE_S + _T,
        "delete": PATIENCE_S + _T,
        "keep_alive": 2 * PATIENCE_S + _T,
        "close": 2 * PATIENCE_S + _T,
    },
}
"""Longest one call may take, virtual seconds: the documented waits that it is made of, and one transaction more (a
wait is looked at between transactions). What the exposure itself takes comes on top of release and recover."""
SLACK_S = 0.25
"""Latencies of the transactions that are not waited for."""


@dataclass
class _Transfer:
    stop: int
    frame: FrameRef
    nominal_s: float
    exposures: range
    content: bytes = b""
    attempts: int = 0
    busy_since_s: float | None = None


@dataclass
class Verdict:
    """What a sitting showed; ``wrong`` must be empty."""

    fired: int = 0
    wrong: list[str] = field(default_factory=list)
    errors: Counter[str] = field(default_factory=Counter)
    recoveries: int = 0
    resumes: int = 0
    waits_s: dict[str, float] = field(default_factory=dict)
    elapsed_s: float = 0.0


class Sitting:
    """Connects, takes every stop, lets a person mend what must be, and takes one more in the end."""

    def __init__(self, flavour: Flavour, faults: tuple[Fault, ...], seed: int = 0) -> None:
        self.flavour = flavour
        self.clock = CountedClock()
        self.shots = RecordedShots()
        self.device = flavour.device(self.shots, self.clock, FaultSchedule(faults), seed)
        self.backend = SimulatedUsbBackend([self.device], self.clock)
        self.camera = flavour.driver(self.backend, self.clock)
        self.verdict = Verdict()
        self._backlog: deque[_Transfer] = deque()
        self._taken: dict[int, bytes] = {}
        self._safe: set[int] = set()
        self._stops = dict(enumerate(SHUTTERS_S))
        self.n_operations = 0
        """Until the last stop was taken; what follows is the proof that the camera works again."""

    def run(self) -> Verdict:
        """Run it whole; nothing escapes but a fault of this program."""
        try:
            self._whole()
        except EndlessError as error:
            self.verdict.wrong.append(f"endless: {error}")
        except DeviceError as error:
            self.verdict.wrong.append(f"gave up: {type(error).__name__}: {error}")
        except Exception as error:
            self.verdict.wrong.append(f"escaped: {type(error).__name__}: {error}")
        self.verdict.fired = len(self.device.faults.fired)
        self.verdict.elapsed_s = self.clock._elapsed_s
        if self.verdict.elapsed_s > SITTING_LIMIT_S:
            self.verdict.wrong.append(f"took {self.verdict.elapsed_s:.0f} s")
        return self.verdict

    def _whole(self) -> None:
        self._resume(first=True)
        self._take_all()
        self.n_operations = len(self.device.stats.operations)
        self._mend(everything=True)
        self._stops = {len(SHUTTERS_S): 1 / 60}
        recoveries = self.verdict.recoveries
        self._take_all()
        if self.verdict.recoveries > recoveries + 1:
            self.verdict.wrong.append("the fault is over, and it took more than one recovery to work again")
        self._call("close")
        lost = set(range(len(SHUTTERS_S) + 1)) - set(self._taken)
        if lost:
            self.verdict.wrong.append(f"stops never taken: {sorted(lost)}")

    # ---- calls, each with its limit

    def _call(self, name: str, *args: Any, on_top_s: float = 0.0) -> Any:
        begun_s = self.clock.monotonic_s()
        try:
            return getattr(self.camera, name)(*args)
        except DeviceError as error:
            self.verdict.errors[type(error).__name__] += 1
            raise
        finally:
            took_s = self.clock.monotonic_s() - begun_s - on_top_s
            self.verdict.waits_s[name] = max(self.verdict.waits_s.get(name, 0.0), took_s)
            limit_s = LIMITS_S[self.flavour.kind][name] + SLACK_S
            if took_s > limit_s:
                self.verdict.wrong.append(f"{name} took {took_s:.1f} s, the limit is {limit_s:.1f} s")

    def _settings(self) -> CameraSettings:
        return replace(SETTINGS[self.flavour.kind])

    # ---- the station's ways

    def _guarded(self, step: Callable[[], None]) -> bool:
        """Carry out a step; on a device error recover and set anew, or else have a person help and resume."""
        try:
            step()
        except DeviceError as cause:
            self.verdict.recoveries += 1
            try:
                self._call("recover", on_top_s=max(SHUTTERS_S))
                self._call("prepare", self._settings())
            except DeviceError:
                self._resume()
            else:
                if isinstance(cause, NEEDS_A_PERSON):
                    self._mend()
                    self._resume()
            return False
        return True

    def _resume(self, *, first: bool = False) -> None:
        """Begin as a new program does, after a person's help if need be."""
        for attempt in range(MAX_TRIES):
            if attempt or not first:
                self.verdict.resumes += 1
                self._call("close")
                self._backlog.clear()
                self.camera = self.flavour.driver(self.backend, self.clock)
            try:
                self._call("connect")
                self._call("prepare", self._settings())
                if not self._fit(self._call("status")):
                    self._mend()
                return
            except DeviceError:
                if attempt == MAX_TRIES - 1:
                    raise
                self._mend()

    @staticmethod
    def _fit(status: CameraStatus) -> bool:
        """Whether preflight would let the capture begin."""
        full = status.free_frames is not None and status.free_frames < 20
        empty = status.battery_frac is not None and status.battery_frac < 0.2
        return not (status.problems or full or empty)

    def _mend(self, *, everything: bool = False) -> None:
        """Put the cable in, charge, empty the card, switch off and on: what has shown itself is over."""
        self.clock.sleep(PERSON_S)
        runner = self.device.faults
        runner._conditions.clear()
        shown = {id(fault) for fault in runner.fired}
        # An empty place keeps the others' counts.
        never = Fault(FaultKind.BUSY, nth=1 << 30)
        faults = runner.schedule.faults
        runner.schedule = FaultSchedule(tuple(never if everything or id(f) in shown else f for f in faults))
        if not self.device.plugged:
            self.device.replug()

    def _take_all(self) -> None:
        tries: Counter[int] = Counter()
        while missing := [s for s in self._stops if s not in self._taken]:
            waiting = {t.stop for t in self._backlog}
            stop = next((s for s in missing if s not in waiting), None)
            if stop is None or (self._backlog and self.flavour.destination == "pc"):
                self._guarded(lambda: self._transfer_chunk(pause=True))
                continue
            tries[stop] += 1
            if tries[stop] > MAX_TRIES:
                raise ExposureFailedError(f"stop {stop} failed {MAX_TRIES} times")
            if tries[stop] == MAX_DEVICE_FAILURES + 2:  # the station names it as missing, and a person resumes
                self._mend()
                self._resume()
            self._guarded(lambda stop=stop: self._expose(stop))  # type: ignore[misc]

    def _expose(self, stop: int) -> None:
        nominal_s = self._call("set_shutter", self._stops[stop]).nominal_s
        self._call("arm")
        first = self.device.shot_count + 1
        self._call("release", on_top_s=nominal_s)
        frames = self._wait_exposure(nominal_s)
        for frame in frames:
            self._backlog.append(_Transfer(stop, frame, nominal_s, range(first, self.device.shot_count + 1)))

    def _wait_exposure(self, nominal_s: float) -> tuple[FrameRef, ...]:
        deadline = Deadline.after(self.clock, 2 * nominal_s + EXPOSURE_GRACE_S)
        while not deadline.expired:
            progress = self._call("poll_exposure")
            if progress.done and progress.frames:
                return progress.frames
            if progress.done:
                raise ExposureFailedError("the exposure ended without a picture")
            if self._backlog and self.camera.can_transfer_while_exposing:
                self._transfer_chunk(pause=False)
        raise DeviceTimeoutError("no picture")

    def _transfer_chunk(self, *, pause: bool) -> None:
        transfer = self._backlog[0]
        try:
            self._read_into(transfer)
        except DeviceBusyError:
            now_s = self.clock.monotonic_s()
            transfer.busy_since_s = now_s if transfer.busy_since_s is None else transfer.busy_since_s
            if now_s - transfer.busy_since_s > BUSY_LIMIT_S:
                self._restart(transfer)
                raise
            if pause:
                self.clock.sleep(BUSY_PAUSE_S)
        except DeviceError:
            self._restart(transfer)
            raise

    def _read_into(self, transfer: _Transfer) -> None:
        frame, offset = transfer.frame, len(transfer.content)
        data = self._call("read_chunk", frame, offset, min(CHUNK_BYTES, frame.size_bytes - offset))
        transfer.content += data
        transfer.busy_since_s = None
        if len(transfer.content) >= frame.size_bytes:
            self._backlog.popleft()
            self._judge(transfer)
            self._guarded(lambda: self._finish(transfer))

    def _finish(self, transfer: _Transfer) -> None:
        self._call("finish_frame", transfer.frame)
        if self.flavour.delete_after:
            self._call("delete", transfer.frame)

    def _restart(self, transfer: _Transfer) -> None:
        transfer.content, transfer.busy_since_s = b"", None
        transfer.attempts += 1
        if transfer.attempts >= MAX_TRANSFER_ATTEMPTS:
            self._backlog.remove(transfer)

    # ---- judgement

    def _judge(self, transfer: _Transfer) -> None:
        """Hold a whole frame against what the camera made for the exposure that it was asked for."""
        made = self.shots.made.get(transfer.content)
        if made is None:
            self.verdict.wrong.append(f"stop {transfer.stop}: {len(transfer.content)} bytes that the camera never made")
            return
        asked = self._settings()
        if abs(made.shutter_s / transfer.nominal_s - 1) > 1e-6:
            self.verdict.wrong.append(f"misfiled: asked {transfer.nominal_s:g} s, the frame is of {made.shutter_s:g} s")
        if made.sequence not in transfer.exposures:
            self.verdict.wrong.append(f"misfiled: frame of exposure {made.sequence}, not of {transfer.exposures}")
        if (made.iso, made.f_number, made.color_temperature_k) != (
            asked.iso,
            asked.f_number,
            asked.color_temperature_k,
        ):
            self.verdict.wrong.append(f"taken with other settings than asked: {made}")
        self._taken[transfer.stop] = transfer.content

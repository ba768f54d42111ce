"""The thread that owns one camera during a bracket: sets, releases, polls, and fetches behind exposures.

The conductor (`station.capture.capture`) gives orders through an inbox and hears back through notices; nobody else
touches the camera. Idle → (SetUp) → armed → (Fire) → exposing → idle. Transfers of earlier frames run a chunk at a time
while exposing (where the camera can) and while idle, never while armed, so that both shutters open together.
"""

import queue
import threading
from collections import deque
from contextlib import suppress
from dataclasses import dataclass

from drivers import errors
from drivers.camera import Camera, CameraSettings, FrameRef, ShutterReadback
from drivers.clock import Clock, Deadline
from station.capture import events
from station.capture.intake import Intake
from station.session.folder import FRAME_CAP_BYTES
from station.session.session import Side

# Chosen: 40 ms at 25 MB/s, so that an order never waits long.
CHUNK_BYTES = 1 << 20
EXPOSING_CHUNK_BYTES = 1 << 18  # smaller, because the end of the exposure is noticed only between two chunks
EXPOSURE_GRACE_S = 30.0
"""Readout, processing and announcement of a frame must be over by then (its exposure comes on top)."""
BUSY_LIMIT_S = 60.0  # a camera that answers "busy" to a transfer for longer has failed it
# Pauses and periods: chosen.
BUSY_PAUSE_S = 0.03
IDLE_WAIT_S = 0.02  # chosen: how late a request is seen
KEEP_ALIVE_S = 5.0  # chosen: well within every body's automatic power-off
MAX_TRANSFER_ATTEMPTS = 2  # chosen: then the camera is recovered
PATIENCE_S = 100.0
"""Chosen: a camera that is only late (busy, silent) is recovered anew for so long: it may be two minutes late."""
PATIENCE_PAUSE_S = 1.0  # chosen


@dataclass
class _Transfer:
    shot: events.Shot
    offset: int = 0
    attempts: int = 0
    busy_since_s: float | None = None


class CameraWorker:
    """Runs one camera: `start` it, `order` it about, read its notices, `join` it."""

    def __init__(
        self,
        camera: Camera,
        settings: CameraSettings,
        intake: Intake,
        clock: Clock,
        *,
        release_lag_s: float,
        delete_after: bool = False,
    ) -> None:
        self.side: Side = intake.side
        self._camera = camera
        self._settings = settings
        self._intake = intake
        self._clock = clock
        self.release_lag_s = release_lag_s
        self._delete_after = delete_after
        self._inbox: queue.SimpleQueue[events.Order] = queue.SimpleQueue()
        self._backlog: deque[_Transfer] = deque()
        self._safe: deque[events.Safe] = deque()
        self._armed: events.SetUp | None = None
        self._leave_asked = False
        self._shutter: ShutterReadback
        self._alive_at_s = clock.monotonic_s()
        self._thread = threading.Thread(target=self._run, name=f"camera-{self.side}", daemon=True)

    def start(self) -> None:
        """Start the thread."""
        self._thread.start()

    def order(self, order: events.Order) -> None:
        """Queue an order."""
        self._leave_asked |= isinstance(order, events.Leave)
        self._inbox.put(order)

    def join(self, timeout_s: float) -> bool:
        """Wait for the thread to end; returns whether it did."""
        self._thread.join(timeout_s)
        return not self._thread.is_alive()

    def _put(self, notice: events.Notice) -> None:
        self._intake.notices.put(notice)

    def _run(self) -> None:
        try:
            self._serve()
        except Exception as error:  # noqa: BLE001 (the conductor must hear of it, whatever it is)
            self._put(events.Fatal(self.side, error))
        finally:
            self._put(events.Left(self.side))

    def _serve(self) -> None:
        leaving: events.Leave | None = None
        while leaving is None or (self._backlog and not leaving.at_once):
            order = self._next_order()
            if isinstance(order, events.Leave):
                leaving = order
                with suppress(errors.DeviceError):
                    self._stand_down()
            else:
                self._guarded(order)
        self._give_up_backlog()
        self._intake.wait_idle()
        # The camera forgets what became safe meanwhile; one that fails now is not worth a recovery any more.
        while not self._inbox.empty():
            order = self._inbox.get()
            if isinstance(order, events.Safe):
                self._safe.append(order)
        with suppress(errors.DeviceError):
            while self._safe:
                self._finish(self._safe.popleft())

    def _next_order(self) -> events.Order | None:
        """Return the next order, or None when it is time for a chunk or for keeping the camera awake."""
        useful = self._armed is None and (self._backlog or self._safe)
        with suppress(queue.Empty):
            return self._inbox.get(timeout=0.0 if useful else IDLE_WAIT_S)
        return None

    def _guarded(self, order: events.Order | None) -> None:
        """Carry out an order (None: something useful meanwhile); on a device error recover and report it."""
        stop = order.stop if isinstance(order, events.SetUp) else self._armed.stop if self._armed else None
        try:
            self._carry_out(order)
        except errors.DeviceError as error:
            self._armed = None
            self._put(events.Broken(self.side, stop, error, recovered=self._recover(error, stop)))

    def _carry_out(self, order: events.Order | None) -> None:
        match order:
            case None if self._armed is not None:
                self._stay_awake()  # its partner may take a minute: the 5D2 would switch itself off
            case None if self._safe:
                self._finish(self._safe.popleft())
            case None if self._backlog:
                self._transfer_chunk(CHUNK_BYTES, pause=True)
            case None:
                self._stay_awake()
            case events.SetUp():
                self._set_up(order)
            case events.Fire(open_at_s) if self._armed is not None:
                self._expose(self._armed, open_at_s)
            case events.StandDown():
                self._stand_down()
            case events.Safe() if self._armed is None:
                self._finish(order)
            case events.Safe():
                self._safe.append(order)  # an armed camera is left alone until it has fired

    def _set_up(self, order: events.SetUp) -> None:
        if self._camera.holds_pictures:
            self._fetch_what_is_held()
        while self._safe:
            self._finish(self._safe.popleft())
        self._shutter = self._camera.set_shutter(order.shutter_s)
        self._camera.arm()
        self._armed, self._alive_at_s = order, self._clock.monotonic_s()
        self._put(events.Ready(self.side, order.stop, order.number))

    def _stand_down(self) -> None:
        if self._armed is not None:
            self._armed = None
            self._camera.stand_down()

    def _fetch_what_is_held(self) -> None:
        """Fetch the last picture of a camera that keeps it in its memory, and is busy until it is safe here."""
        while self._backlog:
            self._transfer_chunk(CHUNK_BYTES, pause=True)
        self._intake.wait_idle()
        others: list[events.Order] = []
        while not self._inbox.empty():
            order = self._inbox.get()
            self._safe.append(order) if isinstance(order, events.Safe) else others.append(order)
        for order in others:
            self._inbox.put(order)

    def _expose(self, order: events.SetUp, open_at_s: float) -> None:
        self._clock.sleep(open_at_s - self.release_lag_s - self._clock.monotonic_s())
        released_utc, released_s = self._clock.utc_now(), self._clock.monotonic_s()
        self._camera.release()
        self._put(events.Released(self.side, order.stop, released_s))
        frames = self._wait_exposure(self._shutter.nominal_s)
        self._armed = None
        announced_utc = self._clock.utc_now()
        for frame in frames:
            shot = events.Shot(
                side=self.side,
                stop=order.stop,
                frame=frame,
                asked_s=order.shutter_s,
                shutter=self._shutter,
                released_utc=released_utc,
                released_s=released_s,
                announced_utc=announced_utc,
                retakes=order.retakes,
                repeats=order.repeats,
            )
            self._backlog.append(_Transfer(shot))
        self._put(events.Exposed(self.side, order.stop, len(frames), self._camera.can_transfer_while_exposing))

    def _wait_exposure(self, shutter_s: float) -> tuple[FrameRef, ...]:
        deadline = Deadline.after(self._clock, 2 * shutter_s + EXPOSURE_GRACE_S)
        while not deadline.expired:
            progress = self._camera.poll_exposure()
            if progress.done and progress.frames:
                return progress.frames
            if progress.done:
                likely = "no focus, or the card rejected the picture"
                raise errors.ExposureFailedError("the exposure gave no picture", where=str(self.side), likely=likely)
            if self._backlog and self._camera.can_transfer_while_exposing:
                self._transfer_chunk(EXPOSING_CHUNK_BYTES)
        text = f"no picture within {deadline.limit_s:g} s of the release"
        raise errors.DeviceTimeoutError(text, where=str(self.side), limit_s=deadline.limit_s)

    def _transfer_chunk(self, max_bytes: int, *, pause: bool = False) -> None:
        """Fetch one chunk of the oldest frame; a frame that fails is fetched anew once, then reported lost."""
        transfer = self._backlog[0]
        try:
            self._read_into(transfer, max_bytes)
        except errors.DeviceBusyError as error:
            if not pause:
                return  # it exposes; that has its own limit
            now_s = self._clock.monotonic_s()
            if transfer.busy_since_s is None:
                transfer.busy_since_s = now_s
            if now_s - transfer.busy_since_s > BUSY_LIMIT_S:
                self._restart(transfer, error)
                raise
            self._clock.sleep(BUSY_PAUSE_S)
        except errors.DeviceError as error:
            self._restart(transfer, error)
            raise

    def _read_into(self, transfer: _Transfer, max_bytes: int) -> None:
        frame = transfer.shot.frame
        if frame.size_bytes > FRAME_CAP_BYTES:
            text = f"a frame of {frame.size_bytes} bytes is announced, more than {FRAME_CAP_BYTES}"
            raise errors.ProtocolViolationError(text, where=str(self.side))
        data = self._camera.read_chunk(frame, transfer.offset, min(max_bytes, frame.size_bytes - transfer.offset))
        if not data:
            raise errors.ExposureFailedError("the camera sent no frame data", where=str(self.side), handle=frame.handle)
        self._intake.write(transfer.shot, data)
        transfer.offset += len(data)
        transfer.busy_since_s = None
        self._put(events.Progress(self.side, transfer.shot.stop, transfer.offset, frame.size_bytes))
        if transfer.offset >= frame.size_bytes:
            self._backlog.popleft()
            self._intake.complete(transfer.shot)

    def _restart(self, transfer: _Transfer, error: errors.DeviceError) -> None:
        self._intake.abort(transfer.shot)
        transfer.offset, transfer.busy_since_s = 0, None
        transfer.attempts += 1
        if transfer.attempts >= MAX_TRANSFER_ATTEMPTS:
            self._backlog.remove(transfer)
            self._put(events.Lost(self.side, transfer.shot.stop, error))

    def _give_up_backlog(self) -> None:
        while self._backlog:
            shot = self._backlog.popleft().shot
            self._intake.abort(shot)
            error = errors.DeviceTimeoutError("left on the camera", where=str(self.side))
            self._put(events.Lost(self.side, shot.stop, error))

    def _finish(self, safe: events.Safe) -> None:
        self._camera.finish_frame(safe.frame)
        if self._delete_after and safe.acknowledged:
            with suppress(errors.OperationRefusedError, errors.StoreFullError):  # one that is protected stays there
                self._camera.delete(safe.frame)

    def _stay_awake(self) -> None:
        now_s = self._clock.monotonic_s()
        if now_s - self._alive_at_s > KEEP_ALIVE_S:
            self._alive_at_s = now_s
            self._camera.keep_alive()

    def _recover(self, cause: errors.DeviceError, stop: int | None) -> bool:
        """Bring the camera back and set it anew (settings may be lost with power); False if it stays broken."""
        deadline = Deadline.after(self._clock, PATIENCE_S)
        while True:
            self._put(events.Breaking(self.side, stop, cause))
            try:
                self._camera.recover()
                self._camera.prepare(self._settings)
            except errors.DeviceError as error:
                cause.details["recovery"] = str(error)
                if not error.retryable or deadline.expired or self._leave_asked:
                    self._give_up_backlog()
                    return False
                self._clock.sleep(PATIENCE_PAUSE_S)
            else:
                return True

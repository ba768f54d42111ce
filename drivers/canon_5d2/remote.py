"""An EOS camera in remote mode: its properties as its events report them, its shutter button, its patience.

Everything an EOS says comes through GetEvent (9116). Events left undrained make it answer "busy" to whatever else
it is asked, so every wait here drains between attempts. Source: libgphoto2 (devices.md 3.5 to 3.8).
"""

from collections.abc import Callable
from contextlib import suppress
from typing import TypeVar

from drivers.camera_link import CameraLink
from drivers.canon_5d2 import operations
from drivers.canon_5d2.codes import CanonEvent, CanonOperation, CanonProp, CanonResponse
from drivers.canon_5d2.operations import AvailableValues, NumberRecord, ObjectRecord, PropValue, Record
from drivers.clock import Clock, Deadline
from drivers.errors import BatteryLowError, DeviceBusyError, DeviceTimeoutError, OperationRefusedError, StoreFullError

MAX_STREAM_BYTES = 256 * 1024  # the first answer of a 60D is 7.5 kB
# Bounds of draining and of waiting for a busy camera: chosen.
MAX_DRAIN_POLLS = 200
DRAIN_LIMIT_S = 5.0  # chosen: for the whole first report
BUSY_LIMIT_S = 5.0  # chosen: while it writes what is in its buffer
FIRST_PAUSE_S, LONGEST_PAUSE_S = 0.05, 0.2
VALUE_LIMIT_S = 3.0  # a written property is reported back within this time
CONFIRM_LIMIT_S = 1.0  # chosen: recorded bodies report within one poll
IDLE_LIMIT_S = 15.0  # chosen: a full buffer on a slow card
REPORTED_IDLE_LIMIT_S = 1.0
"""So long the camera is trusted to report of its own accord that it is not busy any more; then it is asked."""
KEEP_ON_PERIOD_S = 10.0  # chosen: well within the shortest automatic power-off, 1 min (manual)
HALF_PRESS_LIMIT_S = 8.0  # with a slow lens the camera may take so long (libgphoto2 names the 5D Mark II)
HALF_PRESS_SETTLE_S = 0.1  # with manual focus nothing more is awaited after a half press than one event, or this time
HALF, FULL = 1, 2
HOST_CLUSTERS, HOST_CLUSTER_BYTES = 0x0FFFFFFF, 0x1000
"""The free space that we claim for pictures held for the computer."""

T = TypeVar("T")


class CanonRemote:
    """Remote and event mode over a link; ``values`` and ``lists`` are kept current by every poll."""

    def __init__(self, link: CameraLink, clock: Clock) -> None:
        self.values: dict[int, bytes] = {}
        self.lists: dict[int, AvailableValues] = {}
        self.functions: dict[int, int] = {}
        """Custom functions by id, of all their groups."""
        self.announced: list[ObjectRecord] = []
        """Objects announced and not yet taken over by an exposure."""
        self.busy = False
        self._link = link
        self._clock = clock
        self._fresh: set[int] = set()
        self._pressed: list[int] = []
        self._kept_on_at_s = clock.monotonic_s()
        self._shuts_down_soon = False

    def forget(self) -> None:
        """Forget all that the camera has reported: it is a new connection."""
        self.values.clear()
        self.lists.clear()
        self.functions.clear()
        self.announced.clear()
        self._fresh.clear()
        self._pressed.clear()
        self.busy = self._shuts_down_soon = False

    def start(self, busy_limit_s: float = BUSY_LIMIT_S) -> None:
        """Enter remote and event mode and take over the camera's whole state, which it reports on entering.

        Events may have been lost before, so event mode is left first where it was on.
        """
        self.patiently(lambda: self.do(CanonOperation.SET_REMOTE_MODE, 1), busy_limit_s)
        if self.values:
            self.do(CanonOperation.SET_EVENT_MODE, 0)
        self._enter_event_mode()
        if not self.values:
            self.do(CanonOperation.SET_EVENT_MODE, 0)  # it was on already: an earlier answer was lost
            self._enter_event_mode()

    def _enter_event_mode(self) -> None:
        self.patiently(lambda: self.do(CanonOperation.SET_EVENT_MODE, 1))
        self.drain()

    def stop(self) -> None:
        """Give the camera back to its own buttons."""
        with suppress(DeviceBusyError):  # it still exposes or writes: its own buttons count for more
            self.do(CanonOperation.KEEP_DEVICE_ON)
            self.poll()
        self.patiently(lambda: self.do(CanonOperation.SET_REMOTE_MODE, 0))
        self.do(CanonOperation.SET_EVENT_MODE, 0)

    def do(self, operation: int, *params: int, timeout_s: float | None = None) -> tuple[int, ...]:
        """Run an operation without data; returns the parameters of its response."""
        try:
            return self._link.session.transact(operation, params, timeout_s=timeout_s).params
        except OperationRefusedError as error:
            if error.response_code == CanonResponse.LOW_BATTERY:
                advice = "charge or replace the battery"
                raise BatteryLowError(error.message, where=error.where, advice=advice) from error
            raise

    def poll(self) -> tuple[Record, ...]:
        """Fetch the camera's events once and take them over; returns them (empty: nothing new)."""
        reply = self._link.session.transact(CanonOperation.GET_EVENT, data_in=True, max_data_bytes=MAX_STREAM_BYTES)
        records = operations.decode_events(reply.data)
        for record in records:
            self._take_over(record)
        return records

    def _take_over(self, record: Record) -> None:
        match record:
            case PropValue(prop, raw):
                self.values[prop] = raw
                if prop == CanonProp.CUSTOM_FUNCTIONS:
                    self.functions |= operations.decode_custom_functions(raw)  # a 60D sends one record a group
                self._fresh.add(prop)
            case AvailableValues(prop):
                self.lists[prop] = record
            case ObjectRecord():
                self.announced.append(record)
            case NumberRecord(CanonEvent.CAMERA_STATUS_CHANGED, number):
                self.busy = number != 0
            case NumberRecord(CanonEvent.WILL_SOON_SHUTDOWN):
                self._shuts_down_soon = True
            case _:
                pass

    def drain(self) -> None:
        """Poll until the camera has nothing more to report; `DeviceTimeoutError` where it never stops."""
        deadline = Deadline.after(self._clock, DRAIN_LIMIT_S)
        for _ in range(MAX_DRAIN_POLLS):
            if not self.patiently(self.poll):
                return
            if deadline.expired:
                break
        text = f"still sending events after {deadline.limit_s:g} s"
        likely = "a control of the camera is held or turned"
        raise DeviceTimeoutError(text, where=self._link.name, likely=likely, advice="let go of the camera, then resume")

    def patiently(self, call: Callable[[], T], limit_s: float = BUSY_LIMIT_S) -> T:
        """Call until the camera is not busy any more, draining its events between; at most ``limit_s``."""
        deadline = Deadline.after(self._clock, limit_s)
        pause_s = FIRST_PAUSE_S
        while True:
            try:
                return call()
            except DeviceBusyError:
                if deadline.remaining_s <= pause_s:
                    raise
            self._clock.sleep(pause_s)
            pause_s = min(2 * pause_s, LONGEST_PAUSE_S)
            self._poll_unless_busy()

    def _poll_unless_busy(self) -> None:
        with suppress(DeviceBusyError):  # the caller asks again anyway
            self.poll()

    def wait_idle(self, limit_s: float = IDLE_LIMIT_S) -> None:
        """Drain until the camera does not call itself busy; `DeviceBusyError` after ``limit_s``."""
        deadline = Deadline.after(self._clock, REPORTED_IDLE_LIMIT_S)
        self.drain()
        while self.busy and not deadline.expired:
            self._clock.sleep(FIRST_PAUSE_S)
            self.drain()
        if self.busy:
            self.settle(limit_s)

    def settle(self, limit_s: float) -> None:
        """Wait until the camera takes commands, whatever it reported before (an "idle" may have been lost).

        It answers "busy" to ResetUILock while it exposes, and does nothing else to it that we could notice.
        """
        try:
            self.patiently(lambda: self.do(CanonOperation.RESET_UI_LOCK), limit_s)
        except OperationRefusedError:
            pass  # any other answer than "busy" will do
        except DeviceBusyError as error:
            error.message = f"busy for more than {limit_s:g} s"
            error.likely = "it still exposes or writes to its card, or holds a picture that nobody fetched"
            error.advice = "wait until its lamp goes out; if it stays on, switch the camera off and on"
            raise
        self.drain()
        self.busy = False

    def number(self, prop: int) -> int | None:
        """Return the last reported value of a numeric property, or None where the camera reported none."""
        return PropValue(prop, self.values[prop]).number if prop in self.values else None

    def ensure(self, prop: int, value: bytes) -> bytes:
        """Bring a property to ``value`` and return what the camera then reports (``b""``: nothing).

        A property that has the value already is confirmed, not written: the camera may answer "busy" to a write
        that changes nothing.
        """
        if prop not in self.values:
            self.ask_anew(prop)
        if self.values.get(prop) == value and self._confirm(prop) == value:
            return value
        self._fresh.discard(prop)
        data = operations.encode_property(prop, value)
        self.patiently(lambda: self._link.session.transact(CanonOperation.SET_DEVICE_PROP_VALUE_EX, data_out=data))
        self._await(prop, VALUE_LIMIT_S, value)
        return self.values.get(prop, b"") if prop in self._fresh else b""

    def _confirm(self, prop: int) -> bytes:
        """Return the property as reported anew, or as last reported where requests are not answered."""
        reported = self.ask_anew(prop)
        return self.values[prop] if reported is None else reported

    def ask_anew(self, prop: int) -> bytes | None:
        """Request a property and return what the camera then reports, or None where it does not answer."""
        self._fresh.discard(prop)
        try:
            self.patiently(lambda: self.do(CanonOperation.REQUEST_DEVICE_PROP_VALUE, prop))
        except OperationRefusedError:
            return None
        self._await(prop, CONFIRM_LIMIT_S, None)
        return self.values[prop] if prop in self._fresh else None

    def _await(self, prop: int, limit_s: float, value: bytes | None) -> None:
        """Poll until the property is reported anew (and is ``value``, where one is given), at most ``limit_s``."""
        deadline = Deadline.after(self._clock, limit_s)
        while not deadline.expired:
            news = bool(self.patiently(self.poll))
            if prop in self._fresh and value in (None, self.values[prop]):
                return
            if not news:
                self._clock.sleep(FIRST_PAUSE_S)

    def keep_on(self) -> bool:
        """Keep the camera from switching itself off, every `KEEP_ON_PERIOD_S` or when it warns; whether it was time."""
        now_s = self._clock.monotonic_s()
        if now_s - self._kept_on_at_s < KEEP_ON_PERIOD_S and not self._shuts_down_soon:
            return False
        self.patiently(lambda: self.do(CanonOperation.KEEP_DEVICE_ON))
        self._kept_on_at_s = now_s
        self._shuts_down_soon = False
        self.drain()
        return True

    def offer_space(self) -> None:
        """Let the camera know that the computer has room for pictures."""
        self.patiently(lambda: self.do(CanonOperation.PC_HDD_CAPACITY, HOST_CLUSTERS, HOST_CLUSTER_BYTES, 1))

    def press_half(self) -> None:
        """Press the button half-way and let the camera settle."""
        self._pressed = [HALF]
        try:
            self.patiently(
                lambda: self.do(CanonOperation.REMOTE_RELEASE_ON, HALF, 0, timeout_s=HALF_PRESS_LIMIT_S),
                HALF_PRESS_LIMIT_S,
            )
        except OperationRefusedError:
            self._pressed.clear()
            raise
        deadline = Deadline.after(self._clock, HALF_PRESS_SETTLE_S)
        while not self.patiently(self.poll) and not deadline.expired:
            self._clock.sleep(FIRST_PAUSE_S)
        self.drain()

    def press_full(self, limit_s: float) -> None:
        """Press the button through; where it is refused, let go of it and raise the refusal."""
        self._pressed = [HALF, FULL]
        try:
            self.do(CanonOperation.REMOTE_RELEASE_ON, FULL, 0, timeout_s=limit_s)
        except (OperationRefusedError, DeviceBusyError, StoreFullError, BatteryLowError):
            self._pressed = [HALF]
            self._poll_unless_busy()
            self.let_go()
            raise

    @property
    def pressed(self) -> bool:
        """Whether the button is held in any way, as far as we know."""
        return bool(self._pressed)

    def let_go_a_little(self) -> None:
        """Release the outermost hold of the button: the full press first, then the half press, one a call."""
        if self._pressed:
            self.do(CanonOperation.REMOTE_RELEASE_OFF, self._pressed[-1])
            self._pressed.pop()

    def let_go(self) -> None:
        """Release the button wholly."""
        while self._pressed:
            self.patiently(self.let_go_a_little)

    def let_go_whatever_happened(self) -> None:
        """Release both holds after an error, when nobody knows which is pressed; a refusal means it was not."""
        self._pressed = [HALF, FULL]
        while self._pressed:
            try:
                self.patiently(self.let_go_a_little)
            except OperationRefusedError:
                self._pressed.pop()

    def transfer_complete(self, handle: int) -> None:
        """Allow the camera to forget a picture that it held for us."""
        self.patiently(lambda: self.do(CanonOperation.TRANSFER_COMPLETE, handle))

"""The Ricoh Theta Z1 over USB: manual exposures one at a time, everything read back.

Source: Ricoh USB API specification, libgphoto2, and scripts that work with the real camera (devices.md section 2).
"""

from collections.abc import Callable
from contextlib import suppress
from datetime import UTC, datetime

from drivers import camera, errors
from drivers.camera_link import CameraLink, CameraModel, FrameStore
from drivers.clock import Clock, Deadline
from drivers.ptp.codes import DataType, Event, ObjectFormat, Operation, Prop
from drivers.ptp.datasets import StorageInfo, decode_date
from drivers.ptp.pipes import PtpTransport
from drivers.theta_z1 import settings as theta_settings
from drivers.theta_z1.codes import SHUTTER_FRACTIONS, VENDOR_EXTENSION_ID, RicohProp
from drivers.theta_z1.exposure import ThetaExposure, ThetaShot, is_ready
from drivers.theta_z1.settings import Fraction32, Setting, ThetaProperties

MODEL = CameraModel(
    "Theta Z1",
    (VENDOR_EXTENSION_ID,),
    (
        Operation.GET_OBJECT_HANDLES,
        Operation.GET_OBJECT_INFO,
        Operation.GET_PARTIAL_OBJECT,
        Operation.GET_DEVICE_PROP_DESC,
        Operation.GET_DEVICE_PROP_VALUE,
        Operation.SET_DEVICE_PROP_VALUE,
        Operation.INITIATE_CAPTURE,
    ),
)
FORMATS: dict[int, camera.FrameFormat] = {
    ObjectFormat.EXIF_JPEG: camera.FrameFormat.JPEG,
    ObjectFormat.DNG: camera.FrameFormat.DNG,
}
# Waking and working take the camera a few seconds (Ricoh names none): limits chosen.
WAKE_LIMIT_S = 10.0
WAKE_PAUSE_S = 1.0  # chosen
READY_LIMIT_S = 15.0  # chosen: writing a raw frame takes 10 s (Ricoh)
READY_PAUSE_S = 0.05  # chosen
EVENT_DRAIN_WAIT_S = 0.001  # chosen: takes what is there, waits for nothing
MAX_DRAINED_EVENTS = 256  # chosen: a bound on a camera that never stops
RELEASE_LIMIT_S = 8.0  # on top of the exposure time, should the camera answer only when the shutter has closed
RELEASE_LAG_S = 0.12  # assumed: Ricoh gives no figure. Measure it and put it into the rig file.
USB_SHOOTING_POSSIBLE = 0  # Ricoh's USB API
WITNESSES = (
    Prop.EXPOSURE_PROGRAM_MODE,
    Prop.WHITE_BALANCE,
    RicohProp.COLOR_TEMPERATURE,
    Prop.F_NUMBER,
    Prop.EXPOSURE_INDEX,
)
"""Settings that are read again before every exposure: the camera forgets them in its sleep."""
USUAL_SLEEP_S = {RicohProp.SLEEP_DELAY: 180, RicohProp.AUTO_POWER_OFF_DELAY: 64_800}
"""Ricoh's defaults. Given back where 0 is found: a station that was killed left it so, and the camera would stay awake
until its battery is empty."""
FULL_BATTERY = 100  # per cent (PIMA 15740, BatteryLevel)
UNKNOWN_COUNT = 0xFFFFFFFF  # PIMA 15740, FreeSpaceInImages


class ThetaZ1:
    """`drivers.camera.Camera` of a Theta Z1.

    ``open_transport``: opens the link to the camera; called by `connect` and by `recover` after a lost connection.
    """

    kind = "theta_z1"

    def __init__(self, open_transport: Callable[[], PtpTransport], clock: Clock) -> None:
        self.shutter_times_s: tuple[float, ...] = ()
        self.can_transfer_while_exposing = True
        self.holds_pictures = False
        self.release_lag_s = RELEASE_LAG_S
        self._clock = clock
        self._link = CameraLink(open_transport, clock, MODEL)
        self._properties = ThetaProperties(self._link, clock)
        self._store = FrameStore(self._link, FORMATS)
        self._fractions: tuple[Fraction32, ...] = ()
        self._kept: tuple[Setting, ...] = ()
        self._formats: tuple[camera.FrameFormat, ...] = (camera.FrameFormat.JPEG,)
        self._sleep_before: dict[int, int] = {}
        self._shutter_s = 0.0
        self._exposure: ThetaExposure | None = None
        self._past_captures: set[int] = set()
        self._read_since_poll = False

    def connect(self) -> camera.CameraIdentity:
        """Open the session, wake the camera, wait for what it still does, and learn its shutter times."""
        info = self._link.open()
        self._past_captures.clear()
        self._start_over(READY_LIMIT_S)
        self._learn_shutter_times()
        return camera.CameraIdentity(info.manufacturer, info.model, info.serial, info.device_version)

    def _start_over(self, ready_limit_s: float) -> None:
        self._exposure = None
        self._wake()
        self._wait_until_ready(ready_limit_s)
        if not self._properties.has(RicohProp.EXPOSURE_STATUS):
            # Older firmware does not report a single exposure, but refuses settings meanwhile.
            mode = self._properties.number(Prop.STILL_CAPTURE_MODE)
            self._properties.write(Prop.STILL_CAPTURE_MODE, mode, ready_limit_s)
        self._drain_events()
        self._store.remember()

    def _wake(self) -> None:
        """Write "awake" until the camera takes it and answers for properties that a sleeping one keeps to itself."""
        deadline = Deadline.after(self._clock, WAKE_LIMIT_S)
        session = self._link.session
        while True:
            try:
                self._properties.number(RicohProp.SLEEP_MODE)
                session.set_prop_value(RicohProp.SLEEP_MODE, DataType.UINT8, 0)
                self._properties.number(Prop.EXPOSURE_PROGRAM_MODE)
                return
            except errors.DeviceBusyError as error:
                if deadline.expired:
                    error.likely = "it did not wake up, or is in a menu or recording"
                    error.advice = "wake it by its power button, then resume"
                    raise
            self._clock.sleep(WAKE_PAUSE_S)

    def _wait_until_ready(self, limit_s: float) -> None:
        deadline = Deadline.after(self._clock, limit_s)
        while not is_ready(self._properties):
            if deadline.expired:
                text = f"still working after {limit_s:g} s"
                likely = "it is recording, counting down, or converting a video"
                advice = "stop it by its own button, then resume"
                raise errors.DeviceBusyError(text, where=self._link.name, likely=likely, advice=advice, limit_s=limit_s)
            self._clock.sleep(READY_PAUSE_S)

    def _drain_events(self) -> None:
        """Take events of the past in; pictures that they announce are none of the next exposure's."""
        for _ in range(MAX_DRAINED_EVENTS):
            event = self._link.session.poll_event(EVENT_DRAIN_WAIT_S)
            if event is None:
                return
            if event.code == Event.OBJECT_ADDED:
                self._store.known.update(event.params[:1])
        advice = "switch the camera off and on"
        raise errors.DeviceTimeoutError("events without end", where=self._link.name, advice=advice)

    def _learn_shutter_times(self) -> None:
        """Take the camera's own list; outside manual mode it has none, and the specification's list stands in."""
        times: set[Fraction32] = set()
        with suppress(errors.OperationRefusedError, errors.DeviceBusyError):
            desc = self._link.session.get_prop_desc(RicohProp.SHUTTER_SPEED)
            times = {f for v in desc.choices if isinstance(v, int) and (f := Fraction32.from_u64(v)).is_time}
        if len(times) < 2:
            times = {Fraction32(*pair) for pair in SHUTTER_FRACTIONS}
        self._fractions = tuple(sorted(times, key=lambda f: -f.seconds))
        self.shutter_times_s = tuple(f.seconds for f in self._fractions)

    def status(self) -> camera.CameraStatus:
        """Return battery, space, clock and what forbids shooting."""
        read = self._properties.number_or_none
        problems, warnings = theta_settings.error_texts(read(RicohProp.ERROR_INFO) or 0)
        if read(Prop.FUNCTIONAL_MODE) not in (None, USB_SHOOTING_POSSIBLE):
            problems = (*problems, "shooting over USB is not possible now: leave the camera's menu or plug-in")
        if read(RicohProp.SLEEP_MODE):
            problems = (*problems, "the camera is asleep: wake it")
        battery = read(Prop.BATTERY_LEVEL)
        free_bytes, free_frames = self._free_space()
        return camera.CameraStatus(
            battery_frac=None if battery is None else min(battery, FULL_BATTERY) / FULL_BATTERY,
            free_bytes=free_bytes,
            free_frames=free_frames,
            clock_utc=self._clock_utc(),
            ready=not problems and self._exposure is None and is_ready(self._properties),
            problems=problems,
            warnings=warnings,
        )

    def _clock_utc(self) -> datetime | None:
        with suppress(errors.ProtocolViolationError, OverflowError):
            date = decode_date(str(self._properties.read_or_none(Prop.DATE_TIME) or ""))
            return None if date is None else date.astimezone(UTC)
        return None  # a clock that was never set is no reason not to shoot; ErrorInfo reports it

    def _free_space(self) -> tuple[int | None, int | None]:
        session, infos = self._link.session, list[StorageInfo]()
        with suppress(errors.DeviceBusyError, errors.OperationRefusedError, errors.StoreFullError):
            infos = [session.get_storage_info(storage_id) for storage_id in session.get_storage_ids()]
        if not infos:
            return None, None
        frames = sum(i.free_images for i in infos) if all(i.free_images != UNKNOWN_COUNT for i in infos) else None
        return sum(i.free_bytes for i in infos), frames

    def prepare(self, settings: camera.CameraSettings) -> tuple[camera.SettingReadback, ...]:
        """Make all fixed settings, each read back; see `drivers.theta_z1.settings` for which and why."""
        self._wake()
        self._wait_until_ready(READY_LIMIT_S)
        # Remember how the camera was to fall asleep, to leave it so
        for prop, default_s in USUAL_SLEEP_S.items():
            if prop not in self._sleep_before:
                self._sleep_before[prop] = self._properties.number(prop) or default_s
        modes = theta_settings.mode_settings()
        readbacks = self._apply(modes)
        images = theta_settings.picture_settings(settings, theta_settings.find_f_number(self._link, settings.f_number))
        readbacks += self._apply(images)
        self._kept = tuple(s for s in (*modes, *images) if s.prop in WITNESSES)
        raws = (camera.FrameFormat.DNG,) if settings.keep_raw else ()
        self._formats = (camera.FrameFormat.JPEG, *raws)
        self._learn_shutter_times()
        self._store.remember()
        return readbacks

    def body_settings(self) -> tuple[camera.BodySetting, ...]:
        """Judge the firmware; all else that a bracket depends on is set by `prepare`."""
        return theta_settings.read_body(self._properties, self._link.info.device_version)

    def _apply(self, settings: tuple[Setting, ...]) -> tuple[camera.SettingReadback, ...]:
        readbacks = []
        for setting in settings:
            readbacks.append(self._properties.apply(setting))
            self._clock.sleep(theta_settings.PROPERTY_PAUSE_S)
        return tuple(readbacks)

    def set_shutter(self, shutter_s: float) -> camera.ShutterReadback:
        """Set the nearest exposure time and read it back, after checking that the camera kept its other settings."""
        self.keep_alive()
        self._wait_until_ready(READY_LIMIT_S)
        for setting in self._kept:
            # What the camera forgets, it forgets all at once: these few witnesses are enough.
            self._properties.require(setting.name, setting.prop, setting.value)
        try:
            fraction = camera.nearest_time(shutter_s, {f: f.seconds for f in self._fractions})
        except ValueError as error:
            text = f"no exposure time: {error}"
            raise errors.SettingRefusedError(text, where=self._link.name, asked=shutter_s) from error
        self._properties.write_and_compare("shutter", RicohProp.SHUTTER_SPEED, fraction.to_u64())
        self._shutter_s = fraction.seconds
        return camera.ShutterReadback(asked_s=shutter_s, nominal_s=fraction.seconds, raw=str(fraction))

    def arm(self) -> None:
        """Wait until the camera is ready and take in old events."""
        self._exposure = None
        self._wait_until_ready(READY_LIMIT_S)
        self._drain_events()

    def stand_down(self) -> None:
        """Nothing to do: an armed Theta holds nothing."""

    def release(self) -> None:
        """Start the exposure; `DeviceBusyError` where the camera is still saving."""
        session, earlier_ids = self._link.session, frozenset(self._past_captures)
        try:
            session.transact(Operation.INITIATE_CAPTURE, (0, 0), timeout_s=self._shutter_s + RELEASE_LIMIT_S)
        finally:
            self._past_captures.add(session.last_transaction_id)
        shot = ThetaShot(self._shutter_s, self._formats, session.last_transaction_id, earlier_ids)
        self._exposure = ThetaExposure(self._link, self._store, self._clock, shot)

    def poll_exposure(self) -> camera.ExposureProgress:
        """Look for the frames of the running exposure."""
        if self._exposure is None:
            raise errors.ExposureFailedError("no exposure is running", where=self._link.name, advice="release first")
        progress = self._exposure.poll(wait=not self._read_since_poll)
        self._read_since_poll = False
        if progress.done:
            self._exposure = None
        return progress

    def read_chunk(self, frame: camera.FrameRef, offset: int, max_bytes: int) -> bytes:
        """Return a part of a frame; a camera that is busy exposing is not asked again during exposures."""
        self._read_since_poll = True
        try:
            return self._link.session.get_partial_object(frame.handle, offset, max_bytes)
        except errors.DeviceBusyError:
            if self._exposure is not None:
                self.can_transfer_while_exposing = False
            else:
                self.keep_alive()  # a sleeping camera answers "busy" for ever
            raise

    def finish_frame(self, frame: camera.FrameRef) -> None:
        """Nothing to do: the frame stays on the camera's store."""

    def delete(self, frame: camera.FrameRef) -> None:
        """Delete the frame from the camera's store."""
        self._store.delete(frame)

    def list_frames(self) -> tuple[camera.FrameRef, ...]:
        """Return the pictures on the camera, oldest first."""
        return self._store.list_frames()

    def keep_alive(self) -> None:
        """Wake the camera should it have fallen asleep; `prepare` has switched its sleep off."""
        if self._properties.number_or_none(RicohProp.SLEEP_MODE):
            self._wake()

    def recover(self) -> None:
        """Resynchronise or reconnect, wake the camera, let a running exposure end, and forget it."""
        running_s = self._shutter_s if self._exposure is not None else 0.0
        if self._link.recover():
            self._past_captures.clear()
        self._start_over(READY_LIMIT_S + running_s)

    def close(self) -> None:
        """Give the camera its own sleep times back and close the session; never raises."""
        with suppress(errors.DeviceError):  # it is gone or out of step; it keeps awake until switched off
            for prop in tuple(self._sleep_before):  # what it did not take is given back when it has been found again
                self._properties.write(prop, self._sleep_before[prop])
                del self._sleep_before[prop]
        self._exposure = None
        self._link.close()

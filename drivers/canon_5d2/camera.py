"""The Canon EOS 5D Mark II over USB: remote mode, manual exposures, frames from its card or its memory.

Source: libgphoto2 and logs of EOS cameras (devices.md section 3). The mode dial has to stand at M and the lens at MF;
no computer can turn those.
"""

from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager, suppress
from datetime import datetime
from typing import Literal

from drivers import camera
from drivers.camera_link import CameraLink, CameraModel, FrameStore
from drivers.canon_5d2 import codes as canon_codes
from drivers.canon_5d2 import settings as canon_settings
from drivers.canon_5d2.body import read_body
from drivers.canon_5d2.codes import CanonOperation, CanonProp, CanonResponse
from drivers.canon_5d2.exposure import FORMATS, CanonExposure, CanonShot
from drivers.canon_5d2.operations import encode_number
from drivers.canon_5d2.remote import BUSY_LIMIT_S, IDLE_LIMIT_S, CanonRemote
from drivers.canon_5d2.settings import CanonSetting
from drivers.clock import Clock
from drivers.errors import DeviceBusyError, DeviceError, ExposureFailedError, OperationRefusedError, StoreFullError
from drivers.ptp.codes import Operation, Response
from drivers.ptp.pipes import PtpTransport

MODEL = CameraModel(
    canon_settings.WHERE,
    canon_codes.VENDOR_EXTENSION_IDS,
    (
        CanonOperation.SET_REMOTE_MODE,
        CanonOperation.SET_EVENT_MODE,
        CanonOperation.GET_EVENT,
        CanonOperation.SET_DEVICE_PROP_VALUE_EX,
    ),
)
NOT_SUPPORTED = (
    Response.OPERATION_NOT_SUPPORTED,
    Response.PARAMETER_NOT_SUPPORTED,
    Response.INVALID_PARAMETER,
    CanonResponse.UNKNOWN_COMMAND,
)
"""Refusals of the two-step release (9128) that mean: use the one-step release (910F)."""
RELEASE_LIMIT_S = 8.0  # on top of the exposure time, should the camera answer only when the shutter has closed
RELEASE_LAG_S = 0.073
"""Full press to shutter opening with the button half pressed: a figure from memory of the data sheet, not confirmed.
Measure it and put it into the rig file."""
MIN_SHOTS_FOR_COMPUTER = 100  # below so many shots of room, the camera is given anew how much room the computer has


class Canon5D2:
    """`drivers.camera.Camera` of an EOS 5D Mark II.

    ``open_transport``: opens the link to the camera; called by `connect` and by `recover` after a lost connection.
    ``destination``: ``"card"``: pictures go to the card, and are fetched while the next exposure runs. ``"pc"``: they
      stay in the camera's memory until fetched, and the camera is busy until then: nothing is hidden behind exposures.
    ``sizes_px``: JPEG size code -> (width, height) in pixels.
    """

    kind = "canon_5d2"

    def __init__(
        self,
        open_transport: Callable[[], PtpTransport],
        clock: Clock,
        *,
        destination: Literal["card", "pc"] = "card",
        sizes_px: Mapping[int, tuple[int, int]] = canon_codes.IMAGE_SIZES_PX,
    ) -> None:
        self.shutter_times_s: tuple[float, ...] = ()
        self.can_transfer_while_exposing = destination == "card"
        self.holds_pictures = destination == "pc"
        self.release_lag_s = RELEASE_LAG_S
        self._clock = clock
        self._to_card = destination == "card"
        self._sizes_px = sizes_px
        self._link = CameraLink(open_transport, clock, MODEL)
        self._remote = CanonRemote(self._link, clock)
        self._store = FrameStore(self._link, FORMATS)
        self._store_known = False
        self._held: set[int] = set()
        self._stuck = False
        self._kept: tuple[CanonSetting, ...] = ()
        self._formats: tuple[camera.FrameFormat, ...] = (camera.FrameFormat.JPEG,)
        self._shutter_s = 0.0
        self._one_step_release = False
        self._exposure: CanonExposure | None = None
        self._read_since_poll = False

    def connect(self) -> camera.CameraIdentity:
        """Open the session, enter remote mode, take over the camera's state, and learn its shutter times."""
        info = self._link.open()
        self._start_over(new_session=True)
        self._one_step_release = CanonOperation.REMOTE_RELEASE_ON not in info.operations
        return camera.CameraIdentity(info.manufacturer, info.model, info.serial, info.device_version)

    def _start_over(self, *, new_session: bool) -> None:
        running_s = self._shutter_s if self._exposure is not None else 0.0
        self._exposure = None
        if new_session:
            self._remote.forget()
            self._held.clear()
        self._remote.start(BUSY_LIMIT_S + running_s)
        self._remote.settle(IDLE_LIMIT_S + running_s)
        self._remote.let_go_whatever_happened()
        self._drop_orphans()
        self._learn_shutter_times()

    def _drop_orphans(self) -> None:
        """Let go of pictures that nobody waits for; a camera that holds one stays busy."""
        self._remote.drain()
        announced, self._remote.announced = self._remote.announced, []
        for record in announced:
            self._store.known.add(record.handle)
            if record.wants_transfer and record.handle not in self._held:
                self._remote.transfer_complete(record.handle)

    def _shutter_codes(self) -> tuple[int, ...]:
        """Return the camera's own list; outside mode M it has none, and the table of third stops stands in."""
        listed = self._remote.lists.get(CanonProp.SHUTTER_SPEED)
        codes = canon_settings.shutter_codes_known(listed.numbers if listed is not None else ())
        return codes or canon_settings.shutter_codes_known(canon_codes.SHUTTER_CODES)

    def _learn_shutter_times(self) -> None:
        self.shutter_times_s = tuple(canon_settings.SHUTTER_S[code] for code in self._shutter_codes())

    def status(self) -> camera.CameraStatus:
        """Return battery, space, clock, and what stands wrong on the camera's controls."""
        self._remote.drain()
        free_bytes = self._free_bytes()
        problems = canon_settings.control_problems(self._remote)
        if free_bytes == 0 and self._to_card:
            problems += ("there is no card in the camera, or it is full",)
        warnings: tuple[str, ...] = ()
        if self._remote.number(CanonProp.AUTO_EXPOSURE_MODE) is None:
            warnings += ("the camera does not report where its mode dial stands: it must stand at M",)
        if self._remote.number(CanonProp.FOCUS_MODE) is None:
            warnings += ("the camera does not report whether its lens is on MF: it must be",)
        battery = self._remote.number(CanonProp.BATTERY_POWER)
        return camera.CameraStatus(
            battery_frac=None if battery is None else canon_settings.BATTERY_FRAC.get(battery),
            free_bytes=free_bytes,
            free_frames=self._remote.number(CanonProp.AVAILABLE_SHOTS),
            clock_utc=self._clock_utc(),
            ready=not problems and not self._remote.busy and self._exposure is None,
            problems=problems,
            warnings=warnings,
        )

    def _clock_utc(self) -> datetime | None:
        """Ask for the clock anew: what the camera reported when it was connected is old by now."""
        if self._remote.ask_anew(CanonProp.CAMERA_TIME) is None:
            return None
        seconds = self._remote.number(CanonProp.CAMERA_TIME)
        return None if seconds is None else canon_settings.camera_time_utc(seconds, self._clock.utc_now())

    def _free_bytes(self) -> int | None:
        session = self._link.session
        with suppress(OperationRefusedError, StoreFullError, DeviceBusyError):
            ids = self._remote.patiently(session.get_storage_ids)
            return sum(self._remote.patiently(lambda i=i: session.get_storage_info(i)).free_bytes for i in ids)  # type: ignore[misc]
        return None

    def prepare(self, settings: camera.CameraSettings) -> tuple[camera.SettingReadback, ...]:
        """Check the controls and make all fixed settings, each as the camera then reports it.

        Raises `SettingRefusedError`: A control on the camera stands wrong (all are named at once), or a setting does
        not take.
        """
        try:
            return self._prepare(settings)
        except DeviceBusyError:
            if not self._stuck:
                raise
        self.recover()
        return self._prepare(settings)

    def _prepare(self, settings: camera.CameraSettings) -> tuple[camera.SettingReadback, ...]:
        self._remote.let_go()
        self._remote.wait_idle()
        canon_settings.require_controls(self._remote)
        kept = canon_settings.fixed_settings(settings, self._remote, sizes_px=self._sizes_px, to_card=self._to_card)
        with self._noticing_a_held_picture():
            raw = self._remote.values.get(CanonProp.AUTO_EXPOSURE_MODE, b"")
            dial = camera.SettingReadback("exposure mode (dial)", "M", canon_settings.ae_mode_words(raw), raw.hex())
            readbacks = (dial, *(canon_settings.make(self._remote, setting) for setting in kept))
        if not self._to_card:
            self._remote.offer_space()
        else:
            # Know what is on the card, so that a picture whose announcement is lost can be known from the others
            try:
                self._remote.patiently(self._store.remember)
                self._store_known = True
            except OperationRefusedError:
                self._store_known = False  # then a lost announcement cannot be made good
        self._kept = kept
        raws = (camera.FrameFormat.CR2,) if settings.keep_raw else ()
        self._formats = (camera.FrameFormat.JPEG, *raws)
        self._learn_shutter_times()
        return readbacks

    def body_settings(self) -> tuple[camera.BodySetting, ...]:
        """Read the settings of the body that no rig file sets; set those with one right value."""
        self._remote.drain()
        return read_body(self._remote)

    def set_shutter(self, shutter_s: float) -> camera.ShutterReadback:
        """Set the nearest exposure time and read it back, after checking that nobody touched the camera."""
        self._remote.let_go()
        self._remote.wait_idle()
        canon_settings.require_controls(self._remote)
        for setting in self._kept:
            canon_settings.require_kept(self._remote, setting)
        try:
            code = camera.nearest_time(shutter_s, {c: canon_settings.SHUTTER_S[c] for c in self._shutter_codes()})
        except ValueError as error:
            raise canon_settings.refused("shutter", shutter_s, error) from error
        words = canon_settings.shutter_words
        with self._noticing_a_held_picture():
            setting = CanonSetting("shutter", CanonProp.SHUTTER_SPEED, encode_number(code), words)
            canon_settings.make(self._remote, setting)
        self._remote.wait_idle()
        self._shutter_s = canon_settings.SHUTTER_S[code]
        return camera.ShutterReadback(asked_s=shutter_s, nominal_s=self._shutter_s, raw=f"{code:#04x}")

    def arm(self) -> None:
        """Take in old events, keep the camera on, and press the button half-way."""
        self._exposure = None
        self._remote.let_go()
        self._remote.wait_idle()
        self._drop_orphans()
        self._remote.keep_on()
        shots = self._remote.number(CanonProp.AVAILABLE_SHOTS)
        if not self._to_card and shots is not None and shots < MIN_SHOTS_FOR_COMPUTER:
            self._remote.offer_space()
        if self._one_step_release:
            return
        try:
            self._remote.press_half()
        except OperationRefusedError as error:
            if error.response_code not in NOT_SUPPORTED:
                raise
            self._one_step_release = True

    def stand_down(self) -> None:
        """Let go of the button."""
        self._remote.let_go()

    def release(self) -> None:
        """Press the button through; `DeviceBusyError` or `OperationRefusedError` where the camera does not take it."""
        limit_s = self._shutter_s + RELEASE_LIMIT_S
        shot = CanonShot(self._shutter_s, self._formats, to_card=self._to_card)
        store = self._store if self._store_known and shot.to_card else None
        exposure = CanonExposure(self._link, self._remote, store, self._clock, shot)
        with self._noticing_a_held_picture():
            if self._one_step_release:
                self._release_in_one_step(limit_s)
            else:
                self._remote.press_full(limit_s)
        self._exposure = exposure

    @contextmanager
    def _noticing_a_held_picture(self) -> Iterator[None]:
        """Note a camera that is idle and yet busy: it holds a picture whose announcement was lost."""
        try:
            yield
        except DeviceBusyError:
            self._stuck = not self._to_card
            raise

    def _release_in_one_step(self, limit_s: float) -> None:
        answer = self._remote.do(CanonOperation.REMOTE_RELEASE, timeout_s=limit_s)
        result = answer[0] if answer else 0
        problem = canon_settings.release_problem(result)
        if problem is None:
            return
        kind = StoreFullError if result in canon_settings.RELEASE_CARD_RESULTS else ExposureFailedError
        advice = "correct this, then resume"
        raise kind(f"the camera did not release: {problem}", where=canon_settings.WHERE, advice=advice, result=result)

    def poll_exposure(self) -> camera.ExposureProgress:
        """Look for the frames of the running exposure."""
        if self._exposure is None:
            raise ExposureFailedError("no exposure is running", where=canon_settings.WHERE, advice="release first")
        progress = self._exposure.poll(wait=not self._read_since_poll)
        self._read_since_poll = False
        if not self._to_card:
            self._held.update(frame.handle for frame in progress.frames)
        if progress.done:
            self._exposure = None
        return progress

    def read_chunk(self, frame: camera.FrameRef, offset: int, max_bytes: int) -> bytes:
        """Return a part of a frame; a camera that is busy exposing is not asked again during exposures."""
        self._read_since_poll = True
        operations = self._link.info.operations
        operation = Operation.GET_PARTIAL_OBJECT
        reader: int = operation if operation in operations else CanonOperation.GET_PARTIAL_OBJECT
        try:
            return self._link.session.get_partial_object(frame.handle, offset, max_bytes, reader)
        except DeviceBusyError:
            if self._exposure is not None:
                self.can_transfer_while_exposing = False
            raise

    def finish_frame(self, frame: camera.FrameRef) -> None:
        """Let the camera forget a picture that it held in its memory for us; nothing to do for one on the card."""
        if frame.handle in self._held:
            self._remote.transfer_complete(frame.handle)
            self._held.discard(frame.handle)

    def delete(self, frame: camera.FrameRef) -> None:
        """Delete the frame from the card; one held in memory is gone with `finish_frame`."""
        if frame.storage_id:
            self._remote.patiently(lambda: self._store.delete(frame))

    def list_frames(self) -> tuple[camera.FrameRef, ...]:
        """Return the pictures on the card, oldest first."""
        return self._remote.patiently(self._store.list_frames)

    def keep_alive(self) -> None:
        """Keep the camera from switching itself off, and its events from piling up."""
        if not self._remote.keep_on():
            self._remote.drain()

    def recover(self) -> None:
        """Resynchronise or reconnect, enter remote mode anew, let go of the button, forget a running exposure.

        A picture that the camera holds and that nobody can name goes with a reset of its port, as with pulling the
        cable; without it the camera would stay busy until it is switched off.
        """
        new_session = self._link.recover(from_port_reset=self._stuck)
        self._stuck = False
        self._start_over(new_session=new_session)

    def close(self) -> None:
        """Let go of the button, give the camera back to its own controls, close the session; never raises."""
        self._exposure = None
        with suppress(DeviceError):  # it is gone or out of step; closing the link is all that is left
            with suppress(DeviceBusyError):
                self._remote.let_go()
            self._remote.stop()
        self._link.close()

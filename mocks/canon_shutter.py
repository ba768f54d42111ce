"""How a simulated EOS takes a picture: half press, full press, bulb, card and host, and when it is busy."""

from __future__ import annotations

from typing import TYPE_CHECKING

from drivers.ptp import canon_codes
from drivers.ptp.canon_codes import CanonOperation, CanonProp, CanonResponse
from drivers.ptp.codes import ObjectFormat, Response
from mocks import canon_stream
from mocks.canon_properties import BULB
from mocks.faults import Fault, FaultKind
from mocks.ptp_camera import SimulatedCamera
from mocks.ptp_messages import Answer, Refusal, Request, Rule
from mocks.ptp_objects import StoredObject
from mocks.ptp_wire import u32s
from mocks.shots import ShotRequest

if TYPE_CHECKING:
    from mocks.canon_5d2 import CanonOptions
    from mocks.canon_properties import CanonSettings

FIRST_HOST_HANDLE = 0x91900001
HALF, FULL = 1, 2
NO_FOCUS, CARD_FULL, CARD_LOCKED = 1, 7, 8
RELEASE_FAILED = 0x2000
"""Bits of response parameter 1 that mean an error, beside the small numbers."""
BULB_OPEN_S = 1e9
NO_FOCUS_POINTS = u32s([8, 0])
ONE_FOCUS_POINT = u32s([12, 1, 1])
SHUTTER_S = {**canon_codes.SHUTTER_CODES, **canon_codes.SHUTTER_CODES_HALF}
DEFAULT_KELVIN = {0: 5200, 1: 5200, 8: 7000, 2: 6000, 3: 3200, 4: 4000, 5: 6000, 6: 5200}


class CanonShutter(SimulatedCamera):
    """The half of `mocks.canon_5d2.SimulatedCanon5D2` that exposes."""

    options: CanonOptions
    settings: CanonSettings
    host_pictures: int

    def start_shutter(self) -> None:
        """Begin with no button pressed and nothing for the host."""
        self.waiting_for_host: dict[int, StoredObject] = {}
        self._next_host_handle = FIRST_HOST_HANDLE
        self._pressed = 0
        self._focused_s = 0.0
        self._bulb_since_s: float | None = None

    def shutter_rules(self) -> dict[int, Rule]:
        """Return the operations that press and release."""
        code = CanonOperation
        return {
            code.REMOTE_RELEASE: Rule(self._remote_release),
            code.REMOTE_RELEASE_ON: Rule(self._press, 1, 2),
            code.REMOTE_RELEASE_OFF: Rule(self._let_go, 1, 1),
            code.BULB_START: Rule(self._bulb_start),
            code.BULB_END: Rule(self._bulb_end),
            code.TRANSFER_COMPLETE: Rule(self._transfer_complete, 1, 1),
            code.CANCEL_TRANSFER: Rule(self._transfer_complete, 1, 1),
            code.AF_CANCEL: Rule(self._af_cancel),
        }

    def tell(self, record: canon_stream.Record) -> None:
        """Put a record into the event stream."""
        raise NotImplementedError

    def tell_value(self, prop: int) -> None:
        """Put the present value of a property into the event stream."""
        raise NotImplementedError

    def stay_awake(self) -> None:
        """Start the power-off delay anew."""
        raise NotImplementedError

    # ---- busy

    @property
    def shutter_open(self) -> bool:
        """Whether an exposure runs, timed or bulb."""
        return self.exposing or self._bulb_since_s is not None

    def refuse_while_busy(self) -> None:
        """Answer busy while exposing, and while a picture waits for the host in the camera's memory."""
        if self.shutter_open or self.waiting_for_host:
            raise Refusal(Response.DEVICE_BUSY)

    def forget_host_pictures(self) -> None:
        """Lose the pictures that wait in memory."""
        self.waiting_for_host.clear()
        self._pressed = 0

    # ---- buttons

    def _press(self, request: Request) -> Answer:
        buttons, without_focus = request.params[0], request.param(1) == 1
        if buttons not in (HALF, FULL, HALF | FULL):
            raise Refusal(Response.INVALID_PARAMETER)
        self.refuse_while_busy()
        if buttons & self._pressed & FULL:
            raise Refusal(Response.DEVICE_BUSY)
        self.stay_awake()
        if not self._pressed & HALF:
            self._begin_focus(without_focus=without_focus)
        if buttons & FULL:
            self._refuse_full_press(without_focus=without_focus)
            self._release(max(0.0, self._focused_s - self.clock.monotonic_s()))
        self._pressed |= buttons | HALF
        return Answer()

    def _let_go(self, request: Request) -> Answer:
        self._pressed &= ~request.params[0]
        return Answer()

    def _af_cancel(self, _request: Request) -> Answer:
        self.refuse_while_exposing()
        self._focused_s = 0.0
        return Answer()

    def _autofocus(self) -> bool:
        return self.settings.numbers[CanonProp.FOCUS_MODE] != canon_codes.FOCUS_MANUAL

    def _finds_focus(self) -> bool:
        fault = self.faults.condition(FaultKind.AUTOFOCUS)
        return bool(fault.number("finds")) if fault else self.options.finds_focus

    def _begin_focus(self, *, without_focus: bool) -> None:
        now_s = self.clock.monotonic_s()
        self._focused_s = now_s
        if self._autofocus() and not without_focus:
            self._focused_s = now_s + self.timing.focus_s
            self.agenda.at(self._focused_s, lambda _due_s: self._tell_focus())

    def _tell_focus(self) -> None:
        points = ONE_FOCUS_POINT if self._finds_focus() else NO_FOCUS_POINTS
        self.tell(canon_stream.structure(CanonProp.FOCUS_INFO_EX, points))

    # ---- release

    def _to_host(self) -> bool:
        return self.settings.numbers[CanonProp.CAPTURE_DESTINATION] == canon_codes.DESTINATION_PC

    def _trouble(self, *, without_focus: bool) -> int:
        """Return what keeps the shutter from opening, as RemoteRelease's parameter has it; 0: nothing."""
        if self._autofocus() and not without_focus and not self._finds_focus():
            return NO_FOCUS
        if self._to_host():
            return 0 if self.host_pictures else CARD_FULL
        if self.faults.condition(FaultKind.STORE_READ_ONLY):
            return CARD_LOCKED
        return 0 if self.free_pictures() else CARD_FULL

    def _refuse_full_press(self, *, without_focus: bool) -> None:
        trouble = self._trouble(without_focus=without_focus)
        if trouble == NO_FOCUS:
            raise Refusal(Response.GENERAL_ERROR)
        if trouble and self._to_host():
            raise Refusal(CanonResponse.MEMORY_STATUS_NOT_READY)
        if trouble:
            self.refuse_without_room()
        if self._in_bulb():
            raise Refusal(CanonResponse.OPERATION_REFUSED)

    def _remote_release(self, _request: Request) -> Answer:
        self.refuse_while_busy()
        self.stay_awake()
        trouble = self._trouble(without_focus=False)
        if trouble == 0 and self._in_bulb():
            trouble = RELEASE_FAILED
        if trouble == 0:
            self._release(self.timing.focus_s if self._autofocus() else 0.0)
        return Answer(params=(trouble,))

    def _release(self, delay_s: float, open_s: float | None = None) -> None:
        self.expose(self._shot_request(), delay_s, open_s)
        self.tell(canon_stream.status(busy=True))

    # ---- bulb

    def _in_bulb(self) -> bool:
        numbers = self.settings.numbers
        bulb_dial = numbers[CanonProp.AUTO_EXPOSURE_MODE] == canon_codes.AE_BULB
        return bulb_dial or numbers[CanonProp.SHUTTER_SPEED] == BULB

    def _bulb_start(self, _request: Request) -> Answer:
        self.refuse_while_busy()
        self.stay_awake()
        trouble = self._trouble(without_focus=False) if self._in_bulb() else RELEASE_FAILED
        if trouble == 0:
            self._bulb_since_s = self.clock.monotonic_s()
            self.tell(canon_stream.status(busy=True))
        return Answer(params=(trouble,))

    def _bulb_end(self, _request: Request) -> Answer:
        if self._bulb_since_s is None:
            return Answer(params=(RELEASE_FAILED,))
        open_s = self.clock.monotonic_s() - self._bulb_since_s
        self._bulb_since_s = None
        self.expose(self._shot_request(open_s), delay_s=-open_s, open_s=open_s)
        return Answer(params=(0,))

    # ---- pictures

    def _shot_request(self, shutter_s: float | None = None) -> ShotRequest:
        numbers = self.settings.numbers
        balance = numbers[CanonProp.WHITE_BALANCE]
        by_temperature = balance == canon_codes.WB_COLOR_TEMPERATURE
        kelvin = numbers[CanonProp.COLOR_TEMPERATURE] if by_temperature else DEFAULT_KELVIN[balance]
        width_px, height_px = self.options.image_sizes_px[self.settings.files[-1][1]]
        return ShotRequest(
            shutter_s=shutter_s or SHUTTER_S[numbers[CanonProp.SHUTTER_SPEED]],
            iso=canon_codes.ISO_CODES[numbers[CanonProp.ISO_SPEED]],
            f_number=canon_codes.APERTURE_CODES[numbers[CanonProp.APERTURE]],
            color_temperature_k=kelvin,
            width_px=width_px,
            height_px=height_px,
            taken_local=self.local_now().replace(tzinfo=None, microsecond=0),
            sequence=self.shot_count + 1,
            manufacturer="Canon",
            model="Canon EOS 5D Mark II",
            serial=self.options.serial[-10:],
            firmware=self.options.firmware,
        )

    def picture_ready(self, settings: ShotRequest, faults: tuple[Fault, ...]) -> None:
        """Store each file, or keep it for the host, and announce it; then say that the camera is idle."""
        for kind, _size, _compression in self.settings.files:
            is_raw = kind == canon_codes.IMAGE_TYPE_RAW
            data = self.darkroom.raw(settings) if is_raw else self.darkroom.jpeg(settings, faults)
            object_format = ObjectFormat.CANON_CR2 if is_raw else ObjectFormat.EXIF_JPEG
            name = f"IMG_{self.shot_count % 10000:04d}.{'CR2' if is_raw else 'JPG'}"
            if self._to_host():
                self._offer(name, object_format, data, settings)
            else:
                self.tell(canon_stream.object_added(self.keep(name, object_format, data, settings)))
        self.tell_value(CanonProp.AVAILABLE_SHOTS)
        self.tell(canon_stream.status(busy=False))

    def _offer(self, name: str, object_format: int, data: bytes, settings: ShotRequest) -> None:
        item = StoredObject(
            self._next_host_handle, 0, object_format, name, 0, data,
            settings.taken_local, settings.width_px, settings.height_px,
        )  # fmt: skip
        self._next_host_handle += 1
        self.waiting_for_host[item.handle] = item
        self.host_pictures = max(0, self.host_pictures - 1)
        self.tell(canon_stream.transfer_request(item))

    def _transfer_complete(self, request: Request) -> Answer:
        if self.waiting_for_host.pop(request.params[0], None) is None:
            raise Refusal(Response.INVALID_OBJECT_HANDLE)
        return Answer()

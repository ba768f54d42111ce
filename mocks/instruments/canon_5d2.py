"""A simulated Canon EOS (5D Mark II by default): the body and its shutter button (half, full, autofocus, bulb)."""

import struct
from dataclasses import replace

from drivers.canon_5d2 import codes
from drivers.ptp.codes import ObjectFormat, Response
from mocks.instruments import canon_records
from mocks.instruments.canon_body import CANON_TIMING, CanonBody
from mocks.instruments.canon_records import BULB_SHUTTER, CanonOptions, ImageFormat, Record
from mocks.instruments.exposures import ShotRequest
from mocks.instruments.faults import Fault, FaultKind
from mocks.instruments.ptp.wire import Answer, Refusal, Request, Rule

__all__ = ["CANON_TIMING", "CanonOptions", "SimulatedCanon5D2"]

HALF, FULL, HALF_AND_FULL = 1, 2, 3
RELEASED, NO_FOCUS, CARD_FULL, CARD_READ_ONLY = 0, 1, 7, 8  # response parameter 1 of RemoteRelease
STORE_CODES = {Response.STORE_FULL: CARD_FULL, Response.STORE_READ_ONLY: CARD_READ_ONLY}
AUTO_ISO, AUTO_SHUTTER_S, AUTO_F_NUMBER, DAYLIGHT_K = 100, 1 / 125, 8.0, 5200
FOCUS_POINTS_IN_USE = 9  # of the 5D Mark II (Canon's data sheet)
WHITE_BALANCE_K = {1: 5200, 2: 6000, 3: 3200, 4: 4000, 5: 6000, 8: 7000}
SHUTTER_TIMES_S = {**codes.SHUTTER_CODES, **codes.SHUTTER_CODES_HALF}


class SimulatedCanon5D2(CanonBody):
    """Put it into a `mocks.instruments.usb.bus.SimulatedUsbBackend`, or behind `tests.peers.ptp_ip.PtpIpServer`."""

    half_pressed = False
    full_pressed = False
    _focused = False
    _focusing_until_s = 0.0
    _bulb_since_s: float | None = None
    _plan: tuple[ImageFormat, int] = ((), 0)
    """What the running exposure is to become: its files and their destination."""

    def _body_rules(self) -> dict[int, Rule]:
        canon = codes.CanonOperation
        return super()._body_rules() | {
            canon.REMOTE_RELEASE: Rule(self._remote_release),
            canon.REMOTE_RELEASE_ON: Rule(self._release_on, 1, 2),
            canon.REMOTE_RELEASE_OFF: Rule(self._release_off, 1, 1),
            canon.BULB_START: Rule(self._bulb_start),
            canon.BULB_END: Rule(self._bulb_end),
            canon.DO_AF: Rule(self._do_af),
            canon.AF_CANCEL: Rule(self._when_idle),
        }

    def forget_session(self) -> None:
        """Close the session; the button comes up."""
        super().forget_session()
        self.half_pressed = self.full_pressed = False

    # ---- the button

    def press_shutter(self) -> None:
        """Take a picture as a person at the camera does."""
        with self.lock:
            self._open()

    def _release_on(self, request: Request) -> Answer:
        self.refuse_without_remote()
        self.refuse_undrained()
        self.refuse_while_exposing()
        press = request.params[0]
        if press not in (HALF, FULL, HALF_AND_FULL):
            raise Refusal(Response.INVALID_PARAMETER)
        if press & HALF or not self.half_pressed:
            self._press_half(with_af=not request.param(1))
        if press & FULL:
            if self.full_pressed:
                raise Refusal(Response.DEVICE_BUSY)
            self._refuse_to_open()
            if not self._focused:
                raise Refusal(codes.CanonResponse.OPERATION_REFUSED)
            self.full_pressed = True
            self._open()
        return Answer()

    def _release_off(self, request: Request) -> Answer:
        self.refuse_without_remote()
        if request.params[0] & FULL:
            self.full_pressed = False
        if request.params[0] & HALF:
            self.half_pressed = False
        return Answer()

    def _press_half(self, *, with_af: bool) -> None:
        self.half_pressed = True
        self.refresh_settings()
        self._focused = True
        self._focusing_until_s = self.clock.monotonic_s()
        if self.settings.number(codes.CanonProp.FOCUS_MODE) == codes.FOCUS_MANUAL or not with_af:
            return
        fault = self.faults.condition(FaultKind.AUTOFOCUS)
        self._focused = bool(fault.number("finds")) if fault else self.options.focus_finds
        self._focusing_until_s += self.timing.focus_s
        points = FOCUS_POINTS_IN_USE if self._focused else 0
        # C189 of D1D3: a count and the points in focus (its true layout is not published)
        body = struct.pack("<II", 8 + 4 * points, points) + struct.pack(f"<{points}I", *range(points))
        record = canon_records.value_changed(codes.CanonProp.FOCUS_INFO_EX, body)
        self.agenda.at(self._focusing_until_s, lambda _due_s: self.queue_records(record))

    def _remote_release(self, _request: Request) -> Answer:
        self.refuse_without_remote()
        self.refuse_undrained()
        try:
            self._refuse_to_open()
        except Refusal as refusal:
            if refusal.code in STORE_CODES:
                return Answer(params=(STORE_CODES[Response(refusal.code)],))
            raise
        self._press_half(with_af=True)
        self.half_pressed = False
        if not self._focused:
            return Answer(params=(NO_FOCUS,))
        self._open()
        return Answer(params=(RELEASED,))

    def _refuse_to_open(self) -> None:
        """Refuse a release for lack of battery or room, or because a picture waits to be fetched."""
        self.refuse_while_exposing()
        if self.memory:
            raise Refusal(Response.DEVICE_BUSY)
        if self.faults.condition(FaultKind.BATTERY_LOW):
            raise Refusal(codes.CanonResponse.LOW_BATTERY)
        destination = self.settings.number(codes.CanonProp.CAPTURE_DESTINATION)
        if destination != codes.DESTINATION_PC:
            self.refuse_without_room()
        if destination & codes.DESTINATION_PC and self.computer_bytes < self.picture_bytes:
            raise Refusal(Response.STORE_FULL)

    def _open(self, open_s: float | None = None) -> None:
        focusing_s = max(0.0, self._focusing_until_s - self.clock.monotonic_s())
        settings = self.current_settings()
        if open_s is not None:
            settings = replace(settings, shutter_s=open_s)
        self._plan = (self.settings.files, self.settings.number(codes.CanonProp.CAPTURE_DESTINATION))
        self.expose(settings, focusing_s - (open_s or 0.0), open_s)
        self.queue_records(canon_records.number(codes.CanonEvent.CAMERA_STATUS_CHANGED, 1))

    # ---- bulb and autofocus

    def _bulb_start(self, _request: Request) -> Answer:
        self.refuse_without_remote()
        self.refuse_undrained()
        self._refuse_to_open()
        number, prop = self.settings.number, codes.CanonProp
        if number(prop.AUTO_EXPOSURE_MODE) != codes.AE_BULB and number(prop.SHUTTER_SPEED) != BULB_SHUTTER:
            raise Refusal(codes.CanonResponse.OPERATION_REFUSED)
        self._bulb_since_s = self.clock.monotonic_s()
        self.busy_until_s = float("inf")
        self.queue_records(canon_records.number(codes.CanonEvent.CAMERA_STATUS_CHANGED, 1))
        return Answer(params=(RELEASED,))

    def _bulb_end(self, _request: Request) -> Answer:
        if self._bulb_since_s is None:
            raise Refusal(codes.CanonResponse.OPERATION_REFUSED)
        open_s = self.clock.monotonic_s() - self._bulb_since_s
        self._bulb_since_s = None
        self._open(open_s)
        self.queue_records(canon_records.number(codes.CanonEvent.BULB_EXPOSURE_TIME, int(open_s)))
        return Answer(params=(RELEASED,))

    def _do_af(self, _request: Request) -> Answer:
        self.refuse_without_remote()
        self.refuse_while_exposing()
        self._press_half(with_af=True)
        self.half_pressed = False
        return Answer()

    # ---- the picture

    def current_settings(self) -> ShotRequest:
        """Return the exposure as the camera is set now."""
        number = self.settings.number
        white_balance = number(codes.CanonProp.WHITE_BALANCE)
        kelvin = WHITE_BALANCE_K.get(white_balance, DAYLIGHT_K)
        if white_balance == codes.WB_COLOR_TEMPERATURE:
            kelvin = number(codes.CanonProp.COLOR_TEMPERATURE)
        width_px, height_px = self._size_px(self.settings.files[-1][1])
        return ShotRequest(
            shutter_s=SHUTTER_TIMES_S.get(number(codes.CanonProp.SHUTTER_SPEED), AUTO_SHUTTER_S),
            iso=codes.ISO_CODES.get(number(codes.CanonProp.ISO_SPEED), AUTO_ISO),
            f_number=float(codes.APERTURE_CODES.get(number(codes.CanonProp.APERTURE), AUTO_F_NUMBER)),
            color_temperature_k=kelvin,
            width_px=width_px,
            height_px=height_px,
            taken_local=self.local_now().replace(tzinfo=None, microsecond=0),
            sequence=self.shot_count + 1,
            manufacturer="Canon",
            model=self.identity.model,
            serial=self.options.serial,
            firmware=self.identity.version,
        )

    def _size_px(self, size: int) -> tuple[int, int]:
        """Return the pixels of size code 0 L, 1 M, 2 S, in proportion to the large picture of the options."""
        full, wanted = codes.IMAGE_SIZES_PX[0], codes.IMAGE_SIZES_PX.get(size, codes.IMAGE_SIZES_PX[2])
        width_px, height_px = self.options.image_size_px
        return width_px * wanted[0] // full[0], height_px * wanted[1] // full[1]

    def picture_ready(self, settings: ShotRequest, faults: tuple[Fault, ...]) -> None:
        """Put the files on the card or into memory and announce them; then the camera is idle."""
        announcements: list[Record] = []
        files, destination = self._plan
        for kind, _size, _compression in files:
            raw = kind == codes.IMAGE_TYPE_RAW
            data = self.darkroom.source.raw(settings) if raw else self.darkroom.jpeg(settings, faults)
            name = f"IMG_{self.shot_count % 10000:04d}.{'CR2' if raw else 'JPG'}"
            object_format = ObjectFormat.CANON_CR2 if raw else ObjectFormat.EXIF_JPEG
            if destination != codes.DESTINATION_PC:
                announcements.append(canon_records.object_added(self.keep(name, object_format, data, settings)))
            if destination & codes.DESTINATION_PC:
                kept = self.remember(name, object_format, data, (settings.width_px, settings.height_px))
                announcements.append(canon_records.transfer_requested(kept))
                self.computer_bytes = max(0, self.computer_bytes - len(data))
        self.refresh_settings()
        idle = canon_records.number(codes.CanonEvent.CAMERA_STATUS_CHANGED, 0)
        self.queue_records(self.settings.value_record(codes.CanonProp.AVAILABLE_SHOTS), *announcements, idle)

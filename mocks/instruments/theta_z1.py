"""A simulated Ricoh Theta Z1 with the manners of the real one (Ricoh USB API specification; device dumps).

What no source says is chosen here and said so: the interrupt packet (64 bytes), the answer of settings that the
exposure program forbids (InvalidDevicePropValue), which settings survive sleep, and all times.
"""

import math
from collections.abc import Iterator
from dataclasses import dataclass, replace
from datetime import datetime

from drivers.clock import Clock
from drivers.ptp.codes import DataType, Event, ObjectFormat, Operation, Prop, Response
from drivers.theta_z1 import codes as ricoh_codes
from drivers.theta_z1.codes import RicohOperation, RicohProp
from mocks.instruments.exposures import CameraTiming, ShotRequest, ShotSource
from mocks.instruments.faults import Fault, FaultKind, FaultSchedule
from mocks.instruments.ptp import wire as ptp_wire
from mocks.instruments.ptp.camera import CameraMemory, SimulatedCamera
from mocks.instruments.ptp.datasets import ObjectStore, Property, PropertyTable, Storage
from mocks.instruments.ptp.wire import Answer, DeviceIdentity, Refusal, Request, Rule
from mocks.instruments.recorded import recording
from processing.ground.tables import table_of

RECORDING = recording("theta_z1")
STITCHING_FIRMWARE = (2, 10, 1)  # the first with static stitching (Ricoh's USB API specification)
READABLE_WHILE_BUSY = tuple(int(code, 16) for code in RECORDING.raw["answered_while_busy"])
FIRST_HANDLE = 0x62  # so that the first picture is 64h, after the two folders
THETA_TIMING = CameraTiming(
    release_lag_s=0.12, processing_s=2.5, transfer_bytes_per_s=25e6, raw_cycle_s=6.4, dated_after_s=2.5
)
"""With DNG nine stops take 50 to 54 s, 6 to 7 s a frame whatever the shutter (EXIF of 14 brackets of the authors;
6.4 s and the driver's settings make 6.5). The file is made, and dated, about 2.5 s after the shutter (theta-api-specs,
issue 26). Lag and transfer are chosen: no figures are published."""
_NAMED: dict[str, int] = {prop.name: prop for prop in (*Prop, *RicohProp)}
FORMS = {_NAMED.get(name) or int(name, 16): row for name, row in table_of(__package__, "theta_properties").items()}
"""Properties by code, as rows of theta_properties.toml."""
SURVIVES_SLEEP = [code for code, row in FORMS.items() if row.get("survives_sleep")]
MANUAL, NORMAL, APERTURE_PRIORITY, SHUTTER_PRIORITY, ISO_PRIORITY = 1, 2, 3, 4, 0x8003
PROGRAMS_THAT_TAKE = {
    Prop.F_NUMBER: (MANUAL, APERTURE_PRIORITY),
    RicohProp.SHUTTER_SPEED: (MANUAL, SHUTTER_PRIORITY),
    Prop.EXPOSURE_INDEX: (MANUAL, ISO_PRIORITY),
}
AUTO_EXPOSURE_S, AUTO_ISO, AUTO_F_NUMBER, AUTO_COLOR_TEMPERATURE_K = 1 / 60, 400, 2.1, 5000
"""What the automatic picks, where a host leaves it to the camera."""
AUTO_SHUTTER = 0  # Ricoh's USB API, ShutterSpeed
TAKES_COLOR_TEMPERATURE = 0x8007  # Ricoh's USB API: the white balance that lets a temperature be set
ISO_LIMITS = tuple(v for v in ricoh_codes.ISO_VALUES if v >= 200)
LATER_PROPERTIES = (RicohProp.EXPOSURE_STATUS, RicohProp.MODE_MEMORY)  # of firmware 3.10.2 and 3.60.3
ERROR_NO_MEMORY = 0x00000001  # Ricoh's USB API, ErrorInfo


@dataclass(frozen=True)
class ThetaOptions:
    """What differs between cameras and firmwares. ``f_number_index``: 1..3 instead of F x 100 (sources disagree).

    ``firmware``: static stitching is there from 2.10.1 on; ``later_firmware`` adds ExposureStatus and ModeMemory.
    ``busy_as_recorded``: it begins as the recorded camera was: SleepMode reads 0, and yet most properties answer busy;
    ``cured_by_waking``: whether writing SleepMode = 0 ends this, which no recording shows. ``image_size_px`` may be
    smaller than life, for speed.
    """

    serial: str = "10010001"
    firmware: str = "2.11.1"
    f_number_index: bool = False
    later_firmware: bool = False
    image_size_px: tuple[int, int] = (6720, 3360)
    battery_percent: int = 90
    error_info: int = 0
    asleep: bool = False
    busy_as_recorded: bool = False
    cured_by_waking: bool = True
    interrupt_packet_bytes: int = 64


def theta_identity(options: ThetaOptions) -> DeviceIdentity:
    """Return the Theta's USB identity and DeviceInfo."""
    identity = RECORDING.identity(
        version=options.firmware,
        serial=options.serial,
        interrupt_packet_bytes=options.interrupt_packet_bytes,
        serial_on_usb=True,
    )
    stitches = tuple(map(int, options.firmware.split("."))) >= STITCHING_FIRMWARE
    added = (RicohProp.IMAGE_STITCHING,) * stitches + LATER_PROPERTIES * options.later_firmware
    return replace(identity, properties=identity.properties + added)


def shutter_fraction(value: int) -> tuple[int, int]:
    """Return the (numerator, denominator) of a property value: its little-endian bytes are one, then the other."""
    return value & 0xFFFFFFFF, value >> 32


def theta_properties(listed: tuple[int, ...], *, f_number_index: bool, image_sizes: tuple[str, ...]) -> list[Property]:
    """Return the properties that DeviceInfo lists, in the defaults the camera wakes with.

    Those that neither the recording nor the specification explains are there, read-only and 0.
    """
    f_numbers = tuple(ricoh_codes.F_NUMBER_INDEX if f_number_index else ricoh_codes.F_NUMBER_TIMES_100)
    shutters = (AUTO_SHUTTER, *(below << 32 | above for above, below in ricoh_codes.SHUTTER_FRACTIONS))
    isos, u16 = (ricoh_codes.ISO_AUTO, *ricoh_codes.ISO_VALUES), DataType.UINT16
    computed = [
        Property(Prop.IMAGE_SIZE, DataType.STRING, image_sizes[0], writable=True, choices=image_sizes),
        Property(Prop.F_NUMBER, u16, 0, writable=True, choices=f_numbers),
        Property(Prop.EXPOSURE_INDEX, u16, ricoh_codes.ISO_AUTO, writable=True, choices=isos),
        Property(RicohProp.SHUTTER_SPEED, DataType.UINT64, AUTO_SHUTTER, writable=True, choices=shutters),
        Property(RicohProp.BRACKET_PARAMETERS, DataType.ARRAY | DataType.UINT128, (), writable=True),
        Property(RicohProp.ISO_AUTO_HIGH_LIMIT, u16, 3200, writable=True, choices=ISO_LIMITS),
    ]
    explained = {p.code: p for p in (*computed, *_tabled())}
    return [explained.get(code) or Property(code, DataType.UINT8, 0) for code in listed]


def _tabled() -> Iterator[Property]:
    for code, row in FORMS.items():
        default, writable, span = row.get("default", 0), row.get("writable", True), row.get("span")
        choices, kind = tuple(row.get("choices", ())), DataType[row["type"]]
        yield Property(code, kind, default, writable, choices, tuple(span) if span else None)


class SimulatedThetaZ1(SimulatedCamera):
    """Put it into a `mocks.instruments.usb.bus.SimulatedUsbBackend`."""

    unsupported_faults = frozenset({FaultKind.AUTOFOCUS})

    def __init__(
        self,
        shots: ShotSource,
        clock: Clock,
        *,
        timing: CameraTiming = THETA_TIMING,
        options: ThetaOptions = ThetaOptions(),
        faults: FaultSchedule | None = None,
        seed: int = 0,
    ) -> None:
        self.options = options
        sizes = ("{}x{}".format(*options.image_size_px), "3840x1920", "1920x960")
        identity = theta_identity(options)
        table = theta_properties(identity.properties, f_number_index=options.f_number_index, image_sizes=sizes)
        recorded = RECORDING.raw["storage"]
        storage = Storage(recorded["id"], recorded["type"], recorded["capacity_bytes"])
        memory = CameraMemory(ObjectStore(storage, FIRST_HANDLE, ("DCIM", "100RICOH")), PropertyTable(table))
        super().__init__(identity, shots, clock, timing=timing, memory=memory, faults=faults, seed=seed)
        self.rules |= {
            Operation.INITIATE_CAPTURE: Rule(self._initiate_capture, 0, 2),
            Operation.RESET_DEVICE_PROP_VALUE: Rule(self._reset_prop_value, 1, 1),
            Operation.POWER_DOWN: Rule(self._power_down),
            RicohOperation.STOP_SELF_TIMER: Rule(self._stop_self_timer),
        }
        self._last_active_s = clock.monotonic_s()
        self._waking_until_s = math.inf if options.busy_as_recorded else 0.0
        self._self_timer_until_s = 0.0
        self._capture_transaction = 0
        if options.asleep:
            self.properties.values[RicohProp.SLEEP_MODE] = 1

    # ---- sleep

    @property
    def asleep(self) -> bool:
        """Whether the camera sleeps."""
        return self.properties.number(RicohProp.SLEEP_MODE) == 1

    def fall_asleep(self) -> None:
        """Sleep; settings go back to their defaults unless ModeMemory keeps them."""
        if self.properties.values.get(RicohProp.MODE_MEMORY, 0) == 0:
            self.properties.reset(keep=SURVIVES_SLEEP)
        self.properties.values[RicohProp.SLEEP_MODE] = 1

    def advance(self) -> None:
        """Catch up with the clock; fall asleep or switch off after idling too long."""
        with self.lock:
            super().advance()
            idle_s = self.clock.monotonic_s() - max(self._last_active_s, self.busy_until_s)
            delay_s = self.properties.number(RicohProp.SLEEP_DELAY)
            if delay_s and idle_s >= delay_s and not self.asleep:
                self.fall_asleep()
            off_s = self.properties.number(RicohProp.AUTO_POWER_OFF_DELAY)
            if off_s and idle_s >= off_s and self.plugged:
                self.fall_asleep()
                self.unplug()

    def before(self, request: Request) -> None:
        """Answer busy to everything but a few properties while asleep or waking."""
        now_s = self.clock.monotonic_s()
        self._last_active_s = now_s
        if not self.asleep and now_s >= self._waking_until_s:
            return
        about_one = (Operation.GET_DEVICE_PROP_DESC, Operation.GET_DEVICE_PROP_VALUE, Operation.SET_DEVICE_PROP_VALUE)
        readable = request.operation in about_one and request.param(0) in READABLE_WHILE_BUSY
        always = (Operation.GET_DEVICE_INFO, Operation.OPEN_SESSION, Operation.CLOSE_SESSION)
        if not readable and request.operation not in always:
            raise Refusal(Response.DEVICE_BUSY)

    # ---- properties

    def refresh(self, code: int) -> None:
        """Compute battery, clock, errors and capture status."""
        values, now_s = self.properties.values, self.clock.monotonic_s()
        if code == Prop.DATE_TIME:
            values[code] = ptp_wire.date(self.local_now())
        elif code == Prop.BATTERY_LEVEL:
            low = self.faults.condition(FaultKind.BATTERY_LOW)
            values[code] = int(low.number("percent")) if low else self.options.battery_percent
        elif code == RicohProp.ERROR_INFO:
            values[code] = self.options.error_info | (ERROR_NO_MEMORY if self.free_pictures() < 1 else 0)
        elif code == RicohProp.CAPTURE_STATUS:
            values[code] = 2 if now_s < self._self_timer_until_s else 0
        elif code == RicohProp.EXPOSURE_STATUS and self.exposing:
            values[code] = 1 if now_s < self.exposure_log[-1].end_s else 2
        elif code == RicohProp.EXPOSURE_STATUS:
            values[code] = 0

    def choices(self, code: int) -> tuple[ptp_wire.Value, ...]:
        """Return the values the exposure program leaves open; only the automatic one where it takes none."""
        programs = PROGRAMS_THAT_TAKE.get(code)  # type: ignore[call-overload]
        if programs and self.properties.number(Prop.EXPOSURE_PROGRAM_MODE) not in programs:
            return (self.properties.properties[code].default,)
        return super().choices(code)

    def changed(self, code: int, value: ptp_wire.Value) -> None:
        """Take a setting and what follows from it."""
        if code != RicohProp.SLEEP_MODE:
            self.refuse_while_exposing()
        if code == RicohProp.COLOR_TEMPERATURE:
            if self.properties.number(Prop.WHITE_BALANCE) != TAKES_COLOR_TEMPERATURE:
                raise Refusal(Response.INVALID_PROP_VALUE)
        elif code == Prop.EXPOSURE_PROGRAM_MODE and value != NORMAL and self.properties.number(RicohProp.FILTER):
            raise Refusal(Response.INVALID_PROP_VALUE)
        elif code == RicohProp.SLEEP_DELAY and value in range(1, 60):
            value = 60
        elif code == RicohProp.SLEEP_MODE:
            self._set_sleep_mode(asleep=value == 1)
            return
        elif code == Prop.DATE_TIME:
            try:
                self.set_local(datetime.strptime(str(value), "%Y%m%dT%H%M%S%z"))
            except ValueError:
                raise Refusal(Response.INVALID_PROP_VALUE) from None
            return
        super().changed(code, value)
        self._follow(code, value)

    def _follow(self, code: int, value: ptp_wire.Value) -> None:
        if code == Prop.EXPOSURE_PROGRAM_MODE:
            for setting, programs in PROGRAMS_THAT_TAKE.items():
                if value not in programs:
                    self.properties.values[setting] = self.properties.properties[setting].default
        elif code == RicohProp.FILTER and value:
            self.properties.values[Prop.EXPOSURE_PROGRAM_MODE] = NORMAL
            self._follow(Prop.EXPOSURE_PROGRAM_MODE, NORMAL)
        elif code == Prop.IMAGE_SIZE:
            self.emit(Event.STORAGE_INFO_CHANGED, self.store.storage.storage_id)

    def _set_sleep_mode(self, *, asleep: bool) -> None:
        if asleep and not self.asleep:
            self.fall_asleep()
        elif not asleep and (self.asleep or (self._waking_until_s == math.inf and self.options.cured_by_waking)):
            self.properties.values[RicohProp.SLEEP_MODE] = 0
            self._waking_until_s = self.clock.monotonic_s() + self.timing.wake_s

    def _reset_prop_value(self, request: Request) -> Answer:
        prop = self.properties.properties.get(request.params[0])
        if prop is None:
            raise Refusal(Response.DEVICE_PROP_NOT_SUPPORTED)
        if not prop.writable:
            raise Refusal(Response.ACCESS_DENIED)
        self.changed(prop.code, prop.default)
        return Answer()

    def _power_down(self, _request: Request) -> Answer:
        self.agenda.at(self.clock.monotonic_s() + 0.5, lambda _due_s: self.unplug())
        return Answer()

    # ---- shooting

    def least_cycle_s(self) -> float:
        """Return 0 without DNG: no figure is published of a JPEG alone."""
        return self.timing.raw_cycle_s if self.properties.number(RicohProp.IMAGE_FORMAT) == 1 else 0.0

    def _initiate_capture(self, request: Request) -> Answer:
        self.refuse_while_exposing()
        if self.properties.number(Prop.STILL_CAPTURE_MODE) != ricoh_codes.STILL_CAPTURE_SINGLE:
            raise Refusal(Response.DEVICE_BUSY)
        if request.param(0) not in (0, self.store.storage.storage_id):
            raise Refusal(Response.INVALID_STORAGE_ID)
        if request.param(1) not in (0, ObjectFormat.EXIF_JPEG):
            raise Refusal(Response.INVALID_OBJECT_FORMAT)
        if not self.no_storage() and self.free_pictures() < 1:
            self.emit(Event.STORE_FULL, self.store.storage.storage_id)
        self.refuse_without_room()
        delay_s = self.properties.number(Prop.CAPTURE_DELAY) / 1000
        self._self_timer_until_s = self.clock.monotonic_s() + delay_s
        self._capture_transaction = request.transaction_id
        self.expose(self.current_settings(), delay_s)
        return Answer()

    def current_settings(self) -> ShotRequest:
        """Return the exposure as the camera is set now."""
        numerator, denominator = shutter_fraction(self.properties.number(RicohProp.SHUTTER_SPEED))
        automatic = (numerator, denominator) == shutter_fraction(AUTO_SHUTTER)
        iso = self.properties.number(Prop.EXPOSURE_INDEX)
        table = ricoh_codes.F_NUMBER_INDEX if self.options.f_number_index else ricoh_codes.F_NUMBER_TIMES_100
        f_text = table[self.properties.number(Prop.F_NUMBER)]
        by_temperature = self.properties.number(Prop.WHITE_BALANCE) == TAKES_COLOR_TEMPERATURE
        kelvin = self.properties.number(RicohProp.COLOR_TEMPERATURE) if by_temperature else AUTO_COLOR_TEMPERATURE_K
        width, height = self.properties.text(Prop.IMAGE_SIZE).split("x")
        return ShotRequest(
            shutter_s=AUTO_EXPOSURE_S if automatic else numerator / denominator,
            iso=AUTO_ISO if iso == ricoh_codes.ISO_AUTO else iso,
            f_number=AUTO_F_NUMBER if f_text == "auto" else float(f_text),
            color_temperature_k=kelvin,
            width_px=int(width),
            height_px=int(height),
            taken_local=self.local_now().replace(tzinfo=None, microsecond=0),
            sequence=self.shot_count + 1,
            manufacturer="RICOH",
            model="RICOH THETA Z1",
            serial=self.options.serial,
            firmware=self.options.firmware,
        )

    def picture_ready(self, settings: ShotRequest, faults: tuple[Fault, ...]) -> None:
        """Store JPEG (and DNG) and send ObjectAdded for each, then CaptureComplete."""
        transaction_id = self._capture_transaction
        settings = replace(settings, sequence=self.shot_count)
        stem = f"R{10000 + self.shot_count:07d}"
        jpeg = self.darkroom.jpeg(settings, faults)
        handles = [self.keep(f"{stem}.JPG", ObjectFormat.EXIF_JPEG, jpeg, settings).handle]
        if self.properties.number(RicohProp.IMAGE_FORMAT) == 1:
            handles.append(
                self.keep(f"{stem}.DNG", ObjectFormat.DNG, self.darkroom.source.raw(settings), settings).handle
            )
        for handle in handles:
            self.emit(Event.OBJECT_ADDED, handle, transaction_id=transaction_id)
        self.emit(Event.CAPTURE_COMPLETE, transaction_id, transaction_id=transaction_id)

    def _stop_self_timer(self, _request: Request) -> Answer:
        if self.clock.monotonic_s() >= self._self_timer_until_s:
            raise Refusal(Response.CAPTURE_ALREADY_TERMINATED)
        self._self_timer_until_s = 0.0
        self.busy_until_s = 0.0
        self.exposure_log.pop()
        self.agenda.clear()
        return Answer()

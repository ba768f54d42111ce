"""What both simulated cameras do alike: storage, objects, transfers, properties, shots and the camera's own clock."""

from abc import ABC, abstractmethod
from dataclasses import replace
from datetime import UTC, datetime, timedelta
from typing import NamedTuple

from drivers.clock import Clock
from drivers.ptp.codes import ObjectFormat, Operation, Response
from mocks.instruments.exposures import CameraTiming, Darkroom, ExposureRecord, ShotRequest, ShotSource, true_time_s
from mocks.instruments.faults import Fault, FaultKind, FaultSchedule, Moment
from mocks.instruments.ptp import wire as ptp_wire
from mocks.instruments.ptp.datasets import ANY, ObjectStore, PropertyTable, StoredObject
from mocks.instruments.ptp.responder import PtpResponder
from mocks.instruments.ptp.wire import Answer, DeviceIdentity, Refusal, Request, Rule


class CameraMemory(NamedTuple):
    """What a camera holds: pictures and settings."""

    store: ObjectStore
    properties: PropertyTable


class SimulatedCamera(PtpResponder, ABC):
    """A responder with a store, properties and a shutter; each model adds its own manners."""

    picture_bytes = 10_000_000
    """What the camera reckons with for one picture."""
    unsupported_faults: frozenset[FaultKind] = frozenset()

    def __init__(
        self,
        identity: DeviceIdentity,
        shots: ShotSource,
        clock: Clock,
        *,
        timing: CameraTiming,
        memory: CameraMemory,
        faults: FaultSchedule | None,
        seed: int,
    ) -> None:
        useless = {f.kind for f in faults.faults} & self.unsupported_faults if faults else set()
        if useless:
            raise ValueError(f"faults without effect on {identity.model}: {', '.join(sorted(useless))}")
        super().__init__(identity, clock, timing, faults, seed)
        self.rules |= {
            Operation.GET_STORAGE_IDS: Rule(self.get_storage_ids),
            Operation.GET_STORAGE_INFO: Rule(self.get_storage_info, 1, 1),
            Operation.GET_NUM_OBJECTS: Rule(lambda request: Answer(params=(len(self.selected(request)),)), 1, 3),
            Operation.GET_OBJECT_HANDLES: Rule(self._get_object_handles, 1, 3),
            Operation.GET_OBJECT_INFO: Rule(self.get_object_info, 1, 1),
            Operation.GET_OBJECT: Rule(self.get_object, 1, 1),
            Operation.GET_THUMB: Rule(self._get_thumb, 1, 1),
            Operation.DELETE_OBJECT: Rule(self.delete_object, 1, 2),
            Operation.GET_PARTIAL_OBJECT: Rule(self.get_partial_object, 3, 3),
            Operation.GET_DEVICE_PROP_DESC: Rule(self._get_prop_desc, 1, 1),
            Operation.GET_DEVICE_PROP_VALUE: Rule(self._get_prop_value, 1, 1),
            Operation.SET_DEVICE_PROP_VALUE: Rule(self._set_prop_value, 1, 1, data_out=True),
        }
        self.store, self.properties = memory
        self.darkroom = Darkroom(shots)
        self.zone = UTC
        self.clock_offset_s = 0.0
        self.busy_until_s = 0.0
        self.shot_count = 0

    # ---- clock

    def local_now(self) -> datetime:
        """Return the camera's own clock, with its zone."""
        wrong = self.faults.condition(FaultKind.CLOCK_OFFSET)
        offset_s = self.clock_offset_s + (wrong.number("offset_s") if wrong else 0.0)
        return (self.clock.utc_now() + timedelta(seconds=offset_s)).astimezone(self.zone)

    def set_local(self, moment: datetime) -> None:
        """Set the camera's clock to an aware moment."""
        self.zone = moment.tzinfo  # type: ignore[assignment]
        self.clock_offset_s = (moment - self.clock.utc_now()).total_seconds()

    # ---- exposing

    @property
    def exposing(self) -> bool:
        """Whether an exposure runs or is being worked on."""
        return self.clock.monotonic_s() < self.busy_until_s

    def refuse_while_exposing(self) -> None:
        """Answer busy while an exposure runs."""
        if self.exposing:
            raise Refusal(Response.DEVICE_BUSY)

    @abstractmethod
    def current_settings(self) -> ShotRequest:
        """Return the exposure as the camera is set now."""

    def press_shutter(self) -> None:
        """Take a picture as a person at the camera does."""
        with self.lock:
            self.expose(self.current_settings())

    def expose(self, settings: ShotRequest, delay_s: float = 0.0, open_s: float | None = None) -> ExposureRecord:
        """Open the shutter after the release lag, log it, and plan `picture_ready`.

        ``settings.shutter_s`` is what was set; ``open_s`` replaces it in bulb exposures.
        """
        shot_faults = self.faults.at(Moment.SHOT)
        for fault in shot_faults:
            self.faults.note(fault)
        wrong = next((f for f in shot_faults if f.kind is FaultKind.WRONG_EXPOSURE), None)
        nominal_s = settings.shutter_s * (wrong.number("factor") if wrong else 1.0)
        jitter_s = self.random.uniform(-1, 1) * self.timing.release_jitter_s
        start_s = self.clock.monotonic_s() + delay_s + max(0.0, self.timing.release_lag_s + jitter_s)
        length_s = open_s or true_time_s(nominal_s, power_of_two=self.timing.power_of_two_times)
        self.shot_count += 1
        taken_with = (settings.iso, settings.f_number, settings.color_temperature_k)
        record = ExposureRecord(self.shot_count, start_s, start_s + length_s, nominal_s, *taken_with)
        self.exposure_log.append(record)
        self.busy_until_s = max(record.end_s + self.timing.processing_s, start_s + self.least_cycle_s())
        self.busy_until_s += sum(f.number("delay_s") for f in shot_faults if f.kind is FaultKind.LATE_PICTURE)
        if self.timing.dated_after_s is not None:
            after_s = record.end_s + self.timing.dated_after_s - self.clock.monotonic_s()
            dated = (self.local_now() + timedelta(seconds=after_s)).replace(tzinfo=None, microsecond=0)
            settings = replace(settings, taken_local=dated)
        self.agenda.at(self.busy_until_s, lambda _due_s: self.picture_ready(settings, shot_faults))
        return record

    def least_cycle_s(self) -> float:
        """Return the least time from one exposure to the next."""
        return 0.0

    @abstractmethod
    def picture_ready(self, settings: ShotRequest, faults: tuple[Fault, ...]) -> None:
        """Store the picture and announce it; each model does this its own way."""

    def keep(self, name: str, object_format: int, data: bytes, settings: ShotRequest) -> StoredObject:
        """Put a file into the picture folder."""
        folder, taken, size = self.store.picture_folder, settings.taken_local, (settings.width_px, settings.height_px)
        return self.store.add(StoredObject(0, 0, object_format, name, folder, data, taken, *size))

    # ---- storage

    def no_storage(self) -> bool:
        """Whether the card is out."""
        return self.faults.condition(FaultKind.NO_STORAGE) is not None

    def free_pictures(self) -> int:
        """Return how many pictures still fit."""
        if self.faults.condition(FaultKind.STORE_FULL) or self.no_storage():
            return 0
        return self.store.free_bytes // self.picture_bytes

    def refuse_without_room(self) -> None:
        """Answer as a missing, locked or full store makes it."""
        if self.no_storage():
            raise Refusal(Response.STORE_NOT_AVAILABLE)
        if self.faults.condition(FaultKind.STORE_READ_ONLY):
            raise Refusal(Response.STORE_READ_ONLY)
        if self.free_pictures() < 1:
            raise Refusal(Response.STORE_FULL)

    def get_storage_ids(self, _request: Request) -> Answer:
        """List the store, unless it is out."""
        return Answer(data=ptp_wire.array(6, [] if self.no_storage() else [self.store.storage.storage_id]))

    def get_storage_info(self, request: Request) -> Answer:
        """Describe the store."""
        self._check_storage(request.params[0])
        info = self.store.info(
            free_bytes=0 if self.free_pictures() == 0 else self.store.free_bytes,
            free_pictures=self.free_pictures(),
            read_only=self.faults.condition(FaultKind.STORE_READ_ONLY) is not None,
        )
        return Answer(data=info)

    def _check_storage(self, storage_id: int) -> None:
        if self.no_storage():
            raise Refusal(Response.STORE_NOT_AVAILABLE)
        if storage_id != self.store.storage.storage_id:
            raise Refusal(Response.INVALID_STORAGE_ID)

    def selected(self, request: Request) -> list[StoredObject]:
        """Return the objects that GetObjectHandles' parameters select."""
        if request.params[0] != ANY:
            self._check_storage(request.params[0])
        parent = request.param(2)
        if parent not in (0, ANY) and self.store.get(parent) is None:
            raise Refusal(Response.INVALID_PARENT)
        return [] if self.no_storage() else self.store.select(request.param(1), parent)

    def _get_object_handles(self, request: Request) -> Answer:
        return Answer(data=ptp_wire.array(6, [o.handle for o in self.selected(request)][:9999]))

    def find_object(self, handle: int) -> StoredObject:
        """Return the object, or refuse."""
        found = None if self.no_storage() else self.store.get(handle)
        if found is None:
            raise Refusal(Response.INVALID_OBJECT_HANDLE)
        return found

    def get_object_info(self, request: Request) -> Answer:
        """Describe an object."""
        return Answer(data=self.find_object(request.params[0]).info())

    def _file(self, handle: int) -> StoredObject:
        if not self.timing.transfer_while_exposing:
            self.refuse_while_exposing()
        found = self.find_object(handle)
        if found.format == ObjectFormat.ASSOCIATION:
            raise Refusal(Response.INVALID_OBJECT_HANDLE)
        return found

    def get_object(self, request: Request) -> Answer:
        """Send a whole file."""
        return Answer(data=self._file(request.params[0]).data)

    def get_partial_object(self, request: Request) -> Answer:
        """Send part of a file; response parameter 1 is the number of bytes."""
        handle, offset, size = request.params
        data = self._file(handle).data
        if offset > len(data):
            raise Refusal(Response.INVALID_PARAMETER)
        part = data[offset : offset + size]
        return Answer(params=(len(part),), data=part)

    def _get_thumb(self, request: Request) -> Answer:
        self.find_object(request.params[0])
        raise Refusal(Response.NO_THUMBNAIL)

    def delete_object(self, request: Request) -> Answer:
        """Delete a file."""
        if request.param(1) != 0:
            raise Refusal(Response.SPEC_BY_FORMAT_UNSUPPORTED)
        found = self._file(request.params[0])
        if self.faults.condition(FaultKind.STORE_READ_ONLY):
            raise Refusal(Response.STORE_READ_ONLY)
        self.store.remove(found.handle)
        return Answer()

    # ---- properties

    def _known(self, request: Request) -> int:
        code = request.params[0]
        if code not in self.properties.properties:
            raise Refusal(Response.DEVICE_PROP_NOT_SUPPORTED)
        self.refresh(code)
        return code

    def refresh(self, code: int) -> None:
        """Bring a property that the camera computes up to date."""

    def choices(self, code: int) -> tuple[ptp_wire.Value, ...]:
        """Return the values a property may take at present."""
        return self.properties.properties[code].choices

    def _get_prop_desc(self, request: Request) -> Answer:
        code = self._known(request)
        return Answer(data=self.properties.properties[code].describe(self.properties.values[code], self.choices(code)))

    def _get_prop_value(self, request: Request) -> Answer:
        code = self._known(request)
        return Answer(data=ptp_wire.typed(self.properties.properties[code].data_type, self.properties.values[code]))

    def _set_prop_value(self, request: Request) -> Answer:
        code = self._known(request)
        prop = self.properties.properties[code]
        if not prop.writable:
            raise Refusal(Response.ACCESS_DENIED)
        try:
            value = ptp_wire.parse_typed(prop.data_type, request.data)
        except ptp_wire.BadBytesError:
            raise Refusal(Response.INVALID_PROP_FORMAT) from None
        choices = self.choices(code)
        if (choices and value not in choices) or (not choices and not prop.allows(value)):
            raise Refusal(Response.INVALID_PROP_VALUE)
        if self.takes_setting(code):
            self.changed(code, value)
        return Answer()

    def takes_setting(self, code: int) -> bool:
        """Whether the camera takes a setting, or only says so because a fault wants it."""
        faults = self.faults.at(Moment.SETTING, code)
        for fault in faults:
            self.faults.note(fault)
        return not faults

    def changed(self, code: int, value: ptp_wire.Value) -> None:
        """Take a new value; models add what follows from it."""
        self.properties.values[code] = value

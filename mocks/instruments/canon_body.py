"""The body of a simulated EOS, generated from a recording of a real one: modes, settings, event stream, pictures.

What no source says is chosen here and said so: which operations count as activity for auto power-off (all but
GetEvent), the codes of refusals that libgphoto2 does not distinguish, that a USB reset drops unfetched pictures as
pulling the cable does, and all times. The shutter button is in `mocks.instruments.canon_5d2`.
"""

import struct
from collections import deque
from datetime import UTC, datetime

from drivers.canon_5d2 import codes as canon_codes
from drivers.canon_5d2.codes import DESTINATION_PC, CanonEvent, CanonOperation, CanonProp, CanonResponse
from drivers.clock import Clock
from drivers.ptp.codes import DataType, Event, Operation, Response
from mocks.instruments import canon_records
from mocks.instruments.canon_records import D11E, D11F, FULL_BATTERY, READ_ONLY, CanonOptions, CanonSettings, Record
from mocks.instruments.exposures import CameraTiming, ShotSource
from mocks.instruments.faults import FaultKind, FaultSchedule
from mocks.instruments.ptp import wire as ptp_wire
from mocks.instruments.ptp.camera import CameraMemory, SimulatedCamera
from mocks.instruments.ptp.datasets import ObjectStore, Property, PropertyTable, Storage, StoredObject
from mocks.instruments.ptp.wire import Answer, Refusal, Request, Rule
from mocks.instruments.recorded import recording

# Chosen: plausible for the camera's age; no figures are published.
CANON_TIMING = CameraTiming(release_lag_s=0.075, processing_s=0.6, transfer_bytes_per_s=18e6)
FIRST_HANDLE = 0x9000_0000  # as in the recordings
FIRST_MEMORY_HANDLE = 0x9190_0001  # chosen: apart from those on the card
SHUTDOWN_WARNING_S = 10  # chosen
EMPTY_BATTERY, LOW_BATTERY_PERCENT = 0, 20
FIRST_RECORD_CODE = 0xC180  # as libgphoto2 numbers events' records
PLAIN_PROPERTIES = (
    Property(0xD402, DataType.STRING, "Canon EOS"),
    Property(0xD407, DataType.UINT32, 1),
    Property(0xD406, DataType.STRING, "Unknown Initiator", writable=True),
    Property(0xD303, DataType.UINT8, 1),
    Property(0x5001, DataType.UINT8, 50, choices=(100, 0, 75, 0, 50)),
)
"""As a 60D describes them, but for its name."""


class CanonBody(SimulatedCamera):
    """Everything but the shutter button: modes, settings, the record stream, pictures in memory."""

    unsupported_faults = frozenset()

    def __init__(
        self,
        shots: ShotSource,
        clock: Clock,
        *,
        timing: CameraTiming = CANON_TIMING,
        options: CanonOptions = CanonOptions(),  # noqa: B008 - frozen
        faults: FaultSchedule | None = None,
        seed: int = 0,
    ) -> None:
        if faults and any(f.kind is FaultKind.STALL and f.code >= FIRST_RECORD_CODE for f in faults.faults):
            raise ValueError("records of GetEvent cannot stall: they come as data; stall that phase of 9116")
        self.options = options
        self.settings = CanonSettings(options)
        self.records: deque[Record] = deque()
        self.memory: dict[int, StoredObject] = {}
        """Pictures for the computer, not yet fetched."""
        self.remote_mode = 0
        self.event_mode = 0
        self.computer_bytes = 0
        self._next_memory_handle = FIRST_MEMORY_HANDLE
        self._last_active_s = clock.monotonic_s()
        self._warned = False
        body = recording(options.body)
        card = body.raw["storage"]
        storage = Storage(card["id"], card["type"], options.card_bytes, card["description"], "", card["free_images"])
        identity = body.identity(
            version=options.firmware, serial=options.serial, interrupt_packet_bytes=8, serial_on_usb=False
        )
        plain = (p for p in PLAIN_PROPERTIES if p.code in identity.properties)
        memory = CameraMemory(ObjectStore(storage, FIRST_HANDLE, ("DCIM", "100CANON")), PropertyTable(plain))
        super().__init__(identity, shots, clock, timing=timing, memory=memory, faults=faults, seed=seed)
        self.rules |= self._body_rules()

    def _body_rules(self) -> dict[int, Rule]:
        canon = CanonOperation
        accept = Rule(lambda _request: Answer())
        return {
            canon.GET_STORAGE_IDS: Rule(self.get_storage_ids),
            canon.GET_STORAGE_INFO: Rule(self.get_storage_info, 1, 1),
            canon.GET_OBJECT_INFO: Rule(self.get_object_info, 1, 1),
            canon.GET_OBJECT: Rule(self.get_object, 1, 1),
            canon.DELETE_OBJECT: Rule(self.delete_object, 1, 2),
            canon.GET_PARTIAL_OBJECT: Rule(self.get_partial_object, 3, 3),
            canon.GET_DEVICE_INFO_EX: Rule(self._get_device_info_ex),
            canon.GET_OBJECT_INFO_EX: Rule(self._get_object_info_ex, 2, 3),
            canon.SET_DEVICE_PROP_VALUE_EX: Rule(self._set_value, data_out=True),
            canon.GET_REMOTE_MODE: Rule(lambda _request: Answer(params=(self.remote_mode,))),
            canon.SET_REMOTE_MODE: Rule(self._set_remote_mode, 1, 1),
            canon.SET_EVENT_MODE: Rule(self._set_event_mode, 1, 1),
            canon.GET_EVENT: Rule(self._get_event),
            canon.TRANSFER_COMPLETE: Rule(self._transfer_complete, 1, 1),
            canon.CANCEL_TRANSFER: Rule(self._transfer_complete, 1, 1),
            canon.PC_HDD_CAPACITY: Rule(self._pc_capacity, 2, 3),
            canon.SET_UI_LOCK: accept,
            canon.RESET_UI_LOCK: Rule(self._when_idle),
            canon.KEEP_DEVICE_ON: accept,
            canon.REQUEST_DEVICE_PROP_VALUE: Rule(self._request_value, 1, 1),
        }

    # ---- link and power

    def forget_session(self) -> None:
        """Close the session; remote and event mode end with it."""
        super().forget_session()
        self.remote_mode = self.event_mode = 0
        self.records.clear()

    def link_reset(self) -> None:
        """Lose the session and unfetched pictures."""
        super().link_reset()
        self.memory.clear()

    def fall_asleep(self) -> None:
        """Switch off: `replug` is the power switch."""
        self.unplug()

    def replug(self) -> None:
        """Put the cable back, or switch on."""
        super().replug()
        self._last_active_s = self.clock.monotonic_s()
        self._warned = False

    def advance(self) -> None:
        """Catch up with the clock; warn, then switch off, after idling too long."""
        with self.lock:
            super().advance()
            limit_s = self.settings.number(CanonProp.AUTO_POWER_OFF)
            idle_s = self.clock.monotonic_s() - max(self._last_active_s, self.busy_until_s)
            if not limit_s or not self.plugged:
                return
            if idle_s >= limit_s:
                self.unplug()
            elif idle_s >= limit_s - SHUTDOWN_WARNING_S and not self._warned:
                self._warned = True
                self.queue_records(canon_records.number(CanonEvent.WILL_SOON_SHUTDOWN, SHUTDOWN_WARNING_S))

    def before(self, request: Request) -> None:
        """Note activity, which keeps the camera on."""
        if request.operation != CanonOperation.GET_EVENT:
            self._last_active_s = self.clock.monotonic_s()
            self._warned = False

    def _when_idle(self, _request: Request) -> Answer:
        self.refuse_while_exposing()
        return Answer()

    # ---- modes and records

    def queue_records(self, *records: Record) -> None:
        """Queue records for GetEvent, and ask the host on the interrupt pipe to fetch them."""
        if not self.event_mode:
            return
        was_empty = not self.records
        for record in records:
            self.gate.deliver(record.code, record, self.records.append)
        if was_empty and self.records:
            self.emit(CanonEvent.REQUEST_GET_EVENT)

    def refuse_without_remote(self) -> None:
        """Refuse what needs remote mode."""
        if not self.remote_mode:
            raise Refusal(CanonResponse.OPERATION_REFUSED)

    def refuse_undrained(self) -> None:
        """Answer busy while the host has events to fetch."""
        if self.records:
            raise Refusal(Response.DEVICE_BUSY)

    def _set_remote_mode(self, request: Request) -> Answer:
        self.remote_mode = request.params[0]
        return Answer()

    def _set_event_mode(self, request: Request) -> Answer:
        began = request.params[0] and not self.event_mode
        self.event_mode = request.params[0]
        if began:
            self.refresh_settings()
            self.queue_records(*self.settings.first_records())
        elif not self.event_mode:
            self.records.clear()
        return Answer()

    def _get_event(self, _request: Request) -> Answer:
        records = list(self.records)
        self.records.clear()
        for fault in (r.fault for r in records if r.fault and r.fault.kind is FaultKind.UNPLUG):
            self.faults.note(fault)  # a stall is of the interrupt pipe, which records do not travel on
            self.unplug(fault.number("replug_after_s"))
        return Answer(data=b"".join(r.encode() for r in records) + canon_records.END)

    # ---- settings

    def refresh_settings(self) -> None:
        """Bring counters, clock, battery and the lens switch up to date."""
        values = self.settings.values
        values[CanonProp.AVAILABLE_SHOTS] = self.available_shots()
        values[CanonProp.CAMERA_TIME] = int(self.local_now().timestamp())
        low = self.faults.condition(FaultKind.BATTERY_LOW)
        empty = low and low.number("percent") < LOW_BATTERY_PERCENT
        values[CanonProp.BATTERY_POWER] = EMPTY_BATTERY if empty else FULL_BATTERY
        manual = self.options.lens_manual and not self.faults.condition(FaultKind.AUTOFOCUS)
        values[CanonProp.FOCUS_MODE] = canon_codes.FOCUS_MANUAL if manual else 0

    def available_shots(self) -> int:
        """Return how many pictures fit where they are going."""
        if self.settings.number(CanonProp.CAPTURE_DESTINATION) != DESTINATION_PC:
            return self.free_pictures()
        return self.computer_bytes // self.picture_bytes

    def _set_value(self, request: Request) -> Answer:
        self.refuse_without_remote()
        total, prop = struct.unpack_from("<II", request.data.ljust(8, b"\0"))
        if total != len(request.data) or total < 8:
            raise Refusal(Response.INVALID_DATASET)
        self.refuse_undrained()
        self.refuse_while_exposing()
        if self.memory:
            raise Refusal(Response.DEVICE_BUSY)
        if prop not in self.settings.values:
            raise Refusal(Response.DEVICE_PROP_NOT_SUPPORTED)
        if prop in READ_ONLY:
            raise Refusal(Response.ACCESS_DENIED)
        value = self.settings.parse(prop, request.data[8:])
        if prop == CanonProp.CAPTURE_DESTINATION and value == self.settings.values[prop]:
            raise Refusal(Response.DEVICE_BUSY)
        choices = self.settings.choices(prop)
        if (choices and value not in choices) or (prop == CanonProp.SHUTTER_SPEED and not choices):
            raise Refusal(Response.INVALID_PROP_VALUE)
        if self.takes_setting(prop):
            self._take(prop, value)
        props: tuple[int, ...] = (prop,)
        if prop == CanonProp.CAPTURE_DESTINATION:
            props = (CanonProp.AVAILABLE_SHOTS, prop, CanonProp.IMAGE_FORMAT, D11E, prop, D11F)
        self.queue_records(*[self.settings.value_record(p) for p in props])
        return Answer()

    def _take(self, prop: int, value: canon_records.CanonValue) -> None:
        self.settings.values[prop] = value
        if prop == CanonProp.CAMERA_TIME:
            self.set_local(datetime.fromtimestamp(self.settings.number(prop), UTC))
        elif prop == CanonProp.CAPTURE_DESTINATION:
            self.settings.values[CanonProp.AVAILABLE_SHOTS] = self.available_shots()

    def _request_value(self, request: Request) -> Answer:
        prop = request.params[0]
        if prop not in self.settings.values:
            raise Refusal(Response.DEVICE_PROP_NOT_SUPPORTED)
        self.refresh_settings()
        self.queue_records(self.settings.value_record(prop))
        return Answer()

    def _pc_capacity(self, request: Request) -> Answer:
        self.refuse_without_remote()
        self.computer_bytes = request.params[0] * request.params[1]
        card = canon_records.value_changed(CanonProp.AVAILABLE_SHOTS, self.free_pictures())
        self.settings.values[CanonProp.AVAILABLE_SHOTS] = self.available_shots()
        self.queue_records(card, self.settings.value_record(CanonProp.AVAILABLE_SHOTS))
        return Answer()

    def _get_device_info_ex(self, _request: Request) -> Answer:
        events, props = sorted(CanonEvent), sorted(self.settings.values)
        lists = b"".join(ptp_wire.array(DataType.UINT32, codes) for codes in (events, props, ()))
        return Answer(data=struct.pack("<I", 4 + len(lists)) + lists)

    # ---- objects

    def find_object(self, handle: int) -> StoredObject:
        """Return the object on the card or in memory, or refuse."""
        return self.memory[handle] if handle in self.memory else super().find_object(handle)

    def remember(self, name: str, object_format: int, data: bytes, size_px: tuple[int, int]) -> StoredObject:
        """Keep a picture in memory until the computer has fetched it."""
        taken = self.local_now().replace(tzinfo=None)
        item = StoredObject(self._next_memory_handle, 0, object_format, name, 0, data, taken, *size_px)
        self._next_memory_handle += 1
        self.memory[item.handle] = item
        return item

    def _transfer_complete(self, request: Request) -> Answer:
        handle = request.params[0]
        self.find_object(handle)
        self.memory.pop(handle, None)
        return Answer()

    def delete_object(self, request: Request) -> Answer:
        """Delete a file and say so, on the interrupt pipe and in the stream."""
        handle = request.params[0]
        if handle in self.memory:
            raise Refusal(Response.INVALID_OBJECT_HANDLE)
        answer = super().delete_object(request)
        self.emit(Event.OBJECT_REMOVED, handle)
        self.queue_records(canon_records.number(CanonEvent.OBJECT_REMOVED, handle))
        return answer

    def _get_object_info_ex(self, request: Request) -> Answer:
        storage_id, parent = request.params[:2]
        listing = Request(Operation.GET_OBJECT_HANDLES, request.transaction_id, (storage_id, 0, parent))
        entries = [canon_records.object_fields(o) for o in self.selected(listing)]
        packed = b"".join(struct.pack("<I", 4 + len(e)) + e for e in entries)
        return Answer(data=struct.pack("<I", len(entries)) + packed)

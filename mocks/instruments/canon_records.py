"""Records of Canon's GetEvent stream as a simulated camera writes them: u32 size, u32 code, payload (libgphoto2)."""

import struct
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from typing import Self

from drivers.canon_5d2.codes import AE_BULB, AE_MANUAL, FOCUS_MANUAL, SHUTTER_CODES, CanonEvent, CanonProp
from mocks.instruments.faults import Fault
from mocks.instruments.ptp import wire as ptp_wire
from mocks.instruments.ptp.datasets import StoredObject
from mocks.instruments.recorded import RecordedEvent, recording

END = struct.pack("<II", 8, 0)
# libgphoto2 camlibs/ptp2.
NAME_BYTES = 16
NO_LIST = 1  # forms of a record, as in the recordings
WITH_LIST = 3  # the same

ImageFormat = tuple[tuple[int, int, int], ...]  # one or two files: (type, size, compression)
CanonValue = int | str | bytes | ImageFormat
IMAGE_FORMATS = (0xD120, 0xD121, 0xD122, 0xD123)


@dataclass(frozen=True)
class Record(RecordedEvent):
    """A record on its way to the host; the first four bytes of ``payload`` say whom it is about."""

    fault: Fault | None = None

    def elsewhere(self, offset: int) -> Self:
        """Return the record about another object or property."""
        number = (int.from_bytes(self.payload[:4], "little") + offset) & 0xFFFFFFFF
        return replace(self, payload=struct.pack("<I", number) + self.payload[4:])

    def breaking(self, fault: Fault) -> Self:
        """Return the record with a fault of the link in it."""
        return replace(self, fault=fault)


def parse_image_format(data: bytes) -> ImageFormat:
    """Return the image format that ``data`` is: u32 count, then {10h, type, size, compression} each."""
    count = int.from_bytes(data[:4], "little")
    if count not in (1, 2) or len(data) != 4 + 16 * count:
        raise ptp_wire.BadBytesError(f"image format of {len(data)} bytes")
    files = [struct.unpack_from("<4I", data, 4 + 16 * i) for i in range(count)]
    if any(length != 0x10 for length, *_ in files):
        raise ptp_wire.BadBytesError("image format with entries of another size")
    return tuple((kind, size, compression) for _, kind, size, compression in files)


def value_bytes(value: CanonValue) -> bytes:
    """Return a value: numbers take four bytes whatever their type, strings end with NUL."""
    if isinstance(value, int):
        return struct.pack("<I", value)
    if isinstance(value, str):
        return value.encode("ascii") + b"\0"
    if isinstance(value, bytes):
        return value
    return struct.pack("<I", len(value)) + b"".join(struct.pack("<4I", 0x10, *file) for file in value)


def value_changed(prop: int, value: CanonValue) -> Record:
    """Return C189."""
    return Record(CanonEvent.PROP_VALUE_CHANGED, struct.pack("<I", prop) + value_bytes(value))


def number(code: int, value: int) -> Record:
    """Return a record that carries one number."""
    return Record(code, struct.pack("<I", value))


def _name(item: StoredObject) -> bytes:
    return item.name.encode("ascii")[: NAME_BYTES - 1].ljust(NAME_BYTES, b"\0")


def object_fields(item: StoredObject) -> bytes:
    """Return an object as C181 and GetObjectInfoEx describe it (flags, second handle and time inferred)."""
    taken = int(item.taken.timestamp()) if item.taken else 0
    head = struct.pack("<IIHHII", item.handle, item.storage_id, item.format, 0, 0, 0)
    return head + struct.pack("<III", len(item.data), item.parent, item.handle) + _name(item) + struct.pack("<I", taken)


def object_added(item: StoredObject) -> Record:
    """Return C181: a file on the card."""
    return Record(CanonEvent.OBJECT_ADDED_EX, object_fields(item))


def transfer_requested(item: StoredObject) -> Record:
    """Return C186: a picture in the camera's memory that wants to be fetched."""
    head = struct.pack("<IIIII", item.handle, item.format, 0, len(item.data), 0)
    return Record(CanonEvent.REQUEST_OBJECT_TRANSFER, head + _name(item))


# The settings of a body: values, lists, and the order of its first GetEvent, from its recording.


BULB_SHUTTER = 0x0C  # libgphoto2's table of shutter speeds
SHUTTER_PRIORITY, APERTURE_PRIORITY = 1, 2
ONE_SHOT = 0  # libgphoto2's table of focus modes
D11E, D11F = 0xD11E, 0xD11F
READ_ONLY = frozenset({0xD105, 0xD111, 0xD116, 0xD11B, 0xD1A0, 0xD1AF, 0xD1BF, D11E, D11F})
TEXTS = (CanonProp.OWNER, CanonProp.ARTIST, CanonProp.COPYRIGHT)
"""Not in the first reply: they come only when asked for with 9127."""

FULL_BATTERY = 2  # code of D111 (libgphoto2)


@dataclass(frozen=True)
class CanonOptions:
    """The camera's switches and menus; what is None is as the ``body`` (the name of a recording) was recorded.

    ``ae_mode`` is the dial (3 = M, 4 = bulb); ``lens_manual`` the lens switch. ``values`` and ``custom_functions``
    change what is recorded: (property or function, value). ``image_size_px`` of large pictures may be smaller than
    life, for speed.
    """

    body: str = "eos_5d2"
    serial: str = "0123456789abcdef0123456789abcdef"
    firmware: str = ""
    ae_mode: int | None = AE_MANUAL
    lens_manual: bool = True
    focus_finds: bool = True
    destination: int | None = None
    values: tuple[tuple[int, int], ...] = ()
    custom_functions: tuple[tuple[int, int], ...] = ()
    image_size_px: tuple[int, int] = (5616, 3744)
    card_bytes: int = 16_000_000_000


class CanonSettings:
    """Values by property code, and the lists of what each can be."""

    def __init__(self, options: CanonOptions) -> None:
        self.values: dict[int, CanonValue] = dict.fromkeys(TEXTS, "")
        self.values[CanonProp.SERIAL_NUMBER] = options.serial
        body = recording(options.body)
        self._first = tuple(_with_functions(e, dict(options.custom_functions)) for e in body.events)
        self._lists: dict[int, tuple[CanonValue, ...]] = {}
        for event in self._first:
            if event.code == CanonEvent.PROP_VALUE_CHANGED:
                self.values[event.prop] = _parsed(event.prop, event.body)
            elif event.code == CanonEvent.AVAIL_LIST_CHANGED:
                self._lists[event.prop] = tuple(_listed(event.prop, event.body))
        self._lists |= body.dial_at_m()
        # No recording with the dial at M has its shutter list: third stops stand in.
        self._lists[CanonProp.SHUTTER_SPEED] = self._lists.get(CanonProp.SHUTTER_SPEED) or tuple(SHUTTER_CODES)
        turned = {
            CanonProp.AUTO_EXPOSURE_MODE: options.ae_mode,
            CanonProp.FOCUS_MODE: FOCUS_MANUAL if options.lens_manual else ONE_SHOT,
            CanonProp.CAPTURE_DESTINATION: options.destination,
            CanonProp.BATTERY_POWER: FULL_BATTERY,
            **dict(options.values),
        }
        self.values |= {prop: value for prop, value in turned.items() if value is not None}
        if options.ae_mode == AE_BULB:
            self.values[CanonProp.SHUTTER_SPEED] = BULB_SHUTTER

    def number(self, prop: int) -> int:
        """Return the value of a numeric property."""
        value = self.values[prop]
        assert isinstance(value, int)
        return value

    @property
    def files(self) -> ImageFormat:
        """The files of one exposure."""
        value = self.values[CanonProp.IMAGE_FORMAT]
        assert isinstance(value, tuple)
        return value

    def choices(self, prop: int) -> tuple[CanonValue, ...]:
        """Return the list of a property in the present mode; empty: none."""
        mode = self.number(CanonProp.AUTO_EXPOSURE_MODE)
        if prop == CanonProp.SHUTTER_SPEED and mode not in (AE_MANUAL, SHUTTER_PRIORITY):
            return ()
        if prop == CanonProp.APERTURE and mode not in (AE_MANUAL, APERTURE_PRIORITY, AE_BULB):
            return ()
        return self._lists.get(prop, ())

    def parse(self, prop: int, data: bytes) -> CanonValue:
        """Return the value that ``data`` of a 9110 is; `BadBytesError` where it has another form."""
        old = self.values[prop]
        if isinstance(old, int):
            if len(data) != 4:
                raise ptp_wire.BadBytesError(f"number of {len(data)} bytes")
            return int.from_bytes(data, "little")
        if isinstance(old, str):
            if not data.endswith(b"\0") or not data.isascii():
                raise ptp_wire.BadBytesError("string without NUL")
            return data.rstrip(b"\0").decode("ascii")
        return parse_image_format(data) if isinstance(old, tuple) else data

    def value_record(self, prop: int) -> Record:
        """Return C189 of a property."""
        return value_changed(prop, self.values[prop])

    def first_records(self) -> list[Record]:
        """Return the answer to the first GetEvent: as recorded, with the values and lists of now."""
        return [self._as_now(event) for event in self._first]

    def _as_now(self, event: RecordedEvent) -> Record:
        if event.code == CanonEvent.PROP_VALUE_CHANGED and event.prop != CanonProp.CUSTOM_FUNCTIONS:
            return self.value_record(event.prop)
        if event.code == CanonEvent.AVAIL_LIST_CHANGED and event.prop in (CanonProp.SHUTTER_SPEED, CanonProp.APERTURE):
            # C18A; a property without a list has type 1 and count 0
            items = [value_bytes(c) for c in self.choices(event.prop)]
            head = struct.pack("<III", event.prop, WITH_LIST if items else NO_LIST, len(items))
            return Record(CanonEvent.AVAIL_LIST_CHANGED, head + b"".join(items))
        return Record(event.code, event.payload)


def _parsed(prop: int, body: bytes) -> CanonValue:
    if prop in IMAGE_FORMATS:
        return parse_image_format(body)
    return int.from_bytes(body, "little") if len(body) == 4 else body


def _listed(prop: int, body: bytes) -> Iterator[CanonValue]:
    """Yield the list of a C18A: form, count, values; structures of unknown layout are none."""
    form, count = struct.unpack_from("<II", body)
    if form != WITH_LIST:
        return
    at = 8
    for _ in range(count if prop in IMAGE_FORMATS or len(body) == 8 + 4 * count else 0):
        size = 4 + 16 * int.from_bytes(body[at : at + 4], "little") if prop in IMAGE_FORMATS else 4
        yield _parsed(prop, body[at : at + size])
        at += size


def _with_functions(event: RecordedEvent, wanted: Mapping[int, int]) -> RecordedEvent:
    """Return the event with other values of custom functions, where it holds them: (id, 1, value) as u32."""
    if event.code != CanonEvent.PROP_VALUE_CHANGED or event.prop != CanonProp.CUSTOM_FUNCTIONS:
        return event
    words = list(struct.unpack(f"<{len(event.payload) // 4}I", event.payload))
    for at in range(len(words) - 2):
        if words[at] in wanted and words[at + 1] == 1:
            words[at + 2] = wanted[words[at]]
    return RecordedEvent(event.code, struct.pack(f"<{len(words)}I", *words))

"""Records of Canon's GetEvent stream as a simulated camera writes them: u32 size, u32 code, payload (libgphoto2)."""

from __future__ import annotations

import struct
from collections.abc import Iterable
from dataclasses import dataclass, replace
from typing import Self

from drivers.canon_5d2.codes import (
    AE_BULB,
    AE_MANUAL,
    APERTURE_CODES,
    DESTINATION_PC,
    FOCUS_MANUAL,
    IMAGE_COMPRESSION_FINE,
    IMAGE_COMPRESSION_NORMAL,
    IMAGE_COMPRESSION_RAW,
    IMAGE_TYPE_JPEG,
    IMAGE_TYPE_RAW,
    ISO_CODES,
    SHUTTER_CODES,
    CanonEvent,
    CanonProp,
)
from mocks.instruments.faults import Fault
from mocks.instruments.ptp import wire as ptp_wire
from mocks.instruments.ptp.datasets import StoredObject

END = struct.pack("<II", 8, 0)
# libgphoto2 camlibs/ptp2.
NAME_BYTES = 16
NO_LIST = 1
WITH_LIST = 3

ImageFormat = tuple[tuple[int, int, int], ...]
"""One or two files: (type, size, compression)."""
CanonValue = int | str | ImageFormat


@dataclass(frozen=True)
class Record:
    """A record on its way to the host; the first four bytes of ``payload`` say whom it is about."""

    code: int
    payload: bytes
    fault: Fault | None = None

    def encode(self) -> bytes:
        """Return the record as it stands in the stream."""
        return struct.pack("<II", 8 + len(self.payload), self.code) + self.payload

    def elsewhere(self, offset: int) -> Self:
        """Return the record about another object or property."""
        number = (int.from_bytes(self.payload[:4], "little") + offset) & 0xFFFFFFFF
        return replace(self, payload=struct.pack("<I", number) + self.payload[4:])

    def breaking(self, fault: Fault) -> Self:
        """Return the record with a fault of the link in it."""
        return replace(self, fault=fault)


def image_format(files: ImageFormat) -> bytes:
    """Return an image format: u32 count, then {10h, type, size, compression} each."""
    return struct.pack("<I", len(files)) + b"".join(struct.pack("<4I", 0x10, *file) for file in files)


def parse_image_format(data: bytes) -> ImageFormat:
    """Return the image format that ``data`` is."""
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
    return image_format(value)


def value_changed(prop: int, value: CanonValue | bytes) -> Record:
    """Return C189."""
    body = value if isinstance(value, bytes) else value_bytes(value)
    return Record(CanonEvent.PROP_VALUE_CHANGED, struct.pack("<I", prop) + body)


def list_changed(prop: int, choices: Iterable[CanonValue]) -> Record:
    """Return C18A; a property without a list has type 1 and count 0."""
    items = [value_bytes(c) for c in choices]
    head = struct.pack("<III", prop, WITH_LIST if items else NO_LIST, len(items))
    return Record(CanonEvent.AVAIL_LIST_CHANGED, head + b"".join(items))


def number(code: int, value: int) -> Record:
    """Return a record that carries one number."""
    return Record(code, struct.pack("<I", value))


def _name(item: StoredObject) -> bytes:
    return item.name.encode("ascii")[: NAME_BYTES - 1].ljust(NAME_BYTES, b"\0")


def object_fields(item: StoredObject) -> bytes:
    """Return an object as C181 and GetObjectInfoEx describe it (flags, second handle and time inferred)."""
    taken = int(item.taken.timestamp()) if item.taken else 0
    head = struct.pack("<IIHHII", item.handle, item.storage_id, item.format, 0, 0, 0)
    middle = struct.pack("<III", len(item.data), item.parent, item.handle)
    return head + middle + _name(item) + struct.pack("<I", taken)


def object_added(item: StoredObject) -> Record:
    """Return C181: a file on the card."""
    return Record(CanonEvent.OBJECT_ADDED_EX, object_fields(item))


def transfer_requested(item: StoredObject) -> Record:
    """Return C186: a picture in the camera's memory that wants to be fetched."""
    head = struct.pack("<IIIII", item.handle, item.format, 0, len(item.data), 0)
    return Record(CanonEvent.REQUEST_OBJECT_TRANSFER, head + _name(item))


# The 5D Mark II's settings: values, lists, and the order its first GetEvent lists them in (from a 60D's log).


CARD, CARD_AND_PC = 1, 5
"""Of bodies with CompactFlash, as a 5D Mark III lists them."""
BULB_SHUTTER = 0x0C
SHUTTER_PRIORITY, APERTURE_PRIORITY = 1, 2
ONE_SHOT = 0
WIDEST_CODE, NARROWEST_CODE = 0x25, 0x50
"""The outdoor lens: f/3.5 to f/22."""
D11E, D11F = 0xD11E, 0xD11F
MODEL_ID_5D2 = 0x80000218

FIRST_VALUES = (
    0xD105, 0xD108, 0xD106, 0xD107, 0xD109, 0xD10A, 0xD10F, 0xD11B, 0xD114, 0xD116, 0xD110, 0xD101, 0xD102, 0xD103,
    0xD104, 0xD111, 0xD113, 0xD120, 0xD11C, D11E, D11F, 0xD1B0, 0xD1BF,
)  # fmt: skip
"""Properties of the first reply, in its order; strings come only when asked for with 9127."""
FIRST_LISTS = (0xD105, 0xD108, 0xD106, 0xD107, 0xD109, 0xD10A, 0xD10F, 0xD101, 0xD102, 0xD103, 0xD104, 0xD120, 0xD11C)
READ_ONLY = frozenset({0xD105, 0xD111, 0xD116, 0xD11B, 0xD1AF, 0xD1BF, D11E, D11F})


@dataclass(frozen=True)
class CanonOptions:
    """The camera's switches and menus. ``ae_mode`` is the dial (3 = M, 4 = bulb); ``lens_manual`` the lens switch.

    ``busy_until_drained``: answer busy to settings and releases while the host has not fetched all events.
    ``honours_no_af``: parameter 2 of RemoteReleaseOn keeps a lens on AF from focusing. ``battery_power`` is the code
    of D111 (2 full; codes from libgphoto2). ``image_size_px`` of large pictures may be smaller than life, for speed.
    """

    serial: str = "0123456789abcdef0123456789abcdef"
    firmware: str = "3-1.0.7"
    ae_mode: int = AE_MANUAL
    lens_manual: bool = True
    focus_finds: bool = True
    honours_no_af: bool = True
    busy_until_drained: bool = True
    auto_power_off_s: int = 60
    battery_power: int = 2
    destination: int = CARD
    image_size_px: tuple[int, int] = (5616, 3744)
    card_bytes: int = 16_000_000_000


class CanonSettings:
    """Values by property code."""

    def __init__(self, options: CanonOptions) -> None:
        self.values: dict[int, CanonValue] = {
            CanonProp.AUTO_EXPOSURE_MODE: options.ae_mode,
            CanonProp.FOCUS_MODE: FOCUS_MANUAL if options.lens_manual else ONE_SHOT,
            CanonProp.DRIVE_MODE: 0,
            CanonProp.METERING_MODE: 3,
            CanonProp.WHITE_BALANCE: 0,
            CanonProp.COLOR_TEMPERATURE: 5200,
            CanonProp.COLOR_SPACE: 1,
            CanonProp.AVAILABLE_SHOTS: 0,
            CanonProp.AUTO_POWER_OFF: options.auto_power_off_s,
            CanonProp.MODEL_ID: MODEL_ID_5D2,
            CanonProp.PICTURE_STYLE: 0x81,
            CanonProp.APERTURE: 0x38,
            CanonProp.SHUTTER_SPEED: BULB_SHUTTER if options.ae_mode == AE_BULB else 0x70,
            CanonProp.ISO_SPEED: 0x48,
            CanonProp.EXP_COMPENSATION: 0,
            CanonProp.BATTERY_POWER: options.battery_power,
            CanonProp.CAMERA_TIME: 0,
            CanonProp.IMAGE_FORMAT: ((IMAGE_TYPE_JPEG, 0, IMAGE_COMPRESSION_FINE),),
            CanonProp.CAPTURE_DESTINATION: options.destination,
            D11E: 0,
            D11F: 0,
            CanonProp.EVF_OUTPUT_DEVICE: 0,
            CanonProp.MIRROR_LOCKUP_STATE: 0,
            CanonProp.OWNER: "",
            CanonProp.ARTIST: "",
            CanonProp.COPYRIGHT: "",
            CanonProp.SERIAL_NUMBER: options.serial,
        }

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
        if prop == CanonProp.SHUTTER_SPEED:
            return tuple(SHUTTER_CODES) if mode in (AE_MANUAL, SHUTTER_PRIORITY) else ()
        if prop == CanonProp.APERTURE:
            open_to_host = mode in (AE_MANUAL, APERTURE_PRIORITY, AE_BULB)
            return tuple(c for c in APERTURE_CODES if WIDEST_CODE <= c <= NARROWEST_CODE) if open_to_host else ()
        return _FIXED_LISTS.get(prop, ())

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
        return parse_image_format(data)

    def value_record(self, prop: int) -> Record:
        """Return C189 of a property."""
        return value_changed(prop, self.values[prop])

    def list_record(self, prop: int) -> Record:
        """Return C18A of a property."""
        return list_changed(prop, self.choices(prop))

    def first_records(self) -> list[Record]:
        """Return what the first GetEvent lists: all values, then all lists."""
        return [*map(self.value_record, FIRST_VALUES), *map(self.list_record, FIRST_LISTS)]


def _image_formats() -> tuple[ImageFormat, ...]:
    jpegs = [
        (IMAGE_TYPE_JPEG, size, compression)
        for size in (0, 1, 2)
        for compression in (IMAGE_COMPRESSION_FINE, IMAGE_COMPRESSION_NORMAL)
    ]
    raw = (IMAGE_TYPE_RAW, 0, IMAGE_COMPRESSION_RAW)
    return (*((jpeg,) for jpeg in jpegs), *((raw, jpeg) for jpeg in jpegs), (raw,))


_FIXED_LISTS: dict[int, tuple[CanonValue, ...]] = {
    CanonProp.DRIVE_MODE: (0, 1, 4, 0x10, 0x11),
    CanonProp.METERING_MODE: (3, 4, 1, 5),
    CanonProp.WHITE_BALANCE: (0, 1, 8, 2, 3, 4, 5, 6, 9),
    CanonProp.COLOR_TEMPERATURE: tuple(range(2500, 10001, 100)),
    CanonProp.COLOR_SPACE: (1, 2),
    CanonProp.ISO_SPEED: (0, *ISO_CODES),
    CanonProp.IMAGE_FORMAT: _image_formats(),
    CanonProp.CAPTURE_DESTINATION: (CARD, CARD_AND_PC, DESTINATION_PC),
}

"""Records of Canon's GetEvent stream as a simulated camera writes them: u32 size, u32 code, payload (libgphoto2)."""

from __future__ import annotations

import struct
from collections.abc import Iterable
from dataclasses import dataclass, replace
from typing import Self

from drivers.ptp.canon_codes import CanonEvent
from mocks import ptp_wire
from mocks.faults import Fault
from mocks.ptp_objects import StoredObject

END = struct.pack("<II", 8, 0)
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

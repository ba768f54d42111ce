"""Records of Canon's GetEvent stream, as the camera writes them (layouts as published by libgphoto2's documentation).

A record is u32 size, u32 code, payload; a reply is records and a terminator of size 8, code 0.
"""

from __future__ import annotations

import struct
from collections.abc import Iterable
from dataclasses import dataclass, replace
from typing import Self

from drivers.ptp.canon_codes import LIST_FORM, CanonEvent
from mocks.faults import Fault
from mocks.ptp_objects import StoredObject
from mocks.ptp_wire import u32s

TERMINATOR = struct.pack("<II", 8, 0)
NAME_BYTES = 16
_HANDLE_CODES = frozenset({CanonEvent.OBJECT_ADDED_EX, CanonEvent.OBJECT_REMOVED, CanonEvent.REQUEST_OBJECT_TRANSFER})


@dataclass(frozen=True)
class Record:
    """One record waiting to be fetched; ``fault`` breaks the link while it is read."""

    code: int
    payload: bytes
    fault: Fault | None = None

    def encode(self) -> bytes:
        """Return the record with its head."""
        return struct.pack("<II", 8 + len(self.payload), self.code) + self.payload

    def elsewhere(self, offset: int) -> Self:
        """Return the record for another object; records of other things stay as they are."""
        if self.code not in _HANDLE_CODES:
            return self
        handle = (int.from_bytes(self.payload[:4], "little") + offset) & 0xFFFFFFFF
        return replace(self, payload=u32s([handle]) + self.payload[4:])

    def breaking(self, fault: Fault) -> Self:
        """Return the record with a fault of the link in it."""
        return replace(self, fault=fault)


def number(prop: int, value: int) -> Record:
    """Return PropValueChanged of a numeric property: four bytes whatever its type."""
    return Record(CanonEvent.PROP_VALUE_CHANGED, u32s([prop, value]))


def structure(prop: int, value: bytes) -> Record:
    """Return PropValueChanged of a structured property (image format, focus points)."""
    return Record(CanonEvent.PROP_VALUE_CHANGED, u32s([prop]) + value)


def text(prop: int, value: str) -> Record:
    """Return PropValueChanged of a string property: ASCII with NUL, padded to four bytes."""
    data = value.encode("ascii", "replace") + b"\0"
    return Record(CanonEvent.PROP_VALUE_CHANGED, u32s([prop]) + data + bytes(-len(data) % 4))


def choices(prop: int, values: Iterable[int]) -> Record:
    """Return AvailListChanged of a numeric property."""
    items = tuple(values)
    return Record(CanonEvent.AVAIL_LIST_CHANGED, u32s([prop, LIST_FORM, len(items), *items]))


def structured_choices(prop: int, values: Iterable[bytes]) -> Record:
    """Return AvailListChanged of a structured property."""
    items = tuple(values)
    return Record(CanonEvent.AVAIL_LIST_CHANGED, u32s([prop, LIST_FORM, len(items)]) + b"".join(items))


def no_choices(prop: int, form: int = 1) -> Record:
    """Return AvailListChanged of a property that the host cannot change."""
    return Record(CanonEvent.AVAIL_LIST_CHANGED, u32s([prop, form, 0]))


def status(*, busy: bool) -> Record:
    """Return CameraStatusChanged."""
    return Record(CanonEvent.CAMERA_STATUS_CHANGED, u32s([int(busy)]))


def object_entry(item: StoredObject) -> bytes:
    """Return the 52 bytes that describe an object in ObjectAddedEx and GetObjectInfoEx."""
    name = item.name.encode("ascii", "replace")[: NAME_BYTES - 1].ljust(NAME_BYTES, b"\0")
    seconds = int(item.taken.timestamp()) if item.taken else 0
    head = struct.pack("<IIHHII", item.handle, item.storage_id, item.format, 0, 0, 0x20)
    return head + u32s([len(item.data), item.parent, item.handle]) + name + u32s([seconds])


def object_added(item: StoredObject) -> Record:
    """Return ObjectAddedEx: a picture on the card."""
    return Record(CanonEvent.OBJECT_ADDED_EX, object_entry(item))


def object_removed(handle: int) -> Record:
    """Return ObjectRemoved."""
    return Record(CanonEvent.OBJECT_REMOVED, u32s([handle]))


def transfer_request(item: StoredObject) -> Record:
    """Return RequestObjectTransfer: a picture in the camera's memory that the host must fetch."""
    name = item.name.encode("ascii", "replace")[: NAME_BYTES - 1].ljust(NAME_BYTES, b"\0")
    payload = u32s([item.handle, item.format, 0, len(item.data), 0]) + name
    return Record(CanonEvent.REQUEST_OBJECT_TRANSFER, payload)

"""Canon's encodings as pure functions: the GetEvent stream, property writes, image formats.

Source: behaviour of EOS cameras as documented by libgphoto2 and by a 60D's log (devices.md 3.4, 3.5). A stream is
records of {u32 size, u32 code, payload} that end with size 8, code 0. Malformed bytes raise `ProtocolViolationError`;
a decoder allocates no more than the stream it was given.
"""

import struct
from collections.abc import Callable, Sequence
from dataclasses import dataclass

from drivers.canon_5d2 import codes
from drivers.errors import ProtocolViolationError

# Sizes of the GetEvent stream and of an image-format entry (libgphoto2 camlibs/ptp2).
RECORD_HEADER_BYTES = 8
IMAGE_FILE_BYTES = 16  # four 32-bit numbers (libgphoto2)
MAX_IMAGE_FILES = 2  # JPEG and raw
IMAGE_FORMAT_PROPS = frozenset({codes.CanonProp.IMAGE_FORMAT, 0xD121, 0xD122, 0xD123})
"""D120 and its twins for CF, SD and PC: their values are structures."""
OUR_PROPS = frozenset(map(int, codes.CanonProp))


@dataclass(frozen=True)
class PropValue:
    """C189: a property has this value now. ``raw`` is the value's bytes: a number, a string or a structure."""

    prop: int
    raw: bytes

    @property
    def number(self) -> int | None:
        """The value as a number, or None where it is no four-byte value."""
        return int.from_bytes(self.raw, "little") if len(self.raw) == 4 else None


@dataclass(frozen=True, order=True)
class ImageFile:
    """One file that a shot makes: type (JPEG, RAW), size (L, M, S) and compression, as codes of the camera."""

    file_type: int
    size: int
    compression: int


@dataclass(frozen=True)
class AvailableValues:
    """C18A: the values a property can take; empty where the camera gives no list. One of the two is always empty."""

    prop: int
    numbers: tuple[int, ...] = ()
    formats: tuple[tuple[ImageFile, ...], ...] = ()


@dataclass(frozen=True)
class ObjectRecord:
    """An object of the camera: C181 (added), C187 (changed), C186 and C190 (wants to be transferred)."""

    code: int
    handle: int
    storage_id: int
    object_format: int
    size_bytes: int
    name: str

    @property
    def wants_transfer(self) -> bool:
        """Whether the camera holds it in memory until it hears that the transfer is complete."""
        return self.code in (codes.CanonEvent.REQUEST_OBJECT_TRANSFER, codes.CanonEvent.REQUEST_OBJECT_TRANSFER_DT)


@dataclass(frozen=True)
class NumberRecord:
    """A record that carries one number: C182 handle, C184/C185/C1A4 storage, C18B busy, C18D and C194 seconds."""

    code: int
    number: int


@dataclass(frozen=True)
class OtherRecord:
    """A record whose payload we do not read."""

    code: int
    payload: bytes


Record = PropValue | AvailableValues | ObjectRecord | NumberRecord | OtherRecord

JPEG_LARGE_FINE = ImageFile(codes.IMAGE_TYPE_JPEG, codes.IMAGE_SIZE_LARGE, codes.IMAGE_COMPRESSION_FINE)
RAW_FULL = ImageFile(codes.IMAGE_TYPE_RAW, codes.IMAGE_SIZE_LARGE, codes.IMAGE_COMPRESSION_RAW)


def decode_events(stream: bytes) -> tuple[Record, ...]:
    """Decode one answer of GetEvent.

    Raises `ProtocolViolationError`: A record runs over the end, is too short for its kind, holds a list that does not
    fill it, or the end mark is missing.
    """
    records: list[Record] = []
    at = 0
    while True:
        if len(stream) - at < RECORD_HEADER_BYTES:
            raise _violation("the event stream ends without its end mark", stream, at)
        size, code = struct.unpack_from("<II", stream, at)
        if size < RECORD_HEADER_BYTES or size > len(stream) - at:
            raise _violation(f"an event record of {size} bytes where {len(stream) - at} are left", stream, at)
        if code == 0 and size == RECORD_HEADER_BYTES:
            break
        record, decode = stream[at : at + size], _DECODERS.get(code)
        records.append(decode(code, record) if decode else OtherRecord(code, record[RECORD_HEADER_BYTES:]))
        at += size
    if any(stream[at + RECORD_HEADER_BYTES :]):
        raise _violation("bytes after the end mark of the event stream", stream, at)
    return tuple(records)


def _violation(message: str, stream: bytes, at: int) -> ProtocolViolationError:
    where = "Canon event stream"
    likely = "a transfer was cut or its bytes were damaged"
    advice = "resynchronise; if it persists, report it with the camera's firmware version"
    return ProtocolViolationError(
        message, where=where, likely=likely, advice=advice, offset=at, bytes_hex=stream[at : at + 32].hex()
    )


def _words(record: bytes, offset: int, count: int) -> tuple[int, ...]:
    """Return ``count`` u32 of a record from ``offset``."""
    if offset + 4 * count > len(record):
        raise _violation(f"an event record of {len(record)} bytes is too short for its kind", record, 0)
    return struct.unpack_from(f"<{count}I", record, offset)


def _decode_value(_code: int, record: bytes) -> PropValue:
    (prop,) = _words(record, 8, 1)
    return PropValue(prop, record[12:])


def _decode_available(_code: int, record: bytes) -> AvailableValues:
    prop, form, count = _words(record, 8, 3)
    if form != codes.LIST_FORM:
        return AvailableValues(prop)
    if prop in IMAGE_FORMAT_PROPS:
        # The formats of a list; bytes of zero may follow the last (a 1000D sends such a word)
        formats = []
        at = 20
        for _ in range(min(count, len(record))):
            files, at = _take_image_format(record, at)
            formats.append(files)
        if len(formats) != count or any(record[at:]):
            raise _violation(f"a list of {count} image formats does not fill its record", record, 0)
        return AvailableValues(prop, formats=tuple(formats))
    if len(record) != 20 + 4 * count:
        if prop in OUR_PROPS:
            raise _violation(f"a list of {count} values in a record of {len(record)} bytes", record, 0)
        return AvailableValues(prop)  # of structures: a 5D Mark III lists its D17D so
    return AvailableValues(prop, numbers=_words(record, 20, count))


def _decode_added(code: int, record: bytes) -> ObjectRecord:
    handle, storage_id, object_format = _words(record, 8, 3)
    (size_bytes,) = _words(record, 0x1C, 1)
    return ObjectRecord(code, handle, storage_id, object_format & 0xFFFF, size_bytes, _name(record, 0x28))


def _decode_transfer(code: int, record: bytes) -> ObjectRecord:
    handle, object_format, _, size_bytes = _words(record, 8, 4)
    return ObjectRecord(code, handle, 0, object_format & 0xFFFF, size_bytes, _name(record, 0x1C))


def _name(record: bytes, offset: int) -> str:
    """Return the zero-ended name at ``offset``; what is not ASCII is replaced (it is shown, never used as a path)."""
    end = record.find(b"\0", offset)
    if end < 0:
        raise _violation("a file name without its end", record, 0)
    return record[offset:end].decode("ascii", errors="replace")


def _decode_number(code: int, record: bytes) -> NumberRecord:
    return NumberRecord(code, _words(record, 8, 1)[0])


_DECODERS: dict[int, Callable[[int, bytes], Record]] = {
    codes.CanonEvent.PROP_VALUE_CHANGED: _decode_value,
    codes.CanonEvent.AVAIL_LIST_CHANGED: _decode_available,
    codes.CanonEvent.OBJECT_ADDED_EX: _decode_added,
    codes.CanonEvent.OBJECT_INFO_CHANGED_EX: _decode_added,
    codes.CanonEvent.REQUEST_OBJECT_TRANSFER: _decode_transfer,
    codes.CanonEvent.REQUEST_OBJECT_TRANSFER_DT: _decode_transfer,
    codes.CanonEvent.OBJECT_REMOVED: _decode_number,
    codes.CanonEvent.STORAGE_STATUS_CHANGED: _decode_number,
    codes.CanonEvent.STORAGE_INFO_CHANGED: _decode_number,
    codes.CanonEvent.CAMERA_STATUS_CHANGED: _decode_number,
    codes.CanonEvent.WILL_SOON_SHUTDOWN: _decode_number,
    codes.CanonEvent.BULB_EXPOSURE_TIME: _decode_number,
    codes.CanonEvent.CTG_INFO_CHECK_COMPLETE: _decode_number,
}


def decode_custom_functions(raw: bytes) -> dict[int, int]:
    """Return the single-valued custom functions of D1A0 by id; of what is no such structure, those before the fault."""
    found: dict[int, int] = {}
    words = struct.unpack(f"<{len(raw) // 4}I", raw[: len(raw) // 4 * 4])
    at = 2  # size, number of groups
    while at + 3 <= len(words):
        count, at = words[at + 2], at + 3  # of a group: id, size, number of functions
        for _ in range(min(count, len(words))):
            if at + 2 > len(words):
                return found
            n_values = words[at + 1]
            if n_values == 1 and at + 2 < len(words):
                found[words[at]] = words[at + 2]
            at += 2 + n_values
    return found


def decode_image_format(raw: bytes) -> tuple[ImageFile, ...]:
    """Decode the value of an image-format property (D120): the one or two files that a shot makes.

    Raises `ProtocolViolationError`: not exactly one such structure.
    """
    files, end = _take_image_format(raw, 0)
    if end != len(raw):
        raise _violation("bytes after an image format", raw, 0)
    return files


def _take_image_format(data: bytes, at: int) -> tuple[tuple[ImageFile, ...], int]:
    """Return the image format at ``at`` and the offset behind it."""
    (count,) = _words(data, at, 1)
    if not 1 <= count <= MAX_IMAGE_FILES:
        raise _violation(f"an image format of {count} files", data, at)
    at += 4
    files = []
    for _ in range(count):
        size, file_type, image_size, compression = _words(data, at, 4)
        if size != IMAGE_FILE_BYTES:
            raise _violation(f"an image format entry of {size} bytes", data, at)
        files.append(ImageFile(file_type, image_size, compression))
        at += IMAGE_FILE_BYTES
    return tuple(files), at


def encode_image_format(files: Sequence[ImageFile]) -> bytes:
    """Encode one or two files as the value of an image-format property."""
    if not 1 <= len(files) <= MAX_IMAGE_FILES:
        raise ValueError(f"an image format has one or two files, not {len(files)}")
    entries = (struct.pack("<4I", IMAGE_FILE_BYTES, f.file_type, f.size, f.compression) for f in files)
    return struct.pack("<I", len(files)) + b"".join(entries)


def encode_property(prop: int, value: bytes) -> bytes:
    """Return the data phase of SetDevicePropValueEx (9110): total size, property, value."""
    return struct.pack("<II", 8 + len(value), prop) + value


def encode_number(value: int) -> bytes:
    """Return a number as properties carry it: four bytes, whatever the property's own width."""
    return struct.pack("<I", value)

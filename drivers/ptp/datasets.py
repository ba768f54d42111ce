"""The datasets of PTP that our cameras speak: DeviceInfo, StorageInfo, ObjectInfo, DevicePropDesc, and the
values in them (integers, arrays, strings, dates); pure, strict, never past the end of the buffer.

The fields of each dataclass stand in the order of the wire. Decoding raises `ProtocolViolationError` for anything that
is no such dataset. Bytes after the last field of DeviceInfo, StorageInfo and ObjectInfo are let pass, since devices in
the field append fields of their own there; values and descriptions of properties must end where they end, since a
longer one means another type. Text from a camera is text: names are never used as paths.
"""

import re
import struct
from collections.abc import Sequence
from dataclasses import dataclass
from datetime import UTC, datetime, timedelta, timezone
from typing import Any

from drivers.ptp.codes import DataType, FormFlag
from drivers.ptp.container import violation

Value = int | str | tuple[int, ...]

MAX_STRING_UNITS = 255  # a string's length, its closing NUL included, is one byte

_INTEGERS: dict[int, tuple[int, bool]] = {
    DataType[f"{'' if signed else 'U'}INT{8 * size_bytes}"]: (size_bytes, signed)
    for size_bytes in (1, 2, 4, 8, 16)
    for signed in (True, False)
}
"""Datatype -> size and sign."""

_DATE = re.compile(r"(\d{8}T\d{6})(?:\.(\d{1,6}))?(Z|[+-]\d{4})?", re.ASCII)


class DatasetReader:
    """Walks through a dataset; every step is checked against what is left. `ProtocolViolationError` otherwise."""

    def __init__(self, data: bytes, what: str) -> None:
        self._data = data
        self._at = 0
        self._what = what

    @property
    def left_bytes(self) -> int:
        """How many bytes are not read yet."""
        return len(self._data) - self._at

    def take(self, count: int) -> bytes:
        """Return the next ``count`` bytes."""
        if count > self.left_bytes:
            raise violation(f"{self._what} ends after {len(self._data)} of {self._at + count} bytes", self._data)
        piece = self._data[self._at : self._at + count]
        self._at += count
        return piece

    def unsigned(self, size_bytes: int) -> int:
        """Return the next unsigned little-endian integer."""
        return int.from_bytes(self.take(size_bytes), "little")

    def array(self, item_bytes: int, *, signed: bool = False) -> tuple[int, ...]:
        """Return the next array (32-bit count, then items); the count is checked before anything is built."""
        count = self.unsigned(4)
        if count * item_bytes > self.left_bytes:
            raise violation(f"{self._what} announces {count} items and has {self.left_bytes} bytes left", self._data)
        raw = self.take(count * item_bytes)
        return tuple(
            int.from_bytes(raw[i : i + item_bytes], "little", signed=signed) for i in range(0, len(raw), item_bytes)
        )

    def string(self) -> str:
        """Return the next string; it must be closed by NUL, and nothing but NULs may follow a NUL."""
        units = self.unsigned(1)
        if units == 0:
            return ""
        try:
            text = self.take(2 * units).decode("utf-16-le")
        except UnicodeDecodeError:
            raise violation(f"{self._what} has a string that is no UTF-16", self._data) from None
        body = text.rstrip("\0")
        if len(body) == len(text) or "\0" in body:
            raise violation(f"{self._what} has a string that is not closed where it should be", self._data)
        return body

    def value(self, data_type: int) -> Value:
        """Return the next value of a `DataType`, or of an array of one."""
        if data_type == DataType.STRING:
            return self.string()
        size_bytes, signed = _integer_type(data_type & ~DataType.ARRAY, self._what)
        if data_type & DataType.ARRAY:
            return self.array(size_bytes, signed=signed)
        return int.from_bytes(self.take(size_bytes), "little", signed=signed)

    def finish(self) -> None:
        """Refuse bytes after the end: then the layout is not what we think it is."""
        if self.left_bytes:
            raise violation(f"{self._what} has {self.left_bytes} bytes too many", self._data)


def _integer_type(data_type: int, what: str) -> tuple[int, bool]:
    try:
        return _INTEGERS[data_type]
    except KeyError:
        raise violation(f"{what}: datatype {data_type:04X} does not exist", datatype=data_type) from None


def decode_value(data: bytes, data_type: int) -> Value:
    """Return the value that ``data`` is, to the byte."""
    reader = DatasetReader(data, "property value")
    value = reader.value(data_type)
    reader.finish()
    return value


def decode_ids(data: bytes) -> tuple[int, ...]:
    """Return the array of 32-bit ids or handles that ``data`` is, to the byte."""
    reader = DatasetReader(data, "list of ids")
    items = reader.array(4)
    reader.finish()
    return items


def encode_integer(value: int, data_type: int) -> bytes:
    """Return an integer of a `DataType`; `ValueError` where it does not fit."""
    size_bytes, signed = _INTEGERS[data_type]
    try:
        return value.to_bytes(size_bytes, "little", signed=signed)
    except OverflowError:
        raise ValueError(f"{value} does not fit datatype {data_type:04X}") from None


def encode_array(items: Sequence[int], item_type: int) -> bytes:
    """Return an array: 32-bit count, then the items."""
    return len(items).to_bytes(4, "little") + b"".join(encode_integer(item, item_type) for item in items)


def encode_string(text: str) -> bytes:
    """Return a string: number of UTF-16 units with the closing NUL, then the units; one zero byte where empty.

    `ValueError` for NULs, lone surrogates, or more than 254 units.
    """
    if not text:
        return b"\0"
    if "\0" in text:
        raise ValueError("a PTP string cannot hold NUL")
    raw = (text + "\0").encode("utf-16-le")
    if len(raw) // 2 > MAX_STRING_UNITS:
        raise ValueError(f"a PTP string holds {MAX_STRING_UNITS - 1} units, not {len(raw) // 2 - 1}")
    return bytes([len(raw) // 2]) + raw


def encode_value(value: Value, data_type: int) -> bytes:
    """Return a value of a `DataType`, or of an array of one; `ValueError` where it does not fit."""
    if isinstance(value, str):
        if data_type != DataType.STRING:
            raise ValueError(f"datatype {data_type:04X} holds no text")
        return encode_string(value)
    is_array = data_type != DataType.STRING and bool(data_type & DataType.ARRAY)
    if data_type == DataType.STRING or is_array != isinstance(value, tuple):
        raise ValueError(f"datatype {data_type:04X} does not hold {value!r}")
    if data_type & ~DataType.ARRAY not in _INTEGERS:
        raise ValueError(f"datatype {data_type:04X} does not exist")
    if isinstance(value, tuple):
        return encode_array(value, data_type & ~DataType.ARRAY)
    return encode_integer(value, data_type)


def decode_date(text: str) -> datetime | None:
    """Return the date of ``YYYYMMDDThhmmss[.s][Z|+hhmm]``; None for empty text.

    Aware where the text names a zone, naive otherwise: then it is the camera's own local time.
    """
    if not text:
        return None
    match = _DATE.fullmatch(text)
    if match is None:
        raise violation(f"{text[:40]!r} is no PTP date")
    moment, fraction, zone = match.groups()
    try:
        date = datetime.strptime(moment, "%Y%m%dT%H%M%S")  # noqa: DTZ007 - naive on purpose where no zone is given
        date = date.replace(microsecond=int((fraction or "0").ljust(6, "0")), tzinfo=_decode_zone(zone))
    except ValueError:
        raise violation(f"{text[:40]!r} is no date that exists") from None
    return date


def _decode_zone(zone: str | None) -> timezone | None:
    if zone is None:
        return None
    if zone == "Z":
        return UTC
    offset = timedelta(hours=int(zone[1:3]), minutes=int(zone[3:5]))
    return timezone(-offset if zone[0] == "-" else offset)


_OBJECT_INFO = struct.Struct("<IHHIHIIIIIIIHII")
_STORAGE_INFO = struct.Struct("<HHHQQI")
_DEVICE_INFO = struct.Struct("<HIH")


@dataclass(frozen=True)
class DeviceInfo:
    """What a camera says of itself; codes as numbers, see `drivers.ptp.codes`."""

    standard_version: int
    vendor_extension_id: int
    vendor_extension_version: int
    vendor_extension_desc: str
    functional_mode: int
    operations: tuple[int, ...]
    events: tuple[int, ...]
    properties: tuple[int, ...]
    capture_formats: tuple[int, ...]
    image_formats: tuple[int, ...]
    manufacturer: str
    model: str
    device_version: str
    serial: str


@dataclass(frozen=True)
class StorageInfo:
    """A store of the camera. ``free_images`` is FFFFFFFF where the camera does not know."""

    storage_type: int
    filesystem_type: int
    access: int
    max_bytes: int
    free_bytes: int
    free_images: int
    description: str
    label: str


@dataclass(frozen=True)
class ObjectInfo:
    """An object on the camera; ``size_bytes`` is FFFFFFFF from 4 GiB on. Dates as the camera writes them."""

    storage_id: int
    format_code: int
    protection: int
    size_bytes: int
    thumb_format: int
    thumb_bytes: int
    thumb_width_px: int
    thumb_height_px: int
    image_width_px: int
    image_height_px: int
    image_depth_bits: int
    parent: int
    association_type: int
    association_desc: int
    sequence: int
    filename: str
    capture_date: str = ""
    modification_date: str = ""
    keywords: str = ""


@dataclass(frozen=True)
class DevicePropDesc:
    """A property: its type, values, and what may be set.

    ``value_range`` is (minimum, maximum, step) for a range; ``choices`` the values of an enumeration.
    """

    code: int
    data_type: int
    writable: bool
    default: Value
    current: Value
    form: FormFlag = FormFlag.NONE
    value_range: tuple[Value, Value, Value] | None = None
    choices: tuple[Value, ...] = ()


def decode_device_info(data: bytes) -> DeviceInfo:
    """Return the DeviceInfo that ``data`` is."""
    reader = DatasetReader(data, "DeviceInfo")
    fields: list[Any] = [
        *_DEVICE_INFO.unpack(reader.take(_DEVICE_INFO.size)),
        reader.string(),
        reader.unsigned(2),
        *(reader.array(2) for _ in range(5)),
        *(reader.string() for _ in range(4)),
    ]
    return DeviceInfo(*fields)


def decode_storage_info(data: bytes) -> StorageInfo:
    """Return the StorageInfo that ``data`` is."""
    return StorageInfo(*_numbers_and_texts(data, "StorageInfo", _STORAGE_INFO, 2))


def decode_object_info(data: bytes) -> ObjectInfo:
    """Return the ObjectInfo that ``data`` is."""
    return ObjectInfo(*_numbers_and_texts(data, "ObjectInfo", _OBJECT_INFO, 4))


def _numbers_and_texts(data: bytes, name: str, layout: struct.Struct, texts: int) -> tuple[Any, ...]:
    reader = DatasetReader(data, name)
    return (*layout.unpack(reader.take(layout.size)), *(reader.string() for _ in range(texts)))


def decode_device_prop_desc(data: bytes) -> DevicePropDesc:
    """Return the DevicePropDesc that ``data`` is."""
    reader = DatasetReader(data, "DevicePropDesc")
    code, data_type, access = reader.unsigned(2), reader.unsigned(2), reader.unsigned(1)
    if access > 1:
        raise violation(f"DevicePropDesc of {code:04X} has access {access}, neither read nor write", data)
    default, current = reader.value(data_type), reader.value(data_type)
    form = reader.unsigned(1)
    value_range: tuple[Value, Value, Value] | None = None
    choices: tuple[Value, ...] = ()
    if form == FormFlag.RANGE:
        value_range = (reader.value(data_type), reader.value(data_type), reader.value(data_type))
    elif form == FormFlag.ENUMERATION:
        # No value is shorter than one byte, so that a false count ends with the buffer.
        choices = tuple(reader.value(data_type) for _ in range(reader.unsigned(2)))
    elif form != FormFlag.NONE:
        raise violation(f"DevicePropDesc of {code:04X} has form {form}, which does not exist", data)
    reader.finish()
    return DevicePropDesc(code, data_type, bool(access), default, current, FormFlag(form), value_range, choices)

"""The datasets of PTP that our cameras speak: DeviceInfo, StorageInfo, ObjectInfo, DevicePropDesc; both ways, pure.

The fields of each dataclass stand in the order of the wire. Decoding raises `ProtocolViolationError` for anything that
is no such dataset. Bytes after the last field of DeviceInfo, StorageInfo and ObjectInfo are let pass, since devices in
the field append fields of their own there; values and descriptions of properties must end where they end, since a
longer one means another type. Text from a camera is text: names are never used as paths.
"""

from __future__ import annotations

import struct
from dataclasses import dataclass
from datetime import datetime
from typing import Any

from drivers.ptp.codes import DataType, FormFlag
from drivers.ptp.container import violation
from drivers.ptp.values import (
    DatasetReader,
    Value,
    decode_date,
    encode_array,
    encode_string,
    encode_value,
)

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

    def captured_at(self) -> datetime | None:
        """Return the capture date, None where there is none; naive where the camera names no zone."""
        return decode_date(self.capture_date)


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
        reader.array(2),
        reader.array(2),
        reader.array(2),
        reader.array(2),
        reader.array(2),
        reader.string(),
        reader.string(),
        reader.string(),
        reader.string(),
    ]
    return DeviceInfo(*fields)


def encode_device_info(info: DeviceInfo) -> bytes:
    """Return the bytes of a DeviceInfo."""
    lists = (info.operations, info.events, info.properties, info.capture_formats, info.image_formats)
    texts = (info.manufacturer, info.model, info.device_version, info.serial)
    return b"".join(
        [
            _DEVICE_INFO.pack(info.standard_version, info.vendor_extension_id, info.vendor_extension_version),
            encode_string(info.vendor_extension_desc),
            info.functional_mode.to_bytes(2, "little"),
            *(encode_array(codes, DataType.UINT16) for codes in lists),
            *(encode_string(text) for text in texts),
        ]
    )


def decode_storage_info(data: bytes) -> StorageInfo:
    """Return the StorageInfo that ``data`` is."""
    reader = DatasetReader(data, "StorageInfo")
    fields: list[Any] = [*_STORAGE_INFO.unpack(reader.take(_STORAGE_INFO.size)), reader.string(), reader.string()]
    return StorageInfo(*fields)


def encode_storage_info(info: StorageInfo) -> bytes:
    """Return the bytes of a StorageInfo."""
    fixed = _STORAGE_INFO.pack(
        info.storage_type, info.filesystem_type, info.access, info.max_bytes, info.free_bytes, info.free_images
    )
    return fixed + encode_string(info.description) + encode_string(info.label)


def decode_object_info(data: bytes) -> ObjectInfo:
    """Return the ObjectInfo that ``data`` is."""
    reader = DatasetReader(data, "ObjectInfo")
    fields: list[Any] = [
        *_OBJECT_INFO.unpack(reader.take(_OBJECT_INFO.size)),
        reader.string(),
        reader.string(),
        reader.string(),
        reader.string(),
    ]
    return ObjectInfo(*fields)


def encode_object_info(info: ObjectInfo) -> bytes:
    """Return the bytes of an ObjectInfo."""
    fixed = _OBJECT_INFO.pack(
        info.storage_id,
        info.format_code,
        info.protection,
        info.size_bytes,
        info.thumb_format,
        info.thumb_bytes,
        info.thumb_width_px,
        info.thumb_height_px,
        info.image_width_px,
        info.image_height_px,
        info.image_depth_bits,
        info.parent,
        info.association_type,
        info.association_desc,
        info.sequence,
    )
    texts = (info.filename, info.capture_date, info.modification_date, info.keywords)
    return fixed + b"".join(encode_string(text) for text in texts)


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


def encode_device_prop_desc(desc: DevicePropDesc) -> bytes:
    """Return the bytes of a DevicePropDesc; `ValueError` where form and values do not belong together."""
    if (desc.form is FormFlag.RANGE) != (desc.value_range is not None):
        raise ValueError("a range form needs a range, and nothing else does")
    if desc.choices and desc.form is not FormFlag.ENUMERATION:
        raise ValueError("choices need an enumeration form")
    head = struct.pack("<HHB", desc.code, desc.data_type, desc.writable)
    values: list[Value] = [desc.default, desc.current]
    parts = [head, *(encode_value(value, desc.data_type) for value in values), bytes([desc.form])]
    if desc.form is FormFlag.ENUMERATION:
        parts.append(len(desc.choices).to_bytes(2, "little"))
    parts += [encode_value(value, desc.data_type) for value in desc.value_range or desc.choices]
    return b"".join(parts)

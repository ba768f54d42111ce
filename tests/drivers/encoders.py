"""Datasets of PTP as a camera would send them: the other way round from `drivers.ptp.datasets`, for tests alone."""

from __future__ import annotations

import struct
from datetime import datetime

from drivers.ptp.codes import DataType, FormFlag
from drivers.ptp.datasets import (
    DeviceInfo,
    DevicePropDesc,
    ObjectInfo,
    StorageInfo,
    Value,
    encode_array,
    encode_string,
    encode_value,
)


def encode_device_info(info: DeviceInfo) -> bytes:
    """Return the bytes of a DeviceInfo."""
    lists = (info.operations, info.events, info.properties, info.capture_formats, info.image_formats)
    texts = (info.manufacturer, info.model, info.device_version, info.serial)
    return b"".join(
        [
            struct.pack("<HIH", info.standard_version, info.vendor_extension_id, info.vendor_extension_version),
            encode_string(info.vendor_extension_desc),
            info.functional_mode.to_bytes(2, "little"),
            *(encode_array(codes, DataType.UINT16) for codes in lists),
            *(encode_string(text) for text in texts),
        ]
    )


def encode_storage_info(info: StorageInfo) -> bytes:
    """Return the bytes of a StorageInfo."""
    fixed = struct.pack(
        "<HHHQQI",
        info.storage_type,
        info.filesystem_type,
        info.access,
        info.max_bytes,
        info.free_bytes,
        info.free_images,
    )
    return fixed + encode_string(info.description) + encode_string(info.label)


def encode_object_info(info: ObjectInfo) -> bytes:
    """Return the bytes of an ObjectInfo."""
    fixed = struct.pack(
        "<IHHIHIIIIIIIHII",
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


def encode_date(date: datetime) -> str:
    """Return a date as ``YYYYMMDDThhmmss[+hhmm]``; whole seconds, as cameras want it."""
    return date.strftime("%Y%m%dT%H%M%S%z")[:20]

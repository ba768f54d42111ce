"""Little-endian bytes of PTP as the simulated cameras write and read them (ISO 15740).

Written apart from the drivers' own coding on purpose: a mistake there must not be repeated here.
"""

from __future__ import annotations

import struct
from collections.abc import Iterable
from dataclasses import dataclass
from datetime import datetime

from drivers.ptp.codes import HEADER_BYTES, ContainerType, DataType

Value = int | str | tuple[int, ...]
"""Value of a device property: an integer, a string, or an array of integers."""

_SIZES = {1: 1, 2: 1, 3: 2, 4: 2, 5: 4, 6: 4, 7: 8, 8: 8, 9: 16, 10: 16}
MAX_STRING_UNITS = 255


class BadBytesError(ValueError):
    """The host sent bytes that do not decode."""


@dataclass(frozen=True)
class WireContainer:
    """A container taken apart: its type, code, transaction id and payload."""

    type: int
    code: int
    transaction_id: int
    payload: bytes


def container(kind: int, code: int, transaction_id: int, payload: bytes = b"") -> bytes:
    """Return the bytes of a container."""
    return struct.pack("<IHHI", HEADER_BYTES + len(payload), kind, code, transaction_id) + payload


def parse_container(data: bytes) -> WireContainer:
    """Take one whole container apart; its length field must be the length of ``data``."""
    if len(data) < HEADER_BYTES:
        raise BadBytesError(f"container of {len(data)} bytes")
    length, kind, code, transaction_id = struct.unpack_from("<IHHI", data)
    if length != len(data):
        raise BadBytesError(f"container says {length} bytes and has {len(data)}")
    return WireContainer(kind, code, transaction_id, data[HEADER_BYTES:])


def event(code: int, transaction_id: int, params: Iterable[int] = ()) -> bytes:
    """Return the bytes of an event container."""
    return container(ContainerType.EVENT, code, transaction_id, u32s(params))


def u32s(values: Iterable[int]) -> bytes:
    """Return 32-bit values one after the other, without a count."""
    return b"".join(struct.pack("<I", v & 0xFFFFFFFF) for v in values)


def parse_params(payload: bytes) -> tuple[int, ...]:
    """Return the 32-bit parameters of a command."""
    if len(payload) % 4:
        raise BadBytesError(f"{len(payload)} bytes of parameters")
    return struct.unpack(f"<{len(payload) // 4}I", payload)


def string(text: str) -> bytes:
    """Return a PTP string: count of UTF-16 units with NUL, then UTF-16LE; the empty string is one zero byte."""
    if not text:
        return b"\0"
    encoded = (text + "\0").encode("utf-16-le")
    if len(encoded) // 2 > MAX_STRING_UNITS:
        raise ValueError(f"string of {len(encoded) // 2} units")
    return bytes([len(encoded) // 2]) + encoded


def parse_string(data: bytes) -> str:
    """Return the string that ``data`` is, all of it."""
    if not data or len(data) != 1 + 2 * data[0]:
        raise BadBytesError(f"string of {len(data)} bytes")
    if data[0] == 0:
        return ""
    try:
        text = data[1:].decode("utf-16-le")
    except UnicodeDecodeError as error:
        raise BadBytesError("string that is not UTF-16") from error
    if not text.endswith("\0"):
        raise BadBytesError("string without a closing NUL")
    return text[:-1]


def array(element_type: int, values: Iterable[int]) -> bytes:
    """Return a PTP array: u32 count, then the elements."""
    items = [typed(element_type, v) for v in values]
    return struct.pack("<I", len(items)) + b"".join(items)


def codes(values: Iterable[int]) -> bytes:
    """Return an array of 16-bit codes."""
    return array(DataType.UINT16, values)


def typed(data_type: int, value: Value) -> bytes:
    """Return a value of a property's datatype."""
    if data_type == DataType.STRING:
        assert isinstance(value, str)
        return string(value)
    if data_type & DataType.ARRAY:
        assert isinstance(value, tuple)
        return array(data_type & 0xFFF, value)
    assert isinstance(value, int)
    return value.to_bytes(_SIZES[data_type], "little", signed=bool(data_type & 1))


def parse_typed(data_type: int, data: bytes) -> Value:
    """Return the value of ``data_type`` that ``data`` is, all of it."""
    if data_type == DataType.STRING:
        return parse_string(data)
    if data_type & DataType.ARRAY:
        size = _SIZES[data_type & 0xFFF]
        if len(data) < 4 or len(data) != 4 + size * int.from_bytes(data[:4], "little"):
            raise BadBytesError(f"array of {len(data)} bytes")
        signed = bool(data_type & 1)
        return tuple(int.from_bytes(data[i : i + size], "little", signed=signed) for i in range(4, len(data), size))
    if len(data) != _SIZES[data_type]:
        raise BadBytesError(f"{len(data)} bytes for datatype {data_type:04x}")
    return int.from_bytes(data, "little", signed=bool(data_type & 1))


def date(moment: datetime) -> str:
    """Return a PTP date, without its zone where ``moment`` has none."""
    return moment.strftime("%Y%m%dT%H%M%S%z")

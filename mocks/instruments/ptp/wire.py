"""Little-endian bytes of PTP as the simulated cameras write and read them (ISO 15740).

Written apart from the drivers' own coding on purpose: a mistake there must not be repeated here.
"""

import struct
from collections.abc import Callable, Iterable
from dataclasses import dataclass, field, replace
from datetime import datetime
from typing import Self

from drivers.ptp.codes import HEADER_BYTES, ContainerType, DataType, Response
from mocks.instruments.faults import Fault

Value = int | str | tuple[int, ...]  # value of a device property: an integer, a string, or an array of integers

_SIZES = {1: 1, 2: 1, 3: 2, 4: 2, 5: 4, 6: 4, 7: 8, 8: 8, 9: 16, 10: 16}
MAX_STRING_UNITS = 255  # PIMA 15740: the length is one byte


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


@dataclass(frozen=True)
class DeviceIdentity:
    """Who the camera is, on the bus and in DeviceInfo."""

    usb_id: tuple[int, int]
    endpoints: tuple[int, int, int]
    interrupt_packet_bytes: int
    vendor_extension: tuple[int, int]
    operations: tuple[int, ...]
    events: tuple[int, ...]
    properties: tuple[int, ...]
    capture_formats: tuple[int, ...]
    image_formats: tuple[int, ...]
    manufacturer: str
    model: str
    version: str
    serial: str
    serial_on_usb: bool = True

    def device_info(self) -> bytes:
        """Return the DeviceInfo dataset."""
        extension_id, extension_version = self.vendor_extension
        head = struct.pack("<HIH", 100, extension_id, extension_version) + string("") + struct.pack("<H", 0)
        lists = (self.operations, self.events, self.properties, self.capture_formats, self.image_formats)
        texts = (self.manufacturer, self.model, self.version, self.serial)
        return head + b"".join(array(DataType.UINT16, codes) for codes in lists) + b"".join(map(string, texts))


@dataclass(frozen=True)
class Request:
    """A command with its data, if the host sent any."""

    operation: int
    transaction_id: int
    params: tuple[int, ...] = ()
    data: bytes = b""

    def param(self, index: int, default: int = 0) -> int:
        """Return a parameter, or ``default`` where the host left it out."""
        return self.params[index] if index < len(self.params) else default


@dataclass(frozen=True)
class Answer:
    """Response code and parameters, data to send before it, and the time the camera thinks first."""

    code: int = Response.OK
    params: tuple[int, ...] = ()
    data: bytes | None = None
    delay_s: float = 0.0


class Refusal(Exception):
    """Raised by an operation to answer with a code other than OK."""

    def __init__(self, code: int, *params: int) -> None:
        super().__init__(f"{code:04x}")
        self.code = code
        self.params = params


@dataclass(frozen=True)
class Rule:
    """How an operation is called: its parameters, whether the host sends data, whether it needs a session."""

    handler: Callable[[Request], Answer]
    least_params: int = 0
    most_params: int = 0
    data_out: bool = False
    sessionless: bool = False


@dataclass(frozen=True)
class PendingEvent:
    """An event waiting for the interrupt pipe; ``fault`` breaks the link while it is read."""

    code: int
    transaction_id: int
    params: tuple[int, ...]
    fault: Fault | None = None

    def encode(self) -> bytes:
        """Return the event container."""
        return container(ContainerType.EVENT, self.code, self.transaction_id, u32s(self.params))

    def elsewhere(self, offset: int) -> Self:
        """Return the event for another object or property."""
        return replace(self, params=(self.params[0] + offset, *self.params[1:])) if self.params else self

    def breaking(self, fault: Fault) -> Self:
        """Return the event with a fault of the link in it."""
        return replace(self, fault=fault)


@dataclass(frozen=True)
class OperationRecord:
    """One line of the operation log."""

    at_s: float
    operation: int
    transaction_id: int
    params: tuple[int, ...]
    code: int
    out_bytes: int
    in_bytes: int


@dataclass
class ResponderStats:
    """What the camera has seen, for tests."""

    operations: list[OperationRecord] = field(default_factory=list)
    violations: list[str] = field(default_factory=list)
    """Breaches of the protocol by the host, in words."""

    def count(self, operation: int, code: int | None = None) -> int:
        """Return how often an operation came (and was answered with ``code``)."""
        return sum(1 for r in self.operations if r.operation == operation and code in (None, r.code))

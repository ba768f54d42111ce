"""Containers, the envelopes of PTP over USB: pure coding, strict about every length.

A container is a 12-byte little-endian header (length, type, code, transaction id) and a payload; commands and
responses carry up to five 32-bit parameters, events up to three, data containers anything.
"""

from __future__ import annotations

import struct
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

from drivers.errors import ProtocolViolationError
from drivers.ptp.codes import HEADER_BYTES, MAX_PARAMETERS, UNKNOWN_LENGTH, ContainerType

MAX_EVENT_PARAMETERS = 3
_HEADER = struct.Struct("<IHHI")
_MAX_PAYLOAD_BYTES = {
    ContainerType.COMMAND: 4 * MAX_PARAMETERS,
    ContainerType.RESPONSE: 4 * MAX_PARAMETERS,
    ContainerType.EVENT: 4 * MAX_EVENT_PARAMETERS,
}
_SHOWN_BYTES = 64


def violation(message: str, data: bytes | bytearray = b"", **details: Any) -> ProtocolViolationError:
    """Return the error for bytes that PTP does not allow, with the first of them as hex."""
    if data:
        details["bytes_hex"] = bytes(data[:_SHOWN_BYTES]).hex(" ")
    return ProtocolViolationError(
        message,
        likely="an exchange was cut short, or the cable corrupts data",
        advice="resynchronise; if it comes back, try another cable or port",
        **details,
    )


@dataclass(frozen=True)
class Header:
    """The first 12 bytes. ``length_bytes`` includes them and is `UNKNOWN_LENGTH` where the sender does not say."""

    length_bytes: int
    type: ContainerType
    code: int
    transaction_id: int

    @property
    def unbounded(self) -> bool:
        """Whether the payload runs until a short packet."""
        return self.length_bytes == UNKNOWN_LENGTH

    @property
    def payload_bytes(self) -> int:
        """Size of the payload; meaningless where `unbounded`."""
        return self.length_bytes - HEADER_BYTES


@dataclass(frozen=True)
class Container:
    """One whole container."""

    type: ContainerType
    code: int
    transaction_id: int
    payload: bytes = b""

    @property
    def params(self) -> tuple[int, ...]:
        """The payload as 32-bit parameters (commands, responses, events)."""
        return unpack_params(self.payload)


def pack_params(params: Sequence[int]) -> bytes:
    """Return parameters as little-endian 32-bit words; `ValueError` for more than five or out of range."""
    if len(params) > MAX_PARAMETERS:
        raise ValueError(f"{len(params)} parameters; PTP has at most {MAX_PARAMETERS}")
    if not all(0 <= p <= 0xFFFFFFFF for p in params):
        raise ValueError(f"parameters must be unsigned 32-bit numbers: {tuple(params)}")
    return struct.pack(f"<{len(params)}I", *params)


def unpack_params(payload: bytes) -> tuple[int, ...]:
    """Return the 32-bit words of ``payload``; `ProtocolViolationError` unless it is 0 to 5 whole words."""
    count, rest = divmod(len(payload), 4)
    if rest or count > MAX_PARAMETERS:
        raise violation(f"{len(payload)} bytes are no 0 to {MAX_PARAMETERS} parameters", payload)
    return struct.unpack(f"<{count}I", payload)


def encode(container: Container) -> bytes:
    """Return the bytes of a container; `ValueError` where it is none that PTP allows."""
    limit = _MAX_PAYLOAD_BYTES.get(container.type, UNKNOWN_LENGTH - 1 - HEADER_BYTES)
    size = len(container.payload)
    if size > limit or (container.type is not ContainerType.DATA and size % 4):
        raise ValueError(f"a {container.type.name.lower()} container cannot carry {size} bytes")
    header = _HEADER.pack(HEADER_BYTES + size, container.type, container.code, container.transaction_id)
    return header + container.payload


def decode_header(data: bytes | bytearray) -> Header:
    """Return the checked header at the start of ``data``; `ProtocolViolationError` where it is none.

    Bytes after the header are not looked at. An unknown length is allowed for data containers only.
    """
    if len(data) < HEADER_BYTES:
        raise violation(f"{len(data)} bytes are too few for a container header", data)
    length, kind, code, transaction_id = _HEADER.unpack_from(data)
    try:
        container_type = ContainerType(kind)
    except ValueError:
        raise violation(f"container type {kind} does not exist", data) from None
    header = Header(length, container_type, code, transaction_id)
    if container_type is ContainerType.DATA:
        if length < HEADER_BYTES:
            raise violation(f"a data container of {length} bytes is shorter than its own header", data)
    elif not HEADER_BYTES <= length <= HEADER_BYTES + _MAX_PAYLOAD_BYTES[container_type] or length % 4:
        raise violation(f"a {container_type.name.lower()} container cannot be {length} bytes long", data)
    return header


def decode(data: bytes) -> Container:
    """Return the one container that ``data`` is, to the byte; `ProtocolViolationError` for anything else."""
    header = decode_header(data)
    if header.length_bytes not in (len(data), UNKNOWN_LENGTH):
        raise violation(f"a container announces {header.length_bytes} bytes and has {len(data)}", data)
    return Container(header.type, header.code, header.transaction_id, bytes(data[HEADER_BYTES:]))

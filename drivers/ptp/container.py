"""Containers, the envelopes of PTP over USB: pure coding, strict about every length.

A container is a 12-byte little-endian header (length, type, code, transaction id) and a payload; commands and
responses carry up to five 32-bit parameters, events up to three, data containers anything.
"""

import struct
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

from drivers.errors import ProtocolViolationError
from drivers.ptp.codes import HEADER_BYTES, MAX_PARAMETERS, UNKNOWN_LENGTH, ContainerType

MAX_EVENT_PARAMETERS = 3  # PIMA 15740: of an event
_HEADER = struct.Struct("<IHHI")
_MAX_PAYLOAD_BYTES = {
    ContainerType.COMMAND: 4 * MAX_PARAMETERS,
    ContainerType.RESPONSE: 4 * MAX_PARAMETERS,
    ContainerType.EVENT: 4 * MAX_EVENT_PARAMETERS,
}
_SHOWN_BYTES = 64  # chosen: what a reader of the message can use


def violation(message: str, data: bytes | bytearray = b"", **details: Any) -> ProtocolViolationError:
    """Return the error for bytes that PTP does not allow, with the first of them as hex."""
    if data:
        details["bytes_hex"] = bytes(data[:_SHOWN_BYTES]).hex(" ")
    likely = "an exchange was cut short, or the cable corrupts data"
    advice = "resynchronise; if it recurs, try another cable or port"
    return ProtocolViolationError(message, likely=likely, advice=advice, **details)


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
        raise ValueError(f"a container of type {container.type.name.lower()} cannot carry {size} bytes")
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
        raise violation(f"a container of type {container_type.name.lower()} cannot be {length} bytes long", data)
    return header


def decode(data: bytes) -> Container:
    """Return the one container that ``data`` is, to the byte; `ProtocolViolationError` for anything else."""
    header = decode_header(data)
    if header.length_bytes not in (len(data), UNKNOWN_LENGTH):
        raise violation(f"a container announces {header.length_bytes} bytes and has {len(data)}", data)
    return Container(header.type, header.code, header.transaction_id, bytes(data[HEADER_BYTES:]))


MAX_RESPONSE_BYTES = HEADER_BYTES + 4 * MAX_PARAMETERS
MAX_EVENT_BYTES = HEADER_BYTES + 4 * MAX_EVENT_PARAMETERS
# Chosen: cameras send one zero-length packet before or after a phase.
MAX_EMPTY_TRANSFERS = 8

Admission = Callable[[Header], int | None]
"""Given the header of a container; returns the largest payload to accept, or None to skip the container."""


class BulkAssembler:
    """Containers from bulk-in transfers.

    ``max_packet_bytes``: A transfer that is no multiple of it is the last of its phase; matters for data of unknown
      length, and shows when a camera stops before the length it announced.
    """

    def __init__(self, max_packet_bytes: int) -> None:
        self._max_packet_bytes = max_packet_bytes
        self._raw = bytearray()
        self._header: Header | None = None
        self._limit: int | None = 0
        self._payload = bytearray()
        self._passed_bytes = 0
        self._ended = False
        self._empty_in_a_row = 0

    @property
    def in_pieces(self) -> bool:
        """Whether a container has begun and not ended: whatever comes next belongs to it."""
        return self._header is not None or bool(self._raw)

    @property
    def wanted_bytes(self) -> int:
        """How many more bytes the current container needs; 0 where that is not known."""
        if self._header is None or self._header.unbounded:
            return 0
        return self._header.payload_bytes - self._passed_bytes

    def feed(self, transfer: bytes) -> None:
        """Take one bulk-in transfer; ``b""`` is a zero-length packet. `ProtocolViolationError` for one too many."""
        short = len(transfer) % self._max_packet_bytes != 0 or not transfer
        self._empty_in_a_row = 0 if transfer else self._empty_in_a_row + 1
        if self._empty_in_a_row > MAX_EMPTY_TRANSFERS:
            raise violation(f"more than {MAX_EMPTY_TRANSFERS} empty transfers in a row")
        self._refuse_response_inside_data(transfer)
        if self._header is not None and self._header.unbounded:
            self._ended = short
        else:
            # A header that arrives alone (split header) is short too, and ends nothing.
            self._ended = short and len(self._raw) + len(transfer) > HEADER_BYTES
        self._raw += transfer

    def _refuse_response_inside_data(self, transfer: bytes) -> None:
        """Notice a response where announced data is still missing, rather than wait for the rest in vain.

        A transfer that is, to the byte, a response with the id of the data is no part of a picture.
        """
        header = self._header
        if header is None or header.type is not ContainerType.DATA or self.wanted_bytes == 0:
            return
        if not HEADER_BYTES <= len(transfer) <= MAX_RESPONSE_BYTES:
            return
        try:
            found = decode(transfer)
        except ProtocolViolationError:
            return
        if found.type is ContainerType.RESPONSE and found.transaction_id == header.transaction_id:
            text = "data ended before its announced length"
            raise violation(text, transfer, announced_bytes=header.payload_bytes, received_bytes=self._passed_bytes)

    def take(self, admit: Admission) -> Container | None:
        """Return the next whole container, or None where more transfers are needed.

        ``admit`` is asked once a container, before anything is stored; a container it skips is passed over without
        being kept. `ProtocolViolationError` for bytes that are no container, or a payload over the admitted size.
        """
        while self._raw or self._header is not None:
            if self._header is None and not self._begin(admit):
                return None
            header, limit = self._header, self._limit
            if header is None or not self._move(header):
                return None
            container = Container(header.type, header.code, header.transaction_id, bytes(self._payload))
            self.reset(keep_rest=True)
            if limit is not None:
                return container
        return None

    def _begin(self, admit: Admission) -> bool:
        """Read a header where there is one; return whether there was."""
        if len(self._raw) < HEADER_BYTES:
            return False
        header = decode_header(self._raw)
        if header.type not in (ContainerType.DATA, ContainerType.RESPONSE):
            raise violation(f"a container of type {header.type.name.lower()} cannot come from bulk-in", self._raw)
        self._limit = admit(header)
        if self._limit is not None and not header.unbounded and header.payload_bytes > self._limit:
            text = f"{header.payload_bytes} bytes announced where at most {self._limit} are due"
            raise violation(text, self._raw, code=header.code)
        self._header = header
        del self._raw[:HEADER_BYTES]
        return True

    def _move(self, header: Header) -> bool:
        """Move raw bytes into the payload; return whether the container is whole."""
        room = len(self._raw) if header.unbounded else header.payload_bytes - self._passed_bytes
        piece = self._raw[:room]
        del self._raw[:room]
        self._passed_bytes += len(piece)
        if self._limit is not None:
            if self._passed_bytes > self._limit:
                raise violation(f"data of unknown length runs past {self._limit} bytes", code=header.code)
            self._payload += piece
        if header.unbounded:
            ended, self._ended = self._ended, False
            return ended
        return self._passed_bytes == header.payload_bytes

    def reset(self, *, keep_rest: bool = False) -> None:
        """Forget the container in pieces, and with it everything received unless ``keep_rest``."""
        self._header = None
        self._payload = bytearray()
        self._passed_bytes = 0
        self._ended = False
        if not keep_rest:
            self._raw.clear()
            self._empty_in_a_row = 0


class EventAssembler:
    """Event containers from interrupt transfers, which may be as small as eight bytes each."""

    def __init__(self) -> None:
        self._raw = bytearray()
        self.garbled = 0
        """How many stretches of bytes were thrown away because they were no event."""

    @property
    def in_pieces(self) -> bool:
        """Whether an event has begun and not ended."""
        return bool(self._raw)

    def feed(self, transfer: bytes) -> list[Container]:
        """Take one interrupt transfer; return the events that are whole now.

        Bytes that are no event are dropped and counted: an event is a hint, and the drivers can do without it.
        """
        if self._raw and _begins_event(transfer):
            self.reset(garbled=True)
        self._raw += transfer
        events: list[Container] = []
        while len(self._raw) >= 4:
            length = int.from_bytes(self._raw[:4], "little")
            if not HEADER_BYTES <= length <= MAX_EVENT_BYTES:
                self.reset(garbled=True)
                break
            if len(self._raw) < length:
                break
            try:
                found = decode(bytes(self._raw[:length]))
            except ProtocolViolationError:
                found = None
            if found is None or found.type is not ContainerType.EVENT:
                self.reset(garbled=True)
                break
            events.append(found)
            del self._raw[:length]
        return events

    def reset(self, *, garbled: bool = False) -> None:
        """Forget an event in pieces."""
        self._raw.clear()
        self.garbled += garbled


def _begins_event(transfer: bytes) -> bool:
    """Whether a transfer looks like the beginning of an event, so that an unfinished one before it was cut off."""
    if len(transfer) < 8:
        return False
    length = int.from_bytes(transfer[:4], "little")
    kind = int.from_bytes(transfer[4:6], "little")
    code = int.from_bytes(transfer[6:8], "little")
    in_range = HEADER_BYTES <= length <= MAX_EVENT_BYTES and length % 4 == 0
    return in_range and kind == ContainerType.EVENT and code >> 12 in (0x4, 0xC)

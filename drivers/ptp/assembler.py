"""Containers out of the pieces that USB delivers them in; no I/O, bounded memory.

Cameras differ in how they cut: header and payload in one transfer or in two, a response glued to the data before it,
a zero-length packet before or after, events in pieces of eight bytes. All of that gives the same containers here.
"""

from __future__ import annotations

from collections.abc import Callable

from drivers.errors import ProtocolViolationError
from drivers.ptp.codes import HEADER_BYTES, MAX_PARAMETERS, ContainerType
from drivers.ptp.container import MAX_EVENT_PARAMETERS, Container, Header, decode, decode_header, violation

MAX_RESPONSE_BYTES = HEADER_BYTES + 4 * MAX_PARAMETERS
MAX_EVENT_BYTES = HEADER_BYTES + 4 * MAX_EVENT_PARAMETERS
MAX_EMPTY_TRANSFERS = 8

Admission = Callable[[Header], int | None]
"""Told the header of a container; returns the largest payload to accept, or None to skip the container."""


class BulkAssembler:
    """Containers from bulk-in transfers.

    Parameters
    ----------
    max_packet_bytes
        A transfer that is no multiple of it is the last of its phase; matters for data of unknown length, and shows
        when a camera stops before the length it announced.
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
            raise violation(
                "data ended before its announced length",
                transfer,
                announced_bytes=header.payload_bytes,
                received_bytes=self._passed_bytes,
            )

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
            raise violation(f"a {header.type.name.lower()} container cannot come from bulk-in", self._raw)
        self._limit = admit(header)
        if self._limit is not None and not header.unbounded and header.payload_bytes > self._limit:
            raise violation(
                f"{header.payload_bytes} bytes announced where at most {self._limit} are due",
                self._raw,
                code=header.code,
            )
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

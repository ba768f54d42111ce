"""Containers over a transport: deadlines, halted endpoints, draining. Knows bytes and time, no transactions."""

from collections import deque
from typing import Literal, Protocol, get_args

from drivers.clock import Clock, Deadline
from drivers.errors import DeviceTimeoutError, LinkStallError
from drivers.ptp.codes import ContainerType
from drivers.ptp.container import Admission, BulkAssembler, Container, EventAssembler, encode

Pipe = Literal["in", "out", "event"]


class PtpTransport(Protocol):
    """Three endpoints and a control pipe of the USB still-image class.

    ``name``: what to call the instrument in messages.
    ``max_packet_bytes``: packet size of the bulk pipes; a transfer that is no multiple of it ends a data phase.
    """

    name: str
    max_packet_bytes: int

    def write(self, data: bytes, timeout_s: float) -> None:
        """Send all of ``data`` on bulk-out; ``b""`` sends a zero-length packet."""

    def read(self, max_bytes: int, timeout_s: float) -> bytes:
        """Return one bulk-in transfer of at most ``max_bytes`` (a multiple of the packet size); ``b""`` is a ZLP."""

    def read_event(self, timeout_s: float) -> bytes | None:
        """Return one interrupt transfer, or None where none came within ``timeout_s``."""

    def control_out(self, request: int, data: bytes, timeout_s: float) -> None:
        """Send a class request to the interface."""

    def control_in(self, request: int, length: int, timeout_s: float) -> bytes:
        """Return up to ``length`` bytes of a class request to the interface."""

    def clear_halt(self, pipe: Pipe) -> None:
        """Clear the halt of one endpoint, and its data toggle with it."""

    def reset(self) -> None:
        """Reset the USB port of the instrument; the link must be reopened afterwards."""

    def reopen(self) -> None:
        """Find and open the same instrument anew; one attempt."""

    def close(self) -> None:
        """Release the instrument; never raises."""


# A first read holds any response or event; long data go in pieces that a 25 MB/s link fills in 20 ms (chosen).
FIRST_READ_BYTES = 1024
MAX_READ_BYTES = 512 * 1024
MIN_CALL_S = 0.001  # shortest limit given to a link: libusb takes zero for "for ever"
DRAIN_QUIET_S = 0.05  # chosen: the line is quiet
# Bounds against a camera that never stops: chosen.
MAX_DRAIN_READS = 4096
MAX_WAITING_EVENTS = 256  # chosen: a bracket makes about 50; of more that nobody fetches, the oldest go
MAX_EVENT_PIECES = 8  # chosen: an event has 24 bytes


class BulkPipe:
    """The two bulk endpoints as one pipe of containers."""

    def __init__(self, transport: PtpTransport, clock: Clock) -> None:
        self._transport = transport
        self._clock = clock
        self._assembler = BulkAssembler(transport.max_packet_bytes)

    @property
    def in_pieces(self) -> bool:
        """Whether a container from the camera has begun and not ended."""
        return self._assembler.in_pieces

    def send(self, container: Container, deadline: Deadline) -> None:
        """Send a container; a data container that fills its last packet is followed by a zero-length packet.

        A halt met by a command is cleared and the command sent once more. A halt met by data is cleared and no more:
        the camera has refused the data, and its response says why.
        """
        data = encode(container)
        try:
            self._write(data, deadline)
        except LinkStallError:
            self._transport.clear_halt("out")
            if container.type is ContainerType.COMMAND:
                self._write(data, deadline)
            return
        if container.type is ContainerType.DATA and len(data) % self._transport.max_packet_bytes == 0:
            self._write(b"", deadline)

    def _write(self, data: bytes, deadline: Deadline) -> None:
        self._transport.write(data, max(deadline.remaining_s, MIN_CALL_S))

    def receive(self, admit: Admission, deadline: Deadline) -> Container:
        """Return the next container that ``admit`` does not skip.

        `DeviceTimeoutError` after the deadline, `LinkStallError` where the endpoint halts again after it was cleared,
        `ProtocolViolationError` for bytes that are no container.
        """
        while (container := self._assembler.take(admit)) is None:
            deadline.check("answer from the camera", self._transport.name)
            self._assembler.feed(self._read(deadline))
        return container

    def _read(self, deadline: Deadline) -> bytes:
        packet = self._transport.max_packet_bytes
        wanted = self._assembler.wanted_bytes or (MAX_READ_BYTES if self.in_pieces else FIRST_READ_BYTES)
        size = -(-min(wanted, MAX_READ_BYTES) // packet) * packet
        try:
            return self._transport.read(size, max(deadline.remaining_s, MIN_CALL_S))
        except LinkStallError:
            self._transport.clear_halt("in")
        return self._transport.read(size, max(deadline.remaining_s, MIN_CALL_S))

    def drain(self, limit_s: float) -> int:
        """Read and drop until the camera is quiet; return how many bytes went.

        `DeviceTimeoutError` where it still sends after ``limit_s``.
        """
        self._assembler.reset()
        deadline = Deadline.after(self._clock, limit_s)
        dropped_bytes = 0
        for _ in range(MAX_DRAIN_READS):
            if deadline.expired:
                break
            try:
                dropped_bytes += len(self._transport.read(MAX_READ_BYTES, DRAIN_QUIET_S))
            except DeviceTimeoutError:
                return dropped_bytes
            except LinkStallError:
                self._transport.clear_halt("in")
        text = f"the camera still sends after {dropped_bytes} bytes of an old answer were dropped"
        raise DeviceTimeoutError(text, where=self._transport.name, limit_s=limit_s)

    def forget(self) -> None:
        """Forget a container in pieces."""
        self._assembler.reset()

    def clear_halts(self) -> None:
        """Clear all endpoints, halted or not, and forget a container in pieces."""
        self._assembler.reset()
        for pipe in get_args(Pipe):
            self._transport.clear_halt(pipe)


class EventPipe:
    """The interrupt endpoint as a queue of whole events."""

    def __init__(self, transport: PtpTransport, clock: Clock) -> None:
        self._transport = transport
        self._clock = clock
        self._assembler = EventAssembler()
        self._waiting: deque[Container] = deque(maxlen=MAX_WAITING_EVENTS)

    def poll(self, timeout_s: float) -> Container | None:
        """Return the next event, or None where none came within ``timeout_s``."""
        deadline = Deadline.after(self._clock, timeout_s)
        for _ in range(MAX_EVENT_PIECES):
            if self._waiting:
                return self._waiting.popleft()
            piece = self._read(deadline)
            if piece is None:
                return None
            self._waiting.extend(self._assembler.feed(piece))
            if deadline.expired and not self._waiting:
                return None
        return self._waiting.popleft() if self._waiting else None

    def _read(self, deadline: Deadline) -> bytes | None:
        try:
            return self._transport.read_event(max(deadline.remaining_s, MIN_CALL_S))
        except LinkStallError:
            self._transport.clear_halt("event")
        return self._transport.read_event(max(deadline.remaining_s, MIN_CALL_S))

    def rescue(self, limit_s: float) -> None:
        """Take over what the camera has ready, before a reset throws it away; never raises for an ill pipe."""
        deadline = Deadline.after(self._clock, limit_s)
        for _ in range(MAX_WAITING_EVENTS):
            try:
                piece = self._transport.read_event(MIN_CALL_S)
            except (DeviceTimeoutError, LinkStallError):
                break
            if piece is None or deadline.expired:
                break
            self._waiting.extend(self._assembler.feed(piece))
        self._assembler.reset()

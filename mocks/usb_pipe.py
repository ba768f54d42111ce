"""The device's end of an IN endpoint: packets, short and zero-length ones, as a host's read sees them."""

from __future__ import annotations

import errno
from collections import deque
from dataclasses import dataclass

from mocks.faults import Fault
from mocks.usb_framing import InTransfer


class LinkError(Exception):
    """A transfer failed; ``errno`` as libusb's error becomes in pyusb."""

    def __init__(self, number: int, text: str) -> None:
        super().__init__(text)
        self.errno = number


class CutError(Exception):
    """The transfer reached the byte where a fault breaks the link."""

    def __init__(self, fault: Fault) -> None:
        super().__init__(str(fault.kind))
        self.fault = fault


@dataclass(frozen=True)
class Taken:
    """What one look at the pipe gave: bytes, and whether a short packet ended the transfer."""

    data: bytes
    ended: bool


class InPipe:
    """Transfers waiting for the host."""

    def __init__(self, packet_bytes: int) -> None:
        self.packet_bytes = packet_bytes
        self.queue: deque[InTransfer] = deque()

    def ready(self, now_s: float) -> bool:
        """Whether there is something to read at once."""
        return bool(self.queue) and self.queue[0].ready_s <= now_s

    def next_ready_s(self) -> float | None:
        """Return when the first waiting transfer may start."""
        return self.queue[0].ready_s if self.queue else None

    def take(self, room_bytes: int, most_bytes: int) -> Taken:
        """Take what fits into ``room_bytes`` of the first transfer, at most ``most_bytes`` (what time allows).

        Raises
        ------
        CutError
            A fault breaks the link here.
        LinkError
            EOVERFLOW: the last packet is larger than the room left, and is lost.
        """
        head = self.queue[0]
        if head.cut is not None and head.cut_fault is not None and head.position >= head.cut:
            fault, head.cut = head.cut_fault, None
            if head.left_bytes == 0 and len(head.data) % self.packet_bytes:
                self.queue.popleft()
            raise CutError(fault)
        if head.left_bytes == 0:
            self.queue.popleft()
            return Taken(b"", ended=True)
        count = min(head.left_bytes, room_bytes, most_bytes)
        if head.cut is not None:
            count = min(count, head.cut - head.position)
        elif head.left_bytes > room_bytes and room_bytes % self.packet_bytes:
            head.position += min(self.packet_bytes, head.left_bytes)
            raise LinkError(errno.EOVERFLOW, "Overflow")
        chunk = head.data[head.position : head.position + count]
        head.position += count
        return Taken(chunk, self._ended(head, room_left=room_bytes - count))

    def _ended(self, head: InTransfer, room_left: int) -> bool:
        if head.left_bytes or head.cut is not None:
            return not head.left_bytes and len(head.data) % self.packet_bytes != 0
        whole_packets = len(head.data) % self.packet_bytes == 0
        if whole_packets and head.zlp and room_left == 0:
            return False
        self.queue.popleft()
        return not whole_packets or head.zlp

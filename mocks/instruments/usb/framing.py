"""An answer as the USB transfers it becomes, and every way the link can spoil them."""

import errno
import random
import struct
from collections import deque
from collections.abc import Callable, Sequence
from dataclasses import dataclass

from drivers.ptp.codes import HEADER_BYTES, UNKNOWN_LENGTH, ContainerType
from mocks.instruments.faults import Fault, FaultKind, FaultRunner, Phase
from mocks.instruments.ptp import wire as ptp_wire
from mocks.instruments.ptp.wire import Answer, Request


@dataclass
class InTransfer:
    """Bytes for the host that end with a short packet (a zero-length one if need be and ``zlp``).

    ``cut`` breaks the link with ``cut_fault`` once so many bytes have passed.
    """

    phase: Phase
    data: bytes
    zlp: bool = True
    ready_s: float = 0.0
    cut: int | None = None
    cut_fault: Fault | None = None
    position: int = 0

    @property
    def left_bytes(self) -> int:
        """Bytes not yet read."""
        return len(self.data) - self.position


Edit = Callable[[list[InTransfer], int, Fault, random.Random], bool]
"""Spoils the transfers in place, from the first of the fault's phase (by number); whether there was anything to spoil.
"""


def frame_answer(
    request: Request, answer: Answer, faults: Sequence[Fault], runner: FaultRunner, dice: random.Random
) -> list[InTransfer]:
    """Return the transfers of an answer, spoiled by those of ``faults`` that are about framing."""
    transfers = []
    if answer.data is not None:
        data = ptp_wire.container(ContainerType.DATA, request.operation, request.transaction_id, answer.data)
        transfers.append(InTransfer(Phase.DATA, data))
    params = ptp_wire.u32s(answer.params)
    response = ptp_wire.container(ContainerType.RESPONSE, answer.code, request.transaction_id, params)
    transfers.append(InTransfer(Phase.RESPONSE, response))
    for fault in faults:
        edit, phase = _EDITS.get(fault.kind), _PHASES.get(fault.kind, fault.phase)
        index = next((i for i, t in enumerate(transfers) if t.phase is phase), None)
        if edit and index is not None and edit(transfers, index, fault, dice):
            runner.note(fault)
    for fault in faults:
        if fault.kind in (FaultKind.UNPLUG, FaultKind.STALL):
            _cut(transfers, fault)
    return transfers


def _patch(layout: str, offset: int, value: Callable[[int, Fault], int]) -> Edit:
    """Return an edit that changes one field of the header."""

    def edit(transfers: list[InTransfer], index: int, fault: Fault, _dice: random.Random) -> bool:
        data = bytearray(transfers[index].data)
        (old,) = struct.unpack_from(layout, data, offset)
        limit = 1 << (8 * struct.calcsize(layout))
        struct.pack_into(layout, data, offset, value(old, fault) % limit)
        transfers[index].data = bytes(data)
        return True

    return edit


def _shorten(transfers: list[InTransfer], index: int, fault: Fault, _dice: random.Random) -> bool:
    data = transfers[index].data
    transfers[index].data = data[: max(HEADER_BYTES, len(data) - int(fault.number("missing_bytes")))]
    return len(transfers[index].data) < len(data)


def _duplicate(transfers: list[InTransfer], _index: int, _fault: Fault, _dice: random.Random) -> bool:
    last = transfers[-1]
    transfers.append(InTransfer(last.phase, last.data))
    return True


def _swap(transfers: list[InTransfer], _index: int, _fault: Fault, _dice: random.Random) -> bool:
    if len(transfers) < 2:
        return False
    transfers.reverse()
    return True


def _drop_zlp(transfers: list[InTransfer], index: int, _fault: Fault, _dice: random.Random) -> bool:
    if len(transfers[index].data) % BULK_PACKET_BYTES:
        return False
    transfers[index].zlp = False
    return True


def _split(transfers: list[InTransfer], index: int, _fault: Fault, _dice: random.Random) -> bool:
    if len(transfers[index].data) <= HEADER_BYTES:
        return False
    whole = transfers[index]
    head = InTransfer(whole.phase, whole.data[:HEADER_BYTES])
    transfers[index : index + 1] = [head, InTransfer(whole.phase, whole.data[HEADER_BYTES:], zlp=whole.zlp)]
    return True


def _litter(transfers: list[InTransfer], index: int, fault: Fault, dice: random.Random) -> bool:
    transfers.insert(index, InTransfer(fault.phase, dice.randbytes(int(fault.number("count")))))
    return True


def _cut(transfers: list[InTransfer], fault: Fault) -> None:
    """Place the break at byte ``fault.byte`` of the phase, or after its last byte."""
    parts = [t for t in transfers if t.phase is fault.phase]
    before = 0
    for part in parts:
        if fault.byte < before + len(part.data) or part is parts[-1]:
            part.cut, part.cut_fault = min(fault.byte - before, len(part.data)), fault
            return
        before += len(part.data)


BULK_PACKET_BYTES = 512  # wMaxPacketSize of a high-speed bulk endpoint

_PHASES = {
    FaultKind.SHORT_DATA: Phase.DATA,
    FaultKind.MISSING_ZLP: Phase.DATA,
    FaultKind.DUPLICATE_RESPONSE: Phase.RESPONSE,
    FaultKind.RESPONSE_BEFORE_DATA: Phase.RESPONSE,
}
"""Of kinds that are about one phase, whichever phase the fault names."""
_EDITS: dict[FaultKind, Edit] = {
    FaultKind.SHORT_DATA: _shorten,
    FaultKind.OVERSIZE_LENGTH: _patch("<I", 0, lambda old, fault: old + int(fault.number("extra_bytes"))),
    FaultKind.UNKNOWN_LENGTH: _patch("<I", 0, lambda _old, _fault: UNKNOWN_LENGTH),
    FaultKind.WRONG_TYPE: _patch("<H", 4, lambda _old, fault: int(fault.number("type"))),
    FaultKind.WRONG_CODE: _patch("<H", 6, lambda _old, fault: int(fault.number("code"))),
    FaultKind.WRONG_TRANSACTION_ID: _patch("<I", 8, lambda old, fault: old + int(fault.number("offset"))),
    FaultKind.DUPLICATE_RESPONSE: _duplicate,
    FaultKind.RESPONSE_BEFORE_DATA: _swap,
    FaultKind.MISSING_ZLP: _drop_zlp,
    FaultKind.SPLIT_HEADER: _split,
    FaultKind.GARBAGE: _litter,
}


# The device's end of an IN endpoint: packets, short and zero-length ones, as a host's read sees them.


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

    def take(self, room_bytes: int, most_bytes: int) -> tuple[bytes, bool]:
        """Take what fits into ``room_bytes`` of the first transfer, at most ``most_bytes`` (what time allows).

        Returns the bytes, and whether a short packet ended the transfer.

        Raises `CutError`: A fault breaks the link here; `LinkError`: EOVERFLOW: the last packet is larger than the
        room left, and is lost.
        """
        head = self.queue[0]
        if head.cut is not None and head.cut_fault is not None and head.position >= head.cut:
            fault, head.cut = head.cut_fault, None
            if head.left_bytes == 0 and len(head.data) % self.packet_bytes:
                self.queue.popleft()
            raise CutError(fault)
        if head.left_bytes == 0:
            self.queue.popleft()
            return b"", True
        count = min(head.left_bytes, room_bytes, most_bytes)
        if head.cut is not None:
            count = min(count, head.cut - head.position)
        elif head.left_bytes > room_bytes and room_bytes % self.packet_bytes:
            head.position += min(self.packet_bytes, head.left_bytes)
            raise LinkError(errno.EOVERFLOW, "Overflow")
        chunk = head.data[head.position : head.position + count]
        head.position += count
        return chunk, self._ended(head, room_left=room_bytes - count)

    def _ended(self, head: InTransfer, room_left: int) -> bool:
        if head.left_bytes or head.cut is not None:
            return not head.left_bytes and len(head.data) % self.packet_bytes != 0
        whole_packets = len(head.data) % self.packet_bytes == 0
        if whole_packets and head.zlp and room_left == 0:
            return False
        self.queue.popleft()
        return not whole_packets or head.zlp

"""A byte-exact dialogue partner: what must be sent, in order, and what is answered; nothing may be left over.

::

    transport = ScriptedTransport([
        Step(OPEN_SESSION, [OK_0]),                                # a bulk write and the bulk reads that answer it
        Step(command(0x100E, 10, 0, 0), [response(0x2001, 10), OnEvent(event(0x4002, 10, 0x64))]),
        Step(ControlIn(0x67, 24), [bytes.fromhex("04000120")]),    # a control transfer
        Step(ClearHalt("in")),
    ])
    ...
    transport.assert_finished()

An exception among the answers is raised by the read that meets it. `Step.sent` may also be an exception with
`Step.raises`. Time is `FakeClock`: a read that finds nothing costs its whole limit, nothing else costs anything.
Bytes are built here with `struct`, not with the code under test.
"""

from __future__ import annotations

import struct
from collections import deque
from collections.abc import Sequence
from dataclasses import dataclass, field
from datetime import UTC, datetime, timedelta

from drivers.errors import DeviceTimeoutError
from drivers.ptp.pipes import Pipe


class FakeClock:
    """Time that passes only when somebody waits."""

    def __init__(self) -> None:
        self.now_s = 1000.0

    def monotonic_s(self) -> float:
        return self.now_s

    def utc_now(self) -> datetime:
        return datetime(2023, 5, 19, 15, 54, tzinfo=UTC) + timedelta(seconds=self.now_s)

    def sleep(self, duration_s: float) -> None:
        self.now_s += max(0.0, duration_s)


@dataclass(frozen=True)
class ControlOut:
    request: int
    data: bytes = b""


@dataclass(frozen=True)
class ControlIn:
    request: int
    length: int


@dataclass(frozen=True)
class ClearHalt:
    pipe: Pipe


@dataclass(frozen=True)
class Reset:
    pass


@dataclass(frozen=True)
class Reopen:
    pass


@dataclass(frozen=True)
class OnEvent:
    """An answer on the interrupt pipe."""

    packet: bytes | Exception


Sent = bytes | ControlOut | ControlIn | ClearHalt | Reset | Reopen
Answer = bytes | Exception | OnEvent


@dataclass(frozen=True)
class Step:
    """One thing that must be sent; its answers appear on the pipes; ``raises`` makes the sending itself fail."""

    sent: Sent
    answers: Sequence[Answer] = field(default=())
    raises: Exception | None = None


class ScriptedTransport:
    """A `PtpTransport` that follows a script to the byte."""

    def __init__(self, steps: Sequence[Step], *, clock: FakeClock | None = None, max_packet_bytes: int = 512) -> None:
        self.name = "scripted camera"
        self.max_packet_bytes = max_packet_bytes
        self.clock = clock or FakeClock()
        self.steps = deque(steps)
        self.bulk_in: deque[bytes | Exception] = deque()
        self.interrupt: deque[bytes | Exception] = deque()
        self.closed = False

    def _meet(self, sent: Sent) -> list[bytes]:
        """Check ``sent`` against the script, queue its answers, return the direct ones of a control transfer."""
        shown = sent.hex(" ") if isinstance(sent, bytes) else sent
        assert self.steps, f"nothing more was expected, but {shown} was sent"
        step = self.steps.popleft()
        expected = step.sent.hex(" ") if isinstance(step.sent, bytes) else step.sent
        assert expected == shown, f"expected {expected}, but {shown} was sent"
        direct: list[bytes] = []
        for answer in step.answers:
            if isinstance(answer, OnEvent):
                self.interrupt.append(answer.packet)
            elif isinstance(sent, ControlIn) and isinstance(answer, bytes) and not direct:
                direct.append(answer)
            else:
                self.bulk_in.append(answer)
        if step.raises is not None:
            raise step.raises
        return direct

    def write(self, data: bytes, timeout_s: float) -> None:
        assert timeout_s > 0
        self._meet(bytes(data))

    def read(self, max_bytes: int, timeout_s: float) -> bytes:
        assert timeout_s > 0
        assert max_bytes > 0
        assert max_bytes % self.max_packet_bytes == 0, "libusb overflows on reads that are no multiple of a packet"
        if not self.bulk_in:
            self.clock.sleep(timeout_s)
            raise DeviceTimeoutError("no bulk data", where=self.name)
        item = self.bulk_in.popleft()
        if isinstance(item, Exception):
            raise item
        if len(item) > max_bytes:
            self.bulk_in.appendleft(item[max_bytes:])
        return item[:max_bytes]

    def read_event(self, timeout_s: float) -> bytes | None:
        assert timeout_s > 0
        if not self.interrupt:
            self.clock.sleep(timeout_s)
            return None
        item = self.interrupt.popleft()
        if isinstance(item, Exception):
            raise item
        return item

    def control_out(self, request: int, data: bytes, timeout_s: float) -> None:
        assert timeout_s > 0
        self._meet(ControlOut(request, bytes(data)))

    def control_in(self, request: int, length: int, timeout_s: float) -> bytes:
        assert timeout_s > 0
        return self._meet(ControlIn(request, length))[0][:length]

    def clear_halt(self, pipe: Pipe) -> None:
        self._meet(ClearHalt(pipe))

    def reset(self) -> None:
        self._meet(Reset())

    def reopen(self) -> None:
        self._meet(Reopen())

    def close(self) -> None:
        self.closed = True

    def assert_finished(self) -> None:
        """Everything was sent that had to be, and everything answered was read."""
        left = [step.sent.hex(" ") if isinstance(step.sent, bytes) else step.sent for step in self.steps]
        assert not left, f"never sent: {left}"
        assert not self.bulk_in, f"never read: {list(self.bulk_in)}"
        assert not self.interrupt, f"events never read: {list(self.interrupt)}"


def container(kind: int, code: int, transaction_id: int, payload: bytes = b"", *, length: int | None = None) -> bytes:
    """A container by hand; ``length`` to lie about it."""
    size = 12 + len(payload) if length is None else length
    return struct.pack("<IHHI", size, kind, code, transaction_id) + payload


def command(code: int, transaction_id: int, *params: int) -> bytes:
    return container(1, code, transaction_id, struct.pack(f"<{len(params)}I", *params))


def data(code: int, transaction_id: int, payload: bytes) -> bytes:
    return container(2, code, transaction_id, payload)


def response(code: int, transaction_id: int, *params: int) -> bytes:
    return container(3, code, transaction_id, struct.pack(f"<{len(params)}I", *params))


def event(code: int, transaction_id: int, *params: int) -> bytes:
    return container(4, code, transaction_id, struct.pack(f"<{len(params)}I", *params))

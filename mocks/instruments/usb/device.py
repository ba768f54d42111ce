"""A PTP responder behind the three endpoints of the USB still-image class, with halts, cancels, resets and faults."""

import errno
import struct
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import NoReturn

from drivers.ptp.codes import HEADER_BYTES, ClassRequest, ContainerType, Event, Response
from mocks.instruments.faults import Fault, FaultKind, Moment, Phase
from mocks.instruments.ptp import wire as ptp_wire
from mocks.instruments.ptp.responder import PtpResponder
from mocks.instruments.ptp.wire import Request
from mocks.instruments.usb.framing import BULK_PACKET_BYTES, CutError, InPipe, InTransfer, LinkError, frame_answer

# Chosen: nothing that a driver sends comes near.
MAX_DATA_OUT_BYTES = 1 << 20
ENDLESS_S = 3600.0  # stands for a host that waits for ever
WAIT_SLICE_S = 0.25  # chosen
SHORTEST_WAIT_S = 1e-6  # shorter waits would not move a clock that has run for days
HOST_TO_CLASS, CLASS_TO_HOST = 0x21, 0xA1


def _gone() -> LinkError:
    return LinkError(errno.ENODEV, "No such device (it may have been disconnected)")


@dataclass
class _Incoming:
    """A container on its way in: a command, or the data of ``request``."""

    buffer: bytearray
    request: Request | None = None
    faults: tuple[Fault, ...] = ()


class UsbPtpDevice:
    """The device side of the bus. Every call may come from any thread; waiting is done without a lock."""

    def __init__(self, camera: PtpResponder) -> None:
        self.camera = camera
        self.clock = camera.clock
        self._attachment = camera.attachment
        self._free_s = 0.0
        self._late: list[InTransfer] = []
        self._clear()

    def _clear(self) -> None:
        self._in = InPipe(BULK_PACKET_BYTES)
        self._event = InPipe(self.camera.identity.interrupt_packet_bytes)
        self._incoming = _Incoming(bytearray())
        self.halted: set[int] = set()
        self._late.clear()
        self._hung = False
        self._cancelled_until_s = 0.0

    # ---- what the bus calls

    def write(self, data: bytes, timeout_s: float) -> int:
        """Take a bulk OUT transfer; a zero-length one is ``b""``."""
        out = self.camera.identity.endpoints[1]
        with self.camera.lock:
            self._check_present(out)
            try:
                self._take_in(data)
            except CutError as cut:
                self._break(cut.fault, out)
        self._pass_time(len(data), self.clock.monotonic_s() + (timeout_s or ENDLESS_S))
        return len(data)

    def read(self, endpoint: int, size_bytes: int, timeout_s: float) -> bytes:
        """Give a bulk or interrupt IN transfer of at most ``size_bytes``; what came before a time-out is given."""
        pipe = self._event if endpoint == self.camera.identity.endpoints[2] else self._in
        deadline_s = self.clock.monotonic_s() + (timeout_s or ENDLESS_S)
        attachment = self.camera.attachment
        got = bytearray()
        while True:
            with self.camera.lock:
                if self.camera.attachment != attachment:
                    raise _gone()
                self._check_present(endpoint)
                step = self._step(pipe, endpoint, size_bytes - len(got), deadline_s)
            if isinstance(step, float):
                if step < SHORTEST_WAIT_S:
                    break
                self.clock.sleep(step)
                continue
            chunk, ended = step
            got += chunk
            self._pass_time(len(chunk), deadline_s)
            if ended or len(got) == size_bytes:
                return bytes(got)
        if got:
            return bytes(got)
        raise LinkError(errno.ETIMEDOUT, "Operation timed out")

    def control_out(self, request: int, data: bytes) -> int:
        """Take a class request with data."""
        with self.camera.lock:
            self._check_present(None)
            if request == ClassRequest.CANCEL:
                if len(data) != 6 or int.from_bytes(data[:2], "little") != Event.CANCEL_TRANSACTION:
                    self.camera.stats.violations.append(f"cancel request with {data.hex()}")
                    raise LinkError(errno.EPIPE, "Pipe error")
                self._in.queue.clear()
                self._late.clear()
                self._incoming = _Incoming(bytearray())
                self._cancelled_until_s = self.clock.monotonic_s() + self.camera.timing.cancel_s
                self.camera.excuse_transaction_id()
            elif request == ClassRequest.DEVICE_RESET and not data:
                self._clear()
                self.camera.link_reset()
            else:
                raise LinkError(errno.EPIPE, "Pipe error")
        return len(data)

    def control_in(self, request: int) -> bytes:
        """Give the answer of a class request."""
        with self.camera.lock:
            self._check_present(None)
            if request != ClassRequest.GET_DEVICE_STATUS:
                raise LinkError(errno.EPIPE, "Pipe error")
            code = Response.DEVICE_BUSY if self.clock.monotonic_s() < self._cancelled_until_s else Response.OK
            halted = ptp_wire.u32s(sorted(self.halted))
            return struct.pack("<HH", 4 + len(halted), code) + halted

    def clear_halt(self, endpoint: int) -> None:
        """Take the halt off an endpoint."""
        with self.camera.lock:
            self._check_present(None)
            self.halted.discard(endpoint)

    def reset(self) -> None:
        """Take a USB port reset: everything in flight and the session are gone."""
        with self.camera.lock:
            self._check_present(None)
            self._clear()
            self.camera.link_reset()

    def catch_up(self) -> None:
        """Notice that the cable was pulled since the last look."""
        with self.camera.lock:
            self.camera.advance()
            if self._attachment != self.camera.attachment:
                self._attachment = self.camera.attachment
                self._clear()

    # ---- inside, under the camera's lock

    def _check_present(self, endpoint: int | None) -> None:
        self.catch_up()
        if not self.camera.plugged:
            raise _gone()
        if endpoint in self.halted:
            raise LinkError(errno.EPIPE, "Pipe error")

    def _step(self, pipe: InPipe, endpoint: int, room_bytes: int, deadline_s: float) -> float | tuple[bytes, bool]:
        """Return bytes and whether they end the transfer, or the time to wait (0: no time left)."""
        if pipe is self._event:
            while self.camera.events:
                event = self.camera.events.popleft()
                data = event.encode()
                cut = min(event.fault.byte, len(data)) if event.fault else None
                self._event.queue.append(InTransfer(Phase.EVENT, data, zlp=False, cut=cut, cut_fault=event.fault))
        now_s = self.clock.monotonic_s()
        left_s = deadline_s - now_s
        if not pipe.ready(now_s):
            due = [t for t in (self.camera.agenda.next_due_s(), pipe.next_ready_s()) if t is not None]
            return min(left_s, WAIT_SLICE_S, *(max(SHORTEST_WAIT_S, t - now_s) for t in due))
        affordable = int(max(0.0, left_s) * self._rate()) // pipe.packet_bytes * pipe.packet_bytes
        if affordable < min(room_bytes, pipe.packet_bytes):
            return left_s
        try:
            return pipe.take(room_bytes, affordable)
        except CutError as cut:
            self._break(cut.fault, endpoint)

    def _break(self, fault: Fault, endpoint: int) -> NoReturn:
        self.camera.faults.note(fault)
        if fault.kind is FaultKind.UNPLUG:
            self.camera.unplug(fault.number("replug_after_s"))
            self.catch_up()
            raise _gone()
        self.halted.add(endpoint)
        self.camera.excuse_transaction_id()
        if fault.word("afterwards") == "drop":
            self._in.queue.clear()
        raise LinkError(errno.EPIPE, "Pipe error")

    def _rate(self) -> float:
        slow = self.camera.faults.condition(FaultKind.SLOW_TRANSFER)
        return self.camera.timing.transfer_bytes_per_s / (slow.number("factor") if slow else 1.0)

    def _pass_time(self, count_bytes: int, deadline_s: float) -> None:
        """Let the bytes take their time on the wire, which carries one transfer after the other."""
        now_s = self.clock.monotonic_s()
        self._free_s = max(now_s, self._free_s) + count_bytes / self._rate()
        self.clock.sleep(min(self._free_s, deadline_s) - now_s)

    # ---- OUT

    def _take_in(self, data: bytes) -> None:
        """Collect a container; it is whole at its length, plus a zero-length packet if that is whole packets."""
        incoming = self._incoming
        incoming.buffer += data
        size = len(incoming.buffer)
        if incoming.request is None and size == 0:
            return
        length = int.from_bytes(incoming.buffer[:4], "little") if size >= HEADER_BYTES else HEADER_BYTES
        cut = self._cut_of_incoming(min(size, length))
        if cut:
            self._incoming = _Incoming(bytearray())
            raise CutError(cut)
        short_packet = len(data) % BULK_PACKET_BYTES != 0 or not data
        if size < length and not (short_packet and incoming.request is None) and size <= MAX_DATA_OUT_BYTES:
            return
        if size == length and size % BULK_PACKET_BYTES == 0 and data:
            return
        self._incoming = _Incoming(bytearray())
        try:
            self._take_container(ptp_wire.parse_container(bytes(incoming.buffer)), incoming)
        except ptp_wire.BadBytesError as error:
            self.camera.stats.violations.append(str(error))
            self.halted.update(self.camera.identity.endpoints[:2])

    def _cut_of_incoming(self, size_bytes: int) -> Fault | None:
        """Return the fault that breaks the data phase at or before ``size_bytes``."""
        for fault in self._incoming.faults:
            if fault.phase is Phase.DATA and fault.kind in (FaultKind.UNPLUG, FaultKind.STALL):
                whole = int.from_bytes(self._incoming.buffer[:4], "little")
                if size_bytes >= min(fault.byte, whole):
                    return fault
        return None

    def _take_container(self, container: ptp_wire.WireContainer, incoming: _Incoming) -> None:
        request = incoming.request
        if request is not None:
            expected = (ContainerType.DATA, request.operation, request.transaction_id)
            if (container.type, container.code, container.transaction_id) != expected:
                raise ptp_wire.BadBytesError(f"data phase of {request.operation:04x} expected, {container} came")
            self._execute(replace(request, data=container.payload), incoming.faults)
            return
        if container.type != ContainerType.COMMAND:
            raise ptp_wire.BadBytesError(f"command expected, type {container.type} came")
        request = Request(container.code, container.transaction_id, ptp_wire.parse_params(container.payload))
        faults = self.camera.faults.at(Moment.OPERATION, request.operation)
        broken = next(
            (f for f in faults if f.phase is Phase.COMMAND and f.kind in (FaultKind.UNPLUG, FaultKind.STALL)), None
        )
        if broken and broken.byte < HEADER_BYTES + len(container.payload):
            raise CutError(broken)
        if self.camera.expects_data(request.operation):
            self._incoming = _Incoming(bytearray(), request, faults)
        else:
            self._execute(request, faults)
        if broken:
            raise CutError(broken)

    def _execute(self, request: Request, faults: Sequence[Fault]) -> None:
        if self._hung:
            return
        kinds = {f.kind: f for f in faults}
        answer = self.camera.handle(request, faults)
        in_faults = [f for f in faults if not (self.camera.expects_data(request.operation) and f.phase is Phase.DATA)]
        transfers = frame_answer(request, answer, in_faults, self.camera.faults, self.camera.random)
        silent = kinds.get(FaultKind.NO_ANSWER)
        if silent:
            self.camera.faults.note(silent)
            self._hung = silent.word("until") == "reset"
            return
        ready_s = self.clock.monotonic_s() + self.camera.timing.transaction_latency_s + answer.delay_s
        for transfer in transfers:
            transfer.ready_s = ready_s
        late = kinds.get(FaultKind.LATE_ANSWER)
        if late:
            self.camera.faults.note(late)
            self._late += transfers
            return
        self._in.queue.extend(self._late)
        self._late.clear()
        self._in.queue.extend(transfers)

"""A simulated camera behind PTP/IP (CIPA DC-005) on the loopback interface: the same responder, another cable.

Made so that independent initiators, which know nothing of pyusb, can talk to our cameras. A client opens two TCP
connections to the same port, for commands and for events.
"""

from __future__ import annotations

import itertools
import socket
import struct
import threading
from enum import IntEnum
from types import TracebackType
from typing import Self

from drivers.ptp.codes import Response
from mocks.instruments.faults import Moment
from mocks.instruments.ptp.responder import PtpResponder
from mocks.instruments.ptp.wire import Answer, BadBytesError, PendingEvent, Request, parse_params, u32s

LOOPBACK = "127.0.0.1"
HEADER = struct.Struct("<II")
VERSION = 0x00010000
GUID = bytes(range(16))
MAX_PACKET_BYTES = 16 * 1024 * 1024
EVENT_POLL_S = 0.01
FAIL_BUSY = 2


class Packet(IntEnum):
    """Packet types."""

    INIT_COMMAND_REQUEST = 1
    INIT_COMMAND_ACK = 2
    INIT_EVENT_REQUEST = 3
    INIT_EVENT_ACK = 4
    INIT_FAIL = 5
    OPERATION_REQUEST = 6
    OPERATION_RESPONSE = 7
    EVENT = 8
    START_DATA = 9
    DATA = 10
    CANCEL = 11
    END_DATA = 12
    PROBE_REQUEST = 13
    PROBE_RESPONSE = 14


class ConnectionOver(Exception):
    """The client hung up."""


class PacketStream:
    """Whole packets over one TCP connection."""

    def __init__(self, connection: socket.socket) -> None:
        self._connection = connection

    def send(self, kind: Packet, body: bytes = b"") -> None:
        """Send one packet."""
        try:
            self._connection.sendall(HEADER.pack(HEADER.size + len(body), kind) + body)
        except OSError as error:
            raise ConnectionOver from error

    def receive(self) -> tuple[int, bytes]:
        """Return (type, body) of the next packet; `BadBytesError` where its length cannot be right."""
        length, kind = HEADER.unpack(self._exactly(HEADER.size))
        if not HEADER.size <= length <= MAX_PACKET_BYTES:
            raise BadBytesError(f"PTP/IP packet of {length} bytes")
        return kind, self._exactly(length - HEADER.size)

    def _exactly(self, size: int) -> bytes:
        data = bytearray()
        while len(data) < size:
            try:
                piece = self._connection.recv(min(65536, size - len(data)))
            except OSError as error:
                raise ConnectionOver from error
            if not piece:
                raise ConnectionOver
            data += piece
        return bytes(data)


class PtpIpServer:
    """Serves one camera to one client at a time; use as a context manager.

    The responder's clock must run by itself (not a `VirtualClock`), because two threads wait on it.
    """

    def __init__(self, responder: PtpResponder, port: int = 0) -> None:
        self._responder = responder
        self._listener = socket.create_server((LOOPBACK, port))
        self.port = int(self._listener.getsockname()[1])
        self._connections: list[socket.socket] = []
        self._closing = threading.Event()
        self._numbers = itertools.count(1)
        self._client = 0
        self._threads = [threading.Thread(target=self._accept, name="ptp-ip", daemon=True)]

    def __enter__(self) -> Self:
        self._threads[0].start()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._closing.set()
        hang_up(self._listener)
        for connection in list(self._connections):
            hang_up(connection)
        for thread in list(self._threads):
            thread.join(timeout=5.0)

    def _accept(self) -> None:
        while not self._closing.is_set():
            try:
                connection, _ = self._listener.accept()
            except OSError:
                return
            # Small packets follow each other: waiting for acknowledgements would cost 40 ms a transaction.
            connection.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
            self._connections.append(connection)
            thread = threading.Thread(target=self._serve, args=(connection,), name="ptp-ip-client", daemon=True)
            self._threads.append(thread)
            thread.start()

    def _serve(self, connection: socket.socket) -> None:
        stream = PacketStream(connection)
        try:
            kind, body = stream.receive()
            if kind == Packet.INIT_COMMAND_REQUEST:
                number = next(self._numbers)
                # Under the lock: a client that just leaves must not take the new one's place away.
                with self._responder.lock:
                    self._client = number
                name = (self._responder.identity.model + "\0").encode("utf-16-le")
                stream.send(Packet.INIT_COMMAND_ACK, u32s([number]) + GUID + name + u32s([VERSION]))
                self._serve_commands(stream, number)
            elif kind == Packet.INIT_EVENT_REQUEST and body == u32s([client := self._client]):
                stream.send(Packet.INIT_EVENT_ACK)
                self._serve_events(stream, client)  # not of a client that has come meanwhile
            else:
                stream.send(Packet.INIT_FAIL, u32s([FAIL_BUSY]))
        except ConnectionOver:
            pass
        except BadBytesError as error:
            self._responder.stats.violations.append(str(error))
        finally:
            hang_up(connection)

    def _serve_commands(self, stream: PacketStream, client: int) -> None:
        try:
            while not self._closing.is_set() and self._responder.plugged:
                kind, body = stream.receive()
                if kind == Packet.OPERATION_REQUEST:
                    self._transact(stream, body)
                elif kind == Packet.PROBE_REQUEST:
                    stream.send(Packet.PROBE_RESPONSE)
                elif kind != Packet.CANCEL:
                    raise BadBytesError(f"PTP/IP packet type {kind} where a request belongs")
        finally:
            with self._responder.lock:
                if self._client == client:
                    self._responder.forget_session()
                    self._client = 0

    def _transact(self, stream: PacketStream, body: bytes) -> None:
        if len(body) < 10:
            raise BadBytesError(f"operation request of {len(body)} bytes")
        data_phase, operation, transaction_id = struct.unpack_from("<IHI", body)
        data = self._receive_data(stream, transaction_id) if data_phase == 2 else b""
        request = Request(operation, transaction_id, parse_params(body[10:]), data)
        with self._responder.lock:
            due = self._responder.faults.at(Moment.OPERATION, operation)
            answer = self._responder.handle(request, due)
        self._responder.clock.sleep(answer.delay_s + self._responder.timing.transaction_latency_s)
        self._send_answer(stream, answer, transaction_id)

    @staticmethod
    def _receive_data(stream: PacketStream, transaction_id: int) -> bytes:
        kind, body = stream.receive()
        if kind != Packet.START_DATA or len(body) != 12:
            raise BadBytesError(f"PTP/IP packet type {kind} where data begins")
        got_id, total = struct.unpack("<IQ", body)
        data = bytearray()
        while kind != Packet.END_DATA:
            kind, body = stream.receive()
            if kind not in (Packet.DATA, Packet.END_DATA) or body[:4] != u32s([transaction_id]):
                raise BadBytesError(f"PTP/IP packet type {kind} within data")
            data += body[4:]
        if got_id != transaction_id or len(data) != total:
            raise BadBytesError(f"{len(data)} bytes of data where {total} were announced")
        return bytes(data)

    def _send_answer(self, stream: PacketStream, answer: Answer, transaction_id: int) -> None:
        if answer.data is not None and answer.code == Response.OK:
            self._responder.clock.sleep(len(answer.data) / self._responder.timing.transfer_bytes_per_s)
            stream.send(Packet.START_DATA, struct.pack("<IQ", transaction_id, len(answer.data)))
            stream.send(Packet.END_DATA, u32s([transaction_id]) + answer.data)
        body = struct.pack("<HI", answer.code, transaction_id) + u32s(answer.params)
        stream.send(Packet.OPERATION_RESPONSE, body)

    def _serve_events(self, stream: PacketStream, client: int) -> None:
        """Send events for as long as the command connection of the same client lives."""
        while not self._closing.wait(EVENT_POLL_S) and self._client == client:
            event = self._next_event(client)
            while event is not None:
                body = struct.pack("<HI", event.code, event.transaction_id) + u32s(event.params)
                stream.send(Packet.EVENT, body)
                event = self._next_event(client)

    def _next_event(self, client: int) -> PendingEvent | None:
        with self._responder.lock:
            self._responder.advance()
            waiting = self._responder.events if self._client == client else None
            return waiting.popleft() if waiting else None


def hang_up(connection: socket.socket) -> None:
    """Shut a socket down so that a thread waiting in it wakes up, and close it."""
    try:
        connection.shutdown(socket.SHUT_RDWR)
    except OSError:
        pass
    connection.close()

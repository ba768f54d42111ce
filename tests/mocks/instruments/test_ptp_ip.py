"""PTP/IP: packets as CIPA DC-005 lays them out, spoken by a client written here from the table."""

from __future__ import annotations

import socket
import struct
from collections.abc import Iterator

import pytest

from drivers.clock import SystemClock
from drivers.ptp.codes import Event, Operation, Response
from mocks.instruments.faults import Fault, FaultKind
from tests.mocks.instruments.echo import GIVE, KEEP, Echo
from tests.peers.ptp_ip import LOOPBACK, PtpIpServer


class Client:
    """Two connections to a server, packets by hand."""

    def __init__(self, port: int) -> None:
        self.command = socket.create_connection((LOOPBACK, port), timeout=60)
        self.send(self.command, 1, bytes(16) + "me\0".encode("utf-16-le") + struct.pack("<I", 0x10000))
        kind, body = self.receive(self.command)
        assert kind == 2
        assert body[20:-4].decode("utf-16-le") == "Echo\0"
        self.event = socket.create_connection((LOOPBACK, port), timeout=60)
        self.send(self.event, 3, body[:4])
        assert self.receive(self.event) == (4, b"")

    @staticmethod
    def send(connection: socket.socket, kind: int, body: bytes = b"") -> None:
        connection.sendall(struct.pack("<II", 8 + len(body), kind) + body)

    @classmethod
    def receive(cls, connection: socket.socket) -> tuple[int, bytes]:
        length, kind = struct.unpack("<II", cls.exactly(connection, 8))
        return kind, cls.exactly(connection, length - 8)

    @staticmethod
    def exactly(connection: socket.socket, size: int) -> bytes:
        data = b""
        while len(data) < size:
            piece = connection.recv(size - len(data))
            assert piece, "the server hung up"
            data += piece
        return data

    def request(self, operation: int, transaction_id: int, *params: int, phase: int = 1) -> None:
        body = struct.pack(f"<IHI{len(params)}I", phase, operation, transaction_id, *params)
        self.send(self.command, 6, body)

    def answer(self) -> tuple[int, int, bytes]:
        """Return response code, transaction id, parameter bytes."""
        kind, body = self.receive(self.command)
        assert kind == 7
        return (*struct.unpack_from("<HI", body), body[6:])

    def close(self) -> None:
        self.command.close()
        self.event.close()


@pytest.fixture
def camera() -> Echo:
    return Echo(SystemClock(), Fault(FaultKind.BUSY, GIVE, nth=3))


@pytest.fixture
def client(camera: Echo) -> Iterator[Client]:
    with PtpIpServer(camera) as server:
        client = Client(server.port)
        yield client
        client.close()


def test_session_and_refusals(client: Client, camera: Echo) -> None:
    client.request(GIVE, 0)
    assert client.answer()[0] == Response.SESSION_NOT_OPEN
    client.request(Operation.OPEN_SESSION, 0, 1)
    assert client.answer() == (Response.OK, 0, b"")
    client.request(0x9F00, 1)
    assert client.answer()[0] == Response.OPERATION_NOT_SUPPORTED
    client.request(Operation.CLOSE_SESSION, 2)
    assert client.answer()[0] == Response.OK
    assert camera.stats.violations == []


def test_data_goes_out_in_pieces_and_comes_back(client: Client, camera: Echo) -> None:
    data = bytes(range(256)) * 500
    client.request(Operation.OPEN_SESSION, 0, 1)
    client.answer()
    client.request(KEEP, 1, phase=2)
    client.send(client.command, 9, struct.pack("<IQ", 1, len(data)))
    client.send(client.command, 10, struct.pack("<I", 1) + data[:70_000])
    client.send(client.command, 12, struct.pack("<I", 1) + data[70_000:])
    assert client.answer() == (Response.OK, 1, struct.pack("<I", len(data)))
    assert camera.kept == data
    client.request(GIVE, 2)
    assert client.receive(client.command) == (9, struct.pack("<IQ", 2, len(data)))
    assert client.receive(client.command) == (12, struct.pack("<I", 2) + data)
    assert client.answer() == (Response.OK, 2, b"")


def test_events_come_on_their_own_connection(client: Client, camera: Echo) -> None:
    client.request(Operation.OPEN_SESSION, 0, 1)
    client.answer()
    with camera.lock:
        camera.emit(Event.OBJECT_ADDED, 0x64, transaction_id=10)
    assert client.receive(client.event) == (8, struct.pack("<HII", 0x4002, 10, 0x64))


def test_probe_is_answered(client: Client) -> None:
    client.send(client.command, 13)
    assert client.receive(client.command) == (14, b"")


def test_faults_of_the_responder_hold_over_tcp_too(client: Client, camera: Echo) -> None:
    client.request(Operation.OPEN_SESSION, 0, 1)
    client.answer()
    codes = []
    for transaction_id in (1, 2, 3, 4):
        client.request(GIVE, transaction_id)
        if transaction_id != 3:
            client.receive(client.command)
            client.receive(client.command)
        codes.append(client.answer()[0])
    assert codes == [Response.OK, Response.OK, Response.DEVICE_BUSY, Response.OK]
    assert [f.kind for f in camera.faults.fired] == [FaultKind.BUSY]


@pytest.mark.parametrize(
    ("kind", "body"),
    [(6, b"short"), (99, b""), (6, struct.pack("<IHI", 2, KEEP, 0)), (6, struct.pack("<IHIB", 1, 0x1001, 0, 1))],
)
def test_nonsense_ends_the_connection_and_is_noted(client: Client, camera: Echo, kind: int, body: bytes) -> None:
    client.send(client.command, kind, body)
    if kind == 6 and len(body) == 10:
        client.send(client.command, 12, b"")
    assert client.command.recv(1) == b""
    assert len(camera.stats.violations) == 1


def test_a_length_that_cannot_be_is_not_waited_for(client: Client, camera: Echo) -> None:
    client.command.sendall(struct.pack("<II", 0xFFFFFFF0, 6))
    assert client.command.recv(1) == b""
    assert "4294967280" in camera.stats.violations[0]


def test_session_ends_with_its_connection(camera: Echo) -> None:
    with PtpIpServer(camera) as server:
        for _ in range(2):
            client = Client(server.port)
            client.request(Operation.OPEN_SESSION, 0, 1)
            assert client.answer()[0] == Response.OK
            client.request(Operation.GET_DEVICE_INFO, 1)
            client.receive(client.command)
            client.receive(client.command)
            client.answer()
            client.command.shutdown(socket.SHUT_RDWR)
            assert client.command.recv(1) == b""
            client.close()
            wait_until_closed(camera)


def wait_until_closed(camera: Echo) -> None:
    clock = SystemClock()
    for _ in range(500):
        with camera.lock:
            if not camera._session_id:
                return
        clock.sleep(0.01)
    pytest.fail("the session stayed open")


def test_events_go_to_the_client_of_today(camera: Echo) -> None:
    """A client that hung up without a word must not swallow the events of the next one."""
    with PtpIpServer(camera) as server:
        gone = Client(server.port)
        gone.command.close()
        late_client = Client(server.port)
        wait_until_closed(camera)
        late_client.request(Operation.OPEN_SESSION, 0, 1)
        late_client.answer()
        with camera.lock:
            camera.emit(Event.CAPTURE_COMPLETE, 9)
        assert late_client.receive(late_client.event)[0] == 8
        gone.event.close()
        late_client.close()


def test_an_event_connection_of_nobody_is_refused(camera: Echo) -> None:
    with PtpIpServer(camera) as server:
        connection = socket.create_connection((LOOPBACK, server.port), timeout=60)
        Client.send(connection, 3, struct.pack("<I", 99))
        assert Client.receive(connection)[0] == 5
        connection.close()

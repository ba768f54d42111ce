"""A host of plain bytes over the real pyusb: for tests of the simulated cameras, no driver of ours in between."""

from __future__ import annotations

import struct
from dataclasses import dataclass

import usb.core

from mocks.instruments.usb.bus import SimulatedUsbBackend

PACKET_BYTES = 512
FIRST_READ_BYTES = 4096
MAX_READ_BYTES = 1 << 20


@dataclass
class Reply:
    code: int
    params: tuple[int, ...]
    data: bytes


class RawHost:
    """Sends containers, reads containers; believes everything that is well formed."""

    def __init__(self, backend: SimulatedUsbBackend, usb_id: tuple[int, int]) -> None:
        found = usb.core.find(backend=backend, idVendor=usb_id[0], idProduct=usb_id[1])
        assert found is not None
        self.usb = found
        points = list(found.get_active_configuration()[(0, 0)])
        self.bulk_in, self.bulk_out, self.interrupt = (p.bEndpointAddress for p in points)
        self.event_packet = points[2].wMaxPacketSize
        self.tid = 0

    def write(self, data: bytes) -> None:
        self.usb.write(self.bulk_out, data, 1000)

    def read(self, size: int = 1 << 20, timeout_ms: int = 5000) -> bytes:
        return bytes(self.usb.read(self.bulk_in, size, timeout_ms))

    def event(self, timeout_ms: int = 5000) -> tuple[int, int, tuple[int, ...]]:
        packet = self.interrupt_bytes(timeout_ms)
        length, kind, code, tid = struct.unpack_from("<IHHI", packet)
        assert (length, kind) == (len(packet), 4)
        return code, tid, struct.unpack(f"<{(length - 12) // 4}I", packet[12:])

    def interrupt_bytes(self, timeout_ms: int) -> bytes:
        head = bytes(self.usb.read(self.interrupt, self.event_packet, timeout_ms))
        length = int.from_bytes(head[:4], "little")
        while len(head) < length:
            head += bytes(self.usb.read(self.interrupt, self.event_packet, timeout_ms))
        return head

    def command(self, operation: int, *params: int) -> None:
        self.tid = 0 if operation == 0x1002 else self.tid
        payload = struct.pack(f"<{len(params)}I", *params)
        self.write(struct.pack("<IHHI", 12 + len(payload), 1, operation, self.tid) + payload)

    def call(self, operation: int, *params: int, data: bytes | None = None) -> Reply:
        self.command(operation, *params)
        if data is not None:
            self.write(struct.pack("<IHHI", 12 + len(data), 2, operation, self.tid) + data)
        tid, got = self.tid, b""
        while True:
            length, kind, code, answered, payload = self.container()
            assert answered == tid
            assert length == 12 + len(payload)
            if kind == 3:
                break
            assert (kind, code) == (2, operation)
            got = payload
        self.tid += 1
        return Reply(code, struct.unpack(f"<{len(payload) // 4}I", payload), got)

    def container(self) -> tuple[int, int, int, int, bytes]:
        """Read one transfer, which must be one container."""
        size = FIRST_READ_BYTES
        whole = self.read(size)
        length, kind, code, tid = struct.unpack_from("<IHHI", whole)
        while len(whole) < length or (len(whole) % size == 0 and len(whole) % PACKET_BYTES == 0):
            size = min(MAX_READ_BYTES, -(-max(1, length - len(whole)) // PACKET_BYTES) * PACKET_BYTES)
            piece = self.read(size)
            whole += piece
            if len(piece) < size:
                break
        return length, kind, code, tid, whole[12:]

    def open(self) -> None:
        assert self.call(0x1002, 1).code == 0x2001

    def get(self, prop: int) -> bytes:
        reply = self.call(0x1015, prop)
        assert reply.code == 0x2001, f"{reply.code:04x}"
        return reply.data

    def set(self, prop: int, data: bytes) -> int:
        return self.call(0x1016, prop, data=data).code

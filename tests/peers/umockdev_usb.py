"""Runs a command with a simulated camera on an emulated USB bus; to be run by the system's Python in umockdev-wrapper.

    umockdev-wrapper python3 -m tests.peers.umockdev_usb BODY COMMAND...

What libusb asks of the kernel (usbdevfs) is answered from `mocks.instruments.usb.bus`. The exit status is the
command's; the camera's complaints about its host follow on the last line, as JSON.
"""

from __future__ import annotations

import errno
import json
import struct
import subprocess
import sys
import threading
from dataclasses import dataclass
from typing import Any

import gi
import usb.core

from drivers.clock import SystemClock
from mocks.instruments.canon_5d2 import SimulatedCanon5D2
from mocks.instruments.canon_records import CanonOptions
from mocks.instruments.usb.bus import SimulatedUsbBackend, endpoint_descriptors

gi.require_version("UMockdev", "1.0")
from gi.repository import UMockdev  # noqa: E402

NODE = "/dev/bus/usb/001/005"
SUBMIT, REAP, REAP_NOW, DISCARD = 0x8038550A, 0x4008550C, 0x4008550D, 0x550B
GET_CAPABILITIES, GET_DRIVER, GET_SPEED, RESET, CLEAR_HALT = 0x8004551A, 0x41045508, 0x551F, 0x5514, 0x80045515
QUIET = {0x8004550F, 0x80045510, 0x80045505, 0x80085504, CLEAR_HALT}
"""Claim, release, set configuration and setting."""
URB_BYTES, TYPE, ENDPOINT, STATUS, BUFFER, LENGTH, ACTUAL = 56, 0, 1, 4, 16, 24, 28
INTERRUPT, CONTROL, BULK = 1, 2, 3
IN_LIMIT_MS = {INTERRUPT: 200, BULK: 60_000}
PICTURE_PADDING = 300_001


class Padded:
    """Pictures of no round size that name their exposure."""

    def jpeg(self, request: Any) -> bytes:
        return b"\xff\xd8" + f"{request.shutter_s:.6f}".encode() + bytes(PICTURE_PADDING) + b"\xff\xd9"

    def raw(self, request: Any) -> bytes:
        return b"II*\0" + bytes(PICTURE_PADDING)


@dataclass
class Urb:
    """A transfer under way: the client's structure and its buffer."""

    data: Any
    buffer: Any
    kind: int
    endpoint: int
    length: int
    address: int
    given_up: bool = False


def pointer(client: Any) -> int:
    """Return the argument of an ioctl: the address of a structure of the client."""
    return int.from_bytes(bytes(client.get_arg().retrieve())[:8], "little")


class Bus:
    """Answers the ioctls of one device node."""

    def __init__(self, backend: SimulatedUsbBackend) -> None:
        self._backend = backend
        self._port = next(iter(backend.enumerate_devices()))
        self._handle = backend.open_device(self._port)
        backend.claim_interface(self._handle, 0)
        self._pending: dict[int, Urb] = {}
        self._done: list[Urb] = []
        self._lock = threading.Lock()
        self._reading = {e: threading.Lock() for e in self._port.device.camera.identity.endpoints}
        self._left: dict[int, bytes] = {}

    def handle(self, _base: Any, client: Any) -> bool:
        request = client.get_request() & 0xFFFFFFFF
        if request == SUBMIT:
            self._submit(client)
        elif request in (REAP, REAP_NOW):
            self._reap(client)
        elif request == DISCARD:
            self._discard(client)
        elif request == GET_CAPABILITIES:
            client.get_arg().resolve(0, 4).update(0, struct.pack("<I", 0x1F))
            client.complete(0, 0)
        elif request == GET_DRIVER:
            client.complete(-1, errno.ENODATA)
        elif request == RESET:
            self._backend.reset_device(self._handle)
            client.complete(0, 0)
        else:
            client.complete(3 if request == GET_SPEED else 0 if request in QUIET else -1, errno.ENOTTY)
        return True

    def _submit(self, client: Any) -> None:
        address = pointer(client)  # before it is resolved, which replaces it by an address of ours
        data = client.get_arg().resolve(0, URB_BYTES)
        raw = bytes(data.retrieve())
        length = struct.unpack_from("<i", raw, LENGTH)[0]
        buffer = data.resolve(BUFFER, length) if length else None
        urb = Urb(data, buffer, raw[TYPE], raw[ENDPOINT], length, address)
        with self._lock:
            self._pending[address] = urb
        threading.Thread(target=self._carry_out, args=(urb,), daemon=True).start()
        client.complete(0, 0)

    def _carry_out(self, urb: Urb) -> None:
        status, got, at = 0, b"", 0
        while not urb.given_up:
            try:
                got, at = self._transfer(urb)
                break
            except usb.core.USBTimeoutError:
                continue
            except usb.core.USBError as error:
                status = -(error.errno or errno.EIO)
                break
        with self._lock:
            if urb.given_up:
                return
            if (got and urb.endpoint & 0x80) or (urb.kind == CONTROL and got):
                urb.buffer.update(at, got)
            self._finish(urb, status, len(got) if urb.endpoint & 0x80 or urb.kind == CONTROL else urb.length)

    def _transfer(self, urb: Urb) -> tuple[bytes, int]:
        if urb.kind == CONTROL:
            whole = bytes(urb.buffer.retrieve())
            kind, request, value, index, length = struct.unpack_from("<BBHHH", whole)
            data = bytearray(whole[8 : 8 + length])
            n = self._backend.ctrl_transfer(self._handle, kind, request, value, index, memoryview(data), 1000)
            return bytes(data[:n]), 8
        if urb.endpoint & 0x80:
            return self._receive(urb), 0
        sent = bytes(urb.buffer.retrieve()) if urb.buffer is not None else b""
        self._backend.bulk_write(self._handle, urb.endpoint, 0, memoryview(sent), 60_000)
        return b"", 0

    def _receive(self, urb: Urb) -> bytes:
        """Return an IN transfer; what comes for one that was given up is the next one's."""
        with self._reading[urb.endpoint]:
            got = self._left.pop(urb.endpoint, b"")
            if not got:
                data = bytearray(urb.length)
                n = self._backend.bulk_read(self._handle, urb.endpoint, 0, memoryview(data), IN_LIMIT_MS[urb.kind])
                got = bytes(data[:n])
            with self._lock:
                given = 0 if urb.given_up else urb.length
            if got[given:]:
                self._left[urb.endpoint] = got[given:]
            return got[:given]

    def _finish(self, urb: Urb, status: int, actual: int) -> None:
        urb.data.update(STATUS, struct.pack("<i", status))
        urb.data.update(ACTUAL, struct.pack("<i", actual))
        self._pending.pop(urb.address, None)
        self._done.append(urb)

    def _reap(self, client: Any) -> None:
        with self._lock:
            if not self._done:
                client.complete(-1, errno.EAGAIN)
                return
            urb = self._done.pop(0)
            client.get_arg().resolve(0, 8).set_ptr(0, urb.data)
        client.complete(0, 0)

    def _discard(self, client: Any) -> None:
        with self._lock:
            urb = self._pending.get(pointer(client))
            if urb is None:
                client.complete(-1, errno.EINVAL)
                return
            urb.given_up = True
            self._finish(urb, -errno.ENOENT, 0)
        client.complete(0, 0)


def descriptors(backend: SimulatedUsbBackend) -> bytes:
    """Return device and configuration descriptor as the kernel shows them."""
    port = next(iter(backend.enumerate_devices()))
    device = backend.get_device_descriptor(port)
    config = backend.get_configuration_descriptor(port, 0)
    interface = backend.get_interface_descriptor(port, 0, 0, 0)
    head = struct.pack(
        "<BBHBBBBHHHBBBB",
        18,
        1,
        device.bcdUSB,
        0,
        0,
        0,
        64,
        device.idVendor,
        device.idProduct,
        device.bcdDevice,
        device.iManufacturer,
        device.iProduct,
        device.iSerialNumber,
        1,
    )
    ids = (interface.bInterfaceClass, interface.bInterfaceSubClass, interface.bInterfaceProtocol)
    body = struct.pack("<BBHBBBBB", 9, 2, config.wTotalLength, 1, 1, 0, 0xC0, 50)
    body += struct.pack("<BBBBBBBBB", 9, 4, 0, 0, 3, *ids, 0)
    identity = port.device.camera.identity
    for e in endpoint_descriptors(identity.endpoints, identity.interrupt_packet_bytes):
        body += struct.pack("<BBBBHB", 7, 5, e.bEndpointAddress, e.bmAttributes, e.wMaxPacketSize, e.bInterval)
    return head + body


def record(backend: SimulatedUsbBackend) -> str:
    """Return the device as umockdev describes one."""
    raw = descriptors(backend)
    vendor, product = struct.unpack_from("<HH", raw, 8)
    return f"""P: /devices/pci0000:00/0000:00:14.0/usb1/1-5
N: {NODE.removeprefix("/dev/")}={raw.hex().upper()}
E: DEVNAME={NODE}
E: DEVTYPE=usb_device
E: SUBSYSTEM=usb
E: BUSNUM=001
E: DEVNUM=005
E: MAJOR=189
E: MINOR=4
E: PRODUCT={vendor:x}/{product:x}/100
A: dev=189:4
A: busnum=1\\n
A: devnum=5\\n
A: idVendor={vendor:04x}\\n
A: idProduct={product:04x}\\n
A: speed=480\\n
A: bConfigurationValue=1\\n
A: bNumConfigurations=1\\n
H: descriptors={raw.hex().upper()}
"""


def main() -> int:
    body, *command = sys.argv[1:]
    camera = SimulatedCanon5D2(Padded(), SystemClock(), options=CanonOptions(body=body))
    backend = SimulatedUsbBackend([camera], camera.clock)
    testbed = UMockdev.Testbed.new()
    testbed.add_from_string(record(backend))
    base = UMockdev.IoctlBase()
    bus = Bus(backend)
    base.connect("handle-ioctl", bus.handle)
    testbed.attach_ioctl(NODE, base)
    code = subprocess.run(command, timeout=240, check=False).returncode
    sys.stdout.write(json.dumps({"violations": camera.stats.violations, "shots": camera.shot_count}) + "\n")
    sys.stdout.flush()
    testbed.detach_ioctl(NODE)
    return code


if __name__ == "__main__":
    sys.exit(main())

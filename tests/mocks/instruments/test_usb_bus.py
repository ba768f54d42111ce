"""The simulated bus seen through the real pyusb: descriptors, packets, errors, and PTP bytes computed by hand."""

from __future__ import annotations

import errno
from collections.abc import Callable
from typing import Any

import pytest
import usb.core
import usb.util

from mocks.instruments.usb.bus import SimulatedUsbBackend
from tests.mocks.instruments.echo import GIVE, KEEP, SIGNAL, SLOW, Echo
from tests.virtual_clock import VirtualClock

OPEN_SESSION = "10 00 00 00 01 00 02 10 00 00 00 00 01 00 00 00"
DEVICE_INFO = "0c 00 00 00 01 00 01 10 00 00 00 00"
OK_0 = "0c 00 00 00 03 00 01 20 00 00 00 00"
IN, OUT, EVENT = 0x81, 0x02, 0x83


class Bench:
    """One Echo on the bus, opened."""

    def __init__(self) -> None:
        self.clock = VirtualClock()
        self.camera = Echo(self.clock)
        self.backend = SimulatedUsbBackend([self.camera], self.clock)
        self.device = self.find()

    def find(self) -> Any:
        return usb.core.find(backend=self.backend, idVendor=0x1209)

    def write(self, data: str | bytes) -> int:
        return int(self.device.write(OUT, bytes.fromhex(data) if isinstance(data, str) else data, 1000))

    def read(self, size: int = 512, endpoint: int = IN, timeout_ms: int = 1000) -> bytes:
        return bytes(self.device.read(endpoint, size, timeout_ms))

    def command(self, operation: int, transaction_id: int, *params: int) -> None:
        words = b"".join(p.to_bytes(4, "little") for p in params)
        head = (12 + len(words)).to_bytes(4, "little") + b"\1\0" + operation.to_bytes(2, "little")
        self.write(head + transaction_id.to_bytes(4, "little") + words)

    def open(self) -> None:
        self.write(OPEN_SESSION)
        assert self.read() == bytes.fromhex(OK_0)


@pytest.fixture
def bench() -> Bench:
    return Bench()


def failing(call: Callable[[], object]) -> int:
    """Return the errno of the USB error of a call."""
    with pytest.raises(usb.core.USBError) as caught:
        call()
    return int(caught.value.errno)


def test_pyusb_reads_the_descriptors(bench: Bench) -> None:
    device = bench.device
    assert (device.idVendor, device.idProduct, device.bDeviceClass, device.bcdUSB) == (0x1209, 1, 0, 0x0200)
    assert (device.manufacturer, device.product, device.serial_number) == ("Nobody", "Echo", "7")
    interface = device.get_active_configuration()[(0, 0)]
    assert (interface.bInterfaceClass, interface.bInterfaceSubClass, interface.bInterfaceProtocol) == (6, 1, 1)
    ends = [(e.bEndpointAddress, usb.util.endpoint_type(e.bmAttributes), e.wMaxPacketSize) for e in interface]
    assert ends == [(IN, 2, 512), (OUT, 2, 512), (EVENT, 3, 8)]


def test_vectors_open_session_and_device_info(bench: Bench) -> None:
    bench.write(DEVICE_INFO)
    info = bench.read(1024)
    assert info[:12] == len(info).to_bytes(4, "little") + bytes.fromhex("02 00 01 10 00 00 00 00")
    assert info[12:18] == bytes.fromhex("64 00 00 00 00 00")
    assert bench.read() == bytes.fromhex(OK_0)
    bench.open()
    assert bench.camera.stats.violations == []


@pytest.mark.parametrize("payload", [0, 1, 499, 500, 501, 1011, 1012, 1013, 70_000])
def test_a_data_phase_ends_with_a_short_packet(bench: Bench, payload: int) -> None:
    bench.open()
    bench.command(GIVE, 1, payload)
    data = bench.read(131072)
    assert data[12:] == bytes(i % 251 for i in range(payload))
    assert bench.read() == bytes.fromhex("0c 00 00 00 03 00 01 20 01 00 00 00")


def test_a_full_buffer_leaves_the_zero_length_packet_for_the_next_read(bench: Bench) -> None:
    bench.open()
    bench.command(GIVE, 1, 1012)
    assert len(bench.read(1024)) == 1024
    assert bench.read() == b""
    assert bench.read()[4:8] == bytes.fromhex("03 00 01 20")


def test_reads_in_pieces_join_up(bench: Bench) -> None:
    bench.open()
    bench.command(GIVE, 1, 5000)
    pieces = [bench.read() for _ in range(10)]
    assert [len(p) for p in pieces] == [512] * 9 + [404]
    assert b"".join(pieces)[12:] == bytes(i % 251 for i in range(5000))


def test_a_buffer_that_is_no_multiple_of_the_packet_overflows(bench: Bench) -> None:
    bench.open()
    bench.command(GIVE, 1, 5000)
    assert failing(lambda: bench.read(100)) == errno.EOVERFLOW


@pytest.mark.parametrize("payload", [1, 499, 501, 3000])
def test_data_out_in_one_and_in_two_transfers(bench: Bench, payload: int) -> None:
    bench.open()
    sent = bytes(range(256)) * 12
    body = (12 + payload).to_bytes(4, "little") + bytes.fromhex("02 00 00 90 01 00 00 00") + sent[:payload]
    bench.command(KEEP, 1)
    bench.write(body)
    assert bench.read()[4:8] == bytes.fromhex("03 00 01 20")
    bench.command(KEEP, 2)
    bench.write(body[:8] + b"\2" + body[9:12])
    bench.write(body[12:])
    assert bench.read()[4:12] == bytes.fromhex("03 00 01 20 02 00 00 00")
    assert bench.camera.kept == sent[:payload]


def test_data_out_of_whole_packets_is_over_only_after_a_zero_length_packet(bench: Bench) -> None:
    bench.open()
    bench.command(KEEP, 1)
    bench.write((1024).to_bytes(4, "little") + bytes.fromhex("02 00 00 90 01 00 00 00") + bytes(1012))
    assert failing(bench.read) == errno.ETIMEDOUT
    bench.write(b"")
    assert bench.read()[:4] == (16).to_bytes(4, "little")
    assert len(bench.camera.kept) == 1012


def test_a_time_out_costs_virtual_time_only(bench: Bench) -> None:
    bench.open()
    before_s = bench.clock.monotonic_s()
    with pytest.raises(usb.core.USBTimeoutError) as caught:
        bench.read(timeout_ms=60_000)
    assert caught.value.errno == errno.ETIMEDOUT
    assert bench.clock.monotonic_s() - before_s == pytest.approx(60)


def test_an_answer_comes_when_the_camera_is_ready(bench: Bench) -> None:
    bench.open()
    bench.command(SLOW, 1)
    assert failing(lambda: bench.read(timeout_ms=4_900)) == errno.ETIMEDOUT
    before_s = bench.clock.monotonic_s()
    assert bench.read(timeout_ms=10_000)[4:8] == bytes.fromhex("03 00 01 20")
    assert bench.clock.monotonic_s() - before_s < 0.2


def test_bytes_take_their_time(bench: Bench) -> None:
    bench.open()
    bench.command(GIVE, 1, 500_000)
    before_s = bench.clock.monotonic_s()
    bench.read(1 << 20)
    assert bench.clock.monotonic_s() - before_s == pytest.approx(0.5, rel=0.02)


def test_what_came_before_the_time_out_is_given(bench: Bench) -> None:
    bench.open()
    bench.command(GIVE, 1, 500_000)
    got = bench.read(1 << 20, timeout_ms=100)
    assert 50_000 < len(got) < 110_000
    assert len(got) % 512 == 0
    assert got[12:] == bytes(i % 251 for i in range(len(got) - 12))


def test_events_come_in_packets_of_eight_bytes(bench: Bench) -> None:
    bench.open()
    bench.command(SIGNAL, 1, 0xC101)
    bench.read()
    assert bench.read(8, EVENT) == bytes.fromhex("0c 00 00 00 04 00 01 c1")
    assert bench.read(8, EVENT) == bytes.fromhex("01 00 00 00")
    bench.command(SIGNAL, 2, 0x4002, 0x64)
    bench.read()
    assert bench.read(64, EVENT) == bytes.fromhex("10 00 00 00 04 00 02 40 02 00 00 00 64 00 00 00")
    assert failing(lambda: bench.read(64, EVENT, 50)) == errno.ETIMEDOUT


def test_cancel_drops_what_was_coming_and_then_all_is_well(bench: Bench) -> None:
    bench.open()
    bench.command(GIVE, 1, 100_000)
    bench.read()
    assert bench.device.ctrl_transfer(0x21, 0x64, 0, 0, bytes.fromhex("01 40 01 00 00 00"), 1000) == 6
    status = bytes(bench.device.ctrl_transfer(0xA1, 0x67, 0, 0, 64, 1000))
    assert status == bytes.fromhex("04 00 19 20")
    bench.clock.sleep(1)
    assert bytes(bench.device.ctrl_transfer(0xA1, 0x67, 0, 0, 64, 1000)) == bytes.fromhex("04 00 01 20")
    assert failing(lambda: bench.read(timeout_ms=50)) == errno.ETIMEDOUT
    bench.command(GIVE, 2, 8)
    assert len(bench.read()) == 20
    assert bench.read()[6:12] == bytes.fromhex("01 20 02 00 00 00")


def test_a_wrong_cancel_stalls_and_is_noted(bench: Bench) -> None:
    assert failing(lambda: bench.device.ctrl_transfer(0x21, 0x64, 0, 0, b"abc", 1000)) == errno.EPIPE
    assert len(bench.camera.stats.violations) == 1


def test_device_reset_closes_the_session(bench: Bench) -> None:
    bench.open()
    bench.device.ctrl_transfer(0x21, 0x66, 0, 0, b"", 1000)
    bench.command(GIVE, 1, 8)
    assert bench.read()[6:8] == bytes.fromhex("03 20")
    bench.open()


def test_unknown_control_requests_stall(bench: Bench) -> None:
    assert failing(lambda: bench.device.ctrl_transfer(0xA1, 0x99, 0, 0, 8, 1000)) == errno.EPIPE
    assert failing(lambda: bench.device.ctrl_transfer(0xC0, 0x01, 0, 0, 8, 1000)) == errno.EPIPE


@pytest.mark.parametrize(
    "nonsense",
    [
        "0b 00 00 00 01 00 02 10 00 00 00 00",
        "0c 00 00 00 02 00 02 10 00 00 00 00",
        "0d 00 00 00 01 00 02 10 00 00 00 00 01",
        "01 02",
    ],
)
def test_nonsense_halts_the_bulk_pipes_until_cleared(bench: Bench, nonsense: str) -> None:
    bench.write(nonsense)
    assert len(bench.camera.stats.violations) == 1
    assert failing(lambda: bench.write(OPEN_SESSION)) == errno.EPIPE
    assert failing(bench.read) == errno.EPIPE
    status = bytes(bench.device.ctrl_transfer(0xA1, 0x67, 0, 0, 64, 1000))
    assert status[4:] == bytes.fromhex("02 00 00 00 81 00 00 00")
    bench.device.clear_halt(OUT)
    bench.device.clear_halt(IN)
    bench.open()


def test_transaction_ids_are_checked(bench: Bench) -> None:
    bench.open()
    bench.command(GIVE, 2, 8)
    assert bench.read()[6:12] == bytes.fromhex("04 20 02 00 00 00")
    bench.command(GIVE, 1, 8)
    assert len(bench.read()) == 20
    assert len(bench.camera.stats.violations) == 1


def test_a_pulled_cable_is_errno_19_and_the_old_handle_stays_dead(bench: Bench) -> None:
    bench.open()
    address = bench.device.address
    bench.camera.unplug(replug_after_s=3)
    assert failing(lambda: bench.write(DEVICE_INFO)) == errno.ENODEV
    assert failing(bench.read) == errno.ENODEV
    assert bench.find() is None
    bench.clock.sleep(3.01)
    assert failing(lambda: bench.write(DEVICE_INFO)) == errno.ENODEV
    bench.device = bench.find()
    assert bench.device.address != address
    bench.open()


def test_a_camera_held_by_another_program_is_errno_16(bench: Bench) -> None:
    bench.backend.port(bench.camera).claimed_elsewhere = True
    assert failing(lambda: bench.write(DEVICE_INFO)) == errno.EBUSY


def test_two_handles_cannot_hold_it_at_once(bench: Bench) -> None:
    bench.open()
    other = bench.find()
    assert failing(lambda: other.write(OUT, bytes.fromhex(DEVICE_INFO), 1000)) == errno.EBUSY
    usb.util.dispose_resources(bench.device)
    assert other.write(OUT, bytes.fromhex(DEVICE_INFO), 1000) == 12


def test_a_forbidden_camera_is_errno_13(bench: Bench) -> None:
    bench.backend.port(bench.camera).forbidden = True
    assert failing(lambda: bench.write(DEVICE_INFO)) == errno.EACCES


def test_a_port_reset_keeps_the_handle_and_ends_the_session(bench: Bench) -> None:
    bench.open()
    bench.device.reset()
    bench.open()

"""The USB link through the real pyusb, over a backend of this file's own that plays a bus."""

from __future__ import annotations

import errno
import os
from array import array
from collections import deque
from collections.abc import Callable, Iterator
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest
import usb.backend
import usb.core

from drivers import usb_link
from drivers.errors import (
    DeviceClaimedError,
    DeviceError,
    DeviceLostError,
    DeviceNotFoundError,
    DevicePermissionError,
    DeviceTimeoutError,
    LinkStallError,
    ProtocolViolationError,
    UnsupportedError,
)
from drivers.link_errors import SUSPECTS, find_holder, typed_error
from drivers.ptp.session import PtpSession
from drivers.usb_link import UsbDeviceInfo, UsbLink, list_cameras
from tests.drivers.scripted import FakeClock, command, data, event, response

THETA, CANON = (0x05CA, 0x036D), (0x04A9, 0x3199)


class FakeDevice:
    """One device on the bus: descriptors, and transfers to hand out or to record."""

    def __init__(
        self,
        ids: tuple[int, int] = THETA,
        *,
        endpoints: tuple[tuple[int, int, int], ...] = ((0x81, 2, 512), (0x01, 2, 512), (0x82, 3, 8)),
        interface_class: tuple[int, int, int] = (6, 1, 1),
        serial: str = "10010001",
        address: int = 5,
    ) -> None:
        self.ids, self.endpoints, self.interface_class, self.serial = ids, endpoints, interface_class, serial
        self.address = address
        self.incoming: dict[int, deque[bytes | Exception]] = {ep: deque() for ep, _, _ in endpoints}
        self.sent: list[tuple[int, bytes]] = []
        self.control: list[tuple[int, int, int, int, bytes | int]] = []
        self.calls: list[str] = []
        self.limits_ms: list[int] = []
        self.answers: dict[bytes, list[tuple[int, bytes]]] = {}
        self.fail: dict[str, Exception] = {}
        self.take_at_most: int | None = None
        self.configured = True


def usb_error(number: int | None) -> usb.core.USBError:
    if number == errno.ETIMEDOUT:
        return usb.core.USBTimeoutError("Operation timed out", -7, number)
    return usb.core.USBError(os.strerror(number or 0), -1, number)


class FakeBackend(usb.backend.IBackend):  # type: ignore[misc]
    def __init__(self, *devices: FakeDevice) -> None:
        self.devices = list(devices)

    def enumerate_devices(self) -> Iterator[FakeDevice]:
        return iter(self.devices)

    def get_parent(self, dev: FakeDevice) -> None:
        return None

    def get_device_descriptor(self, dev: FakeDevice) -> Any:
        fields = {"bLength": 18, "bDescriptorType": 1, "bcdUSB": 0x200, "bDeviceClass": 0, "bDeviceSubClass": 0}
        fields |= {"bDeviceProtocol": 0, "bMaxPacketSize0": 64, "bcdDevice": 0x100, "iManufacturer": 1, "iProduct": 2}
        fields |= {"iSerialNumber": 3, "bNumConfigurations": 1, "idVendor": dev.ids[0], "idProduct": dev.ids[1]}
        return SimpleNamespace(**fields, address=dev.address, bus=1, port_number=1, port_numbers=(1,), speed=3)

    def get_configuration_descriptor(self, dev: FakeDevice, config: int) -> Any:
        if "describe" in dev.fail:
            raise dev.fail["describe"]
        if config:
            raise IndexError
        fields = {"bLength": 9, "bDescriptorType": 2, "wTotalLength": 39, "bNumInterfaces": 1}
        fields |= {"bConfigurationValue": 1, "iConfiguration": 0, "bmAttributes": 0xC0, "bMaxPower": 1}
        return SimpleNamespace(**fields, extra_descriptors=[])

    def get_interface_descriptor(self, dev: FakeDevice, intf: int, alt: int, config: int) -> Any:
        if intf or alt:
            raise IndexError
        kind, sub, protocol = dev.interface_class
        fields = {"bLength": 9, "bDescriptorType": 4, "bInterfaceNumber": 0, "bAlternateSetting": 0}
        fields |= {"bInterfaceClass": kind, "bInterfaceSubClass": sub, "bInterfaceProtocol": protocol}
        return SimpleNamespace(**fields, bNumEndpoints=len(dev.endpoints), iInterface=0, extra_descriptors=[])

    def get_endpoint_descriptor(self, dev: FakeDevice, ep: int, intf: int, alt: int, config: int) -> Any:
        address, kind, packet = dev.endpoints[ep]
        fields = {"bLength": 7, "bDescriptorType": 5, "bEndpointAddress": address, "bmAttributes": kind}
        fields |= {"wMaxPacketSize": packet, "bInterval": 9, "bRefresh": 0, "bSynchAddress": 0}
        return SimpleNamespace(**fields, extra_descriptors=[])

    def _do(self, dev: FakeDevice, what: str) -> None:
        dev.calls.append(what)
        if what in dev.fail:
            raise dev.fail[what]

    def open_device(self, dev: FakeDevice) -> FakeDevice:
        self._do(dev, "open")
        return dev

    def close_device(self, handle: FakeDevice) -> None:
        self._do(handle, "close")

    def get_configuration(self, handle: FakeDevice) -> int:
        return 1 if handle.configured else 0

    def set_configuration(self, handle: FakeDevice, value: int) -> None:
        self._do(handle, f"configure {value}")
        handle.configured = True

    def claim_interface(self, handle: FakeDevice, intf: int) -> None:
        self._do(handle, "claim")

    def release_interface(self, handle: FakeDevice, intf: int) -> None:
        self._do(handle, "release")

    def is_kernel_driver_active(self, handle: FakeDevice, intf: int) -> bool:
        self._do(handle, "kernel driver")
        return False

    def _write(self, handle: FakeDevice, ep: int, intf: int, sent: array[int], timeout: int) -> int:
        assert timeout > 0, "0 is for ever"
        handle.limits_ms.append(timeout)
        self._do(handle, "write")
        taken = sent.tobytes()[: handle.take_at_most]
        handle.sent.append((ep, taken))
        for answer_ep, answer in handle.answers.get(taken, []):
            handle.incoming[answer_ep].append(answer)
        return len(taken)

    def _read(self, handle: FakeDevice, ep: int, intf: int, buff: array[int], timeout: int) -> int:
        assert timeout > 0, "0 is for ever"
        handle.limits_ms.append(timeout)
        if not handle.incoming[ep]:
            raise usb_error(errno.ETIMEDOUT)
        item = handle.incoming[ep].popleft()
        if isinstance(item, Exception):
            raise item
        if len(item) > len(buff):
            raise usb_error(errno.EOVERFLOW)
        buff[: len(item)] = array("B", item)
        return len(item)

    bulk_write = intr_write = _write
    bulk_read = intr_read = _read

    def ctrl_transfer(
        self, handle: FakeDevice, kind: int, request: int, value: int, index: int, buff: array[int], timeout: int
    ) -> int:
        if request == 6:
            self._do(handle, "string")
            texts = {0: b"\x04\x03\x09\x04", 2: "RICOH THETA Z1", 3: handle.serial}
            text = texts[value & 0xFF]
            raw = text if isinstance(text, bytes) else bytes([2 + 2 * len(text), 3]) + text.encode("utf-16-le")
            buff[: len(raw)] = array("B", raw)
            return len(raw)
        self._do(handle, "control")
        assert timeout > 0
        handle.control.append((kind, request, value, index, len(buff) if kind & 0x80 else buff.tobytes()))
        if kind & 0x80:
            buff[:4] = array("B", bytes.fromhex("04000120"))
            return 4
        return len(buff)

    def clear_halt(self, handle: FakeDevice, ep: int) -> None:
        self._do(handle, f"clear {ep:02x}")

    def reset_device(self, handle: FakeDevice) -> None:
        self._do(handle, "reset")


def open_link(*devices: FakeDevice, serial: str | None = None, ids: tuple[int, int] = THETA) -> UsbLink:
    return UsbLink.open(*ids, serial=serial, backend=FakeBackend(*devices), clock=FakeClock())


# Finding and opening.


@pytest.mark.parametrize(
    ("ids", "endpoints"),
    [
        (THETA, ((0x81, 2, 512), (0x01, 2, 512), (0x82, 3, 64))),
        (CANON, ((0x81, 2, 512), (0x02, 2, 512), (0x83, 3, 8))),
        (CANON, ((0x84, 3, 8), (0x03, 2, 1024), (0x85, 2, 1024))),
    ],
)
def test_endpoints_come_from_the_descriptors(ids: tuple[int, int], endpoints: tuple[tuple[int, int, int], ...]) -> None:
    device = FakeDevice(ids, endpoints=endpoints)
    link = open_link(device, ids=ids)
    bulk_in = next(ep for ep, kind, _ in endpoints if kind == 2 and ep & 0x80)
    bulk_out = next(ep for ep, kind, _ in endpoints if kind == 2 and not ep & 0x80)
    interrupt = next(ep for ep, kind, _ in endpoints if kind == 3)
    device.incoming[bulk_in].append(b"bulk")
    device.incoming[interrupt].append(b"event")
    link.write(b"command", 1.0)
    assert device.sent == [(bulk_out, b"command")]
    assert link.read(4 * link.max_packet_bytes, 1.0) == b"bulk"
    assert link.read_event(1.0) == b"event"
    assert link.max_packet_bytes == next(size for _, kind, size in endpoints if kind == 2)
    for pipe in ("in", "out", "event"):
        link.clear_halt(pipe)  # type: ignore[arg-type]
    assert device.calls[-3:] == [f"clear {ep:02x}" for ep in (bulk_in, bulk_out, interrupt)]


def test_device_without_configuration_is_configured() -> None:
    device = FakeDevice()
    device.configured = False
    open_link(device)
    assert "configure 1" in device.calls


@pytest.mark.parametrize(
    ("device", "said"),
    [
        (FakeDevice(interface_class=(0xEF, 2, 1)), "no still-image interface"),
        (FakeDevice(endpoints=((0x81, 2, 512), (0x01, 2, 512))), "lacks an endpoint"),
    ],
)
def test_devices_that_are_no_ptp_camera(device: FakeDevice, said: str) -> None:
    with pytest.raises(UnsupportedError, match=said):
        open_link(device)
    assert device.calls[-1] == "close"


def test_missing_camera_is_named() -> None:
    with pytest.raises(DeviceNotFoundError, match=r"camera 05ca:036d: not found on USB.*another USB mode"):
        open_link(FakeDevice(CANON))


def test_one_of_several_is_chosen_by_serial_number() -> None:
    first, second = FakeDevice(serial="1001"), FakeDevice(serial="2002", address=6)
    with pytest.raises(DeviceNotFoundError, match="2 such cameras"):
        open_link(first, second)
    open_link(first, second, serial="2002").write(b"x", 1.0)
    assert (first.sent, second.sent) == ([], [(1, b"x")])
    with pytest.raises(DeviceNotFoundError, match="with serial number 3003"):
        open_link(first, second, serial="3003")


def test_serial_number_that_cannot_be_read_is_a_matter_of_permission() -> None:
    device = FakeDevice()
    device.fail["open"] = usb_error(errno.EACCES)
    with pytest.raises(DevicePermissionError, match="udev"):
        open_link(device, serial="10010001")


@pytest.mark.parametrize(
    ("call", "number", "kind"),
    [
        ("open", errno.EACCES, DevicePermissionError),
        ("open", errno.ENODEV, DeviceLostError),
        ("claim", errno.EBUSY, DeviceClaimedError),
        ("claim", errno.ENODEV, DeviceLostError),
    ],
)
def test_opening_fails_with_typed_errors(call: str, number: int, kind: type[DeviceError]) -> None:
    device = FakeDevice()
    device.fail[call] = usb_error(number)
    with pytest.raises(kind) as caught:
        open_link(device)
    assert caught.value.where == "camera 05ca:036d"
    assert caught.value.advice


def test_kernel_drivers_that_cannot_be_asked_for_do_not_matter() -> None:
    device = FakeDevice()
    device.fail["kernel driver"] = NotImplementedError("not on this system")
    open_link(device).write(b"x", 1.0)
    assert device.sent == [(1, b"x")]


def test_holder_of_a_claimed_camera_is_named(monkeypatch: pytest.MonkeyPatch) -> None:
    device = FakeDevice(address=7)
    device.fail["claim"] = usb_error(errno.EBUSY)
    monkeypatch.setattr(usb_link, "find_holder", lambda node, suspects: f"program on {node} (pid 17)")
    with pytest.raises(DeviceClaimedError, match=r"held by program on /dev/bus/usb/001/007 \(pid 17\)") as caught:
        open_link(device)
    assert caught.value.details["holder"] == "program on /dev/bus/usb/001/007 (pid 17)"


NODE, OTHER_NODE = "/dev/bus/usb/001/007", "/dev/bus/usb/001/008"


def make_process(proc: Path, pid: int, name: str, *opened: str) -> None:
    (proc / str(pid) / "fd").mkdir(parents=True)
    (proc / str(pid) / "comm").write_text(name + "\n")
    for number, target in enumerate(opened):
        (proc / str(pid) / "fd" / str(number)).symlink_to(target)


def test_holder_is_the_process_with_the_device_open(tmp_path: Path) -> None:
    make_process(tmp_path, 10, "bash", "/dev/null")
    make_process(tmp_path, 11, "gvfs-gphoto2-vo")
    make_process(tmp_path, 200, "darktable", "/dev/null", "/dev/bus/usb/001/007")
    (tmp_path / "version").write_text("no process")
    assert find_holder(NODE, tmp_path, suspects=SUSPECTS) == "darktable (pid 200)"
    assert find_holder(OTHER_NODE, tmp_path, suspects=SUSPECTS) == "perhaps gvfs-gphoto2-vo (pid 11)"
    assert find_holder(OTHER_NODE, tmp_path) == ""
    assert find_holder(OTHER_NODE, tmp_path / "missing", suspects=SUSPECTS) == ""


def test_holder_never_is_this_process(tmp_path: Path) -> None:
    make_process(tmp_path, os.getpid(), "python", "/dev/bus/usb/001/007")
    assert find_holder(NODE, tmp_path) == ""


def test_cameras_are_listed_by_their_interface() -> None:
    shy = FakeDevice(CANON, address=6)
    shy.fail["string"] = usb_error(errno.EACCES)
    unreadable = FakeDevice((1, 2))
    unreadable.fail["describe"] = usb_error(errno.EIO)
    keyboard = FakeDevice((3, 4), interface_class=(3, 1, 1))
    assert list_cameras(FakeBackend(FakeDevice(), keyboard, unreadable, shy)) == [
        UsbDeviceInfo(*THETA, 1, 5, "RICOH THETA Z1"),
        UsbDeviceInfo(*CANON, 1, 6, ""),
    ]


def test_missing_usb_library_is_named(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(usb_link, "real_backend", lambda: None)
    with pytest.raises(DeviceNotFoundError, match="pip install libusb-package"):
        list_cameras()
    with pytest.raises(DeviceNotFoundError, match="no USB library"):
        UsbLink.open(*THETA, clock=FakeClock())


# Transfers.


@pytest.mark.parametrize(
    ("number", "kind"),
    [
        (errno.ETIMEDOUT, DeviceTimeoutError),
        (errno.EPIPE, LinkStallError),
        (errno.ENODEV, DeviceLostError),
        (errno.EIO, DeviceLostError),
        (errno.EOVERFLOW, ProtocolViolationError),
        (errno.EACCES, DevicePermissionError),
        (None, DeviceLostError),
    ],
)
@pytest.mark.parametrize("call", ["read", "write", "control"])
def test_numbers_of_failed_transfers_become_typed_errors(
    call: str, number: int | None, kind: type[DeviceError]
) -> None:
    device = FakeDevice()
    link = open_link(device)
    calls: dict[str, Callable[[], object]] = {
        "read": lambda: link.read(512, 1.0),
        "write": lambda: link.write(b"x", 1.0),
        "control": lambda: link.control_out(0x66, b"", 1.0),
    }
    device.fail[call] = usb_error(number)
    device.incoming[0x81].append(usb_error(number))
    with pytest.raises(kind) as caught:
        calls[call]()
    assert caught.value.details["errno"] == number


def test_events_that_do_not_come_are_none() -> None:
    link = open_link(FakeDevice())
    assert link.read_event(0.05) is None


def test_event_endpoint_is_read_packet_by_packet() -> None:
    device = FakeDevice(endpoints=((0x81, 2, 512), (0x01, 2, 512), (0x82, 3, 8)))
    link = open_link(device)
    device.incoming[0x82].extend([event(0x4002, 1, 7)[:8], event(0x4002, 1, 7)[8:], usb_error(errno.ENODEV)])
    assert link.read_event(1.0) == event(0x4002, 1, 7)[:8]
    assert link.read_event(1.0) == event(0x4002, 1, 7)[8:]
    with pytest.raises(DeviceLostError):
        link.read_event(1.0)


def test_zero_length_packets_both_ways() -> None:
    device = FakeDevice()
    link = open_link(device)
    device.incoming[0x81].append(b"")
    link.write(b"", 1.0)
    assert device.sent == [(1, b"")]
    assert link.read(512, 1.0) == b""


def test_write_goes_on_where_a_part_was_taken() -> None:
    device = FakeDevice()
    link = open_link(device)
    device.take_at_most = 512
    link.write(bytes(1200), 1.0)
    assert [len(piece) for _, piece in device.sent] == [512, 512, 176]


def test_write_of_which_nothing_more_is_taken_times_out() -> None:
    device = FakeDevice()
    link = open_link(device)
    device.take_at_most = 0
    with pytest.raises(DeviceTimeoutError, match="10 bytes were not taken"):
        link.write(bytes(10), 1.0)


@pytest.mark.parametrize(("limit_s", "limit_ms"), [(0.0, 1), (0.0001, 1), (0.0501, 51), (20.0, 20_000)])
def test_limits_reach_libusb_in_milliseconds_never_zero(limit_s: float, limit_ms: int) -> None:
    device = FakeDevice()
    link = open_link(device)
    with pytest.raises(DeviceTimeoutError):
        link.read(512, limit_s)
    link.read_event(limit_s)
    assert device.limits_ms == [limit_ms] * 2


def test_class_requests_to_the_byte() -> None:
    device = FakeDevice()
    link = open_link(device)
    link.control_out(0x64, bytes.fromhex("014009000000"), 1.0)
    link.control_out(0x66, b"", 1.0)
    assert link.control_in(0x67, 32, 1.0) == bytes.fromhex("04000120")
    assert device.control == [
        (0x21, 0x64, 0, 0, bytes.fromhex("014009000000")),
        (0x21, 0x66, 0, 0, b""),
        (0xA1, 0x67, 0, 0, 32),
    ]


# Closing, resetting, opening anew.


def test_closed_link_says_so() -> None:
    device = FakeDevice()
    link = open_link(device)
    link.close()
    link.close()
    assert device.calls[-2:] == ["release", "close"]
    for call in (lambda: link.write(b"x", 1.0), lambda: link.read(512, 1.0), link.reset):
        with pytest.raises(DeviceLostError, match="closed"):
            call()


@pytest.mark.parametrize("call", ["release", "close"])
def test_closing_never_raises(call: str) -> None:
    device = FakeDevice()
    link = open_link(device)
    device.fail[call] = usb_error(errno.ENODEV)
    link.close()
    assert call in device.calls
    with pytest.raises(DeviceLostError, match="closed"):
        link.read(512, 1.0)


def test_reset_then_opening_anew_finds_the_camera_at_its_new_address() -> None:
    device = FakeDevice(serial="1001")
    link = open_link(device, serial="1001")
    backend: FakeBackend = link._backend
    link.reset()
    assert "reset" in device.calls
    again = FakeDevice(serial="1001", address=9)
    backend.devices = []
    with pytest.raises(DeviceNotFoundError):
        link.reopen()
    backend.devices = [again]
    link.reopen()
    link.write(b"x", 1.0)
    assert again.sent == [(1, b"x")]


def test_reset_of_a_camera_that_has_left_closes_the_link() -> None:
    device = FakeDevice()
    link = open_link(device)
    device.fail["reset"] = usb_error(errno.ENOENT)
    with pytest.raises(DeviceLostError):
        link.reset()
    with pytest.raises(DeviceLostError, match="closed"):
        link.read(512, 1.0)


def test_session_over_the_link() -> None:
    device = FakeDevice()
    device.answers = {
        command(0x1002, 0, 1): [(0x81, response(0x2001, 0))],
        command(0x101B, 1, 5, 0, 700): [
            (0x81, data(0x101B, 1, bytes(700))),
            (0x81, response(0x2001, 1, 700)),
            (0x82, event(0x4002, 1, 7)[:8]),
            (0x82, event(0x4002, 1, 7)[8:]),
        ],
        command(0x1003, 2): [(0x81, response(0x2001, 2))],
    }
    clock = FakeClock()
    link = UsbLink.open(*THETA, backend=FakeBackend(device), clock=clock)
    session = PtpSession(link, clock, name="Theta")
    session.open()
    assert session.get_partial_object(5, 0, 700) == bytes(700)
    assert session.poll_event(0.05).params == (7,)  # type: ignore[union-attr]
    session.close()
    assert device.calls[-1] == "close"


def test_unknown_numbers_count_as_a_lost_camera() -> None:
    assert isinstance(typed_error(errno.EPROTO, "odd", "camera"), DeviceLostError)


def test_real_libusb_loads_and_lists() -> None:
    if usb_link.real_backend() is None:
        pytest.skip("no libusb on this machine")
    assert all(isinstance(camera, UsbDeviceInfo) for camera in list_cameras())

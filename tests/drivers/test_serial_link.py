"""The real pyserial over a pseudo-terminal: deadlines, bounds, and what the system says as typed errors."""

from __future__ import annotations

import errno
import os
import subprocess
import sys
import termios
from collections.abc import Iterator
from pathlib import Path

import pytest
from serial.tools.list_ports_common import ListPortInfo

from drivers import serial_link
from drivers.clock import SystemClock
from drivers.errors import (
    DeviceClaimedError,
    DeviceLostError,
    DeviceNotFoundError,
    DevicePermissionError,
    DeviceTimeoutError,
)
from drivers.link_errors import find_holder, open_error
from drivers.meter.dialect import load_dialect
from drivers.meter.ls160 import KonicaMinoltaMeter
from drivers.serial_link import (
    PortInfo,
    PortOpener,
    PortSettings,
    SerialLink,
    find_port,
    list_ports,
)
from mocks.instruments.ls160 import MeterFault, MeterFaultKind, SimulatedMeter
from mocks.instruments.serial_port import Piece, SerialPort

IDS = [(0x132B, 0x210D)]
SEVEN_E_TWO = PortSettings(4800, 7, "even", 2, rts_handshake=True)


class Parrot:
    """Says back what it hears, and more on request."""

    line_end = b"\r\n"

    def hear(self, line: bytes, now_s: float) -> list[Piece]:
        if line == b"slow":
            return [Piece(0.01 * n, bytes([b])) for n, b in enumerate(b"s l o w\r\n")]
        if line == b"half":
            return [Piece(0.0, b"half a li")]
        return [Piece(0.0, line + b"\r\n")]


@pytest.fixture
def port() -> Iterator[SerialPort]:
    port = SerialPort(Parrot())
    yield port
    port.close()


@pytest.fixture
def link(port: SerialPort) -> Iterator[SerialLink]:
    link = SerialLink.open(port.name, SEVEN_E_TWO)
    yield link
    link.close()


def ask(link: SerialLink, question: bytes, max_bytes: int = 64, timeout_s: float = 5.0) -> bytes:
    link.write(question + b"\r\n", 1.0)
    return link.read_line(b"\r\n", max_bytes, timeout_s)


def test_lines_come_back_whole_however_they_are_cut(link: SerialLink) -> None:
    assert ask(link, b"hello") == b"hello"
    assert ask(link, b"slow") == b"s l o w"
    link.write(b"one\r\ntwo\r\n", 1.0)
    assert [link.read_line(b"\r\n", 64, 5.0) for _ in range(2)] == [b"one", b"two"]


def test_half_a_line_is_a_timeout_that_keeps_it_and_is_not_glued_to_the_next(link: SerialLink) -> None:
    with pytest.raises(DeviceTimeoutError) as caught:
        ask(link, b"half", timeout_s=0.2)
    assert bytes.fromhex(caught.value.details["partial"]) == b"half a li"
    assert ask(link, b"next") == b"next"


def test_a_flood_is_cut_and_can_be_drained(port: SerialPort, link: SerialLink) -> None:
    port.inject(b"U" * 3_000)
    line = link.read_line(b"\r\n", 64, 5.0)
    assert set(line) == {ord("U")}
    assert len(line) == 65, "one more than allowed, so that nobody takes it for a line"
    assert link.drain(0.1, 5.0) >= 2_900
    assert ask(link, b"again") == b"again"


def test_drain_without_waiting_takes_what_is_there(port: SerialPort, link: SerialLink) -> None:
    assert link.drain(0.0, 0.5) == 0
    port.inject(b"old news\r\n")
    assert ask(link, b"x") == b"old news", "it was there first"
    link.drain(0.1, 1.0)
    assert ask(link, b"y") == b"y"


def test_an_endless_flood_does_not_hold_drain_for_ever(port: SerialPort, link: SerialLink) -> None:
    class Endless:
        in_waiting = 10

        def reset_output_buffer(self) -> None:
            pass

        def read(self, size: int) -> bytes:
            return b"U" * size

    flooded = SerialLink(Endless(), "flood", SystemClock())  # type: ignore[arg-type]
    assert flooded.drain(0.05, 0.1) > 0


def test_a_byte_with_a_wrong_parity_bit_is_asked_to_come_as_nul(port: SerialPort) -> None:
    def flags(settings: PortSettings) -> int:
        link = SerialLink.open(port.name, settings)
        value: int = termios.tcgetattr(link._port.fd)[0]
        link.close()
        return value

    assert flags(SEVEN_E_TWO) & termios.INPCK
    assert not flags(SEVEN_E_TWO) & (termios.IGNPAR | termios.PARMRK | termios.ISTRIP)
    assert not flags(PortSettings(9600)) & termios.INPCK


def test_pulling_the_plug_is_a_loss(port: SerialPort, link: SerialLink) -> None:
    port.close()
    with pytest.raises(DeviceLostError, match="cable"):
        link.read_line(b"\r\n", 64, 5.0)
    with pytest.raises(DeviceLostError):
        link.drain(0.1, 1.0)
    with pytest.raises(DeviceLostError):
        link.write(b"MES\r\n", 0.2)
    link.close()


def test_no_room_on_the_line_is_a_timeout_and_what_waits_is_dropped() -> None:
    class Full:
        dropped = 0

        def write(self, data: bytes) -> int:
            raise serial_link.serial.SerialTimeoutException

        def reset_output_buffer(self) -> None:
            self.dropped += 1

    port = Full()
    with pytest.raises(DeviceTimeoutError, match="handshake"):
        SerialLink(port, "full", SystemClock()).write(b"MES\r\n", 2.0)  # type: ignore[arg-type]
    assert port.dropped == 1


def test_a_line_of_just_the_largest_size_is_whole(port: SerialPort, link: SerialLink) -> None:
    port.inject(b"x" * 64 + b"\r")
    port.inject(b"\n")
    assert link.read_line(b"\r\n", 64, 5.0) == b"x" * 64
    port.inject(b"x" * 65 + b"\r\n")
    assert len(link.read_line(b"\r\n", 64, 5.0)) == 65


def test_a_port_belongs_to_one(port: SerialPort, link: SerialLink) -> None:
    with pytest.raises(DeviceClaimedError, match=r"holds the port"):
        SerialLink.open(port.name, SEVEN_E_TWO)
    link.close()
    SerialLink.open(port.name, SEVEN_E_TWO).close()


def test_who_holds_the_port_is_named(port: SerialPort) -> None:
    code = (
        "import fcntl, os, sys; fd = os.open(sys.argv[1], os.O_RDWR | os.O_NOCTTY);"
        "fcntl.flock(fd, fcntl.LOCK_EX); print('held', flush=True); sys.stdin.read()"
    )
    command = [sys.executable, "-c", code, port.name]
    with subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE) as other:
        assert other.stdout is not None
        other.stdout.readline()
        with pytest.raises(DeviceClaimedError, match=f"pid {other.pid}") as caught:
            SerialLink.open(port.name, SEVEN_E_TWO)
        other.communicate()
    assert "python" in caught.value.details["holder"]


def test_nobody_holds_what_nobody_has(tmp_path: Path) -> None:
    assert find_holder(str(tmp_path / "tty")) == ""
    assert find_holder("tty", proc=tmp_path / "no-proc") == ""


@pytest.mark.parametrize(
    ("number", "kind"),
    [
        (errno.ENOENT, DeviceNotFoundError),
        (errno.ENXIO, DeviceNotFoundError),
        (errno.EACCES, DevicePermissionError),
        (errno.EPERM, DevicePermissionError),
        (errno.EBUSY, DeviceClaimedError),
        (errno.EAGAIN, DeviceClaimedError),
        (errno.EIO, DeviceLostError),
    ],
)
def test_what_the_system_says_is_typed(number: int, kind: type[Exception]) -> None:
    error = open_error(OSError(number, "text"), "/dev/ttyNONE")
    assert type(error) is kind
    assert error.advice


def test_what_is_no_serial_port_is_not_to_be_plugged_in_again() -> None:
    with pytest.raises(DeviceNotFoundError, match="no such port"):
        SerialLink.open(os.devnull, PortSettings(9600))


def test_a_port_without_a_descriptor_works() -> None:
    """As pyserial's of serial-device servers (socket://host:port)."""
    link = SerialLink.open("loop://", PortSettings(9600, data_bits=7, parity="even"))
    link.write(b"MES\r\n", 1.0)
    assert link.read_line(b"\r\n", 80, 1.0) == b"MES"
    link.close()


def test_missing_port_is_not_found() -> None:
    with pytest.raises(DeviceNotFoundError):
        SerialLink.open("/dev/no-such-port", PortSettings(9600))


def test_ports_are_listed_with_their_lasting_names(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    device = tmp_path / "ttyACM3"
    device.touch()
    by_id = tmp_path / "by-id"
    by_id.mkdir()
    (by_id / "usb-KM_LS-160_12345678-if00").symlink_to(device)
    found, plain = ListPortInfo(str(device)), ListPortInfo("/dev/ttyS0")
    found.vid, found.pid, found.serial_number, found.product = 0x132B, 0x210D, "12345678", "LS-160"
    monkeypatch.setattr(serial_link, "BY_ID", by_id)
    monkeypatch.setattr(serial_link.serial_list_ports, "comports", lambda: [plain, found])
    listed = {p.device: p for p in list_ports()}
    assert listed[str(device)].stable_name == str(by_id / "usb-KM_LS-160_12345678-if00")
    assert (listed[str(device)].serial, listed[str(device)].product) == ("12345678", "LS-160")
    assert listed["/dev/ttyS0"] == PortInfo("/dev/ttyS0", "/dev/ttyS0", "n/a", None, None, "")


def info(device: str, serial: str, ids: tuple[int, int] = (0x132B, 0x210D)) -> PortInfo:
    return PortInfo(device, f"/dev/serial/by-id/{serial}", "", *ids, serial=serial)


def test_the_only_meter_is_found_by_its_usb_ids() -> None:
    ports = [info("/dev/ttyACM0", "A"), info("/dev/ttyS0", "", (1, 2))]
    assert find_port(IDS, ports=lambda: ports) == "/dev/serial/by-id/A"
    with pytest.raises(DeviceNotFoundError, match="2 meters"):
        find_port(IDS, ports=lambda: [*ports, info("/dev/ttyACM1", "B")])
    with pytest.raises(DeviceNotFoundError, match="no meter"):
        find_port(IDS, ports=lambda: ports[1:])


@pytest.mark.parametrize("asked", ["auto", "by number"])
def test_the_same_instrument_is_opened_again_under_its_new_number(port: SerialPort, asked: str) -> None:
    other = SerialPort(Parrot())
    ports = [PortInfo(port.name, port.name, "", *IDS[0], serial="A")]
    opener = PortOpener(
        port.name if asked == "by number" else "auto", SEVEN_E_TWO, usb_ids=IDS, ports=lambda: list(ports)
    )
    first = opener()
    old_name = first.name
    first.close()
    port.replug()
    assert port.name != old_name
    ports[:] = [
        PortInfo(other.name, other.name, "", *IDS[0], serial="B"),
        PortInfo(port.name, port.name, "", *IDS[0], serial="A"),
    ]
    second = opener()
    assert second.name == port.name
    second.close()
    del ports[1]
    with pytest.raises(DeviceNotFoundError, match="serial number A"):
        opener()
    other.close()


def test_a_meter_that_is_unplugged_and_renumbered_is_read_on(tmp_path: Path) -> None:
    instrument = SimulatedMeter(
        lambda _t: 1019.0, measuring_s=0.02, noise_frac=0, faults=(MeterFault(MeterFaultKind.UNPLUG, first=2, last=2),)
    )
    stable = tmp_path / "usb-meter"
    port = SerialPort(instrument, stable_name=stable)
    dialect = load_dialect("ls100")
    opened: list[str] = []
    opener = PortOpener(str(stable), dialect.port, ports=list)

    def open_line() -> SerialLink:
        if opened:
            port.replug()
        opened.append(str(stable.readlink()))
        return opener()

    meter = KonicaMinoltaMeter(open_line, dialect, SystemClock())
    try:
        meter.connect()
        assert meter.measure(n_samples=2).luminance_cd_m2 == 1019.0
    finally:
        meter.close()
        port.close()
    assert len(set(opened)) == 2

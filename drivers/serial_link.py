"""Lines over a serial port: the only file that knows pyserial. Every call has a deadline, every buffer a bound."""

import os
import sys
from collections.abc import Callable, Collection
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Literal, NoReturn, Protocol, Self

import serial
from pydantic import ConfigDict, Field
from pydantic.dataclasses import dataclass as checked_dataclass
from serial.tools import list_ports as serial_list_ports

from drivers.clock import Clock, Deadline, SystemClock
from drivers.errors import DeviceLostError, DeviceNotFoundError, DeviceTimeoutError
from drivers.link_errors import open_error

POLL_S = 0.05  # longest single wait inside pyserial; deadlines are looked at in between
STALL_S = 0.5  # a line that takes no bytes for so long will not take them (pyserial counts this in real time)
STEP_S = 0.005  # pause between two looks at a line that should stay quiet
_GONE: tuple[type[Exception], ...] = (OSError, TypeError, AttributeError)
"""What pyserial raises when the port vanishes under it; its file descriptor may be None by then."""
if sys.platform != "win32":
    import fcntl
    import termios

    _GONE += (termios.error,)
_NOT_OPENED: tuple[type[Exception], ...] = (*_GONE, ValueError)
BY_ID = Path("/dev/serial/by-id")
_PARITY = {"none": serial.PARITY_NONE, "even": serial.PARITY_EVEN, "odd": serial.PARITY_ODD}


@checked_dataclass(frozen=True, config=ConfigDict(extra="forbid"))
class PortSettings:
    """Line settings of a serial port; ``[port]`` of a dialect."""

    baud: Annotated[int, Field(ge=300, le=3_000_000)]
    data_bits: Literal[7, 8] = 8
    parity: Literal["none", "even", "odd"] = "none"
    stop_bits: Literal[1, 2] = 1
    rts_handshake: bool = False


@dataclass(frozen=True)
class PortInfo:
    """A serial port as the system lists it; ``stable_name`` survives renumbering where the system has such names."""

    device: str
    stable_name: str
    description: str
    vendor_id: int | None
    product_id: int | None
    serial: str
    product: str = ""
    manufacturer: str = ""
    location: str = ""


class ByteLine(Protocol):
    """A line of text with an instrument at its end."""

    name: str

    def write(self, data: bytes, timeout_s: float) -> None:
        """Send all bytes."""

    def read_line(self, delimiter: bytes, max_bytes: int, timeout_s: float) -> bytes:
        """Return bytes up to and without ``delimiter``.

        `DeviceTimeoutError` when no delimiter comes in time (``details["partial"]`` has what came); a line longer
        than ``max_bytes`` is cut there and returned, for the parser to refuse.
        """

    def drain(self, quiet_s: float, limit_s: float) -> int:
        """Throw away what comes until the line was quiet for ``quiet_s`` or ``limit_s`` is over; returns the bytes."""

    def close(self) -> None:
        """Give the line back; never raises."""


class SerialLink:
    """A serial port; make it with `open`."""

    def __init__(self, port: serial.Serial, name: str, clock: Clock) -> None:
        self.name = name
        self._port = port
        self._clock = clock
        self._buffer = bytearray()

    @classmethod
    def open(cls, name: str, settings: PortSettings, *, clock: Clock | None = None) -> Self:
        """Open a port for ourselves alone.

        Raises `DeviceNotFoundError, DevicePermissionError, DeviceClaimedError, DeviceLostError`: as the operating
        system says.
        """
        try:
            port = serial.serial_for_url(
                name,
                baudrate=settings.baud,
                bytesize=settings.data_bits,
                parity=_PARITY[settings.parity],
                stopbits=settings.stop_bits,
                timeout=POLL_S,
                write_timeout=STALL_S,
                rtscts=settings.rts_handshake,
                exclusive=True if os.name == "posix" else None,
                do_not_open=True,
            )
            port.open()
            _refuse_parity_errors(port)
            _keep_others_out(port, keep=True)
        except _NOT_OPENED as error:
            raise open_error(error, name) from error
        return cls(port, name, clock or SystemClock())

    def write(self, data: bytes, timeout_s: float) -> None:
        """Send all bytes; `DeviceTimeoutError` when the line does not take them within ``timeout_s`` or `STALL_S`.

        What was not sent by then is dropped: the instrument must not get it later.
        """
        try:
            self._port.write(data)
        except serial.SerialTimeoutException as error:
            self._drop_unsent()
            text, limit_s = "the port does not accept data", min(timeout_s, STALL_S)
            likely = "a handshake line is missing in the cable, or the meter is off"
            advice = "switch it on; with a three-wire cable: rts_handshake = false in a dialect of your own"
            raise DeviceTimeoutError(text, where=self.name, likely=likely, advice=advice, limit_s=limit_s) from error
        except _GONE as error:
            self._lost(error)

    def read_line(self, delimiter: bytes, max_bytes: int, timeout_s: float) -> bytes:
        """See `ByteLine.read_line`."""
        deadline = Deadline.after(self._clock, timeout_s)
        while True:
            found = self._buffer.find(delimiter)
            if 0 <= found <= max_bytes:
                line = bytes(self._buffer[:found])
                del self._buffer[: found + len(delimiter)]
                return line
            if len(self._buffer) >= max_bytes + len(delimiter):
                line = bytes(self._buffer[: max_bytes + 1])
                self._buffer.clear()
                return line
            if deadline.expired:
                partial = bytes(self._buffer)
                self._buffer.clear()
                text = f"no complete line within {timeout_s:g} s"
                likely = "the meter is off, not in remote mode, or speaks another dialect"
                advice = "switch it on as its manual says for remote work; try: daylit meter probe"
                raise DeviceTimeoutError(
                    text, where=self.name, likely=likely, advice=advice, partial=partial.hex(), limit_s=timeout_s
                )
            self._buffer += self._read(max_bytes + len(delimiter))

    def drain(self, quiet_s: float, limit_s: float) -> int:
        """See `ByteLine.drain`; what was not sent yet is dropped, too."""
        self._drop_unsent()
        dropped = len(self._buffer)
        self._buffer.clear()
        deadline = Deadline.after(self._clock, limit_s)
        quiet = Deadline.after(self._clock, quiet_s)
        while True:
            waiting = self._waiting()
            if waiting:
                dropped += len(self._read(min(waiting, 4096)))
                quiet = Deadline.after(self._clock, quiet_s)
            if deadline.expired or (quiet.expired and not waiting):
                return dropped
            if not waiting:
                self._clock.sleep(min(STEP_S, quiet.remaining_s))

    def close(self) -> None:
        """Give the port back; never raises."""
        with suppress(*_GONE):  # already gone
            _keep_others_out(self._port, keep=False)
            self._port.close()

    def _drop_unsent(self) -> None:
        try:
            self._port.reset_output_buffer()
        except _GONE as error:
            self._lost(error)

    def _waiting(self) -> int:
        try:
            return int(self._port.in_waiting)
        except _GONE as error:
            self._lost(error)

    def _read(self, max_bytes: int) -> bytes:
        waiting = self._waiting()
        try:
            return bytes(self._port.read(min(max(waiting, 1), max_bytes)))
        except _GONE as error:
            self._lost(error)

    def _lost(self, error: Exception) -> NoReturn:
        raise DeviceLostError(
            f"the line is gone: {error}", where=self.name, likely="the cable was pulled", advice="plug it in, resume"
        ) from error


def _refuse_parity_errors(port: serial.Serial) -> None:
    """Let a byte with a wrong parity bit arrive as NUL, which no dialect accepts; pyserial lets it through as it is."""
    if sys.platform == "win32" or (fd := getattr(port, "fd", None)) is None or port.parity == serial.PARITY_NONE:
        return
    attributes = termios.tcgetattr(fd)
    attributes[0] = (attributes[0] | termios.INPCK) & ~(termios.IGNPAR | termios.PARMRK | termios.ISTRIP)
    termios.tcsetattr(fd, termios.TCSANOW, attributes)


def _keep_others_out(port: serial.Serial, *, keep: bool) -> None:
    """Let the system refuse the port to others (ModemManager does not look at pyserial's lock)."""
    if sys.platform == "win32" or (fd := getattr(port, "fd", None)) is None:  # on Windows a port belongs to one anyway
        return
    with suppress(OSError):  # a line that cannot do this works all the same
        fcntl.ioctl(fd, termios.TIOCEXCL if keep else termios.TIOCNXCL)


def list_ports() -> list[PortInfo]:
    """Return the serial ports of this computer, with the names that survive renumbering."""
    links = sorted(BY_ID.iterdir()) if BY_ID.is_dir() else []
    stable = {os.path.realpath(link): str(link) for link in links}
    return [
        PortInfo(
            device=p.device,
            stable_name=stable.get(os.path.realpath(p.device), p.device),
            description=p.description or "",
            vendor_id=p.vid,
            product_id=p.pid,
            serial=p.serial_number or "",
            product=p.product or "",
            manufacturer=p.manufacturer or "",
            location=p.location or "",
        )
        for p in sorted(serial_list_ports.comports(), key=lambda p: str(p.device))
    ]


class PortOpener:
    """Opens the port of one and the same instrument each time, whatever number it has by then.

    ``port``: name of the port, or ``"auto"``: the only one with one of the ``usb_ids``.
    ``ports``: lists the ports.
    """

    def __init__(
        self,
        port: str,
        settings: PortSettings,
        *,
        usb_ids: Collection[tuple[int, int]] = (),
        clock: Clock | None = None,
        ports: Callable[[], list[PortInfo]] | None = None,
    ) -> None:
        self._port = port
        self._settings = settings
        self._usb_ids = usb_ids
        self._clock = clock
        self._ports = ports or list_ports
        self._known: PortInfo | None = None

    def __call__(self) -> SerialLink:
        """Open the port.

        Raises `DeviceNotFoundError`: the instrument that was there before is not there now (another one does not
        count), or none is; `DeviceError`: see `SerialLink.open`.
        """
        name = self._name_now()
        link = SerialLink.open(name, self._settings, clock=self._clock)
        real = os.path.realpath(name)
        self._known = next((p for p in self._ports() if os.path.realpath(p.device) == real), self._known)
        return link

    def _name_now(self) -> str:
        if self._known is None or not self._known.serial:
            return find_port(self._usb_ids, ports=self._ports) if self._port == "auto" else self._port
        known = self._known
        same = (known.vendor_id, known.product_id, known.serial)
        for port in self._ports():
            if (port.vendor_id, port.product_id, port.serial) == same:
                return port.device
        text = f"the instrument with serial number {known.serial} is not among the ports"
        advice = "plug it into any socket"
        raise DeviceNotFoundError(text, where=self._port, likely="it is unplugged or off", advice=advice)


def find_port(usb_ids: Collection[tuple[int, int]], *, ports: Callable[[], list[PortInfo]] = list_ports) -> str:
    """Return the port of the instrument with one of these USB ids; `DeviceNotFoundError`: none, or several."""
    found = [p for p in ports() if (p.vendor_id, p.product_id) in usb_ids]
    if len(found) == 1:
        return found[0].stable_name
    what = "no meter" if not found else f"{len(found)} meters ({', '.join(p.device for p in found)})"
    likely = "it is off, or it sits on an RS-232 adapter that does not show what is behind it"
    advice = 'name the port: --port, or in the rig [meter] port = "/dev/ttyUSB0"'
    raise DeviceNotFoundError(f"{what} among the serial ports", where="meter", likely=likely, advice=advice)

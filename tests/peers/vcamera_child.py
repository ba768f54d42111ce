"""The virtual camera of libgphoto2 in a process of its own: its state is global and native, each test needs a new one.

Run by `tests.peers.vcamera`: ``python vcamera_child.py SOCKET VUSB``; VCAMERADIR names the folder of the camera's
files, IOLIBS that of the library VUSB. It answers calls that come in over the socket until that is closed.
"""

from __future__ import annotations

import ctypes
import sys
from collections.abc import Callable
from multiprocessing.connection import Connection
from typing import Any

PORT_PATH = b"usb:001,001"
NIKON_D750 = (0x04B0, 0x0437)
WRITE_BYTES = 4096


class UsbSettings(ctypes.Structure):
    """Endpoints of the camera, as the library reports them."""

    _fields_ = [
        (name, ctypes.c_int) for name in ("inep", "outep", "intep", "config", "interface", "alternate", "packet")
    ]


class Settings(ctypes.Union):
    """Room for the settings of any port; those of USB are not the longest."""

    _fields_ = [("usb", UsbSettings), ("room", ctypes.c_char * WRITE_BYTES)]


class PortError(Exception):
    """A call of the library ended with this negative result."""


class VirtualPort:
    """One port of libgphoto2_port with the virtual camera behind it."""

    def __init__(self, library: str) -> None:
        # Linked to libgphoto2_port, whose functions are found through it; alone that one lacks its neighbours.
        self._lib = ctypes.CDLL(library)
        self._info = self._look_up()
        self._port = self._open_port()

    def _call(self, name: str, *args: Any) -> int:
        result = int(getattr(self._lib, name)(*args))
        if result < 0:
            raise PortError(result, name)
        return result

    def _look_up(self) -> ctypes.c_void_p:
        ports, info = ctypes.c_void_p(), ctypes.c_void_p()
        self._call("gp_port_info_list_new", ctypes.byref(ports))
        self._call("gp_port_info_list_load", ports)
        self._call("gp_port_info_list_count", ports)
        index = self._call("gp_port_info_list_lookup_path", ports, PORT_PATH)
        self._call("gp_port_info_list_get_info", ports, index, ctypes.byref(info))
        return info

    def _open_port(self) -> ctypes.c_void_p:
        port = ctypes.c_void_p()
        self._call("gp_port_new", ctypes.byref(port))
        self._call("gp_port_set_info", port, self._info)
        self._call("gp_port_usb_find_device", port, *NIKON_D750)
        self._call("gp_port_open", port)
        return port

    def endpoints(self) -> tuple[int, int, int, int]:
        """Return the addresses of bulk IN, bulk OUT and interrupt IN, and the packet size in bytes."""
        settings = Settings()
        self._call("gp_port_get_settings", self._port, ctypes.byref(settings))
        usb = settings.usb
        return usb.inep, usb.outep, usb.intep, usb.packet

    def restart(self) -> None:
        """Put a new camera on a new port: once closed, a port of this library writes to memory it has given back."""
        self._call("gp_port_close", self._port)
        self._call("gp_port_free", self._port)
        self._port = self._open_port()

    def write(self, data: bytes) -> int:
        """Write to bulk OUT; return the count."""
        return self._call("gp_port_write", self._port, data, len(data))

    def read(self, size_bytes: int) -> bytes:
        """Read from bulk IN; nothing there is no bytes."""
        buffer = ctypes.create_string_buffer(size_bytes)
        got = self._call("gp_port_read", self._port, buffer, size_bytes)
        return buffer.raw[:got]

    def read_event(self, size_bytes: int, timeout_ms: int) -> bytes:
        """Read from interrupt IN."""
        buffer = ctypes.create_string_buffer(size_bytes)
        self._call("gp_port_set_timeout", self._port, timeout_ms)
        got = self._call("gp_port_check_int", self._port, buffer, size_bytes)
        return buffer.raw[:got]

    def clear_halt(self, index: int) -> None:
        """Clear the halt of bulk IN 0, bulk OUT 1 or interrupt IN 2."""
        self._call("gp_port_usb_clear_halt", self._port, index)

    def class_out(self, request: int, value: int, index: int, data: bytes) -> int:
        """Send a class request."""
        return self._call("gp_port_usb_msg_class_write", self._port, request, value, index, data, len(data))

    def class_in(self, request: int, value: int, index: int, length: int) -> bytes:
        """Return the answer to a class request."""
        buffer = ctypes.create_string_buffer(length)
        got = self._call("gp_port_usb_msg_class_read", self._port, request, value, index, buffer, length)
        return buffer.raw[:got]


def serve(connection: Connection, library: str) -> None:
    """Answer ``(method, arguments)`` with ``(result, None)`` or ``(None, code)`` until the other end closes."""
    port = VirtualPort(library)
    while True:
        try:
            name, args = connection.recv()
        except EOFError:
            return
        method: Callable[..., Any] = getattr(port, name)
        try:
            connection.send((method(*args), None))
        except PortError as error:
            connection.send((None, error.args))


if __name__ == "__main__":
    serve(Connection(int(sys.argv[1])), sys.argv[2])

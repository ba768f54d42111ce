"""libgphoto2's virtual camera as a USB device: a pyusb backend, so that our whole stack runs against a foreign camera.

Four things are ours, since the library leaves them out: descriptors (endpoints and packet size are the library's own);
a time-out where nothing is there to read; no string descriptors; and a port reset that restarts the camera, as it would
a real one (the library's own does nothing).
"""

from __future__ import annotations

import errno
import importlib.util
import os
import subprocess
import sys
from collections.abc import Iterator
from multiprocessing import Pipe
from pathlib import Path
from types import TracebackType
from typing import Any, Self

import usb.core
from usb.backend import IBackend

from mocks.instruments.usb.bus import (
    CONFIGURATION,
    INTERFACE,
    Descriptor,
    device_descriptor,
    endpoint_descriptors,
)

NO_LIBRARY = "the virtual camera needs Linux and the wheel gphoto2 (pip install gphoto2)"
USB_IDS = (0x04B0, 0x0437)
GP_ERROR_TIMEOUT = -10
EVENT_PACKET_BYTES = 32
"""The library drops what of an event does not fit, so that a packet has to hold a whole one."""
CALL_LIMIT_S = 30.0
CLASS_OUT, CLASS_IN = 0x21, 0xA1
CHILD = Path(__file__).with_name("vcamera_child.py")


def find_library() -> Path | None:
    """Return the library of the virtual camera in the gphoto2 wheel; None where there is none."""
    spec = importlib.util.find_spec("gphoto2") if sys.platform == "linux" else None
    if spec is None or spec.origin is None:
        return None
    library = Path(spec.origin).parent / "libgphoto2" / "vusb" / "vusb.so"
    return library if library.exists() else None


class VirtualCamera:
    """A virtual camera with the files of a folder, in its own process. Use it in a ``with`` statement."""

    def __init__(self, folder: Path) -> None:
        library = find_library()
        assert library is not None, "ask find_library first"
        ours, theirs = Pipe()
        with theirs:
            self._process = subprocess.Popen(
                [sys.executable, "-I", str(CHILD), str(theirs.fileno()), str(library)],
                env={**os.environ, "VCAMERADIR": str(folder), "IOLIBS": str(library.parent)},
                pass_fds=(theirs.fileno(),),
                stdin=subprocess.DEVNULL,
            )
        self._connection = ours

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, _kind: type[BaseException] | None, _error: BaseException | None, _trace: TracebackType | None
    ) -> None:
        self._connection.close()
        try:
            self._process.wait(CALL_LIMIT_S)
        except subprocess.TimeoutExpired:
            self._process.kill()
            self._process.wait()
            raise

    def call(self, name: str, *args: Any, limit_s: float = CALL_LIMIT_S) -> Any:
        """Return what a method of `tests.peers.vcamera_child.VirtualPort` returns; USB errors as pyusb raises them."""
        try:
            self._connection.send((name, args))
            assert self._connection.poll(limit_s), f"the virtual camera does not come back from {name}"
            result, failure = self._connection.recv()
        except (EOFError, OSError) as error:
            status = self._process.wait(CALL_LIMIT_S)
            raise AssertionError(f"the virtual camera died in {name} with status {status}") from error
        if failure is None:
            return result
        if failure[0] == GP_ERROR_TIMEOUT:
            raise usb.core.USBTimeoutError("Operation timed out", failure[0], errno.ETIMEDOUT)
        raise usb.core.USBError(f"{failure[1]}: libgphoto2 error {failure[0]}", failure[0], errno.EIO)


class VirtualCameraBackend(IBackend):  # type: ignore[misc]
    """Pass it to ``UsbLink.open(backend=...)``."""

    def __init__(self, camera: VirtualCamera) -> None:
        self.camera = camera
        self.transfers: list[bytes] = []
        """All bulk-in transfers."""
        self.resets = 0
        *self.addresses, self.packet_bytes = camera.call("endpoints")

    def enumerate_devices(self) -> Iterator[VirtualCamera]:
        yield self.camera

    def get_parent(self, _dev: Any) -> None:
        return None

    def get_device_descriptor(self, _dev: Any) -> Descriptor:
        return device_descriptor(USB_IDS, 0, 1, 1)

    def get_configuration_descriptor(self, _dev: Any, config: int) -> Descriptor:
        if config:
            raise IndexError("no such configuration")
        return CONFIGURATION

    def get_interface_descriptor(self, _dev: Any, intf: int, alt: int, config: int) -> Descriptor:
        if intf or alt or config:
            raise IndexError("no such interface")
        return INTERFACE

    def get_endpoint_descriptor(self, _dev: Any, ep: int, _intf: int, _alt: int, _config: int) -> Descriptor:
        bulk_in, bulk_out, event = self.addresses
        found = endpoint_descriptors((bulk_in, bulk_out, event), EVENT_PACKET_BYTES)[ep]
        assert ep == 2 or found.wMaxPacketSize == self.packet_bytes
        return found

    def open_device(self, dev: VirtualCamera) -> VirtualCamera:
        return dev

    def close_device(self, _dev_handle: VirtualCamera) -> None:
        """Do nothing: a camera does not notice who has its handle."""

    def set_configuration(self, _dev_handle: Any, _config_value: int) -> None:
        raise AssertionError("the camera is configured")

    def get_configuration(self, _dev_handle: Any) -> int:
        return 1

    def claim_interface(self, _dev_handle: Any, intf: int) -> None:
        assert intf == 0

    release_interface = claim_interface

    def bulk_write(self, _dev_handle: Any, ep: int, _intf: int, data: Any, _timeout: int) -> int:
        assert ep == self.addresses[1]
        return int(self.camera.call("write", data.tobytes()))

    def bulk_read(self, _dev_handle: Any, ep: int, _intf: int, buff: Any, _timeout: int) -> int:
        assert ep == self.addresses[0]
        got: bytes = self.camera.call("read", len(buff))
        if not got:
            # The camera has answered before the write came back: there is nothing to wait for.
            raise usb.core.USBTimeoutError("Operation timed out", GP_ERROR_TIMEOUT, errno.ETIMEDOUT)
        self.transfers.append(got)
        memoryview(buff)[: len(got)] = memoryview(got)
        return len(got)

    def intr_read(self, _dev_handle: Any, ep: int, _intf: int, buff: Any, timeout: int) -> int:
        assert ep == self.addresses[2]
        limit_s = CALL_LIMIT_S + timeout / 1000
        got: bytes = self.camera.call("read_event", len(buff), timeout, limit_s=limit_s)
        memoryview(buff)[: len(got)] = memoryview(got)
        return len(got)

    def ctrl_transfer(
        self,
        _dev_handle: Any,
        bmRequestType: int,
        bRequest: int,
        wValue: int,
        wIndex: int,
        data: Any,
        _timeout: int,
    ) -> int:
        if bmRequestType == CLASS_OUT:
            self.camera.call("class_out", bRequest, wValue, wIndex, data.tobytes())
            return len(data)
        if bmRequestType != CLASS_IN:
            raise usb.core.USBError("Pipe error", None, errno.EPIPE)
        got: bytes = self.camera.call("class_in", bRequest, wValue, wIndex, len(data))
        memoryview(data)[: len(got)] = memoryview(got)
        return len(got)

    def clear_halt(self, _dev_handle: Any, ep: int) -> None:
        self.camera.call("clear_halt", self.addresses.index(ep))

    def reset_device(self, dev_handle: VirtualCamera) -> None:
        self.resets += 1
        dev_handle.call("restart")

    def is_kernel_driver_active(self, _dev_handle: Any, _intf: int) -> bool:
        return False

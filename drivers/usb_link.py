"""A camera on USB through pyusb: the only file that knows pyusb.

Interface and endpoints are found by descriptor, never assumed: the Theta's bulk-out is 01, the Canon's 02.
"""

import errno
import math
from collections.abc import Callable, Iterator
from contextlib import suppress
from dataclasses import dataclass
from typing import Any, Self, TypeVar

import usb.backend.libusb1
import usb.core
import usb.util

from drivers import errors
from drivers.clock import Clock, Deadline
from drivers.link_errors import SUSPECTS, find_holder, typed_error
from drivers.ptp.codes import STILL_IMAGE_CLASS
from drivers.ptp.pipes import Pipe

CLASS_OUT, CLASS_IN = 0x21, 0xA1
PACKET_MASK = 0x07FF  # wMaxPacketSize holds other things in its upper bits

T = TypeVar("T")


@dataclass(frozen=True)
class UsbDeviceInfo:
    """A camera on the bus; ``product`` is empty where it cannot be read (no permission)."""

    vendor_id: int
    product_id: int
    bus: int
    address: int
    product: str


@dataclass(frozen=True)
class _Endpoints:
    """The still-image interface of a device and its three endpoints."""

    interface: int
    bulk_in: int
    bulk_out: int
    event: int
    max_packet_bytes: int
    event_packet_bytes: int


def real_backend() -> Any | None:
    """Return pyusb's libusb backend: of the libusb_package wheel, else the system's, else None."""
    try:
        import libusb_package
    except ImportError:
        return usb.backend.libusb1.get_backend()
    return libusb_package.get_libusb1_backend() or usb.backend.libusb1.get_backend()


def list_cameras(backend: Any | None = None) -> list[UsbDeviceInfo]:
    """Return all devices with a still-image interface; `DeviceNotFoundError` where no USB library loads."""
    found = usb.core.find(find_all=True, backend=_require_backend(backend))
    return [
        UsbDeviceInfo(d.idVendor, d.idProduct, d.bus or 0, d.address or 0, _text(d, d.iProduct))
        for d in found
        if any(_is_still_image(i) for i in _interfaces(d))
    ]


def _require_backend(backend: Any | None) -> Any:
    backend = backend or real_backend()
    if backend is None:
        text = "no USB library can be loaded"
        raise errors.DeviceNotFoundError(text, likely="libusb is not installed", advice="pip install libusb-package")
    return backend


def _interfaces(device: Any) -> Iterator[Any]:
    """Yield the interfaces of all configurations; none for a device that does not let itself be read."""
    with suppress(usb.core.USBError, NotImplementedError):
        for configuration in device:
            yield from configuration


def _is_still_image(interface: Any) -> bool:
    return (interface.bInterfaceClass, interface.bInterfaceSubClass, interface.bInterfaceProtocol) == STILL_IMAGE_CLASS


def _text(device: Any, index: int) -> str:
    with suppress(usb.core.USBError, ValueError, NotImplementedError):
        return str(usb.util.get_string(device, index) or "").rstrip("\0") if index else ""
    return ""


def _ours(error: Exception, where: str, doing: str) -> errors.DeviceError:
    """Return our error for what pyusb raised while ``doing``."""
    number = errno.ETIMEDOUT if isinstance(error, usb.core.USBTimeoutError) else getattr(error, "errno", None)
    return typed_error(number, f"{doing}: {getattr(error, 'strerror', None) or error}", where)


class UsbLink:
    """A `drivers.ptp.pipes.PtpTransport` over pyusb. Use `open`."""

    def __init__(self, ids: tuple[int, int], serial: str | None, backend: Any, clock: Clock) -> None:
        self.name = f"camera {ids[0]:04x}:{ids[1]:04x}"
        self.max_packet_bytes = 512
        self._ids = ids
        self._serial = serial
        self._backend = backend
        self._clock = clock
        self._device: Any | None = None
        self._endpoints: _Endpoints | None = None

    @classmethod
    def open(
        cls, vendor_id: int, product_id: int, *, serial: str | None = None, backend: Any | None = None, clock: Clock
    ) -> Self:
        """Open the camera with these ids, and this USB serial number where several are plugged in.

        Raises `DeviceNotFoundError`: no such camera, or several and no ``serial``; or no USB library;
        `DeviceClaimedError`: another program holds it; named in the message and in ``details['holder']`` where the
        system says; `DevicePermissionError, DeviceLostError`: the system refuses access; the camera vanished
        meanwhile; `UnsupportedError`: it has no still-image interface: another USB mode.
        """
        link = cls((vendor_id, product_id), serial, _require_backend(backend), clock)
        link.reopen()
        return link

    def reopen(self) -> None:
        """Find and open the same camera anew; one attempt; errors as of `open`."""
        self.close()
        device = self._guard("finding the camera", self._find)
        try:
            endpoints = self._guard("reading descriptors", self._read_endpoints, device)
            self._claim(device, endpoints.interface)
        except BaseException:
            _dispose(device)
            raise
        self._device, self._endpoints = device, endpoints
        self.max_packet_bytes = endpoints.max_packet_bytes

    def _guard(self, doing: str, call: Callable[..., T], *args: Any) -> T:
        """Return what ``call(*args)`` returns, with pyusb's errors made ours."""
        try:
            return call(*args)
        except (usb.core.USBError, NotImplementedError) as error:
            raise _ours(error, self.name, doing) from error

    def _find(self) -> Any:
        vendor_id, product_id = self._ids
        found = list(usb.core.find(find_all=True, backend=self._backend, idVendor=vendor_id, idProduct=product_id))
        if self._serial is not None:
            serials = [_text(device, device.iSerialNumber) for device in found]
            if found and not any(serials):
                text = "its serial number cannot be read"
                likely = "no udev rule grants you access, or it has no serial number on USB"
                advice = "install drivers/udev/70-daylit.rules, or leave the serial number out of the rig file"
                raise errors.DevicePermissionError(text, where=self.name, likely=likely, advice=advice)
            found = [device for device, serial in zip(found, serials, strict=True) if serial == self._serial]
        if len(found) == 1:
            return found[0]
        if found:
            text = f"{len(found)} such cameras are plugged in"
            advice = "name one of them by its serial number in the rig file"
            raise errors.DeviceNotFoundError(text, where=self.name, advice=advice)
        text = "not found on USB" + (f" with serial number {self._serial}" if self._serial else "")
        likely = "it is switched off, asleep, not plugged in, or in another USB mode (live streaming)"
        advice = "switch it on and check the cable; daylit doctor lists what is on USB"
        raise errors.DeviceNotFoundError(text, where=self.name, likely=likely, advice=advice)

    def _read_endpoints(self, device: Any) -> _Endpoints:
        try:
            configuration = device.get_active_configuration()
        except usb.core.USBError as error:
            if error.errno is not None:
                raise
            # pyusb's way to say that the device has no configuration yet.
            device.set_configuration()
            configuration = device.get_active_configuration()
        for interface in configuration:
            if _is_still_image(interface) and interface.bAlternateSetting == 0:
                return self._sort_endpoints(interface)
        likely = "the camera is in another USB mode (live streaming, mass storage)"
        advice = "set its USB mode to MTP/PTP"
        raise errors.UnsupportedError("no still-image interface", where=self.name, likely=likely, advice=advice)

    def _sort_endpoints(self, interface: Any) -> _Endpoints:
        found: dict[tuple[int, int], Any] = {}
        for endpoint in interface:
            kind = usb.util.endpoint_type(endpoint.bmAttributes)
            found.setdefault((kind, usb.util.endpoint_direction(endpoint.bEndpointAddress)), endpoint)
        try:
            bulk_in = found[usb.util.ENDPOINT_TYPE_BULK, usb.util.ENDPOINT_IN]
            bulk_out = found[usb.util.ENDPOINT_TYPE_BULK, usb.util.ENDPOINT_OUT]
            event = found[usb.util.ENDPOINT_TYPE_INTR, usb.util.ENDPOINT_IN]
        except KeyError:
            raise errors.UnsupportedError("its still-image interface lacks an endpoint", where=self.name) from None
        return _Endpoints(
            interface.bInterfaceNumber,
            bulk_in.bEndpointAddress,
            bulk_out.bEndpointAddress,
            event.bEndpointAddress,
            (bulk_in.wMaxPacketSize & PACKET_MASK) or 512,
            (event.wMaxPacketSize & PACKET_MASK) or 8,
        )

    def _claim(self, device: Any, interface: int) -> None:
        # Not on this system, or not ours to detach: claiming shows.
        with suppress(usb.core.USBError, NotImplementedError):
            if device.is_kernel_driver_active(interface):
                device.detach_kernel_driver(interface)
        try:
            usb.util.claim_interface(device, interface)
        except usb.core.USBError as error:
            if error.errno != errno.EBUSY:
                raise _ours(error, self.name, "claiming the camera") from error
            holder = find_holder(f"/dev/bus/usb/{device.bus or 0:03d}/{device.address or 0:03d}", suspects=SUSPECTS)
            likely = "the desktop has opened the camera by itself"
            advice = "unmount the camera in the file manager, end that program, or install the udev rule"
            raise errors.DeviceClaimedError(
                f"held by {holder or 'another program'}", where=self.name, likely=likely, advice=advice, holder=holder
            ) from error

    def _require_open(self) -> tuple[Any, _Endpoints]:
        if self._device is None or self._endpoints is None:
            raise errors.DeviceLostError("the link is closed", where=self.name, advice="open it again")
        return self._device, self._endpoints

    def write(self, data: bytes, timeout_s: float) -> None:
        """Send all of ``data`` on bulk-out within ``timeout_s``; ``b""`` sends a zero-length packet."""
        device, endpoints = self._require_open()
        deadline = Deadline.after(self._clock, timeout_s)
        rest = memoryview(data)
        while True:
            limit_ms = _milliseconds(deadline.remaining_s)
            sent = self._guard("sending", device.write, endpoints.bulk_out, bytes(rest), limit_ms)
            rest = rest[sent:]
            if not rest:
                return
            # libusb reports a time-out with a part sent by the count alone.
            if not sent or deadline.expired:
                raise errors.DeviceTimeoutError(f"sending: {len(rest)} bytes were not taken", where=self.name)

    def read(self, max_bytes: int, timeout_s: float) -> bytes:
        """Return one bulk-in transfer of at most ``max_bytes``, a multiple of `max_packet_bytes`."""
        device, endpoints = self._require_open()
        return bytes(self._guard("receiving", device.read, endpoints.bulk_in, max_bytes, _milliseconds(timeout_s)))

    def read_event(self, timeout_s: float) -> bytes | None:
        """Return one interrupt packet, or None where none came within ``timeout_s``."""
        device, endpoints = self._require_open()
        limit_ms = _milliseconds(timeout_s)
        with suppress(errors.DeviceTimeoutError):
            # One packet a read: a longer read would wait for more after an event that fills its last packet.
            size = endpoints.event_packet_bytes
            return bytes(self._guard("waiting for an event", device.read, endpoints.event, size, limit_ms))
        return None

    def control_out(self, request: int, data: bytes, timeout_s: float) -> None:
        """Send a class request to the interface."""
        self._control(CLASS_OUT, request, data, timeout_s)

    def control_in(self, request: int, length: int, timeout_s: float) -> bytes:
        """Return up to ``length`` bytes of a class request to the interface."""
        return bytes(self._control(CLASS_IN, request, length, timeout_s))

    def _control(self, way: int, request: int, data: bytes | int, timeout_s: float) -> Any:
        device, endpoints = self._require_open()
        setup = (way, request, 0, endpoints.interface, data, _milliseconds(timeout_s))
        return self._guard(f"class request {request:02X}", device.ctrl_transfer, *setup)

    def clear_halt(self, pipe: Pipe) -> None:
        """Clear the halt of one endpoint; the kernel bounds the wait (5 s on Linux)."""
        device, endpoints = self._require_open()
        address = {"in": endpoints.bulk_in, "out": endpoints.bulk_out, "event": endpoints.event}[pipe]
        self._guard(f"clearing endpoint {address:02X}", device.clear_halt, address)

    def reset(self) -> None:
        """Reset the port; the link is closed afterwards. The kernel bounds the wait."""
        device, _ = self._require_open()
        self._device = None
        try:
            self._guard("resetting the port", device.reset)
        finally:
            _dispose(device)

    def close(self) -> None:
        """Release the camera; never raises."""
        device, self._device = self._device, None
        if device is not None:
            _dispose(device)


def _dispose(device: Any) -> None:
    with suppress(usb.core.USBError, NotImplementedError):  # it is gone; there is nothing to release
        usb.util.dispose_resources(device)


def _milliseconds(timeout_s: float) -> int:
    """Return a limit as libusb wants it: whole milliseconds, never 0, which would mean for ever."""
    return max(1, math.ceil(timeout_s * 1000))

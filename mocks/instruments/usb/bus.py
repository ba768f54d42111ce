"""A pyusb backend whose devices are simulated cameras: the real pyusb runs on top of it; errno as libusb gives it."""

import errno
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from types import SimpleNamespace
from typing import Any

import usb.core
from usb.backend import IBackend

from drivers.clock import Clock
from drivers.ptp.codes import STILL_IMAGE_CLASS
from mocks.instruments.ptp.responder import PtpResponder
from mocks.instruments.usb.device import CLASS_TO_HOST, HOST_TO_CLASS, UsbPtpDevice
from mocks.instruments.usb.framing import BULK_PACKET_BYTES, LinkError

HIGH_SPEED = 3  # libusb's number of the speed
BULK, INTERRUPT = 2, 3
ENGLISH = b"\x04\x03\x09\x04"

Descriptor = SimpleNamespace  # a descriptor, its fields named as in the USB 2.0 specification, chapter 9.6
HEAD = "bLength bDescriptorType"


def _descriptor(names: str, *values: object, **beside: object) -> Descriptor:
    return Descriptor(**dict(zip(f"{HEAD} {names}".split(), values, strict=True)), **beside)


_OF_CONFIGURATION = "wTotalLength bNumInterfaces bConfigurationValue iConfiguration bmAttributes bMaxPower"
CONFIGURATION = _descriptor(_OF_CONFIGURATION, 9, 2, 9 + 9 + 3 * 7, 1, 1, 0, 0xC0, 1, extra_descriptors=())
"""The only configuration: one interface with three endpoints, self-powered."""
_OF_INTERFACE = (
    "bInterfaceNumber bAlternateSetting bNumEndpoints bInterfaceClass bInterfaceSubClass bInterfaceProtocol iInterface"
)
INTERFACE = _descriptor(_OF_INTERFACE, 9, 4, 0, 0, 3, *STILL_IMAGE_CLASS, 0, extra_descriptors=())
"""The still-image interface."""
_OF_DEVICE = (
    "bcdUSB bDeviceClass bDeviceSubClass bDeviceProtocol bMaxPacketSize0 idVendor idProduct bcdDevice iManufacturer "
    "iProduct iSerialNumber bNumConfigurations"
)
_OF_ENDPOINT = "bEndpointAddress bmAttributes wMaxPacketSize bInterval bRefresh bSynchAddress"


def device_descriptor(usb_id: tuple[int, int], serial_index: int, address: int, port_number: int) -> Descriptor:
    """Return the device descriptor (table 9-8) with the device's place on the bus."""
    place = {"address": address, "bus": 1, "speed": HIGH_SPEED, "port_number": port_number}
    values = (18, 1, 0x0200, 0, 0, 0, 64, *usb_id, 0x0100, 1, 2, serial_index, 1)
    return _descriptor(_OF_DEVICE, *values, **place, port_numbers=(port_number,))


def endpoint_descriptors(addresses: tuple[int, int, int], event_packet_bytes: int) -> tuple[Descriptor, ...]:
    """Return bulk IN, bulk OUT and interrupt IN."""
    bulk, interrupt = (BULK, BULK_PACKET_BYTES, 0), (INTERRUPT, event_packet_bytes, 9)
    return tuple(
        _descriptor(_OF_ENDPOINT, 7, 5, address, kind, packet_bytes, interval, 0, 0, extra_descriptors=())
        for address, (kind, packet_bytes, interval) in zip(addresses, (bulk, bulk, interrupt), strict=True)
    )


def string_descriptor(texts: tuple[str, ...], index: int) -> bytes:
    """Return string descriptor ``index``; 0 lists the languages."""
    if index == 0:
        return ENGLISH
    if index > len(texts):
        raise LinkError(errno.EPIPE, "Pipe error")
    text = texts[index - 1].encode("utf-16-le")
    return bytes([2 + len(text), STRING_DESCRIPTOR]) + text


DEVICE_TO_HOST = 0x80  # USB 2.0, table 9-2
GET_DESCRIPTOR = 0x06  # USB 2.0, table 9-4
STRING_DESCRIPTOR = 0x03  # USB 2.0, table 9-5


@dataclass(eq=False)
class UsbPort:
    """A camera on the bus; set the flags to let another program hold it or the system forbid it."""

    camera: PtpResponder
    device: UsbPtpDevice
    number: int
    claimed_elsewhere: bool = False
    forbidden: bool = False
    claimed_by: "Handle | None" = None

    @property
    def address(self) -> int:
        """Address on the bus; a new one after each replug."""
        return 1 + (self.number * 16 + self.camera.attachment) % 126

    @property
    def strings(self) -> tuple[str, ...]:
        """Text of the string descriptors, from index 1."""
        identity = self.camera.identity
        return (identity.manufacturer, identity.model, identity.serial)


@dataclass(eq=False)
class Handle:
    """An opened device; dead once the cable was pulled, even if it is back."""

    port: UsbPort
    attachment: int
    configuration: int = 1


@contextmanager
def _usb_errors() -> Iterator[None]:
    try:
        yield
    except LinkError as error:
        kind = usb.core.USBTimeoutError if error.errno == errno.ETIMEDOUT else usb.core.USBError
        raise kind(str(error), None, error.errno) from error


class SimulatedUsbBackend(IBackend):  # type: ignore[misc]
    """Pass it to ``usb.core.find(backend=...)``. Safe to use from several threads."""

    def __init__(self, cameras: Iterable[PtpResponder], clock: Clock) -> None:
        self.clock = clock
        self.ports = [UsbPort(c, UsbPtpDevice(c), n) for n, c in enumerate(cameras, 1)]

    def port(self, camera: PtpResponder) -> UsbPort:
        """Return the port of a camera."""
        return next(p for p in self.ports if p.camera is camera)

    # ---- enumeration

    def enumerate_devices(self) -> Iterator[UsbPort]:
        """Yield the ports whose camera is on."""
        for port in self.ports:
            port.camera.advance()
            if port.camera.plugged:
                yield port

    def get_parent(self, _dev: UsbPort) -> None:
        """Return nothing: the simulated bus has no hubs."""

    def get_device_descriptor(self, dev: UsbPort) -> Descriptor:
        """Return the device descriptor."""
        identity = dev.camera.identity
        return device_descriptor(identity.usb_id, 3 if identity.serial_on_usb else 0, dev.address, dev.number)

    def get_configuration_descriptor(self, _dev: UsbPort, config: int) -> Descriptor:
        """Return the only configuration."""
        if config:
            raise IndexError("no such configuration")
        return CONFIGURATION

    def get_interface_descriptor(self, _dev: UsbPort, intf: int, alt: int, config: int) -> Descriptor:
        """Return the still-image interface."""
        if intf or alt or config:
            raise IndexError("no such interface")
        return INTERFACE

    def get_endpoint_descriptor(self, dev: UsbPort, ep: int, intf: int, alt: int, config: int) -> Descriptor:
        """Return one of the three endpoints."""
        if intf or alt or config:
            raise IndexError("no such interface")
        identity = dev.camera.identity
        return endpoint_descriptors(identity.endpoints, identity.interrupt_packet_bytes)[ep]

    # ---- opening

    def open_device(self, dev: UsbPort) -> Handle:
        """Open a camera; errno 13 where forbidden, 19 where it is gone."""
        dev.device.catch_up()
        if not dev.camera.plugged:
            raise usb.core.USBError("No such device (it may have been disconnected)", None, errno.ENODEV)
        if dev.forbidden:
            raise usb.core.USBError("Access denied (insufficient permissions)", None, errno.EACCES)
        return Handle(dev, dev.camera.attachment)

    def close_device(self, dev_handle: Handle) -> None:
        """Close a handle and give up its claim."""
        if dev_handle.port.claimed_by is dev_handle:
            dev_handle.port.claimed_by = None

    def set_configuration(self, dev_handle: Handle, config_value: int) -> None:
        """Select configuration 1; errno 16 while another program holds the interface."""
        port = self._live(dev_handle)
        if port.claimed_elsewhere:
            raise usb.core.USBError("Resource busy", None, errno.EBUSY)
        if config_value != 1:
            raise usb.core.USBError("Entity not found", None, errno.ENOENT)

    def get_configuration(self, dev_handle: Handle) -> int:
        """Return 1: the camera comes configured, as the kernel leaves it."""
        self._live(dev_handle)
        return dev_handle.configuration

    def set_interface_altsetting(self, dev_handle: Handle, intf: int, altsetting: int) -> None:
        """Select alternate setting 0 of interface 0."""
        self._live(dev_handle)
        if intf or altsetting:
            raise usb.core.USBError("Entity not found", None, errno.ENOENT)

    def claim_interface(self, dev_handle: Handle, intf: int) -> None:
        """Claim interface 0; errno 16 while another program or another handle has it."""
        port = self._live(dev_handle)
        if intf:
            raise usb.core.USBError("Entity not found", None, errno.ENOENT)
        other = port.claimed_by not in (None, dev_handle) and port.claimed_by.attachment == port.camera.attachment
        if port.claimed_elsewhere or other:
            raise usb.core.USBError("Resource busy", None, errno.EBUSY)
        port.claimed_by = dev_handle

    def release_interface(self, dev_handle: Handle, _intf: int) -> None:
        """Give the interface up."""
        self.close_device(dev_handle)

    # ---- transfers

    def bulk_write(self, dev_handle: Handle, _ep: int, _intf: int, data: Any, timeout: int) -> int:
        """Send a bulk OUT transfer."""
        with _usb_errors():
            return self._live(dev_handle).device.write(data.tobytes(), timeout / 1000)

    def bulk_read(self, dev_handle: Handle, ep: int, _intf: int, buff: Any, timeout: int) -> int:
        """Fill ``buff`` from an IN endpoint and return the count."""
        with _usb_errors():
            got = self._live(dev_handle).device.read(ep, len(buff) * buff.itemsize, timeout / 1000)
        memoryview(buff).cast("B")[: len(got)] = got
        return len(got)

    intr_read = bulk_read

    def ctrl_transfer(
        self,
        dev_handle: Handle,
        bmRequestType: int,  # noqa: N803 - pyusb's names
        bRequest: int,  # noqa: N803
        wValue: int,  # noqa: N803
        wIndex: int,  # noqa: N803
        data: Any,
        timeout: int,
    ) -> int:
        """Carry out class requests and string descriptors; anything else stalls."""
        with _usb_errors():
            port = self._live(dev_handle)
            if bmRequestType == HOST_TO_CLASS and (wValue, wIndex) == (0, 0):
                return port.device.control_out(bRequest, data.tobytes())
            if bmRequestType == CLASS_TO_HOST and (wValue, wIndex) == (0, 0):
                answer = port.device.control_in(bRequest)
            elif (bmRequestType, bRequest, wValue >> 8) == (DEVICE_TO_HOST, GET_DESCRIPTOR, STRING_DESCRIPTOR):
                answer = string_descriptor(port.strings, wValue & 0xFF)
            else:
                raise LinkError(errno.EPIPE, "Pipe error")
        view = memoryview(data).cast("B")
        count = min(len(answer), len(view))
        view[:count] = answer[:count]
        return count

    def clear_halt(self, dev_handle: Handle, ep: int) -> None:
        """Take the halt off an endpoint."""
        with _usb_errors():
            self._live(dev_handle).device.clear_halt(ep)

    def reset_device(self, dev_handle: Handle) -> None:
        """Reset the port; the handle stays good."""
        with _usb_errors():
            self._live(dev_handle).device.reset()

    def is_kernel_driver_active(self, _dev_handle: Handle, _intf: int) -> bool:
        """Return False: no kernel driver takes still-image interfaces."""
        return False

    def detach_kernel_driver(self, _dev_handle: Handle, _intf: int) -> None:
        """Refuse: there is none."""
        raise usb.core.USBError("Entity not found", None, errno.ENOENT)

    attach_kernel_driver = detach_kernel_driver

    @staticmethod
    def _live(handle: Handle) -> UsbPort:
        port = handle.port
        port.device.catch_up()
        if handle.attachment != port.camera.attachment or not port.camera.plugged:
            raise usb.core.USBError("No such device (it may have been disconnected)", None, errno.ENODEV)
        return port

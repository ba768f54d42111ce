"""A pyusb backend whose devices are simulated cameras: the real pyusb runs on top of it; errno as libusb gives it."""

from __future__ import annotations

import errno
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
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


@dataclass(frozen=True)
class DeviceDescriptor:
    """Device descriptor (USB 2.0, table 9-8) and the device's place on the bus."""

    idVendor: int  # noqa: N815 - names of the USB specification
    idProduct: int  # noqa: N815
    iSerialNumber: int  # noqa: N815
    address: int
    port_number: int
    bus: int = 1
    speed: int = HIGH_SPEED
    bLength: int = 18  # noqa: N815
    bDescriptorType: int = 1  # noqa: N815
    bcdUSB: int = 0x0200  # noqa: N815
    bDeviceClass: int = 0  # noqa: N815
    bDeviceSubClass: int = 0  # noqa: N815
    bDeviceProtocol: int = 0  # noqa: N815
    bMaxPacketSize0: int = 64  # noqa: N815
    bcdDevice: int = 0x0100  # noqa: N815
    iManufacturer: int = 1  # noqa: N815
    iProduct: int = 2  # noqa: N815
    bNumConfigurations: int = 1  # noqa: N815

    @property
    def port_numbers(self) -> tuple[int, ...]:
        """Ports from the root to the device."""
        return (self.port_number,)


@dataclass(frozen=True)
class ConfigurationDescriptor:
    """The only configuration: one interface with three endpoints, self-powered."""

    bLength: int = 9  # noqa: N815
    bDescriptorType: int = 2  # noqa: N815
    wTotalLength: int = 9 + 9 + 3 * 7  # noqa: N815
    bNumInterfaces: int = 1  # noqa: N815
    bConfigurationValue: int = 1  # noqa: N815
    iConfiguration: int = 0  # noqa: N815
    bmAttributes: int = 0xC0  # noqa: N815
    bMaxPower: int = 1  # noqa: N815
    extra_descriptors: tuple[int, ...] = ()


@dataclass(frozen=True)
class InterfaceDescriptor:
    """The still-image interface."""

    bLength: int = 9  # noqa: N815
    bDescriptorType: int = 4  # noqa: N815
    bInterfaceNumber: int = 0  # noqa: N815
    bAlternateSetting: int = 0  # noqa: N815
    bNumEndpoints: int = 3  # noqa: N815
    bInterfaceClass: int = STILL_IMAGE_CLASS[0]  # noqa: N815
    bInterfaceSubClass: int = STILL_IMAGE_CLASS[1]  # noqa: N815
    bInterfaceProtocol: int = STILL_IMAGE_CLASS[2]  # noqa: N815
    iInterface: int = 0  # noqa: N815
    extra_descriptors: tuple[int, ...] = ()


@dataclass(frozen=True)
class EndpointDescriptor:
    """An endpoint."""

    bEndpointAddress: int  # noqa: N815
    bmAttributes: int  # noqa: N815
    wMaxPacketSize: int  # noqa: N815
    bInterval: int = 0  # noqa: N815
    bLength: int = 7  # noqa: N815
    bDescriptorType: int = 5  # noqa: N815
    bRefresh: int = 0  # noqa: N815
    bSynchAddress: int = 0  # noqa: N815
    extra_descriptors: tuple[int, ...] = ()


def endpoint_descriptors(addresses: tuple[int, int, int], event_packet_bytes: int) -> tuple[EndpointDescriptor, ...]:
    """Return bulk IN, bulk OUT and interrupt IN."""
    bulk_in, bulk_out, interrupt = addresses
    return (
        EndpointDescriptor(bulk_in, BULK, BULK_PACKET_BYTES),
        EndpointDescriptor(bulk_out, BULK, BULK_PACKET_BYTES),
        EndpointDescriptor(interrupt, INTERRUPT, event_packet_bytes, bInterval=9),
    )


def string_descriptor(texts: tuple[str, ...], index: int) -> bytes:
    """Return string descriptor ``index``; 0 lists the languages."""
    if index == 0:
        return ENGLISH
    if index > len(texts):
        raise LinkError(errno.EPIPE, "Pipe error")
    text = texts[index - 1].encode("utf-16-le")
    return bytes([2 + len(text), STRING_DESCRIPTOR_TYPE]) + text


STRING_DESCRIPTOR_TYPE = 3  # USB 2.0, table 9-5

DEVICE_TO_HOST = 0x80  # USB 2.0, table 9-2
GET_DESCRIPTOR = 0x06  # USB 2.0, table 9-4
STRING_DESCRIPTOR = 0x03


@dataclass(eq=False)
class UsbPort:
    """A camera on the bus; set the flags to let another program hold it or the system forbid it."""

    camera: PtpResponder
    device: UsbPtpDevice
    number: int
    claimed_elsewhere: bool = False
    forbidden: bool = False
    claimed_by: Handle | None = None

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

    def get_device_descriptor(self, dev: UsbPort) -> DeviceDescriptor:
        """Return the device descriptor."""
        vendor, product = dev.camera.identity.usb_id
        serial_index = 3 if dev.camera.identity.serial_on_usb else 0
        return DeviceDescriptor(vendor, product, serial_index, dev.address, dev.number)

    def get_configuration_descriptor(self, _dev: UsbPort, config: int) -> ConfigurationDescriptor:
        """Return the only configuration."""
        if config:
            raise IndexError("no such configuration")
        return ConfigurationDescriptor()

    def get_interface_descriptor(self, _dev: UsbPort, intf: int, alt: int, config: int) -> InterfaceDescriptor:
        """Return the still-image interface."""
        if intf or alt or config:
            raise IndexError("no such interface")
        return InterfaceDescriptor()

    def get_endpoint_descriptor(self, dev: UsbPort, ep: int, intf: int, alt: int, config: int) -> EndpointDescriptor:
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
        with _usb_errors():
            port = self._live(dev_handle)
        if port.claimed_elsewhere:
            raise usb.core.USBError("Resource busy", None, errno.EBUSY)
        if config_value != 1:
            raise usb.core.USBError("Entity not found", None, errno.ENOENT)

    def get_configuration(self, dev_handle: Handle) -> int:
        """Return 1: the camera comes configured, as the kernel leaves it."""
        with _usb_errors():
            self._live(dev_handle)
        return dev_handle.configuration

    def set_interface_altsetting(self, dev_handle: Handle, intf: int, altsetting: int) -> None:
        """Select alternate setting 0 of interface 0."""
        with _usb_errors():
            self._live(dev_handle)
        if intf or altsetting:
            raise usb.core.USBError("Entity not found", None, errno.ENOENT)

    def claim_interface(self, dev_handle: Handle, intf: int) -> None:
        """Claim interface 0; errno 16 while another program or another handle has it."""
        with _usb_errors():
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

    def intr_read(self, dev_handle: Handle, ep: int, _intf: int, buff: Any, timeout: int) -> int:
        """Fill ``buff`` from the interrupt endpoint and return the count."""
        return self.bulk_read(dev_handle, ep, _intf, buff, timeout)

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
            raise LinkError(errno.ENODEV, "No such device (it may have been disconnected)")
        return port

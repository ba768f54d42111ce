"""USB descriptors of a still-image camera, as pyusb reads them from a backend."""

from __future__ import annotations

import errno
from dataclasses import dataclass

from drivers.ptp.codes import STILL_IMAGE_CLASS
from mocks.instruments.usb.framing import BULK_PACKET_BYTES, LinkError

HIGH_SPEED = 3
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


STRING_DESCRIPTOR_TYPE = 3

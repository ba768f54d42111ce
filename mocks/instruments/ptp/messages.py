"""What passes between a simulated camera and whatever carries its bytes: requests, answers, events, the log."""

from __future__ import annotations

import struct
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from typing import Self

from drivers.ptp.codes import Response
from mocks.instruments.faults import Fault
from mocks.instruments.ptp import ptp_wire


@dataclass(frozen=True)
class DeviceIdentity:
    """Who the camera is, on the bus and in DeviceInfo."""

    usb_id: tuple[int, int]
    endpoints: tuple[int, int, int]
    interrupt_packet_bytes: int
    vendor_extension: tuple[int, int]
    operations: tuple[int, ...]
    events: tuple[int, ...]
    properties: tuple[int, ...]
    capture_formats: tuple[int, ...]
    image_formats: tuple[int, ...]
    manufacturer: str
    model: str
    version: str
    serial: str
    serial_on_usb: bool = True

    def device_info(self) -> bytes:
        """Return the DeviceInfo dataset."""
        extension_id, extension_version = self.vendor_extension
        head = struct.pack("<HIH", 100, extension_id, extension_version) + ptp_wire.string("") + struct.pack("<H", 0)
        lists = (self.operations, self.events, self.properties, self.capture_formats, self.image_formats)
        texts = (self.manufacturer, self.model, self.version, self.serial)
        return head + b"".join(map(ptp_wire.codes, lists)) + b"".join(map(ptp_wire.string, texts))


@dataclass(frozen=True)
class Request:
    """A command with its data, if the host sent any."""

    operation: int
    transaction_id: int
    params: tuple[int, ...] = ()
    data: bytes = b""

    def param(self, index: int, default: int = 0) -> int:
        """Return a parameter, or ``default`` where the host left it out."""
        return self.params[index] if index < len(self.params) else default


@dataclass(frozen=True)
class Answer:
    """Response code and parameters, data to send before it, and the time the camera thinks first."""

    code: int = Response.OK
    params: tuple[int, ...] = ()
    data: bytes | None = None
    delay_s: float = 0.0


class Refusal(Exception):
    """Raised by an operation to answer with a code other than OK."""

    def __init__(self, code: int, *params: int) -> None:
        super().__init__(f"{code:04x}")
        self.code = code
        self.params = params


@dataclass(frozen=True)
class Rule:
    """How an operation is called: its parameters, whether the host sends data, whether it needs a session."""

    handler: Callable[[Request], Answer]
    least_params: int = 0
    most_params: int = 0
    data_out: bool = False
    sessionless: bool = False


@dataclass(frozen=True)
class PendingEvent:
    """An event waiting for the interrupt pipe; ``fault`` breaks the link while it is read."""

    code: int
    transaction_id: int
    params: tuple[int, ...]
    fault: Fault | None = None

    def encode(self) -> bytes:
        """Return the event container."""
        return ptp_wire.event(self.code, self.transaction_id, self.params)

    def elsewhere(self, offset: int) -> Self:
        """Return the event for another object or property."""
        return replace(self, params=(self.params[0] + offset, *self.params[1:])) if self.params else self

    def breaking(self, fault: Fault) -> Self:
        """Return the event with a fault of the link in it."""
        return replace(self, fault=fault)


@dataclass(frozen=True)
class OperationRecord:
    """One line of the operation log."""

    at_s: float
    operation: int
    transaction_id: int
    params: tuple[int, ...]
    code: int
    out_bytes: int
    in_bytes: int


@dataclass
class ResponderStats:
    """What the camera has seen, for tests."""

    operations: list[OperationRecord] = field(default_factory=list)
    violations: list[str] = field(default_factory=list)
    """Breaches of the protocol by the host, in words."""

    def count(self, operation: int, code: int | None = None) -> int:
        """Return how often an operation came (and was answered with ``code``)."""
        return sum(1 for r in self.operations if r.operation == operation and code in (None, r.code))

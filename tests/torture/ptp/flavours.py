"""The cameras of the PTP sittings, the pictures they make, and a clock that ends what never ends."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Literal

from drivers.canon_5d2 import codes as canon_codes
from drivers.canon_5d2.camera import Canon5D2
from drivers.theta_z1 import codes as ricoh_codes
from drivers.theta_z1.camera import ThetaZ1
from drivers.usb_link import UsbLink
from mocks.instruments.canon_5d2 import CanonOptions, SimulatedCanon5D2
from mocks.instruments.exposures import ShotRequest
from mocks.instruments.faults import FaultSchedule
from mocks.instruments.theta_z1 import SimulatedThetaZ1, ThetaOptions
from mocks.instruments.usb.bus import SimulatedUsbBackend
from tests.virtual_clock import VirtualClock

MAX_CLOCK_READS = 400_000
"""A fault-free sitting reads the clock some thousands of times; a loop that never ends is stopped here."""


class EndlessError(BaseException):
    """The sitting went on and on; not an `Exception`, so that nothing under test can swallow it."""


class CountedClock(VirtualClock):
    """A virtual clock that ends a loop that never sleeps."""

    def __init__(self) -> None:
        super().__init__()
        self.reads = 0

    def monotonic_s(self) -> float:
        self.reads += 1
        if self.reads > MAX_CLOCK_READS:
            raise EndlessError(f"{self.reads} looks at the clock")
        return super().monotonic_s()


class RecordedShots:
    """Pictures of a few hundred bytes, each different, kept by the sequence number of their exposure."""

    SIZES = (1400, 2036, 700)
    """Of odd sizes; 2036 bytes and a header are whole packets."""

    def __init__(self) -> None:
        self.made: dict[bytes, ShotRequest] = {}

    def jpeg(self, request: ShotRequest) -> bytes:
        label = f"{request.sequence} {request.shutter_s:.9f} {request.iso} {request.f_number} "
        size = self.SIZES[request.sequence % 3]
        data = (label.encode() * (size // len(label) + 1))[:size]
        self.made[data] = request
        return data

    def raw(self, request: ShotRequest) -> bytes:
        return self.jpeg(request)


@dataclass(frozen=True)
class Flavour:
    """A camera and how it is used."""

    name: str
    kind: Literal["theta_z1", "canon_5d2"]
    f_number_index: bool = False
    later_firmware: bool = False
    destination: Literal["card", "pc"] = "card"
    delete_after: bool = False

    def device(self, shots: RecordedShots, clock: VirtualClock, faults: FaultSchedule, seed: int) -> Any:
        if self.kind == "theta_z1":
            theta = ThetaOptions(f_number_index=self.f_number_index, later_firmware=self.later_firmware)
            return SimulatedThetaZ1(shots, clock, options=theta, faults=faults, seed=seed)
        return SimulatedCanon5D2(shots, clock, options=CanonOptions(), faults=faults, seed=seed)

    def driver(self, backend: SimulatedUsbBackend, clock: VirtualClock) -> ThetaZ1 | Canon5D2:
        ids = ricoh_codes.USB_ID if self.kind == "theta_z1" else canon_codes.USB_ID

        def open_transport() -> UsbLink:
            return UsbLink.open(*ids, backend=backend, clock=clock)

        if self.kind == "theta_z1":
            return ThetaZ1(open_transport, clock)
        return Canon5D2(open_transport, clock, destination=self.destination)


FLAVOURS = (
    Flavour("Theta, F x 100", "theta_z1"),
    Flavour("Theta, F index", "theta_z1", f_number_index=True, later_firmware=True, delete_after=True),
    Flavour("Canon, card", "canon_5d2", delete_after=True),
    Flavour("Canon, computer", "canon_5d2", destination="pc"),
)

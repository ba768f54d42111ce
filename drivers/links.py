"""What a PTP session needs from a link: bytes in, bytes out, every call with a limit.

The real one is `drivers.usb_link.UsbLink`. Links raise errors of `drivers.errors` only: `DeviceTimeoutError`,
`LinkStallError`, `DeviceLostError`; on opening `DeviceClaimedError`, `DevicePermissionError`, `DeviceNotFoundError`.
"""

from __future__ import annotations

from typing import Literal, Protocol

Pipe = Literal["in", "out", "event"]


class PtpTransport(Protocol):
    """Three endpoints and a control pipe of the USB still-image class.

    Attributes
    ----------
    name
        What to call the instrument in messages.
    max_packet_bytes
        Packet size of the bulk pipes; a transfer that is no multiple of it ends a data phase.
    """

    name: str
    max_packet_bytes: int

    def write(self, data: bytes, timeout_s: float) -> None:
        """Send all of ``data`` on bulk-out; ``b""`` sends a zero-length packet."""
        ...

    def read(self, max_bytes: int, timeout_s: float) -> bytes:
        """Return one bulk-in transfer of at most ``max_bytes`` (a multiple of the packet size); ``b""`` is a ZLP."""
        ...

    def read_event(self, timeout_s: float) -> bytes | None:
        """Return one interrupt transfer, or None where none came within ``timeout_s``."""
        ...

    def control_out(self, request: int, data: bytes, timeout_s: float) -> None:
        """Send a class request to the interface."""
        ...

    def control_in(self, request: int, length: int, timeout_s: float) -> bytes:
        """Return up to ``length`` bytes of a class request to the interface."""
        ...

    def clear_halt(self, pipe: Pipe) -> None:
        """Clear the halt of one endpoint, and its data toggle with it."""
        ...

    def reset(self) -> None:
        """Reset the USB port of the instrument; the link must be reopened afterwards."""
        ...

    def reopen(self) -> None:
        """Find and open the same instrument anew; one attempt."""
        ...

    def close(self) -> None:
        """Release the instrument; never raises."""
        ...
